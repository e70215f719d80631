"""Sigma_Aero: the unsteady lifting line on any planform, and the robot's aerodynamics: strips, added mass, wind."""

from aerobat_pin.aerodynamics.added_mass import add_mass
from aerobat_pin.aerodynamics.flapping_wing import Halves, LineFlight, Stroke, fly
from aerobat_pin.aerodynamics.lifting_line import LiftingLine, StateSpace
from aerobat_pin.aerodynamics.links import place_links
from aerobat_pin.aerodynamics.memory import LINK_COUNT, RobotMemory, air_in, fill, robot_in
from aerobat_pin.aerodynamics.robot_air import RobotAir, air_loads, air_memory
from aerobat_pin.aerodynamics.robot_in_air import RobotInAir
from aerobat_pin.aerodynamics.strip_forces import STRIP_ROWS, Pieces, StripLoads, strips_of
from aerobat_pin.aerodynamics.wind import LARGEST_AIRSPEED, Gust, Wind

__all__ = [
    "LARGEST_AIRSPEED",
    "LINK_COUNT",
    "STRIP_ROWS",
    "Gust",
    "Halves",
    "LiftingLine",
    "LineFlight",
    "Pieces",
    "RobotAir",
    "RobotInAir",
    "RobotMemory",
    "StateSpace",
    "StripLoads",
    "Stroke",
    "Wind",
    "add_mass",
    "air_in",
    "air_loads",
    "air_memory",
    "fill",
    "fly",
    "place_links",
    "robot_in",
    "strips_of",
]
