"""Jumps of the forces: where the samples ask for a sudden change that no walk explains.

A force that is taken up or let go, or a gust's edge, changes at once. Walk and slope chosen to follow that would follow
noise everywhere else. With the adjoint l before a knot and its covariance N (`recursion`), a jump there with covariance
J makes the samples likelier by

    gain = l^T (N + J^-1)^-1 l / 2 - log det(1 + J N) / 2

(P. de Jong and J. Penzer, Diagnosing shocks in time series, J. American Statistical Association 93, 1998). Jumps whose
gain is large are let into the model: the walk's variance is larger by J in that interval.
"""

from __future__ import annotations

import numpy as np

from aerobat_pin.aerobat.raw.recursion import Smoothed
from aerobat_pin.numerics import Array

JUMP = 0.5  # of the robot's weight: deviation of a jump
LEAST_JUMP_GAIN = 10.0  # of the log-likelihood: one in 20,000 knots is taken to have a jump
APART = 0.02  # [s] between two jumps that are found at once


def jump_gains(smoothed: Smoothed, forces: slice, variance: float) -> Array:
    """Return what a jump in each interval (m,) would gain in log-likelihood."""
    pull, information = smoothed.pulls[1:, forces], smoothed.inside[1:]
    size = np.eye(pull.shape[1])
    answer = np.linalg.solve(information + size / variance, pull[:, :, None])[:, :, 0]
    return np.asarray(
        0.5 * np.einsum("ki,ki->k", pull, answer) - 0.5 * np.linalg.slogdet(size + variance * information)[1]
    )


def more_jumps(smoothed: Smoothed, forces: slice, time: Array, jumps: Array, weight: float) -> Array:
    """Return the variances of jumps (m,) with those added that the samples still ask for; see `LinearRecord.jumps`."""
    variance = (JUMP * weight) ** 2
    gains, found = jump_gains(smoothed, forces, variance), jumps.copy()
    gains[jumps > 0.0] = 0.0
    while np.max(gains) > LEAST_JUMP_GAIN:
        k = int(np.argmax(gains))
        found[k] = variance
        gains[np.abs(time[:-1] - time[k]) < APART] = 0.0
    return found
