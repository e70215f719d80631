"""From a log and a belief to forces: known inputs, calibrations, raw sensors, recordings of any robot, and scores.

What reads the recordings of any robot is imported when it is first used, so that a run need not wait for it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from aerobat_pin.estimation.air_stream import AirStream
from aerobat_pin.estimation.calibration.calibration import Belief, Calibration
from aerobat_pin.estimation.calibration.calibration_file import calibration_bytes, read_calibration
from aerobat_pin.estimation.calibration.free_flight import FreeFlight
from aerobat_pin.estimation.calibration.learn import calibrate
from aerobat_pin.estimation.calibration.use import CalibrationUse
from aerobat_pin.estimation.contradiction import Contradiction
from aerobat_pin.estimation.contradictions import contradictions
from aerobat_pin.estimation.estimate import belief_about, check_names, describe_belief, estimate_log, read_log
from aerobat_pin.estimation.flight_summary import FlightSummary, flight_summary
from aerobat_pin.estimation.known_inputs import KnownInputs, known_inputs
from aerobat_pin.estimation.metrics import TABLE_HEADER, Scores
from aerobat_pin.estimation.motion import motion
from aerobat_pin.estimation.scores import (
    FORCE_AXES,
    AxisScore,
    ObserverScores,
    observer_scores,
    point_label,
    r_squared,
)
from aerobat_pin.estimation.self_check import self_check
from aerobat_pin.estimation.truth import SUM, TrueEvent, true_events, true_force

if TYPE_CHECKING:
    from aerobat_pin.estimation.recordings import Compared as Compared
    from aerobat_pin.estimation.recordings import LogChannel as LogChannel
    from aerobat_pin.estimation.recordings import Map as Map
    from aerobat_pin.estimation.recordings import MapCalibration as MapCalibration
    from aerobat_pin.estimation.recordings import OnlineEstimator as OnlineEstimator
    from aerobat_pin.estimation.recordings import OnlineSample as OnlineSample
    from aerobat_pin.estimation.recordings import RecordingEstimate as RecordingEstimate
    from aerobat_pin.estimation.recordings import StoredEstimate as StoredEstimate
    from aerobat_pin.estimation.recordings import calibrate_recording as calibrate_recording
    from aerobat_pin.estimation.recordings import describe_map as describe_map
    from aerobat_pin.estimation.recordings import estimate_recording as estimate_recording
    from aerobat_pin.estimation.recordings import load_map as load_map
    from aerobat_pin.estimation.recordings import map_calibration_bytes as map_calibration_bytes
    from aerobat_pin.estimation.recordings import parse_map as parse_map
    from aerobat_pin.estimation.recordings import read_map_calibration as read_map_calibration
    from aerobat_pin.estimation.recordings import suggested_map as suggested_map
    from aerobat_pin.estimation.recordings import with_options as with_options
    from aerobat_pin.estimation.recordings import write_flight_mcap as write_flight_mcap
    from aerobat_pin.estimation.recordings import write_mcap as write_mcap

__all__ = [
    "FORCE_AXES",
    "SUM",
    "TABLE_HEADER",
    "AirStream",
    "AxisScore",
    "Belief",
    "Calibration",
    "CalibrationUse",
    "Compared",
    "Contradiction",
    "FlightSummary",
    "FreeFlight",
    "KnownInputs",
    "LogChannel",
    "Map",
    "MapCalibration",
    "ObserverScores",
    "OnlineEstimator",
    "OnlineSample",
    "RecordingEstimate",
    "Scores",
    "StoredEstimate",
    "TrueEvent",
    "belief_about",
    "calibrate",
    "calibrate_recording",
    "calibration_bytes",
    "check_names",
    "contradictions",
    "describe_belief",
    "describe_map",
    "estimate_log",
    "estimate_recording",
    "flight_summary",
    "known_inputs",
    "load_map",
    "map_calibration_bytes",
    "motion",
    "observer_scores",
    "parse_map",
    "point_label",
    "r_squared",
    "read_calibration",
    "read_log",
    "read_map_calibration",
    "self_check",
    "suggested_map",
    "true_events",
    "true_force",
    "with_options",
    "write_flight_mcap",
    "write_mcap",
]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from aerobat_pin.estimation import recordings

    return getattr(recordings, name)
