"""Sigma_Aero: the unsteady lifting line on any planform, and the air on the robot: strips, added mass, wind."""

from aerobat_pin.aerodynamics.added_mass import add_mass, factored
from aerobat_pin.aerodynamics.flapping_wing import Halves, LineFlight, Stroke, fly
from aerobat_pin.aerodynamics.lifting_line import LiftingLine, StateSpace
from aerobat_pin.aerodynamics.robot_air import RobotAir, StripLoads, air_loads, strips_of
from aerobat_pin.aerodynamics.strips import CIRCULATION, FORCE_X, FORCE_Z, LEAD, LOADS, AirArrays
from aerobat_pin.aerodynamics.wind import Gust, Wind

__all__ = [
    "CIRCULATION",
    "FORCE_X",
    "FORCE_Z",
    "LEAD",
    "LOADS",
    "AirArrays",
    "Gust",
    "Halves",
    "LiftingLine",
    "LineFlight",
    "RobotAir",
    "StateSpace",
    "StripLoads",
    "Stroke",
    "Wind",
    "add_mass",
    "air_loads",
    "factored",
    "fly",
    "strips_of",
]
