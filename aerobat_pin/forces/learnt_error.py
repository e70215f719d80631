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

from collections.abc import Mapping, Sequence
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
LEAST_SERIES_NOISE = 0.08  # of the error's size: least rms of what a series leaves, for its weights
HIGHEST = 0.5  # cycles above the highest harmonic, up to which the flights are fitted
NOISE_ABOVE = 150.0  # [Hz]: where nothing but noise of the sensors is left; of slow records the upper half
NOISE_REACHES = 2.0  # times what it makes in the mean of all harmonics
MEDIAN_OF_SQUARE = 0.455  # of a normal variable of deviation 1
STEPS = 3  # of expectation and maximisation


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
        weights = np.stack([np.sum((terms @ cov) * terms, axis=1) for cov in self.covariance], axis=1)
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
    force = np.zeros_like(values)
    force[:, row] = values[:, row]
    return force


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


@dataclass(frozen=True)
class _Flight:
    """A flight below the highest harmonic."""

    slope: Array  # (k,) 4 sin^2 of each frequency
    terms: Array  # (k, p) regressors
    target: Array  # (k, nv) error to be explained
    doubted: Array  # (k, nv) forces of which it may be a share
    noise: Array  # (nv,) a
    share: float  # of all frequencies, those that are fitted


def fit_learnt_error(
    conditions: Sequence[Condition],
    residuals: Sequence[Array],
    known: Sequence[Mapping[str, Array]],
    steps: Sequence[float],
    order: int,
) -> LearntError:
    """Learn from flights in which no unknown force acts, by Bayesian least squares below the highest harmonic.

    Every flight is turned by a discrete sine transform, in which the derivative of white noise of the velocity sensors
    has the independent variances a 4 sin^2(pi k / 2 (m + 1)), to which b is added: what follows neither phase nor
    state. a is read from frequencies in which no error of a belief is left, b from expectation and maximisation
    together with the weights. For the weights b is at least 8 % of the error's size: evidence alone would believe that
    a few seconds of flight show everything. What a flight is said to leave is what these were found to leave.

    Args:
        conditions: phase and state of each flight.
        residuals: (m, nv) generalised force that is left unexplained in each.
        known: name -> (m, nv) known forces in each.
        steps: length of an interval of each [s].
        order: highest harmonic.
    """
    values = np.concatenate([condition.values for condition in conditions])
    centre, scale = np.mean(values, axis=0), np.mean([condition.scale for condition in conditions], axis=0)
    scale = np.where(scale > 0.0, scale, 1.0)
    targets = [condition.reduced(residual) for condition, residual in zip(conditions, residuals, strict=True)]
    flights = [
        _flight_terms(*each, order, centre, scale) for each in zip(conditions, targets, known, steps, strict=True)
    ]
    size = _error_sizes(conditions, targets, flights, order)
    count, width = weight_count(order, len(centre)), 2 * order + 1
    prior = np.concatenate([_prior(order, len(centre)), np.tile(DAILY**2 * shares(order), len(flights))])
    terms = np.zeros((sum(len(flight.slope) for flight in flights), count + width * len(flights)))
    at = 0
    for j, flight in enumerate(flights):
        rows = slice(at, at + len(flight.slope))
        terms[rows, :count] = flight.terms
        terms[rows, count + width * j : count + width * (j + 1)] = flight.terms[:, :width]
        at += len(flight.slope)
    terms *= np.sqrt(prior)
    target, doubted = (np.concatenate([getattr(flight, name) for flight in flights]) for name in ("target", "doubted"))
    share = _share(target, doubted, size)
    target -= share * doubted
    mean, covariance = np.zeros((count, len(size))), np.zeros((len(size), count, count))
    remainder = np.zeros(len(size))
    for i in np.flatnonzero(size > 0.0):
        noise = np.concatenate([flight.noise[i] * flight.slope for flight in flights]) / size[i] ** 2
        weights, spread, rest = _weights(terms, target[:, i] / size[i], noise)
        root = size[i] * np.sqrt(prior[:count])
        mean[:, i], covariance[i] = root * weights[:count], np.outer(root, root) * spread[:count, :count]
        remainder[i] = size[i] * np.sqrt(rest * np.mean([flight.share for flight in flights]))
    return LearntError(order, conditions[0].states, share, centre, scale, size, mean, covariance, remainder)


def _share(target: Array, doubted: Array, size: Array) -> float:
    """Return by which share of the doubted forces (k, nv) least is left of errors (k, nv), each row over its size."""
    weight = np.divide(1.0, size, out=np.zeros_like(size), where=size > 0.0) ** 2
    square = float(np.sum(weight * doubted**2))
    return float(np.sum(weight * doubted * target)) / square if square > 0.0 else 0.0


