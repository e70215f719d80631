"""Closing the loop: a controller that flies the robot by its thrusters, from sensors and a momentum observer.

Where gymnasium is installed, `ENVIRONMENTS` are registered: `gymnasium.make("aerobat_pin/Hover-v0")`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from aerobat_pin.control.allocation import Allocation
from aerobat_pin.control.controller import Controller
from aerobat_pin.control.disturbance import Disturbance, DisturbanceObserver, TrueDisturbance
from aerobat_pin.control.margins import Margins, loop_margins, noise_slew, wrong_plant_ms
from aerobat_pin.control.monitor import FAILED, LoopState
from aerobat_pin.control.nominal_wrench import Nominal, nominal_flight
from aerobat_pin.control.summary import ControlSummary, control_summary, course_rms

if TYPE_CHECKING:
    from aerobat_pin.control.environment import AerobatEnv as AerobatEnv

ENVIRONMENTS = {  # id -> scenario
    "aerobat_pin/Hover-v0": "hover_closed_loop",
    "aerobat_pin/PaperLeft-v0": "paper_left_closed_loop",
    "aerobat_pin/Gust-v0": "gust_closed_loop",
    "aerobat_pin/Impact-v0": "impact_closed_loop",
}

__all__ = [
    "ENVIRONMENTS",
    "FAILED",
    "AerobatEnv",
    "Allocation",
    "ControlSummary",
    "Controller",
    "Disturbance",
    "DisturbanceObserver",
    "LoopState",
    "Margins",
    "Nominal",
    "TrueDisturbance",
    "control_summary",
    "course_rms",
    "loop_margins",
    "noise_slew",
    "nominal_flight",
    "wrong_plant_ms",
]


def _register() -> None:
    """Tell gymnasium of the environments, if it is installed."""
    try:
        from gymnasium import register
    except ModuleNotFoundError:
        return
    for name, scenario in ENVIRONMENTS.items():
        register(name, "aerobat_pin.control:AerobatEnv", kwargs={"scenario": scenario})


_register()


def __getattr__(name: str) -> Any:
    """Import the environment when it is first used: it needs the extra `gym`."""
    if name != "AerobatEnv":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    try:
        from aerobat_pin.control.environment import AerobatEnv
    except ModuleNotFoundError as error:
        if error.name != "gymnasium":
            raise
        raise ImportError("AerobatEnv needs gymnasium: pip install 'aerobat-pinocchio[gym]'") from error
    return AerobatEnv
