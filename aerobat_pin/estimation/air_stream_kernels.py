"""The compiled part of `air_stream`: what happens between Pinocchio's calls in an interval between two samples."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from aerobat_pin.estimation.believed_air_kernels import advance_air_stage
from aerobat_pin.numerics import Array, array_at, copy_values, kernel, layout_of, merged, next_size, rewind

BASE, PLACE = 6, 7  # rows of the base in v and in q


class Stream(NamedTuple):
    """Memory of a stream; the robot in air has a memory of its own, at the address `air`.

    `q`, `v`, `wind` are those of the sample before; `last_wind` is the newest one, which the caller writes where it
    changes. `dt` is the time between samples [s], `acceleration` and `means` belong to the interval, `velocity` and
    `here` to an instant in it.
    """

    air: int
    dt: Annotated[Array, ""]
    q: Annotated[Array, "nq"]
    v: Annotated[Array, "nv"]
    wind: Annotated[Array, "2, 3"]
    last_wind: Annotated[Array, "2, 3"]
    acceleration: Annotated[Array, "nv"]
    means: Annotated[Array, "2, nv"]
    velocity: Annotated[Array, "nv"]
    here: Annotated[Array, "2, 3"]


stream_fields = layout_of(Stream, "air", "nq", "nv")


@merged
def stream_in(memory: Array) -> Stream:
    """Lay out a stream's memory. Sizes: address of the memory of the robot in air, nq, nv."""
    cursor = rewind(memory)
    return stream_fields(cursor, next_size(cursor), next_size(cursor), next_size(cursor))


@kernel
def air_at(memory: Array, q: Array, v: Array, half: int, count: int, middle: Array) -> None:
    """Add the forces at a place of an interval to its means, and move on by half a step.

    Pinocchio's `nonLinearEffects` must have been called for the motion at this place.

    Args:
        memory: see `stream_in`.
        q: (nq,) configuration at the interval's end.
        v: (nv,) velocity there.
        half: number of half steps from the interval's start to this place.
        count: number of steps in the interval.
        middle: (nq,) configuration at the next place, on the straight line between the samples; its joints are put on
            the cubic, and `velocity` is the velocity there. Not used where that is the end, or after it.
    """
    stream = stream_in(memory)
    air, length, nv = array_at(stream.air, (1,)), float(stream.dt[()]) / count, v.shape[0]
    means, here = stream.means, stream.here
    if half == 0:
        for i in range(nv):
            stream.acceleration[i] = (v[i] - stream.v[i]) / stream.dt[()]
            means[0, i], means[1, i] = 0.0, 0.0
        blend_winds(stream, 0.0)
    if half % 2 == 1:
        advance_air_stage(air, here, stream.acceleration, length, 1, means)
    elif half > 0:
        advance_air_stage(air, here, stream.acceleration, length, 2, means)
    if half == 2 * count:
        for i in range(nv):
            means[0, i] /= count
            means[1, i] /= count
        copy_values(q, stream.q)
        copy_values(v, stream.v)
        for i in range(2):
            copy_values(stream.last_wind[i], stream.wind[i])
        return
    if half % 2 == 0:
        advance_air_stage(air, here, stream.acceleration, length, 0, means)
    share = 0.5 * (half + 1) / count
    blend_winds(stream, share)
    if half + 1 < 2 * count:
        for i in range(nv):
            stream.velocity[i] = stream.v[i] + share * (v[i] - stream.v[i])
        for i in range(q.shape[0] - PLACE):
            gap = q[PLACE + i] - stream.q[PLACE + i]  # bend and twist: the slopes less the chord's, over the interval
            bend, twist = gap - stream.dt[()] * stream.v[BASE + i], gap - stream.dt[()] * v[BASE + i]
            middle[PLACE + i] -= share * (1.0 - share) * ((1.0 - share) * bend - share * twist)


@merged
def blend_winds(stream: Stream, share: float) -> None:
    """Write the wind at a share of the interval to `here`."""
    for i in range(2):
        for j in range(3):
            stream.here[i, j] = stream.wind[i, j] + share * (stream.last_wind[i, j] - stream.wind[i, j])
