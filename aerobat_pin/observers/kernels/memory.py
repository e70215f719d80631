"""Memory of the observers' kernels: the data that an observer keeps between calls."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from aerobat_pin.numerics import Array, Integers, layout_of, merged, rewind


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
    expected: int  # 1 if sizes of forces and errors of rows are expected, see `posterior`, else 0


class ObserverMemory(NamedTuple):
    """Data that an observer keeps between calls."""

    sizes: ObserverSizes
    robot: Annotated[Integers, "5"]  # addresses of Pinocchio's M, C, g, J and oMi
    record: Annotated[Integers, "3"]  # addresses of a record's velocities and samples, and the index of the next sample
    directions: Annotated[Integers, "sizes.directions, 2"]  # for each unit vector in q: where it starts, and its size
    newest: Annotated[Integers, "1"]  # index of the newer one of the two samples
    blind: Annotated[Integers, "1"]  # number of patterns of components that left no trace in the latest interval
    slope: Annotated[Array, "1"]  # slope of a super-twisting filter [unit of the filtered quantity per second]
    gain: Annotated[Array, "sizes.filtered"]  # of the filtered quantities, or of their coordinates in `basis` [1/s]
    basis: Annotated[Array, "sizes.basis, sizes.basis"]  # orthonormal basis, one vector per column, or empty
    weight: Annotated[Array, "sizes.nv"]  # weights of the rows
    tied: Annotated[Array, "sizes.nv * min(sizes.tied, 1), sizes.tied"]  # `BelievedRows.tied`, or empty
    components: Annotated[Array, "sizes.components, 11"]  # as `Applications.table`
    support: Annotated[Array, "sizes.components, sizes.nv"]  # as `Applications.support`
    # Rows as `posterior.py` names them, wide enough for three numbers; one array, as each field costs time.
    posterior: Annotated[Array, "8 * sizes.expected, sizes.nv + sizes.components + 1"]
    samples: Annotated[Array, "2, 3 + sizes.components, sizes.nv"]  # the two latest samples, as in `residual`
    filtered: Annotated[Array, "2, sizes.filtered"]  # state of the filter
    unseen: Annotated[Array, "sizes.components, sizes.components"]  # projector onto the blind patterns, if any
    fitted: Annotated[Array, "sizes.components"]  # components that explain the latest residual best
    velocity: Annotated[Array, "sizes.nv"]  # scratch, like all fields below
    value: Annotated[Array, "sizes.filtered"]
    jacobian: Annotated[Array, "sizes.components, sizes.nv"]
    given: Annotated[Array, "sizes.components + 1, sizes.nv"]  # Jacobians of the components, and a generalised force
    span: Annotated[Array, "sizes.components + 1, sizes.nv"]  # their weighted rows in use, padded with zeros
    equations: Annotated[Array, "sizes.components, sizes.components"]  # after `project` their Cholesky factor


observer_sizes = layout_of(ObserverSizes)
observer_fields = layout_of(ObserverMemory, "sizes")


@merged
def observer_in(memory: Array) -> ObserverMemory:
    """Lay out the memory of an observer."""
    cursor = rewind(memory)
    return observer_fields(cursor, observer_sizes(cursor))