def _weights(terms: Array, target: Array, noise: Array) -> tuple[Array, Array, float]:
    """Return mean, covariance of its error and what is left, squared, for unit prior variances, over the error's size.

    With H the hat matrix, the squared residuals are those of b times tr (I - H)^2 over their count. The error of
    weights that were found with more noise than there is has the covariance C (X^T W N W X + I) C, N the true noise.
    """
    rest = LEAST_SERIES_NOISE**2
    for step in range(STEPS + 1):
        variance = noise + rest
        weighted = terms / variance[:, None]
        covariance = np.linalg.inv(terms.T @ weighted + np.eye(terms.shape[1]))
        mean = covariance @ (weighted.T @ target)
        if step == STEPS:
            break
        square = (target - terms @ mean) ** 2 + np.sum((terms @ covariance) * terms, axis=1)
        share, before = rest / variance, rest
        rest = max(float(np.mean(share**2 * square + rest * (1.0 - share))), LEAST_SERIES_NOISE**2)
        if rest == before:
            break
    used = np.eye(len(mean)) - covariance  # tr H = tr used, tr H^2 = |used|^2
    free = 1.0 - (2.0 * np.trace(used) - np.sum(used**2)) / len(target)
    share = rest / variance
    remainder = float(np.mean(share**2 * (target - terms @ mean) ** 2 / free + rest * (1.0 - share)))
    gram = weighted.T @ ((noise + remainder)[:, None] * weighted) + np.eye(len(mean))
    return mean, covariance @ gram @ covariance, remainder


def _flight_terms(
    condition: Condition,
    target: Array,
    known: Mapping[str, Array],
    step: float,
    order: int,
    centre: Array,
    scale: Array,
) -> _Flight:
    """Return a flight's error and what may explain it, by discrete sine transform, below the highest harmonic."""
    from scipy.fft import dst

    count = len(target)
    hertz = np.arange(1, count + 1) / (2.0 * (count + 1) * step)
    cut = (order + HIGHEST) * condition.turns / (count * step)
    fitted = hertz < cut
    noisy = hertz > min(NOISE_ABOVE, 0.5 * float(hertz[-1]))
    slope = 4.0 * np.sin(0.5 * np.pi * np.arange(1, count + 1) / (count + 1)) ** 2
    turned = dst(target, 1, axis=0, norm="ortho")
    noise = np.median(turned[noisy] ** 2 / slope[noisy, None], axis=0) / MEDIAN_OF_SQUARE
    regressors = weight_regressors(condition, order, centre, scale)
    terms = np.concatenate(
        [dst(part, 1, axis=0, norm="ortho")[fitted] for part in np.array_split(regressors, 8, axis=1)], axis=1
    )
    doubted = dst(condition.doubted_force(known), 1, axis=0, norm="ortho")[fitted]
    return _Flight(slope[fitted], terms, turned[fitted], doubted, noise, float(np.mean(fitted)))


def _prior(order: int, states: int) -> Array:
    """Return the variances (p,) of the weights for an error of size 1."""
    _, linear, square = (_up_to(shares(order), highest) for highest in orders(order))
    products = states * (states + 1) // 2
    return np.concatenate(
        [falling(order) ** -2.0, np.tile(LINEAR**2 * linear, states), np.tile(CURVED**2 * square, products)]
    )


def _up_to(values: Array, highest: int) -> Array:
    """Return those of mean, cosines and sines that are of no higher harmonic."""
    order = len(values) // 2
    return values[[*range(highest + 1), *range(order + 1, order + 1 + highest)]]


def _error_sizes(
    conditions: Sequence[Condition], targets: Sequence[Array], flights: Sequence[_Flight], order: int
) -> Array:
    """Return the rms size (nv,) of what repeats itself with the phase, in rows like each.

    Half of the harmonics mostly have nearly all of it, and the least of the sensors' noise. What all have counts as far
    as it is beyond `NOISE_REACHES` times what noise makes of it: a gear's teeth are in the upper half.
    """
    terms = np.concatenate([series(condition.phase, order // 2) for condition in conditions])
    target = np.concatenate(targets)
    square = np.mean((terms @ np.linalg.lstsq(terms, target, rcond=None)[0]) ** 2, axis=0)
    along = np.linalg.qr(np.concatenate([flight.terms[:, : 2 * order + 1] for flight in flights])).Q
    noise = np.concatenate([flight.noise * flight.slope[:, None] for flight in flights])
    beyond = np.sum((along.T @ np.concatenate([flight.target for flight in flights])) ** 2, axis=0)
    beyond -= NOISE_REACHES * np.sum(along**2, axis=1) @ noise
    size = np.sqrt(np.maximum(square, beyond / len(target)))
    for rows in conditions[0].alike:
        size[list(rows)] = np.sqrt(np.mean(size[list(rows)] ** 2))
    return np.asarray(size)
