"""From a flight log and a believed robot to known inputs, estimates and their scores."""

from aerobat_pin.estimation.estimate import belief_about, check_names, estimate_log, read_log, who_is_believed
from aerobat_pin.estimation.known_inputs import KnownInputs, known_inputs
from aerobat_pin.estimation.motion import motion
from aerobat_pin.estimation.scores import (
    AXES,
    flight_metrics,
    observer_metrics,
    point_label,
    r_squared,
    true_events,
    true_force,
)
from aerobat_pin.estimation.self_check import self_check

__all__ = [
    "AXES",
    "KnownInputs",
    "belief_about",
    "check_names",
    "estimate_log",
    "flight_metrics",
    "known_inputs",
    "motion",
    "observer_metrics",
    "point_label",
    "r_squared",
    "read_log",
    "self_check",
    "true_events",
    "true_force",
    "who_is_believed",
]
