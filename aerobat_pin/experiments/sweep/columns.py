"""What the results of a sweep are called, with units, and the names that no dimension may have."""

from __future__ import annotations

# IFBLOCK sweep.results if TYPE_CHECKING:

SCORES = {
    "r2": ("1", "R2 against the true force with its noise"),
    "r2_noise_free": ("1", "R2 against the noise-free part of the true force"),
    "rmse": ("N", "root mean square error against the true force with its noise"),
    "lag_s": ("s", "delay of the noise-free truth that fits the estimate best"),
}
JUDGED = {"rank": "of the equations for the forces", "condition": "of the equations for the forces"}
FLIGHT_UNITS = {
    "duration": "s",
    "position_end": "m",
    "z_range": "m",
    "roll_range": "rad",
    "pitch_range": "rad",
    "yaw_range": "rad",
    "incidence_range": "rad",
    "thrusters_lift_over_weight": "1",
    "aerodynamic_lift_over_weight": "1",
    "motor_power_mean": "W",
}
LISTS: dict[int, tuple[str, list[str]]] = {2: ("bound", ["lowest", "highest"]), 3: ("axis", ["x", "y", "z"])}
TAKEN = frozenset(
    {"run", "failed", "warnings", "observer", "point", "axis", "bound", *SCORES, *JUDGED, *FLIGHT_UNITS}
)  # names that no dimension of a sweep may have
