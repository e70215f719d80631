"""Air on a bare wing that glides."""

from dataclasses import replace

import numpy as np

from aerobat_description.morphology import Morphology
from aerobat_pin.aerobat import RobotAir, Wing
from aerobat_pin.aerodynamics import StripLoads
from support.section_law import loads_of, settled_state

SHAPE = Morphology.load("aerobat")
WING = Wing(SHAPE)
AIR = RobotAir(WING)
NO_DRAG = replace(SHAPE.aerodynamics, profile_drag=0.0, body_drag_area=0.0)
BARE = RobotAir(Wing(replace(SHAPE, tail=None, aerodynamics=NO_DRAG)), air_density=1.0)


def gliding(speed: float, incidence: float) -> np.ndarray:
    """Return the twists of a spread wing that glides straight at an incidence [rad] of the body."""
    twist = np.array([speed * np.cos(incidence), 0.0, -speed * np.sin(incidence), 0.0, 0.0, 0.0])
    return np.tile(twist, (5, 1))


def evaluate(air: RobotAir, twists: np.ndarray, state: np.ndarray) -> tuple[np.ndarray, np.ndarray, StripLoads]:
    """Return wrenches (5, 6) on the links, rates of the state and the strips' loads, without added mass."""
    return loads_of(air.memory, twists, state)


def settled(air: RobotAir, twists: np.ndarray) -> np.ndarray:
    """Return the aerodynamic state that no longer changes under steady twists."""
    return settled_state(air.memory, twists, air.state_size)
