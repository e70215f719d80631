"""Aerobat on Pinocchio: what is pushing on my robot?

A name is imported when it is first used, so that `import aerobat_pin` alone costs nothing.
"""

from __future__ import annotations

import sys

TYPE_CHECKING = False  # without importing `typing`: a Ctrl-C while this module loads would be a traceback
if TYPE_CHECKING:
    from typing import Any

    from aerobat_pin.aerobat import Aerobat as Aerobat
    from aerobat_pin.aerobat import FlightLog as FlightLog
    from aerobat_pin.aerobat import closed_model as closed_model
    from aerobat_pin.aerobat import load_aerobat as load_aerobat
    from aerobat_pin.aerobat import open_record as open_record
    from aerobat_pin.estimation import calibrate as calibrate
    from aerobat_pin.estimation import estimate as estimate
    from aerobat_pin.experiments import run as run
    from aerobat_pin.flight import simulate as simulate
    from aerobat_pin.observers import OBSERVERS as OBSERVERS
    from aerobat_pin.records import load_robot as load_robot
    from aerobat_pin.scenario import Scenario as Scenario
    from aerobat_pin.scenario import load_scenario as load_scenario

__version__ = "0.1.0"
_ROOMS = {
    "experiments": ["run"],
    "aerobat": ["Aerobat", "FlightLog", "closed_model", "load_aerobat", "open_record"],
    "estimation": ["calibrate", "estimate"],
    "records": ["load_robot"],
    "flight": ["simulate"],
    "observers": ["OBSERVERS"],
    "scenario": ["Scenario", "load_scenario"],
}
__all__ = ["__version__", *(name for names in _ROOMS.values() for name in names)]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    room = next(room for room, names in _ROOMS.items() if name in names)
    return getattr(import_module(f"{__name__}.{room}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)


def _of_before(name: str) -> Any:
    from aerobat_pin.errors import old_names

    places = "aerobat_pin.aerobat", "aerobat_pin.observers"
    if name == "__all__":  # a star would bring nothing, without a word
        from importlib import import_module

        return [*import_module(places[0]).__all__, *_FRAMES]
    return old_names(robot.__name__, {}, None, *places, stacklevel=3)(name)


_FRAMES = "euler_angles", "external_forces", "joint_wrench", "rotation_matrices", "rotations", "world_velocity"
robot = type(sys)("aerobat_pin.robot", "What `aerobat` and, of frames, `observers` have now: for one release.")
robot.__dict__["__getattr__"] = _of_before
sys.modules[robot.__name__] = robot
