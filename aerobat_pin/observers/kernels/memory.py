"""What an observer keeps between calls: the memory of its kernels."""

from __future__ import annotations

from typing import NamedTuple

from aerobat_pin.numerics import Array, Integers, merged, next_size, rewind, take, take_integers


class ObserverSizes(NamedTuple):
    """The integers at the head of an observer's memory, in their order."""

    nv: int
    joints: int  # of the model, the universe included
    components: int
    filtered: int  # quantities that are filtered
    basis: int  # as many where they are filtered in coordinates of their own, else 0
    metric: int  # nv where rows are tied, else 0
    project_first: int  # whether forces are filtered (1) or the residual (0)
    rows: int  # which rows the projection believes, see `rows.ROWS`
    filter: int  # which filter, see `filters`


class ObserverMemory(NamedTuple):
    """What an observer keeps between calls; c components, `size` filtered quantities.

    Attributes:
        sizes: and the choices that go with them.
        robot: (5,) addresses of Pinocchio's M, C, g, J and oMi.
        newest: (1,) which of the two samples is the newer.
        slope: (1,) of a super-twisting filter [unit of the filtered/s].
        gain: (size,) of the filtered quantities, in the coordinates of `basis`.
        basis: (size, size) whose columns they are, or empty.
        weight: (nv,) of the rows.
        metric: (nv, nv) of tied rows, or empty.
        components: (c, 11) as in `Applications.table`.
        support: (c, nv) as in `Applications.support`.
        samples: (2, 3 + c, nv).
        filtered: (2, size) the filter's state.
        velocity: (nv,) scratch, as are value (size,), jacobian (c, nv) and equations (c, c).
    """

    sizes: ObserverSizes
    robot: Integers
    newest: Integers
    slope: Array
    gain: Array
    basis: Array
    weight: Array
    metric: Array
    components: Array
    support: Array
    samples: Array
    filtered: Array
    velocity: Array
    value: Array
    jacobian: Array
    equations: Array


@merged
def observer_sizes(cursor: Integers) -> ObserverSizes:
    """Read the sizes of an observer's memory."""
    return ObserverSizes(
        nv=next_size(cursor),
        joints=next_size(cursor),
        components=next_size(cursor),
        filtered=next_size(cursor),
        basis=next_size(cursor),
        metric=next_size(cursor),
        project_first=next_size(cursor),
        rows=next_size(cursor),
        filter=next_size(cursor),
    )


@merged
def observer_fields(cursor: Integers, sizes: ObserverSizes) -> ObserverMemory:
    """Lay out an observer's fields behind the sizes."""
    nv, c, size = sizes.nv, sizes.components, sizes.filtered
    return ObserverMemory(
        sizes=sizes,
        robot=take_integers(cursor, (5,)),
        newest=take_integers(cursor, (1,)),
        slope=take(cursor, (1,)),
        gain=take(cursor, (size,)),
        basis=take(cursor, (sizes.basis, sizes.basis)),
        weight=take(cursor, (nv,)),
        metric=take(cursor, (sizes.metric, sizes.metric)),
        components=take(cursor, (c, 11)),
        support=take(cursor, (c, nv)),
        samples=take(cursor, (2, 3 + c, nv)),
        filtered=take(cursor, (2, size)),
        velocity=take(cursor, (nv,)),
        value=take(cursor, (size,)),
        jacobian=take(cursor, (c, nv)),
        equations=take(cursor, (c, c)),
    )


@merged
def observer_in(memory: Array) -> ObserverMemory:
    """Lay out an observer's memory."""
    cursor = rewind(memory)
    return observer_fields(cursor, observer_sizes(cursor))
