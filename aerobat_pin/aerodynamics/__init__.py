"""Sigma_Aero: the lifting line on any planform, and the air on the robot."""

from aerobat_pin.aerodynamics.lifting_line import LiftingLine, StateSpace
from aerobat_pin.aerodynamics.robot_air import RobotAir, StripLoads

__all__ = ["LiftingLine", "RobotAir", "StateSpace", "StripLoads"]
