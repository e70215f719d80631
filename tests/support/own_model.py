"""Draw truths from the joint smoother's own linear model, to see whether its deviations are those of its errors."""

from dataclasses import replace

import numpy as np

from aerobat_pin.aerobat.raw.layout import Prior, prior_at
from aerobat_pin.aerobat.raw.linear import LinearRecord
from aerobat_pin.aerobat.raw.tuning import Tuning, white_variance
from aerobat_pin.numerics import Array


def own_model_errors(linear: LinearRecord, prior: Prior, tuning: Tuning, rng: np.random.Generator) -> dict[str, Array]:
    """Return normalised squared errors (m,) and errors over deviations (m, b) of the slow forces: filter, smoother."""
    # The truth and its samples are drawn from the linear model with the covariances that the recursion assumes.
    d, rows, layout, n = linear.dynamics, linear.rows, linear.layout, linear.layout.size
    m, white, walk = len(d.push), layout.white, layout.walk
    P0, noise = prior.covariance.copy(), linear.noise(tuning)
    P0[white, :] = P0[:, white] = 0.0
    first = white_variance(tuning, np.diff(linear.nominal.time[:2]))[0]
    P0[white, white] = np.diag(np.tile(first, layout.points))
    x = np.sqrt(np.diag(P0)) * rng.standard_normal(n)
    true, e = np.empty((m + 1, n)), np.empty(len(rows.e))
    for k in range(m + 1):
        true[k] = x
        at = slice(rows.start[k], rows.start[k + 1])
        e[at] = rows.h[at] @ x + np.sqrt(rows.R[at]) * rng.standard_normal(at.stop - at.start)
        if k < m:
            following = x.copy()
            following[: len(d.shift[k])] = d.transition[k] @ x + d.shift[k]
            following[white] = 0.0
            x = following + np.sqrt(noise[k]) * rng.standard_normal(n)
    here = prior_at(linear.nominal, 0, np.zeros(n), prior.covariance)
    drawn = replace(linear, rows=rows._replace(e=e)).smooth(tuning, here, blocks=True)
    filtered, spread = drawn.filtered.states[:, walk], drawn.filtered.covariances[:, walk, walk]
    made = {}
    for name, found, covariance in (("filter", filtered, spread), ("smoother", drawn.states[:, walk], drawn.blocks)):
        error = found - true[:, walk]
        size = error.shape[1]
        made[f"{name}_nees"] = np.einsum("ki,kij,kj->k", error, np.linalg.inv(covariance), error) / size
        made[f"{name}_z"] = error / np.sqrt(np.einsum("kii->ki", covariance))
    return made
