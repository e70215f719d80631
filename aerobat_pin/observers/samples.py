"""What an observer accepts: gains, records of finite numbers, configurations of the model, and samples of others."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike
from pinocchio import computeCoriolisMatrix, computeGeneralizedGravity, crba

from aerobat_pin.errors import ObserverError, ShapeError
from aerobat_pin.numerics import LARGEST_REAL, Array, checked_shape, real_numbers
from aerobat_pin.observers.applications import Application
from aerobat_pin.observers.kernels.residual import FARTHEST, LENGTH_TOLERANCE
from aerobat_pin.observers.momentum_equations import Samples

# Number of last coordinates of a joint that form a unit vector: a quaternion, or a cosine and a sine.
DIRECTIONS = {"JointModelFreeFlyer": 4, "JointModelSpherical": 4, "JointModelPlanar": 2} | dict.fromkeys(
    ("JointModelRUBX", "JointModelRUBY", "JointModelRUBZ", "JointModelRevoluteUnboundedUnaligned"), 2
)


class Sampled(NamedTuple):
    """What an observer took from a record: for others that look for the same forces, on the same model and record."""

    model: pin.Model  # the robot's, whose joints have axes fixed in the links that they carry (`serial_model`)
    applications: tuple[Application, ...]  # where forces are sought
    samples: Samples  # momentum, drift, velocity and Jacobians at the record's m + 1 samples, see `Samples`


def compute_dynamics(model: pin.Model, data: pin.Data, q: Array, v: Array) -> None:
    """Let Pinocchio compute M, C, g, the world Jacobians and the placements, which the kernels read."""
    crba(model, data, q)
    computeCoriolisMatrix(model, data, q, v)
    computeGeneralizedGravity(model, data, q)


def modes(gain: Array, size: int) -> tuple[Array, Array]:
    """Split a gain into gains (size,) and the orthonormal basis (size, size) in which they act.

    The basis is empty unless the gain is a matrix. Raises ObserverError if the gain does not fit or is not positive.
    """
    if gain.shape not in ((), (size,), (size, size)):
        raise ObserverError(
            f"gain of shape {gain.shape}: one number, {size} numbers or a matrix of {size} x {size} were expected"
        )
    gains, basis = gain, np.zeros((0, 0))
    if gain.ndim == 2 and np.all(np.isfinite(gain)):
        if not np.allclose(gain, gain.T, rtol=1e-9, atol=0.0):
            raise ObserverError("gain matrix: a symmetric one was expected")
        gains, basis = np.linalg.eigh(gain)
    if not (np.all(gains > 0.0) and np.all(gains <= LARGEST_REAL)):
        raise ObserverError(f"gain = {gain}: a finite positive gain in 1/s was expected")
    return np.array(np.broadcast_to(gains, (size,))), basis


def directions_of(model: pin.Model) -> list[tuple[int, int]]:
    """Return where in a configuration a quaternion or a pair (cosine, sine) starts, and its size."""
    sized = ((joint.idx_q + joint.nq, DIRECTIONS.get(joint.shortname(), 0)) for joint in model.joints)
    return [(end - size, size) for end, size in sized if size]


def check_configurations(directions: list[tuple[int, int]], q: Array) -> None:
    """Raise ShapeError for a coordinate of q (m, nq) that is too far, or a direction that has not length one.

    The kernel `is_configuration` checks those of a stream.
    """
    for start, size in directions:
        length = np.linalg.norm(q[:, start : start + size], axis=1)
        if not np.all(np.abs(length - 1.0) < LENGTH_TOLERANCE):
            row = int(np.argmax(np.abs(length - 1.0)))
            part = f"q[{start}:{start + size}] of sample {row}"
            raise ShapeError(f"{part} has length {length[row]:.3g}: 1 was expected")
    if not np.all(np.abs(q) <= FARTHEST):
        row, at = divmod(int(np.argmax(np.abs(q))), q.shape[1])
        raise ShapeError(f"q[{at}] of sample {row} = {q[row, at]:g}: at most {FARTHEST:g} m or rad was expected")


def for_kernels(values: ArrayLike) -> Array:
    """Return an array that is contiguous and can be written: a kernel is compiled once more for any other kind."""
    return np.require(values, requirements=["C", "W"])


def checked_record(values: ArrayLike, rows: int, columns: int, name: str) -> Array:
    """Return a record as a (rows, columns) array of finite doubles for kernels. Raises ShapeError with `name`."""
    table = real_numbers(values, name)
    checked_shape(table, (len(table) if table.ndim == 2 else rows, columns), name)
    if len(table) != rows:
        raise ShapeError(f"{name} has {len(table)} rows: {rows} were expected")
    if not np.all(np.abs(table) <= LARGEST_REAL):
        row = int(np.argmin(np.all(np.abs(table) <= LARGEST_REAL, axis=1)))
        raise ShapeError(f"{name} holds NaN or infinity in row {row}, or a number beyond {LARGEST_REAL:g}")
    return for_kernels(table)


def checked_inputs(
    model: pin.Model,
    directions: list[tuple[int, int]],
    time: ArrayLike,
    q: ArrayLike,
    v: ArrayLike,
    tau: ArrayLike,
    known: Mapping[str, ArrayLike],
) -> tuple[Array, Array, Array, Array]:
    """Return what `Observer.run` takes for kernels: time, q, v and the sum of the known forces. Raises ShapeError."""
    time = for_kernels(time)
    if time.ndim != 1 or len(time) < 2:
        raise ShapeError(f"time has shape {time.shape}: two samples or more were expected")
    count, nq, nv = len(time) - 1, int(model.nq), int(model.nv)
    q, v = checked_record(q, count + 1, nq, "q"), checked_record(v, count + 1, nv, "v")
    check_configurations(directions, q)
    u = checked_record(tau, count, nv, "tau")
    for name, force in known.items():
        u = u + checked_record(force, count, nv, name)
    return time, q, v, u
