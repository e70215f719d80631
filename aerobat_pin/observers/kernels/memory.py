"""What an observer keeps between calls, as one flat array for its kernels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from aerobat_pin.numerics import DOUBLE, Array, Integers, array_at, kernel


class Store(NamedTuple):
    """What an observer keeps between calls. The kernels get it as one flat array, since each array costs a call time.

    `flags` (5,): which of the two memories is the newer, whether to project first, which rows to project, the kind of
    filter, and its slope [unit of the filtered/s]. `gain` (size,) of the filtered quantities, in the coordinates of
    `basis` (size, size), whose columns they are; empty for their own. `weight` (nv,) of the rows; `metric` (nv, nv)
    of tied rows, else empty. `components` (c, 11) and `support` (c, nv) as in `applications`. `memory` (2, 3 + c, nv):
    samples. `filtered` (2, size): the filter. `velocity` (nv,), `value` (size,), `jacobian` (c, nv) and `equations`
    (c, c): scratch.
    """

    flags: Array
    gain: Array
    basis: Array
    weight: Array
    metric: Array
    components: Array
    support: Array
    memory: Array
    filtered: Array
    velocity: Array
    value: Array
    jacobian: Array
    equations: Array


def new_store(
    places: Integers,
    gain: Array,
    basis: Array,
    believed: tuple[Array, Array, int],
    components: Array,
    support: Array,
    *,
    project_first: bool,
    kind: int,
    slope: float,
) -> Array:
    """Return a store as its flat array, with an empty memory and the filter at zero.

    It is headed by the six integers of `look`, bit for bit in the place of doubles, and by the sizes. `believed` are
    the weight and the metric of the rows, and their number.
    """
    weight, metric, rows = believed
    nv, c, size = len(weight), len(components), len(gain)
    head = (nv, c, size, len(basis), len(metric), 0, project_first, rows, kind, slope)
    empty = np.zeros(2 * (3 + c) * nv + 2 * size + nv + size + c * nv + c * c)
    arrays = (gain, basis, weight, metric, components, support, empty)
    return np.concatenate([places.view(float), np.array(head, float), *(np.ravel(one) for one in arrays)])


@kernel
def unpack(flat: Array) -> Store:
    """Give the flat store its names and shapes, without copying."""
    nv, n, size, own, tied = int(flat[6]), int(flat[7]), int(flat[8]), int(flat[9]), int(flat[10])
    head = flat.ctypes.data
    a = head + DOUBLE * 16
    b = a + DOUBLE * size
    c = b + DOUBLE * own * own
    d = c + DOUBLE * nv
    e = d + DOUBLE * tied * tied
    f = e + DOUBLE * 11 * n
    g = f + DOUBLE * n * nv
    h = g + DOUBLE * 2 * (3 + n) * nv
    i = h + DOUBLE * 2 * size
    j = i + DOUBLE * nv
    k = j + DOUBLE * size
    m = k + DOUBLE * n * nv
    return Store(
        array_at(head + DOUBLE * 11, (5,)),
        array_at(a, (size,)),
        array_at(b, (own, own)),
        array_at(c, (nv,)),
        array_at(d, (tied, tied)),
        array_at(e, (n, 11)),
        array_at(f, (n, nv)),
        array_at(g, (2, 3 + n, nv)),
        array_at(h, (2, size)),
        array_at(i, (nv,)),
        array_at(j, (size,)),
        array_at(k, (n, nv)),
        array_at(m, (n, n)),
    )
