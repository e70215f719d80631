"""A record linearised about a nominal motion: filtered for its likelihood, or smoothed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from aerobat_pin.estimation.raw.dynamics import LinearDynamics
from aerobat_pin.estimation.raw.layout import CRANK_ERROR, Layout
from aerobat_pin.estimation.raw.nominal import NominalMotion
from aerobat_pin.estimation.raw.prior import Prior
from aerobat_pin.estimation.raw.recursion import filter_record, smooth_record
from aerobat_pin.estimation.raw.rows import SampleRows
from aerobat_pin.estimation.raw.tuning import Tuning, white_variance
from aerobat_pin.numerics import Array

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
        rows: the samples.
        jumps: (m,) variance that a jump at the end of an interval adds to each slow force [N2]; 0 where there is none.
    """

    layout: Layout
    nominal: NominalMotion
    dynamics: LinearDynamics
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
        gains, innovations = np.empty((k if keep else 1, n)), np.empty((k, 2))
        states = np.empty((m + 1 if keep else 0, n))
        covariances = np.empty((m + 1 if keep else 0, n, n))
        d, rows = self.dynamics, self.rows
        fresh = np.array([white.start, white.stop], dtype=np.intp)
        score = filter_record(
            x, P, d.transition, d.shift, self.noise(tuning), fresh, rows.start, rows.h, rows.e, rows.R,
            gains, innovations, states, covariances,
        )  # fmt: skip
        return score, Filtered(x, P, gains, innovations, states, covariances)

    def smooth(self, tuning: Tuning, prior: Prior, *, scores: bool = False, deviations: bool = False) -> Smoothed:
        """Smooth the record; scores and deviations take most of the time, and are empty if not asked for."""
        score, (_, _, gains, innovations, states, covariances) = self.filter(tuning, prior, keep=True)
        filtered = states.copy()
        n, layout = self.layout.size, self.layout
        fresh = np.array([layout.white.start, layout.white.stop], dtype=np.intp)
        block = np.array([layout.walk.start, layout.walk.stop], dtype=np.intp)
        size = len(states) if deviations else 0
        spread, blocks = np.empty((size, n)), np.empty((size, 3 * layout.points, 3 * layout.points))
        size = len(states) if scores or deviations else 0
        pulls, informations = np.empty((size, n)), np.empty((size, n))
        inside = np.empty((size, 3 * layout.points, 3 * layout.points))
        d, rows = self.dynamics, self.rows
        smooth_record(
            d.transition, fresh, rows.start, rows.h, gains, innovations, states, covariances, block,
            pulls, informations, inside, spread, blocks,
        )  # fmt: skip
        return Smoothed(states, spread, blocks, innovations, score, filtered, covariances, pulls, informations, inside)


class Filtered(NamedTuple):
    """Last state (n,) and covariance (n, n) of a filtered record, then the arrays that `filter_record` writes."""

    last: Array
    covariance: Array
    gains: Array
    innovations: Array
    states: Array
    covariances: Array


@dataclass(frozen=True)
class Smoothed:
    """A smoothed record.

    Attributes:
        states: (m + 1, n) smoothed states.
        deviations: (m + 1, n) their standard deviations, or empty.
        blocks: (m + 1, b, b) covariance of the slowly changing forces, or empty.
        innovations: (k, 2) innovation of each sample and its variance.
        score: log-likelihood.
        filtered, covariances: (m + 1, n), (m + 1, n, n) of the filter.
        pulls, informations: (m + 1, n) derivative of the log-likelihood by a sudden change of each state before each
            knot's samples, with the sign turned, and its variance, or empty.
        inside: (m + 1, b, b) covariance of the pulls of the slowly changing forces, or empty.
    """

    states: Array
    deviations: Array
    blocks: Array
    innovations: Array
    score: float
    filtered: Array
    covariances: Array
    pulls: Array
    informations: Array
    inside: Array
