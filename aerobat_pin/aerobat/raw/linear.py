"""A record linearised about a nominal motion: filtered for its likelihood, or smoothed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aerobat_pin.aerobat.raw.dynamics import LinearDynamics
from aerobat_pin.aerobat.raw.layout import CRANK_ERROR, Layout, Prior
from aerobat_pin.aerobat.raw.nominal_motion import NominalMotion
from aerobat_pin.aerobat.raw.recursion import Filtered, SampleRows, Smoothed, filter_record, smooth_record
from aerobat_pin.aerobat.raw.tuning import Tuning, white_variance
from aerobat_pin.numerics import Array, Integers

GYRO_WALK, ACCELEROMETER_WALK = 1.0e-4, 1.0e-3  # of the biases [rad/s/sqrt(s), m/s2/sqrt(s)]


def added_variances(layout: Layout, tuning: Tuning, dt: Array) -> Array:
    """Return the variances (m, n) that intervals dt (m,) [s] add to the states; of the white forces: the next one's."""
    added, each = np.zeros((len(dt), layout.size)), dt[:, None]
    added[:, CRANK_ERROR.stop - 1] = tuning.jerk**2 * dt
    added[:, layout.gyro_bias] = GYRO_WALK**2 * each
    added[:, layout.accelerometer_bias] = ACCELEROMETER_WALK**2 * each
    added[:, layout.walk] = tuning.by_mode(tuning.walk, layout.points) ** 2 * each
    added[:, layout.slope] = tuning.by_mode(tuning.bend, layout.points) ** 2 * each
    added[:, layout.white] = np.tile(white_variance(tuning, np.append(dt[1:], dt[-1])), layout.points)
    return added


@dataclass(frozen=True)
class LinearRecord:
    """A record linearised about a nominal motion: dynamics and samples.

    Attributes:
        layout: places of the states.
        nominal: the motion.
        dynamics: of each interval.
        sensors: names of the sensors.
        rows: the samples.
        jumps: (m,) variance that a jump at the end of an interval adds to each slow force [N2]; 0 where there is none.
    """

    layout: Layout
    nominal: NominalMotion
    dynamics: LinearDynamics
    sensors: tuple[str, ...]
    rows: SampleRows
    jumps: Array

    def noise(self, tuning: Tuning) -> Array:
        """Return the variances (m, n) that each interval adds to the states."""
        added = added_variances(self.layout, tuning, np.diff(self.nominal.time))
        added[:, self.layout.walk] += self.jumps[:, None]
        return added

    def filter(self, tuning: Tuning, prior: Prior, *, keep: bool) -> tuple[float, Filtered]:
        """Filter the record from a prior; return the log-likelihood, and what `smooth_record` needs if it is kept."""
        n, m, k = self.layout.size, len(self.nominal.time) - 1, len(self.rows.e)
        x, P = prior.about(self.nominal), prior.covariance.copy()
        white = self.layout.white
        first = white_variance(tuning, np.diff(self.nominal.time[:2]))
        x[white], P[white, :], P[:, white] = 0.0, 0.0, 0.0
        P[white, white] = np.diag(np.tile(first[0], self.layout.points))
        knots = m + 1 if keep else 0
        filtered = Filtered(x, P, *map(np.empty, ((k, n), (k, 2), (knots, n), (knots, n, n))))
        d, fresh = self.dynamics, _ends(white)
        return filter_record(d.transition, d.shift, self.noise(tuning), fresh, self.rows, filtered), filtered

    def score(self, tuning: Tuning, prior: Prior) -> float:
        """Return the log-likelihood of the samples."""
        return self.filter(tuning, prior, keep=False)[0]

    def smooth(self, tuning: Tuning, prior: Prior, *, scores: bool = False, blocks: bool = False) -> Smoothed:
        """Smooth the record; scores and blocks take most of the time, and are empty if not asked for."""
        _, filtered = self.filter(tuning, prior, keep=True)
        layout, (m, n) = self.layout, filtered.states.shape
        spread, wanted, b = m if blocks else 0, m if scores or blocks else 0, 3 * layout.points
        sizes = (m, n), (spread, b, b), (wanted, n), (wanted, n), (wanted, b, b)
        smoothed = Smoothed(filtered, *map(np.empty, sizes))
        smooth_record(self.dynamics.transition, _ends(layout.white), _ends(layout.walk), self.rows, smoothed)
        return smoothed


def _ends(states: slice) -> Integers:
    return np.array([states.start, states.stop], dtype=np.intp)
