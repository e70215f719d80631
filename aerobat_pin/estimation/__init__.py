"""Run the observers on a flight log: prepare their inputs with an assumed robot model, and score their estimates."""

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
from aerobat_pin.estimation.recordings import (
    Compared,
    LogChannel,
    Map,
    OnlineEstimator,
    OnlineSample,
    RecordingEstimate,
    StoredEstimate,
    describe_map,
    estimate_recording,
    load_map,
    parse_map,
    suggested_map,
    with_options,
    write_flight_mcap,
    write_mcap,
)
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
    "ObserverScores",
    "OnlineEstimator",
    "OnlineSample",
    "RecordingEstimate",
    "Scores",
    "StoredEstimate",
    "TrueEvent",
    "belief_about",
    "calibrate",
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
    "motion",
    "observer_scores",
    "parse_map",
    "point_label",
    "r_squared",
    "read_calibration",
    "read_log",
    "self_check",
    "suggested_map",
    "true_events",
    "true_force",
    "with_options",
    "write_flight_mcap",
    "write_mcap",
]
