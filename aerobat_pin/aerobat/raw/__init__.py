"""Raw laboratory sensors: from samples of motion capture, inertial unit, crank encoder and torque to forces."""

from aerobat_pin.aerobat.raw.channels import RawRecord, SensorSamples, raw_record
from aerobat_pin.aerobat.raw.filter import JointFilter, JointSample
from aerobat_pin.aerobat.raw.find_mount import find_mount, mounted
from aerobat_pin.aerobat.raw.offsets import ClockOffset
from aerobat_pin.aerobat.raw.results import smoothed_raw
from aerobat_pin.aerobat.raw.smoother import JointEstimate, JointSmoother
from aerobat_pin.aerobat.raw.tuning import Tuning
from aerobat_pin.errors import old_names

__all__ = [
    "ClockOffset",
    "JointEstimate",
    "JointFilter",
    "JointSample",
    "JointSmoother",
    "RawRecord",
    "SensorSamples",
    "Tuning",
    "find_mount",
    "mounted",
    "raw_record",
    "smoothed_raw",
]

__getattr__ = old_names(__name__, {"RawChannel": "SensorSamples"})
