"""What a Kalman filter keeps between calls, as one flat array for its kernels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from aerobat_pin.arrays import Array
from aerobat_pin.jit import kernel

NEWER, WALK_PER_SAMPLE, HEAD_START, PULSATION, MASS, MISFIT, POWER, ELAPSED = range(8)  # of the settings
SETTINGS = 8


class Filter(NamedTuple):
    """What a filter keeps between calls, as one flat array behind an observer's own store.

    `settings` (8,): which memory is the newer; whether the walk's variance grows with dt^2 instead of dt; by how much
    it leads at the first interval [s]; the harmonics' pulsation [rad/s], 0 for none; whether the last coefficient is
    an error of the mass; the misfit [sqrt(s)]; whether the joints' power is known where their torques are not; time
    since the start [s]. `noise` (nv,): the sensors' standard deviations. `rate`, `variance` (nz,): of coefficients
    that decay, 0 for those that walk. `walk` (c, c) of the components. `hidden` (nv, nv): projector on generalised
    forces of which nothing is known, or empty. `errors` (ne, nv): known forces whose size is in doubt, in this
    interval. `doubt` (nv,): running mean square of what may be wrong with them. `x` (n,), `P` (n, n): the estimate and
    its covariance. `memory` (2, 3 + c + nv, nv): samples, as in `kernels`, followed by B^T. `step`: the latest `Step`,
    flat.
    """

    settings: Array
    noise: Array
    rate: Array
    variance: Array
    walk: Array
    hidden: Array
    errors: Array
    doubt: Array
    x: Array
    P: Array
    memory: Array
    step: Array


class Step(NamedTuple):
    """What one interval leaves behind for its smoothing.

    `shear` (nz, nv): dt G. `decay` (nz,): a. `L` (nv, nv): lower Cholesky factor of S. `T` (nv, n): L^-1 P_p. `e`
    (nv,): the whitened innovation. `basis` (h,): weight of each block of c coefficients in the forces. `z` (h c,),
    `Z` (h c, n): these blocks' part of x and P after the update.
    """

    shear: Array
    decay: Array
    L: Array
    T: Array
    e: Array
    basis: Array
    z: Array
    Z: Array


def new_filter(store: Array, noise: Array, hidden: Array, c: int, blocks: int, errors: int, mass: bool) -> Array:
    """Append a filter without noise, at zero, to an observer's flat store; `unpack` names its parts.

    Args:
        store: the observer's.
        noise: (nv,) standard deviations of the sensors.
        hidden: (nv, nv), or (0, 0).
        c: number of unknown components.
        blocks: 1, or 3 with harmonics.
        errors: number of known forces whose size is in doubt.
        mass: whether the mass is in doubt.
    """
    nv, nz = len(noise), blocks * c + errors + mass
    n = nv + nz
    step = nz * nv + nz + nv * nv + nv * n + nv + blocks + blocks * c + blocks * c * n
    size = SETTINGS + nv + 2 * nz + c * c + hidden.size + errors * nv + nv + n + n * n + 2 * (3 + c + nv) * nv + step
    flat = np.concatenate([store, np.zeros(size), [nv, c, errors, nz, len(hidden), len(store)]])
    filter_ = unpack(flat)
    filter_.settings[MASS] = mass
    filter_.noise[:] = noise
    filter_.hidden[:] = hidden
    return flat


@kernel
def unpack(flat: Array) -> Filter:
    """Give the flat filter its names and shapes, without copying."""
    end = flat.shape[0] - 6
    nv, c, ne = int(flat[end]), int(flat[end + 1]), int(flat[end + 2])
    nz, unseen, start = int(flat[end + 3]), int(flat[end + 4]), int(flat[end + 5])
    n = nv + nz
    a = start + SETTINGS
    b = a + nv
    d = b + 2 * nz
    e = d + c * c
    f = e + unseen * unseen
    g = f + ne * nv
    h = g + nv
    i = h + n
    j = i + n * n
    k = j + 2 * (3 + c + nv) * nv
    return Filter(
        flat[start:a],
        flat[a:b],
        flat[b : b + nz],
        flat[b + nz : d],
        flat[d:e].reshape((c, c)),
        flat[e:f].reshape((unseen, unseen)),
        flat[f:g].reshape((ne, nv)),
        flat[g:h],
        flat[h:i],
        flat[i:j].reshape((n, n)),
        flat[j:k].reshape((2, 3 + c + nv, nv)),
        flat[k:end],
    )


@kernel
def unpack_step(flat: Array, nv: int, nz: int, c: int, harmonic: bool) -> Step:
    """Give a flat step its names and shapes, without copying."""
    blocks = 3 if harmonic else 1
    n, h = nv + nz, blocks * c
    a = nz * nv
    b = a + nz
    d = b + nv * nv
    e = d + nv * n
    f = e + nv
    g = f + blocks
    i = g + h
    return Step(
        flat[:a].reshape((nz, nv)),
        flat[a:b],
        flat[b:d].reshape((nv, nv)),
        flat[d:e].reshape((nv, n)),
        flat[e:f],
        flat[f:g],
        flat[g:i],
        flat[i:].reshape((h, n)),
    )
