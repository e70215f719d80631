"""The error of a belief over phase and state, with how sure it is: a Gaussian process of few weights.

    e_i = g F_i + f.w_i + sum_s x_s f.a_is + sum_(s <= t) x_s x_t f.b_ist + f.d_i + n_i
    f = [1, cos k phase, sin k phase]

e_i is row i of the generalised force, F_i that of the known forces that the robot doubts, such as its air, and x_s =
(z_s - zc_s) / z0_s the state at the instant. Forces of air and of inertia are quadratic in all velocities at once, so
every product of two states counts. w and d have all harmonics, a half of them, b a quarter. g, w, a and b belong to the
belief and are learnt from free flights; d belongs to one flight and is never known of another; n is what does not
repeat itself. g, one number for all rows, explains as much of e as it can, as a force that is wrong in one state of
flight is so in others. Before any flight was seen the weights are independent, with mean zero and variances

    w: (A / (1 + k^2/9))^2     a: (c A)^2 h_k     b: (q A)^2 h_k     d: (kappa A)^2 h_k

with h_k = 1 / (1 + k^2/9) over its sum over all k, and A the rms size of the error in like rows. So a prediction far
from what was flown is not refused: it has a large deviation.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from aerobat_pin.numerics import Array
from aerobat_pin.records import Condition

BEND = 9.0  # square of the harmonic from which errors are expected to fall
LINEAR = 1.6  # c: an error may change this often its own size where a state changes by its unit
CURVED = 1.0  # q: share of it that goes with the product of two states, where these are 1
DAILY = 0.005  # kappa: share of the error that differs from flight to flight at the same state
NEARLY_KNOWN = 0.035  # of the error's size: up to this deviation thresholds stay as they are


@dataclass(frozen=True)
class LearntError:
    """What free flights showed of the error of a belief."""

    order: int  # highest harmonic
    states: Mapping[str, str]  # state -> its unit, s of them
    share: float  # g
    centre: Array  # (s,) state in the middle of what was flown
    scale: Array  # (s,) units z0 of the states
    size: Array  # (nv,) rms size A of the error in rows like this one [N, N m]
    mean: Array  # (p, nv) weights, in the order of `weight_regressors`
    covariance: Array  # (nv, p, p) of the weights of each row
    remainder: Array  # (nv,) root mean square of n_i below the highest harmonic [N, N m]

    def force(self, condition: Condition, known: Mapping[str, Array]) -> Array:
        """Return the expected error (m, nv) [N, N m], interval means, given the known forces (m, nv) by name."""
        doubted = self.share * condition.doubted_force(known)
        return condition.spread(self.regressors(condition) @ self.mean + doubted)

    def times(self, factor: float) -> LearntError:
        """Return an error that is larger by a factor, as that of the air is in denser air."""
        return replace(self, mean=factor * self.mean)

    def regressors(self, condition: Condition) -> Array:
        """Return what the weights are multiplied with (m, p)."""
        return weight_regressors(condition, self.order, self.centre, self.scale)

    def deviation(self, condition: Condition) -> Array:
        """Return the standard deviation (m, nv) of the reduced error about `force` [N, N m]."""
        terms = self.regressors(condition)
        weights = np.stack([np.sum((terms @ one) * terms, axis=1) for one in self.covariance], axis=1)
        variance = np.maximum(weights, 0.0) + (DAILY * self.size) ** 2 + self.remainder**2
        return np.asarray(np.sqrt(variance))

    def factors(self, condition: Condition) -> Array:
        """Return S (m, nv, r), such that the error of the generalised force has the covariance S S^T."""
        deviation = self.deviation(condition)
        return np.stack([condition.spread(alone(deviation, i)) for i in self.learnt_rows], axis=2)

    @property
    def learnt_rows(self) -> NDArray[np.intp]:
        """Rows of the reduced force that have an error."""
        return np.flatnonzero(self.size > 0.0)

    def widened(self, condition: Condition) -> Array:
        """Return the factor (m,) by which thresholds grow: 1 where the error is known nearly as well as anywhere."""
        rows = self.learnt_rows
        share = np.sqrt(np.mean((self.deviation(condition)[:, rows] / self.size[rows]) ** 2, axis=1))
        return np.asarray(np.maximum(share / NEARLY_KNOWN, 1.0))


def alone(values: Array, row: int) -> Array:
    """Return a force (m, nv) that has one row of the given one alone."""
    found = np.zeros_like(values)
    found[:, row] = values[:, row]
    return found


def falling(order: int) -> Array:
    """Return 1 + k^2/9 (2 order + 1,) of the mean, the cosines and the sines."""
    k = np.arange(order + 1)
    return 1.0 + np.concatenate([k, k[1:]]) ** 2 / BEND


def shares(order: int) -> Array:
    """Return the variances (2 order + 1,) of mean, cosines and sines that together have a mean square of 1."""
    size = 1.0 / falling(order)
    return np.asarray(size / np.sum(size[: order + 1]))


def series(phase: Array, order: int) -> Array:
    """Return f (m, 2 order + 1): one, cosines, sines."""
    angles = np.outer(phase, np.arange(1, order + 1))
    return np.concatenate([np.ones((len(angles), 1)), np.cos(angles), np.sin(angles)], axis=1)


def orders(order: int) -> tuple[int, int, int]:
    """Return the highest harmonic of what is constant, linear and quadratic in the state."""
    return order, order // 2, order // 4


def weight_count(order: int, states: int) -> int:
    """Return p, the number of weights of a row."""
    counts = 1, states, states * (states + 1) // 2
    return sum(count * (2 * highest + 1) for count, highest in zip(counts, orders(order), strict=True))


def weight_regressors(condition: Condition, order: int, centre: Array, scale: Array) -> Array:
    """Return what the weights are multiplied with (m, p): f, f times each state, f times each product of two states."""
    x = (condition.values - centre) / scale
    first, second = np.triu_indices(x.shape[1])
    factors = np.ones((len(x), 1)), x, x[:, first] * x[:, second]
    parts = [
        (factor[:, :, None] * series(condition.phase, highest)[:, None]).reshape(len(x), -1)
        for factor, highest in zip(factors, orders(order), strict=True)
    ]
    return np.concatenate(parts, axis=1)
