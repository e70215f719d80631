"""Crank drives: they give the crank's angle, rate and acceleration at any time, independently of the flight.

A drive is any function of time: `drive(time) -> (angle, rate, acceleration)`, arrays in, arrays out. The linkage fixes
the joint angles at each crank angle, so the drive alone decides how the joints move, however large the forces on the
wings are.
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
