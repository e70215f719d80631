"""How the crank turns: drives give its angle, rate and acceleration at any time, before the flight is flown.

A drive is any function of time: `drive(time) -> (angle, rate, acceleration)`, arrays in, arrays out. The joints follow
the closed linkage, so a drive decides their motion whatever pushes on the wings.
"""

from aerobat_pin.flight.crank.drives import ConstantRate, CrankDrive, CrankMotion, SpinUp, checked_motion
from aerobat_pin.flight.crank.from_scenario import crank_drive
from aerobat_pin.flight.crank.motor import RateControlledMotor
from aerobat_pin.flight.crank.wing_inertia import WingInertia

__all__ = [
    "ConstantRate",
    "CrankDrive",
    "CrankMotion",
    "RateControlledMotor",
    "SpinUp",
    "WingInertia",
    "checked_motion",
    "crank_drive",
]
