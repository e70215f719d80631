"""Run the observers on a flight log: prepare their inputs with an assumed robot model, and score their estimates."""

from aerobat_pin.estimation.contradictions import Contradiction, contradictions
from aerobat_pin.estimation.estimate import belief_about, check_names, describe_belief, estimate_log, read_log
from aerobat_pin.estimation.flight_summary import FlightSummary, flight_summary
from aerobat_pin.estimation.known_inputs import KnownInputs, known_inputs
from aerobat_pin.estimation.motion import motion
from aerobat_pin.estimation.scores import (
    FORCE_AXES,
    TABLE_HEADER,
    AxisScore,
    ObserverScores,
    Scores,
    observer_scores,
    point_label,
    r_squared,
)
from aerobat_pin.estimation.self_check import self_check
from aerobat_pin.estimation.truth import true_events, true_force

__all__ = [
    "FORCE_AXES",
    "TABLE_HEADER",
    "AxisScore",
    "Contradiction",
    "FlightSummary",
    "KnownInputs",
    "ObserverScores",
    "Scores",
    "belief_about",
    "check_names",
    "contradictions",
    "describe_belief",
    "estimate_log",
    "flight_summary",
    "known_inputs",
    "motion",
    "observer_scores",
    "point_label",
    "r_squared",
    "read_log",
    "self_check",
    "true_events",
    "true_force",
]
