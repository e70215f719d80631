"""Memory of the observers' kernels: the data that an observer keeps between calls."""

from __future__ import annotations

from typing import NamedTuple

from aerobat_pin.numerics import Array, Integers, merged, next_size, rewind, take, take_integers


class ObserverSizes(NamedTuple):
    """The integers at the start of an observer's memory, in this order."""

    nv: int
    joints: int  # number of joints of the model, including the universe
    components: int
    filtered: int  # number of quantities that are filtered
    basis: int  # equal to `filtered` if the gain is a matrix, else 0
    tied: int  # number of tied rows, 0 if rows are not tied
    project_first: int  # 1 if the forces are filtered, 0 if the residual is
    rows: int  # which rows the projection uses, see `rows.ROWS`
    filter: int  # which filter, see `filters`
    directions: int  # number of quaternions and other unit vectors in a configuration
    believed: int  # number of rows in use


class ObserverMemory(NamedTuple):
    """Data that an observer keeps between calls; shapes are in `observer_fields`."""

    sizes: ObserverSizes
    robot: Integers  # addresses of Pinocchio's M, C, g, J and oMi
    record: Integers  # addresses of a record's velocities and samples, and the index of the next sample
    directions: Integers  # for each unit vector in q: where it starts, and its size
    newest: Integers  # index of the newer one of the two samples
    blind: Integers  # number of patterns of components that left no trace in the latest interval
    slope: Array  # slope of a super-twisting filter [unit of the filtered quantity per second]
    gain: Array  # gains of the filtered quantities, or of their coordinates in `basis` [1/s]
    basis: Array  # orthonormal basis, one vector per column, or empty
    weight: Array  # weights of the rows
    tied: Array  # `BelievedRows.tied`, or empty
    components: Array  # as `Applications.table`
    support: Array  # as `Applications.support`
    samples: Array  # the two latest samples, as in `residual`
    filtered: Array  # state of the filter
    unseen: Array  # projector onto the patterns that left no trace; valid if `blind` is not zero
    fitted: Array  # components that explain the latest residual best
    velocity: Array  # scratch, like all fields below
    value: Array
    jacobian: Array
    given: Array  # Jacobians of the components, and a generalised force
    span: Array  # their weighted rows in use, padded with zeros
    equations: Array  # of the components; after `project` the Cholesky factor of the equations it solved


@merged
def observer_sizes(cursor: Integers) -> ObserverSizes:
    """Read the sizes of an observer's memory."""
    return ObserverSizes(
        nv=next_size(cursor),
        joints=next_size(cursor),
        components=next_size(cursor),
        filtered=next_size(cursor),
        basis=next_size(cursor),
        tied=next_size(cursor),
        project_first=next_size(cursor),
        rows=next_size(cursor),
        filter=next_size(cursor),
        directions=next_size(cursor),
        believed=next_size(cursor),
    )


@merged
def observer_fields(cursor: Integers, sizes: ObserverSizes) -> ObserverMemory:
    """Lay out the fields of an observer after its sizes."""
    nv, c, size, tied = sizes.nv, sizes.components, sizes.filtered, sizes.nv if sizes.tied > 0 else 0
    return ObserverMemory(
        sizes=sizes,
        robot=take_integers(cursor, (5,)),
        record=take_integers(cursor, (3,)),
        directions=take_integers(cursor, (sizes.directions, 2)),
        newest=take_integers(cursor, (1,)),
        blind=take_integers(cursor, (1,)),
        slope=take(cursor, (1,)),
        gain=take(cursor, (size,)),
        basis=take(cursor, (sizes.basis, sizes.basis)),
        weight=take(cursor, (nv,)),
        tied=take(cursor, (tied, sizes.tied)),
        components=take(cursor, (c, 11)),
        support=take(cursor, (c, nv)),
        samples=take(cursor, (2, 3 + c, nv)),
        filtered=take(cursor, (2, size)),
        unseen=take(cursor, (c, c)),
        fitted=take(cursor, (c,)),
        velocity=take(cursor, (nv,)),
        value=take(cursor, (size,)),
        jacobian=take(cursor, (c, nv)),
        given=take(cursor, (c + 1, nv)),
        span=take(cursor, (c + 1, nv)),
        equations=take(cursor, (c, c)),
    )


@merged
def observer_in(memory: Array) -> ObserverMemory:
    """Lay out the memory of an observer."""
    cursor = rewind(memory)
    return observer_fields(cursor, observer_sizes(cursor))
