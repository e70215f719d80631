"""The error of a belief as a Fourier series of a phase, fitted to what a free run leaves unexplained.

    e(phase, z) = sum_j z_j (a_j0 + sum_k a_jk cos(k phase) + b_jk sin(k phase)),    z_0 = 1

Each row of the generalised force has its own coefficients. With states of the motion in z (about their means and in
units of their spread) the coefficients are linear in these states, which needs free runs that differ in them.

The runs span a range of states. Within it and a margin around it the series counts fully; further out its weight falls
linearly, and is zero at three margins. Measured on `paper` with quasi-steady air believed, margins of a tenth of speed
and frequency: at one margin of speed or frequency, the series leaves 9 mN of 112 mN and 14 mN of 120 mN; at three
margins 23 mN of 125 mN and 26 mN of 83 mN.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aerobat_pin.numerics import Array
from aerobat_pin.records import Condition

LEAST_SPREAD = 0.05  # of the margin: a state that varies less shows no dependence on it
RIDGE = 1.0e-3  # keeps coefficients of states that always vary together small
ENDS_AT = 3.0  # margins beyond the range, where nothing is left of the series
NEAR_BY = 0.3  # margins beyond the range, up to which contacts are sought
LOST_UNNOTICED = 0.01  # mean weight that may be lost while a run still counts as inside


@dataclass(frozen=True)
class LearntRange:
    """The range (s,) of each state in which a series was learnt, and the margin around it.

    Attributes:
        states: state -> its unit.
        low: (s,) least value of each.
        high: (s,) largest value.
        margin: (s,) margin.
    """

    states: Mapping[str, str]
    low: Array
    high: Array
    margin: Array

    @classmethod
    def of(cls, conditions: Sequence[Condition]) -> LearntRange:
        """Return the range of some runs."""
        values = np.concatenate([one.values for one in conditions])
        return cls(conditions[0].states, np.min(values, axis=0), np.max(values, axis=0), _mean_margin(conditions))

    def excess(self, condition: Condition) -> Array:
        """Return how far each state is outside the range (m, s), in margins."""
        beyond = np.maximum(self.low - condition.values, condition.values - self.high)
        return np.asarray(np.maximum(beyond, 0.0) / np.maximum(self.margin, 1e-12))

    def weight(self, condition: Condition) -> Array:
        """Return the weight (m,) of the series in each interval: 1 inside, 0 far outside."""
        worst = np.max(self.excess(condition), axis=1)
        return np.asarray(np.clip((ENDS_AT - worst) / (ENDS_AT - 1.0), 0.0, 1.0))

    def near(self, condition: Condition) -> NDArray[np.bool_]:
        """Return in which intervals (m,) small forces can be told from errors of the belief, so near to the range."""
        return np.asarray(np.max(self.excess(condition), axis=1) <= NEAR_BY)

    def describe(self, condition: Condition) -> str:
        """Say in one line where a run leaves the range most."""
        beyond = self.excess(condition)
        at, k = np.unravel_index(int(np.argmax(beyond)), beyond.shape)
        name, unit = list(self.states.items())[k]
        return (
            f"{name} {condition.values[at, k]:.3g} {unit}, learnt from {self.low[k]:.3g} to {self.high[k]:.3g} {unit}"
        )


@dataclass(frozen=True)
class Harmonics:
    """A Fourier series of a generalised force over a phase.

    Attributes:
        order: highest harmonic.
        varied: states on which the coefficients depend linearly.
        centre: (v,) value of each of them in the middle of what was learnt.
        spread: (v,) its standard deviation there.
        coefficients: (1 + v, 2 order + 1, nv) constant, cosines, sines of each row [N, N m]; first those of z_0.
        learnt: where that was.
    """

    order: int
    varied: tuple[str, ...]
    centre: Array
    spread: Array
    coefficients: Array
    learnt: LearntRange

    def force(self, condition: Condition) -> Array:
        """Return the generalised force (m, nv) of the error, interval means, as if it held everywhere."""
        terms = _terms(condition, self.order, self.varied, self.centre, self.spread)
        return condition.spread(terms @ self.coefficients.reshape(-1, self.coefficients.shape[2]))

    def faded(self, condition: Condition) -> Array:
        """Return the generalised force (m, nv) of the error, less where the motion leaves what was learnt."""
        return self.learnt.weight(condition)[:, None] * self.force(condition)


def fit_harmonics(
    conditions: Sequence[Condition],
    residuals: Sequence[Array],
    parts: Sequence[slice],
    order: int,
    varied: Sequence[str],
) -> Harmonics:
    """Fit a Fourier series to what is left unexplained of free runs, by least squares.

    Args:
        conditions: phase and state of each run.
        residuals: (m, nv) generalised force that is left unexplained in each run.
        parts: the intervals of each run that are fitted.
        order: highest harmonic.
        varied: states on which the coefficients may depend; those that hardly vary are left out.
    """
    rows = [one.reduced(residual)[part] for one, residual, part in zip(conditions, residuals, parts, strict=True)]
    fitted = [one.part(part) for one, part in zip(conditions, parts, strict=True)]
    values, margin = np.concatenate([one.values for one in fitted]), _mean_margin(fitted)
    spreads, centres, names = np.std(values, axis=0), np.mean(values, axis=0), list(fitted[0].states)
    kept = tuple(name for name in varied if spreads[names.index(name)] > LEAST_SPREAD * margin[names.index(name)])
    at = [names.index(name) for name in kept]
    centre, spread = centres[at], spreads[at]
    terms = np.concatenate([_terms(one, order, kept, centre, spread) for one in fitted])
    target = np.concatenate(rows)
    weight = np.repeat([0.0] + [RIDGE * np.sqrt(len(target))] * len(kept), 2 * order + 1)
    table = np.concatenate([terms, np.diag(weight)])
    found = np.linalg.lstsq(table, np.concatenate([target, np.zeros((len(weight), target.shape[1]))]), rcond=None)[0]
    coefficients = found.reshape(1 + len(kept), 2 * order + 1, target.shape[1])
    return Harmonics(order, kept, centre, spread, coefficients, LearntRange.of(conditions))


def _mean_margin(conditions: Sequence[Condition]) -> Array:
    return np.asarray(np.mean([one.margin for one in conditions], axis=0))


def _terms(condition: Condition, order: int, varied: Sequence[str], centre: Array, spread: Array) -> Array:
    """Return the regressors (m, (1 + v) (2 order + 1))."""
    names, angles = list(condition.states), np.outer(condition.phase, np.arange(1, order + 1))
    series = np.concatenate([np.ones((len(angles), 1)), np.cos(angles), np.sin(angles)], axis=1)
    z = (condition.values[:, [names.index(name) for name in varied]] - centre) / spread
    factors = np.concatenate([np.ones((len(angles), 1)), z], axis=1)
    return np.asarray((factors[:, :, None] * series[:, None]).reshape(len(angles), -1))
