"""State of the observers' kernels: the data that an observer keeps between calls."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from aerobat_pin.numerics import Array, Integers


class ObserverSizes(NamedTuple):
    """The sizes of an observer."""

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


class ObserverState(NamedTuple):
    """Data that an observer keeps between calls."""

    sizes: ObserverSizes
    robot: Annotated[Integers, "5"]  # addresses of Pinocchio's M, C, g, J and oMi
    directions: Annotated[Integers, "directions, 2"]  # for each unit vector in q: where it starts, and its size
    newest: Annotated[Integers, "1"]  # index of the newer one of the two samples
    blind: Annotated[Integers, "1"]  # number of patterns of components that left no trace in the latest interval
    slope: Annotated[Array, "1"]  # slope of a super-twisting filter [unit of the filtered quantity per second]
    gain: Annotated[Array, "filtered"]  # of the filtered quantities, or of their coordinates in `basis` [1/s]
    basis: Annotated[Array, "basis, basis"]  # orthonormal basis, one vector per column, or empty
    weight: Annotated[Array, "nv"]  # weights of the rows
    tied: Annotated[Array, "tied and nv, tied"]  # `BelievedRows.tied`, or empty
    components: Annotated[Array, "components, 11"]  # as `Applications.table`
    support: Annotated[Array, "components, nv"]  # as `Applications.support`
    # Rows as `posterior.py` names them, wide enough for three numbers; one array, as each field costs time.
    posterior: Annotated[Array, "8 * expected, nv + components + 1"]
    samples: Annotated[Array, "2, 3 + components, nv"]  # the two latest samples, as in `residual`
    filtered: Annotated[Array, "2, filtered"]  # state of the filter
    unseen: Annotated[Array, "components, components"]  # projector onto the blind patterns, if any
    fitted: Annotated[Array, "components"]  # components that explain the latest residual best
    velocity: Annotated[Array, "nv"]  # scratch, like all fields below
    value: Annotated[Array, "filtered"]
    jacobian: Annotated[Array, "components, nv"]
    given: Annotated[Array, "components + 1, nv"]  # Jacobians of the components, and a generalised force
    span: Annotated[Array, "components + 1, nv"]  # their weighted rows in use, padded with zeros
    equations: Annotated[Array, "components, components"]  # after `project` their Cholesky factor
