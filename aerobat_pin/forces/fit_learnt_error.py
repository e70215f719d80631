"""Learn the error of a belief from free flights: Bayesian least squares below the highest harmonic.

Every flight is turned by a discrete sine transform, in which the derivative of white noise of the velocity sensors has
the independent variances a 4 sin^2(pi k / 2 (m + 1)), to which b is added: what follows neither phase nor state. a is
read from frequencies in which no error of a belief is left, b from expectation and maximisation together with the
weights. For the weights b is at least 8 % of the error's size: evidence alone would believe that a few seconds
of flight show everything. What a flight is said to leave is what these were found to leave.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from aerobat_pin.forces.learnt_error import (
    CURVED,
    DAILY,
    LINEAR,
    LearntError,
    falling,
    orders,
    series,
    shares,
    weight_count,
    weight_regressors,
)
from aerobat_pin.numerics import Array
from aerobat_pin.records import Condition

LEAST_SERIES_NOISE = 0.08  # of the error's size: least rms of what a series leaves, for its weights
HIGHEST = 0.5  # cycles above the highest harmonic, up to which the flights are fitted
NOISE_ABOVE = 150.0  # [Hz]: where nothing but noise of the sensors is left; of slow records the upper half
MEDIAN_OF_SQUARE = 0.455  # of a normal variable of deviation 1
STEPS = 3  # of expectation and maximisation


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
    """Learn from flights in which no unknown force acts.

    Args:
        conditions: phase and state of each flight.
        residuals: (m, nv) generalised force that is left unexplained in each.
        known: name -> (m, nv) known forces in each.
        steps: length of an interval of each [s].
        order: highest harmonic.
    """
    values = np.concatenate([one.values for one in conditions])
    centre, scale = np.mean(values, axis=0), np.mean([one.scale for one in conditions], axis=0)
    scale = np.where(scale > 0.0, scale, 1.0)
    targets = [one.reduced(residual) for one, residual in zip(conditions, residuals, strict=True)]
    size = _error_sizes(conditions, targets, order)
    flights = [_flight_terms(*one, order, centre, scale) for one in zip(conditions, targets, known, steps, strict=True)]
    count, width = weight_count(order, len(centre)), 2 * order + 1
    prior = np.concatenate([_prior(order, len(centre)), np.tile(DAILY**2 * shares(order), len(flights))])
    terms = np.zeros((sum(len(one.slope) for one in flights), count + width * len(flights)))
    at = 0
    for j, one in enumerate(flights):
        rows = slice(at, at + len(one.slope))
        terms[rows, :count] = one.terms
        terms[rows, count + width * j : count + width * (j + 1)] = one.terms[:, :width]
        at += len(one.slope)
    terms *= np.sqrt(prior)
    target, doubted = (np.concatenate([getattr(one, name) for one in flights]) for name in ("target", "doubted"))
    share = _share(target, doubted, size)
    target -= share * doubted
    mean, covariance = np.zeros((count, len(size))), np.zeros((len(size), count, count))
    left = np.zeros(len(size))
    for i in np.flatnonzero(size > 0.0):
        noise = np.concatenate([one.noise[i] * one.slope for one in flights]) / size[i] ** 2
        found, spread, rest = _weights(terms, target[:, i] / size[i], noise)
        root = size[i] * np.sqrt(prior[:count])
        mean[:, i], covariance[i] = root * found[:count], np.outer(root, root) * spread[:count, :count]
        left[i] = size[i] * np.sqrt(rest * np.mean([one.share for one in flights]))
    return LearntError(order, conditions[0].states, share, centre, scale, size, mean, covariance, left)


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
    left = float(np.mean(share**2 * (target - terms @ mean) ** 2 / free + rest * (1.0 - share)))
    told = weighted.T @ ((noise + left)[:, None] * weighted) + np.eye(len(mean))
    return mean, covariance @ told @ covariance, left


def _flight_terms(
    condition: Condition,
    target: Array,
    known: Mapping[str, Array],
    step: float,
    order: int,
    centre: Array,
    scale: Array,
) -> _Flight:
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


def _error_sizes(conditions: Sequence[Condition], targets: Sequence[Array], order: int) -> Array:
    """Return the rms size (nv,) of what repeats itself with the phase, in rows like each.

    Half of the harmonics have nearly all of it, and the least of the sensors' noise.
    """
    terms = np.concatenate([series(one.phase, order // 2) for one in conditions])
    target = np.concatenate(targets)
    size = np.sqrt(np.mean((terms @ np.linalg.lstsq(terms, target, rcond=None)[0]) ** 2, axis=0))
    for rows in conditions[0].alike:
        size[list(rows)] = np.sqrt(np.mean(size[list(rows)] ** 2))
    return np.asarray(size)
