"""Air on a bare wing that glides."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from aerobat_description.morphology import Morphology
from aerobat_pin.aerodynamics import RobotAir
from aerobat_pin.robot.wing import Wing

SHAPE = Morphology.load("aerobat")
WING = Wing(SHAPE)
AIR = RobotAir(WING)
NO_DRAG = replace(SHAPE.aerodynamics, profile_drag=0.0, body_drag_area=0.0)
BARE = RobotAir(Wing(replace(SHAPE, tail=None, aerodynamics=NO_DRAG)), air_density=1.0)


def gliding(speed: float, incidence: float) -> np.ndarray:
    """Return the twists of a spread wing that glides straight at an incidence [rad] of the body."""
    twist = np.array([speed * np.cos(incidence), 0.0, -speed * np.sin(incidence), 0.0, 0.0, 0.0])
    return np.tile(twist, (5, 1))


def settled(air: RobotAir, twists: np.ndarray) -> np.ndarray:
    """Return the aerodynamic state that no longer changes under steady twists: the rates are affine in the state."""
    size = air.state_size
    offset = air.evaluate(twists, np.zeros(size))[1]
    matrix = np.column_stack([air.evaluate(twists, unit)[1] - offset for unit in np.eye(size)])
    return -np.linalg.solve(matrix, offset)
