"""Show a flight: figures, an HTML report, and a replay in the browser.

Each name is imported only when it is first used, so that a replay need not wait for matplotlib to load.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from aerobat_pin.visualization.comparison import compare_runs as compare_runs
    from aerobat_pin.visualization.crank_by_hand import crank_page as crank_page
    from aerobat_pin.visualization.figures.estimation import draw_estimation as draw_estimation
    from aerobat_pin.visualization.figures.linkage import draw_linkage as draw_linkage
    from aerobat_pin.visualization.figures.linkage import range_table as range_table
    from aerobat_pin.visualization.figures.linkage_svg import linkage_animation as linkage_animation
    from aerobat_pin.visualization.recording_pages import write_recording_pages as write_recording_pages
    from aerobat_pin.visualization.replay.flight_replay import SLOW_MOTION as SLOW_MOTION
    from aerobat_pin.visualization.replay.flight_replay import replay_flight as replay_flight
    from aerobat_pin.visualization.replay.load_run import replay_log as replay_log
    from aerobat_pin.visualization.replay.load_run import replay_run as replay_run
    from aerobat_pin.visualization.replay.motion_csv import replay_table as replay_table
    from aerobat_pin.visualization.replay.open_robot import RobotView as RobotView
    from aerobat_pin.visualization.replay.open_robot import open_robot as open_robot
    from aerobat_pin.visualization.replay.recording import Recording as Recording
    from aerobat_pin.visualization.replay.recording import record as record
    from aerobat_pin.visualization.replay.serve import serve as serve
    from aerobat_pin.visualization.replay.snapshots import snapshots as snapshots
    from aerobat_pin.visualization.style import render_figure as render_figure
    from aerobat_pin.visualization.style import save_figure as save_figure
    from aerobat_pin.visualization.write_all import draw_all as draw_all
    from aerobat_pin.visualization.write_all import write_figures_and_pages as write_figures_and_pages

_MODULES = {
    "crank_by_hand": ["crank_page"],
    "comparison": ["compare_runs"],
    "figures.linkage": ["draw_linkage", "range_table"],
    "figures.linkage_svg": ["linkage_animation"],
    "recording_pages": ["write_recording_pages"],
    "figures.estimation": ["draw_estimation"],
    "replay.flight_replay": ["SLOW_MOTION", "replay_flight"],
    "replay.load_run": ["replay_log", "replay_run"],
    "replay.motion_csv": ["replay_table"],
    "replay.open_robot": ["RobotView", "open_robot"],
    "replay.recording": ["Recording", "record"],
    "replay.serve": ["serve"],
    "replay.snapshots": ["snapshots"],
    "style": ["render_figure", "save_figure"],
    "write_all": ["draw_all", "write_figures_and_pages"],
}
__all__ = [name for names in _MODULES.values() for name in names]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module = next(module for module, names in _MODULES.items() if name in names)
    return getattr(import_module(f"{__name__}.{module}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
