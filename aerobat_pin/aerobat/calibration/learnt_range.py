"""The flights from which a calibration was learnt span a range of speeds, rates and frequencies; it fades out beyond.

Within the range and a margin around it the calibration counts fully. Further out its weight falls linearly, and is zero
at three margins. The margin is a tenth of the airspeed for velocities, a tenth of the frequency, and 1 rad/s for rates.
Measured on `paper` with quasi-steady air believed: at one margin of speed or frequency, a calibration leaves 9 mN of
112 mN and 14 mN of 120 mN; at three margins 23 mN of 125 mN and 26 mN of 83 mN.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aerobat_pin.aerobat.calibration.flight_state import STATE_UNITS, STATES, FlightState
from aerobat_pin.numerics import Array

MARGIN = 0.1  # of airspeed and of frequency
RATE_MARGIN = 1.0  # [rad/s]
ENDS_AT = 3.0  # margins beyond the range, where nothing is left of the calibration
NEAR_BY = 0.3  # margins beyond the range, up to which contacts are sought
LOST_UNNOTICED = 0.01  # mean weight that may be lost while the flight still counts as inside


def margins(values: Array) -> Array:
    """Return the margin (7,) of each state, given states (m, 7) of flights."""
    speed = float(np.mean(np.linalg.norm(values[:, :3], axis=1)))
    frequency = float(np.mean(values[:, STATES.index("frequency")]))
    return np.array([MARGIN * speed] * 3 + [RATE_MARGIN] * 3 + [MARGIN * frequency])


@dataclass(frozen=True)
class LearntRange:
    """The range (7,) of each state of flight in which a calibration was learnt, and the margin around it."""

    low: Array
    high: Array
    margin: Array

    @classmethod
    def of(cls, values: Array) -> LearntRange:
        """Return the range of states (m, 7)."""
        return cls(np.min(values, axis=0), np.max(values, axis=0), margins(values))

    def excess(self, state: FlightState) -> Array:
        """Return how far each state is outside the range (m, 7), in margins."""
        beyond = np.maximum(self.low - state.values, state.values - self.high)
        return np.asarray(np.maximum(beyond, 0.0) / np.maximum(self.margin, 1e-12))

    def weight(self, state: FlightState) -> Array:
        """Return the weight (m,) of the calibration in each interval: 1 inside, 0 far outside."""
        worst = np.max(self.excess(state), axis=1)
        return np.asarray(np.clip((ENDS_AT - worst) / (ENDS_AT - 1.0), 0.0, 1.0))

    def near(self, state: FlightState) -> Array:
        """Return in which intervals (m,) small forces can be told from errors of the belief, so near to the range."""
        return np.asarray(np.max(self.excess(state), axis=1) <= NEAR_BY)

    def describe(self, state: FlightState) -> str:
        """Say in one line where a flight leaves the range most."""
        beyond = self.excess(state)
        at, name = np.unravel_index(int(np.argmax(beyond)), beyond.shape)
        found, unit = state.values[at, name], STATE_UNITS[name]
        return f"{STATES[name]} {found:.3g} {unit}, learnt from {self.low[name]:.3g} to {self.high[name]:.3g} {unit}"
