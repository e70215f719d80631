"""A record on its way through Pinocchio: one sample after the other, without a view of each being made."""

from __future__ import annotations

import numpy as np

from aerobat_pin.numerics import DOUBLE, Array, Integers, addresses, array_at, copy_values, inner


def open_record(q: Array, v: Array, memory: Array) -> tuple[Integers, Array, Array]:
    """Return a place for one sample of a record at a time, and the q (nq,) and v (nv,) that lie there: the first ones.

    Args:
        q: (m, nq) configurations, contiguous.
        v: (m, nv) velocities.
        memory: (m, rows, nv) to be written. The caller keeps all of these alive.
    """
    pose, rate = q[0].copy(), v[0].copy()
    sizes = np.array([0, *memory.shape, q.shape[1]])
    return np.concatenate([sizes, addresses(q, v, memory, pose, rate)]), pose, rate


@inner
def sample(place: Integers) -> tuple[Array, Array]:
    """Return the velocity (nv,) of the sample that lies there and its memory (rows, nv)."""
    rows, nv = place[2], place[3]
    memory = array_at(place[7] + DOUBLE * place[0] * rows * nv, (rows, nv))
    return array_at(place[9], (nv,)), memory


@inner
def proceed(place: Integers) -> None:
    """Put the next sample there, if there is one."""
    nv, nq = place[3], place[4]
    place[0] += 1
    if place[0] < place[1]:
        copy_values(array_at(place[5] + DOUBLE * place[0] * nq, (nq,)), array_at(place[8], (nq,)))
        copy_values(array_at(place[6] + DOUBLE * place[0] * nv, (nv,)), array_at(place[9], (nv,)))
