"""What turns the crank: a drive, known before the flight, or a motor, which the flight acts back on.

A drive is any function of time: `drive(time) -> (angle, rate, acceleration)`, arrays in, arrays out. The linkage fixes
the joint angles at each crank angle, so the drive alone decides how the joints move, however large the forces on the
wings are. With a motor, the crank angle is one more degree of freedom of the robot.
"""

from aerobat_pin.flight.crank.drives import ConstantRate, CrankDrive, CrankMotion, SpinUp, checked_motion
from aerobat_pin.flight.crank.from_scenario import crank_drive
from aerobat_pin.flight.crank.motor import CRANK_SIZE, RateControlledMotor, add_crank, crank_rates

__all__ = [
    "CRANK_SIZE",
    "ConstantRate",
    "CrankDrive",
    "CrankMotion",
    "RateControlledMotor",
    "SpinUp",
    "add_crank",
    "checked_motion",
    "crank_drive",
    "crank_rates",
]
