"""Figures, report and replay: what a person looks at after a flight."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from aerobat_pin.visualization.figures.linkage_svg import animation
    from aerobat_pin.visualization.replay.flight_replay import SLOW_MOTION, replay_flight
    from aerobat_pin.visualization.replay.load_run import flight_of
    from aerobat_pin.visualization.replay.motion_csv import recording_of
    from aerobat_pin.visualization.replay.recording import Recording, record
    from aerobat_pin.visualization.replay.serve import serve
    from aerobat_pin.visualization.replay.snapshots import snapshots

_PLACES = {
    "SLOW_MOTION": "replay.flight_replay",
    "Recording": "replay.recording",
    "animation": "figures.linkage_svg",
    "flight_of": "replay.load_run",
    "record": "replay.recording",
    "recording_of": "replay.motion_csv",
    "replay_flight": "replay.flight_replay",
    "serve": "replay.serve",
    "snapshots": "replay.snapshots",
}
__all__ = [
    "SLOW_MOTION",
    "Recording",
    "animation",
    "flight_of",
    "record",
    "recording_of",
    "replay_flight",
    "serve",
    "snapshots",
]


def __getattr__(name: str) -> Any:
    """Import what is asked for when it is asked for: whoever replays does not wait for matplotlib."""
    if name in _PLACES:
        return getattr(import_module(f"{__name__}.{_PLACES[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
