"""Recordings of any robot: read by a map, checked, brought to common times, and their unknown forces estimated."""

from aerobat_pin.estimation.recordings.channels import LogChannel
from aerobat_pin.estimation.recordings.estimate_recording import RecordingEstimate, estimate_recording
from aerobat_pin.estimation.recordings.map_calibration import MapCalibration, calibrate_recording
from aerobat_pin.estimation.recordings.map_calibration_file import map_calibration_bytes, read_map_calibration
from aerobat_pin.estimation.recordings.map_file import describe_map, load_map, parse_map, with_options
from aerobat_pin.estimation.recordings.map_tables import Map
from aerobat_pin.estimation.recordings.online import OnlineEstimator, OnlineSample
from aerobat_pin.estimation.recordings.sensor_scores import Compared
from aerobat_pin.estimation.recordings.stored_estimate import StoredEstimate
from aerobat_pin.estimation.recordings.suggest import suggested_map
from aerobat_pin.estimation.recordings.write_mcap import write_flight_mcap, write_mcap

__all__ = [
    "Compared",
    "LogChannel",
    "Map",
    "MapCalibration",
    "OnlineEstimator",
    "OnlineSample",
    "RecordingEstimate",
    "StoredEstimate",
    "calibrate_recording",
    "describe_map",
    "estimate_recording",
    "load_map",
    "map_calibration_bytes",
    "parse_map",
    "read_map_calibration",
    "suggested_map",
    "with_options",
    "write_flight_mcap",
    "write_mcap",
]
