"""Whether another zero of a joint explains what forces and friction leave: an encoder's offset.

    y = J^T f + X b + (dg / dq_j) z + e,    f ~ N(0, S^2),    e ~ N(0, R)

y are rows behind the observer's low-pass, X b friction of all joints, g the weight, S and R what is expected of the
record. R grew by what the zero does, but alike at all times: how much less is left with z tells it from errors.
A joint that never slides says nothing, as stiction holds it alike.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pinocchio as pin

from aerobat_pin.estimation.checks.balance import under_gravity
from aerobat_pin.estimation.findings import Finding
from aerobat_pin.forces import SLIDES_AT, WEIGHED, Instants
from aerobat_pin.numerics import Array
from aerobat_pin.observers import Expected
from aerobat_pin.records import Record

LEFT_BY_ZERO = 0.5  # of what is left as mapped, weighed and squared, up to which another zero is named
TURNED, SLID = (0.05, 0.8), (0.02, 0.3)  # least and largest zero that is named [rad], [m]
SMALLEST = 1e-12  # of the largest eigenvalue: what no row shows is 0


def zero_findings(record: Record, instants: Instants, expected: Expected) -> Iterator[Finding]:
    """Yield that another zero of a joint leaves far less of a fixed robot's rows, and no more than another gravity.

    The finding's value is how much farther than its position says the joint stands, -z [rad or m].
    """
    robot, kept = record.robot, instants.kept
    rows = {joint: robot.v_index(joint) for joint in record.driven}
    largest = dict(zip(kept, np.abs(instants.sliding).max(axis=0, initial=0.0), strict=True))
    moved = [joint for joint, row in rows.items() if largest.get(row, 0.0) > SLIDES_AT]
    if robot.free or "joints.effort" not in record.channels or not moved:
        return
    some = slice(None, None, max(1, len(instants.rows) // WEIGHED))
    y, B = instants.rows[some, kept], expected.force[:, None] * instants.jacobians[some][:, :, kept]
    variance = expected.row_deviation(instants.v[some])[:, kept] ** 2
    whiten = np.linalg.inv(np.linalg.cholesky(np.swapaxes(B, 1, 2) @ B + np.eye(len(kept)) * variance[:, None]))
    friction = [column[:, :, None] * np.eye(len(kept)) for column in instants.columns[:2, some]]
    slopes, pulls = _weight_slopes(robot.model, instants.q[some])
    count, all_of = 2 * len(kept), np.concatenate([*friction, slopes[:, kept], pulls[:, kept], y[..., None]], axis=2)
    white = (whiten @ all_of).reshape(y.size, -1)
    gram = white.T @ white

    def left(*columns: int) -> tuple[float, float]:
        """Return what friction and columns leave of y, squared, and how much of the last one explains most."""
        at = [*range(count), *columns]
        size = np.sqrt(np.maximum(np.diag(gram)[at], np.finfo(float).tiny))
        b = np.linalg.pinv(gram[np.ix_(at, at)] / np.outer(size, size), rcond=SMALLEST) @ (gram[at, -1] / size)
        return float(gram[-1, -1] - b @ (gram[at, -1] / size)), float(b[-1] / size[-1])

    (mapped, _), (tilted, _) = left(), left(*range(len(gram) - 4, len(gram) - 1))
    after, zero, joint = min((*left(count + rows[joint]), joint) for joint in moved)
    low, high = SLID if robot.slides(joint) else TURNED
    if after < min(LEFT_BY_ZERO * mapped, tilted) and low < abs(zero) < high:
        share = 100.0 * (after / max(mapped, 1e-300)) ** 0.5
        off = f"{-1e3 * zero:.0f} mm" if robot.slides(joint) else f"{-np.degrees(zero):.1f} deg"
        text = (
            f"{joint} seems to stand {off} farther than its position says, which leaves {share:.0f} % "
            "of what forces and friction leave: its encoder's zero (joints.offset), or a centre of mass that lies aside"
        )
        yield Finding("joint zero", "warning", text, -zero, "m" if robot.slides(joint) else "rad")


def _weight_slopes(model: pin.Model, q: Array) -> tuple[Array, Array]:
    """Return how the weight's rows change with each joint (m, nv, nv), and with gravity along each axis (m, nv, 3)."""
    data, pulled = model.createData(), []
    slopes = np.array([pin.computeGeneralizedGravityDerivatives(model, data, each).copy() for each in q])
    for axis in np.eye(3):
        pulling = under_gravity(model, axis)
        pulled.append([pin.computeGeneralizedGravity(pulling, data, each).copy() for each in q])
    return slopes, np.moveaxis(np.array(pulled), 0, -1)
