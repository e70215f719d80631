"""What a Kalman filter keeps between calls, as one flat array for its kernels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from aerobat_pin.numerics import DOUBLE, Array, array_at, kernel

NEWER, FOLLOWED, HEAD_START, PULSATION, MASS, MISFIT, POWER, ELAPSED = range(8)  # of the settings
SETTINGS = 8


class Filter(NamedTuple):
    """What a filter keeps between calls, as one flat array behind an observer's own store.

    `settings` (8,): which memory is the newer; the power of a gain that sets the walk, 0 for a walk that is given; by
    how much it leads at the first interval [s]; the harmonics' pulsation [rad/s], 0 for none; whether the last
    coefficient is an error of the mass; the misfit [sqrt(s)]; whether the joints' power is known where their torques
    are not; time since the start [s]. `noise` (nv,): the sensors' standard deviations. `rate`, `variance` (nz,): of
    coefficients that decay, 0 for those that walk. `walk` (c, c) of the components. `scale` (c,): their units. `seen`
    (c, 2 c): scratch. `hidden` (nv, nv): projector on generalised forces of which nothing is known, or empty. `errors`
    (ne, nv): known forces whose size is in doubt, in this interval. `doubt` (nv,): running mean square of what may be
    wrong with them. `x` (n,), `P` (n, n): the estimate and its covariance. `memory` (2, 3 + c + nv, nv): samples, as in
    `kernels`, followed by B^T. `step`: the latest `Step`, flat.
    """

    settings: Array
    noise: Array
    rate: Array
    variance: Array
    walk: Array
    scale: Array
    seen: Array
    hidden: Array
    errors: Array
    doubt: Array
    x: Array
    P: Array
    memory: Array
    step: Array


class Step(NamedTuple):
    """What one interval leaves behind for its smoothing.

    `shear` (nz, n): dt G, then zeros. `decay` (nz,): a. `e` (nv,): the innovation. `rows` (nv, ...): S (nv, nv), P_p
    and [1, 0] (nv, n), and e; after the update, with S = L L^T, L^-1 times all that: L^T, T, L^-1, e whitened. `basis`:
    weight of each block of c coefficients in the forces. `z` (h c,), `Z` (h c, n): these blocks' part of x and P after
    the update. Zeros and a rounded width are there because a product of whole vectors costs less than one of parts.
    """

    shear: Array
    decay: Array
    e: Array
    rows: Array
    basis: Array
    z: Array
    Z: Array


@kernel
def columns(nv: int, nz: int) -> int:
    """Return the width of a step's `rows`, rounded up to what a processor's vectors hold."""
    return (nv + 2 * (nv + nz) + 8) // 8 * 8


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
    step = nz * n + nz + nv + nv * columns(nv, nz) + blocks + blocks * c + blocks * c * n
    size = (
        SETTINGS
        + nv
        + 2 * nz
        + 3 * c * c
        + c
        + hidden.size
        + errors * nv
        + nv
        + n
        + n * n
        + 2 * (3 + c + nv) * nv
        + step
    )
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
    head = flat.ctypes.data + DOUBLE * start
    a = head + DOUBLE * SETTINGS
    b = a + DOUBLE * nv
    d = b + DOUBLE * 2 * nz
    m = d + DOUBLE * c * c
    p = m + DOUBLE * c
    e = p + DOUBLE * 2 * c * c
    f = e + DOUBLE * unseen * unseen
    g = f + DOUBLE * ne * nv
    h = g + DOUBLE * nv
    i = h + DOUBLE * n
    j = i + DOUBLE * n * n
    k = j + DOUBLE * 2 * (3 + c + nv) * nv
    return Filter(
        array_at(head, (SETTINGS,)),
        array_at(a, (nv,)),
        array_at(b, (nz,)),
        array_at(b + DOUBLE * nz, (nz,)),
        array_at(d, (c, c)),
        array_at(m, (c,)),
        array_at(p, (c, 2 * c)),
        array_at(e, (unseen, unseen)),
        array_at(f, (ne, nv)),
        array_at(g, (nv,)),
        array_at(h, (n,)),
        array_at(i, (n, n)),
        array_at(j, (2, 3 + c + nv, nv)),
        array_at(k, (end - (k - flat.ctypes.data) // DOUBLE,)),
    )


@kernel
def unpack_step(flat: Array, filter_: Filter) -> Step:
    """Give a filter's flat step its names and shapes, without copying."""
    n, nv, blocks = filter_.x.shape[0], filter_.noise.shape[0], 3 if filter_.settings[PULSATION] > 0.0 else 1
    nz, h = n - nv, blocks * filter_.walk.shape[0]
    a = flat.ctypes.data
    b = a + DOUBLE * nz * n
    d = b + DOUBLE * (nz + nv)
    width = columns(nv, nz)
    e = d + DOUBLE * nv * width
    f = e + DOUBLE * blocks
    g = f + DOUBLE * h
    return Step(
        array_at(a, (nz, n)),
        array_at(b, (nz,)),
        array_at(b + DOUBLE * nz, (nv,)),
        array_at(d, (nv, width)),
        array_at(e, (blocks,)),
        array_at(f, (h,)),
        array_at(g, (h, n)),
    )
