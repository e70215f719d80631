"""Aerobat on Pinocchio: what is pushing on my robot?"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from aerobat_pin.experiments import run
    from aerobat_pin.flight import FlightLog, simulate
    from aerobat_pin.robot import Aerobat, load_aerobat
    from aerobat_pin.scenario import Scenario, load_scenario

__version__ = "0.1.0"
__all__ = ["Aerobat", "FlightLog", "Scenario", "__version__", "load_aerobat", "load_scenario", "run", "simulate"]
_ROOMS = {
    "Aerobat": "robot",
    "FlightLog": "flight",
    "Scenario": "scenario",
    "load_aerobat": "robot",
    "load_scenario": "scenario",
    "run": "experiments",
    "simulate": "flight",
}


def __getattr__(name: str) -> Any:
    """Import what is asked for when it is asked for, so that `import aerobat_pin` alone costs nothing."""
    if name in _ROOMS:
        return getattr(import_module(f"aerobat_pin.{_ROOMS[name]}"), name)
    raise AttributeError(f"module 'aerobat_pin' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
