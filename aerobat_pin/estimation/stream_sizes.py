"""What a stream expects of forces and of errors of its rows, learnt from what has come so far."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from aerobat_pin.forces import (
    LEAST_SHOWN,
    SLIDES_AT,
    FittedValues,
    expected_from,
    lifted_errors,
    points_of,
    row_scale,
    walks_on,
)
from aerobat_pin.numerics import Array
from aerobat_pin.observers import (
    Expected,
    ObserversTogether,
    Rows,
    Sample,
    as_others_rub,
    effort_limits,
    scale_of_forces,
)
from aerobat_pin.records import Map, PlainRobot

LEGS_EVERY, LEGS_KEPT = 10, 200  # estimates of a robot that walks: one in so many shows the errors of legs in the air
RUBS_SHOWN = 200  # estimates of a robot with feet after which friction shows: before, what its feet carry looks like it
RUBS_EVERY = 4  # estimates: one in so many shows friction, which counts where no leg is in the air


class StreamSizes:
    """Sizes that a stream expects.

    Errors are in proportion to the efforts. Where friction is not known, they contain what friction can explain: a
    stream does not take it off, as a push that lasts looks like it until the joint turns back. Joints that have not
    slid yet are taken to rub as the others. `rows` are those that are believed, `values` what is known of friction and
    of errors of rows.
    """

    def __init__(self, chosen: Map, robot: PlainRobot, rows: Rows, values: FittedValues) -> None:
        self._robot, self._rows, self._values, self._points = robot, rows, values, points_of(chosen)
        self._walks = walks_on(robot, chosen)
        count, nv = 3 * len(chosen.robot.points), robot.model.nv
        self._legs = np.zeros((LEGS_KEPT, count)), np.zeros((LEGS_KEPT, count, nv))  # forces, and their Jacobians
        self._count = 0
        self._rate = values.stiction(robot)[1]
        self._joints = [robot.v_index(joint) for joint in robot.joints]
        self._limits, self._slid = effort_limits(robot.model, self._joints), np.zeros(nv)
        self._products = np.zeros((3, 3, nv))  # sums over samples, of each row

    def take(
        self, together: ObserversTogether, samples: Sequence[Sample | None], q: Array, u: Array, dt: float
    ) -> None:
        """Take what observers find at the end q (nq,) of an interval of length dt [s], of known forces u (nv,)."""
        sample, self._count = samples[together.judge], self._count + 1
        if self._walks and sample is not None and self._count % LEGS_EVERY == 0:
            at = (self._count // LEGS_EVERY - 1) % LEGS_KEPT
            observer = together.observers[together.judge]
            self._legs[0][at], self._legs[1][at] = sample.components, observer.applications.jacobian(q)
        if self._count % RUBS_EVERY == 0:
            v, y = together.last_interval(u, dt)
            z = np.stack([np.tanh(v / self._rate), v, y])
            self._products += z[:, None] * z
            self._slid = np.maximum(self._slid, np.abs(z[0]))

    def expected(self, effort: Array) -> Expected | None:
        """Return what is expected, from the rms (nv,) of the efforts so far; other rows carry the weight.

        None for a robot that expects forces of any size.
        """
        if not self._robot.limits_forces:
            return None
        carried = scale_of_forces(self._robot.model) * row_scale(self._robot.model)
        expected = expected_from(self._robot, self._rows, self._values, self._points, effort, carried)
        errors = np.zeros_like(expected.row_error)
        if self._walks and self._count >= LEGS_EVERY:
            force, jacobians = (part[: self._count // LEGS_EVERY] for part in self._legs)
            rows = np.einsum("mc,mcv->mv", force, jacobians)
            errors = lifted_errors(self._robot.model, rows, jacobians, self._robot.weight)
        least = RUBS_SHOWN if self._walks else RUBS_EVERY
        if self._count >= least and self._values.friction is None and not errors.any():  # no leg is in the air
            slides = self._slid[self._joints] > SLIDES_AT
            errors[self._joints] = as_others_rub(self._rubbing()[self._joints], slides, self._limits)
        return replace(expected, row_error=np.hypot(expected.row_error, errors))

    def _rubbing(self) -> Array:
        """Return the rms (nv,) of what Coulomb and viscous friction, which resist, explain of each row."""
        A, y = self._products[:2, :2].transpose(2, 0, 1), self._products[:2, 2].T
        scale = np.sqrt(np.maximum(np.diagonal(A, axis1=1, axis2=2), np.finfo(float).tiny))
        A, y = A / (scale[:, :, None] * scale[:, None, :]) + LEAST_SHOWN * np.eye(2), y / scale
        b = np.linalg.solve(A, y[..., None])[..., 0]
        both, alone = np.where(np.all(b < 0.0, axis=1), np.sum(b * y, axis=1), 0.0), np.minimum(y, 0.0).min(axis=1)
        return np.asarray(np.sqrt(np.maximum(both, alone**2) / (self._count // RUBS_EVERY)))
