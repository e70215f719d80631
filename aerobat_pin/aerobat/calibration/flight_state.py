"""What the errors of a belief depend on: the crank's phase, and the state of the flight averaged over a flap."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aerobat_pin.aerobat.motion import Motion
from aerobat_pin.errors import CalibrationError
from aerobat_pin.numerics import Array
from aerobat_pin.robot import BASE_SIZE, rotations

STATES = ("speed", "side", "climb", "roll_rate", "pitch_rate", "yaw_rate", "frequency")
STATE_UNITS = ("m/s", "m/s", "m/s", "rad/s", "rad/s", "rad/s", "Hz")
STATE_GROUPS = {  # what coefficients can vary with, and the states that stand for it
    "speed": ("speed",),
    "frequency": ("frequency",),
    "attitude": ("side", "climb", "roll_rate", "pitch_rate", "yaw_rate"),
}
LOWEST_FREQUENCY = 0.2  # [Hz]: a crank that turns less often has no phase


@dataclass(frozen=True)
class FlightState:
    """Phase and state in the m intervals of a flight.

    Attributes:
        phase: (m,) crank angle in the middle of the interval [rad].
        values: (m, 7) mean of each of `STATES` over the flap before the interval's end, and over the first flap in the
            intervals of the first flap: velocity of the body through the air in body axes (forward, left, up), body
            rates in body axes, frequency of the crank.
    """

    phase: Array
    values: Array

    def part(self, chosen: slice) -> FlightState:
        """Return phase and state in some of the intervals."""
        return FlightState(self.phase[chosen], self.values[chosen])


def flight_state(moved: Motion) -> FlightState:
    """Return phase and state of a flight.

    Raises:
        CalibrationError: the crank is not recorded, or hardly turns.
    """
    if moved.crank is None:
        raise CalibrationError(
            "flight log: no channel named crank_angle: a calibration follows the phase of the crank, and needs it"
        )
    angle, rate, _ = moved.crank
    frequency = float(np.median(np.abs(rate))) / (2.0 * np.pi)
    if frequency < LOWEST_FREQUENCY:
        raise CalibrationError(
            f"flight log: the crank turns at {frequency:.2g} Hz: at least {LOWEST_FREQUENCY} Hz were expected by a "
            "calibration, which follows its phase"
        )
    base = moved.v[:, :BASE_SIZE].copy()
    base[:, :3] -= np.einsum("nji,nj->ni", rotations(moved.q), moved.wind[:, 0])
    samples = np.column_stack([base, np.abs(rate) / (2.0 * np.pi)])
    means = 0.5 * (samples[1:] + samples[:-1])
    dt = np.diff(moved.time)
    count = max(1, round(1.0 / (frequency * float(np.median(dt[dt > 0.0])))))
    return FlightState(0.5 * (angle[1:] + angle[:-1]), _trailing_mean(means, min(count, len(means))))


def _trailing_mean(values: Array, count: int) -> Array:
    """Return the mean of each row and the `count - 1` rows before it; the first of these means for the rows before."""
    total = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
    means = (total[count:] - total[:-count]) / count
    return np.concatenate([np.repeat(means[:1], count - 1, axis=0), means])
