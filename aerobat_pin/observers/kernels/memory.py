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
    """What an observer keeps between calls; `observer_fields` says the shapes."""

    sizes: ObserverSizes
    robot: Integers  # addresses of Pinocchio's M, C, g, J and oMi
    record: Integers  # addresses of a record's velocities and samples, and which one is next
    newest: Integers  # which of the two samples is the newer
    slope: Array  # of a super-twisting filter [unit of the filtered/s]
    gain: Array  # of the filtered quantities, in the coordinates of `basis` [1/s]
    basis: Array  # whose columns these coordinates are, or empty
    weight: Array  # of the rows
    metric: Array  # of tied rows, or empty
    components: Array  # as `Applications.table`
    support: Array  # as `Applications.support`
    samples: Array  # as in `residual`
    filtered: Array  # the filter's state
    velocity: Array  # scratch, like all that follows
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
        record=take_integers(cursor, (3,)),
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
