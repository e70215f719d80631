"""Find friction, and the errors of rows, while unknown forces push: in a record of which nothing else tells them.

    y = J^T f + X b + e,    f ~ N(0, S^2),    e ~ N(0, r R + stiction)

At some instants y are the rows behind the observer's low-pass, X b Coulomb and viscous friction of the driven joints
behind the same, and R is what is expected of the rows' errors without a record. Those b and r that make the rows most
likely, whatever the forces are, follow by expectation maximisation (Dempster, Laird and Rubin 1977). Rows to spare tell
errors from forces; without any a force would pass for an error, and nothing is sought.

What pushes elsewhere than at the points passes for errors, too. So the mean of r is handed on as the least k, which the
output judges, and the sizes of the rows over it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from aerobat_pin.estimation.expected_of_record import column_rms, expected_of
from aerobat_pin.estimation.known_forces import BESIDE, Fit, KnownForces
from aerobat_pin.estimation.run_observers import inputs_between, points_of
from aerobat_pin.estimation.stored_estimate import TIME_CONSTANTS_TO_SETTLE
from aerobat_pin.numerics import Array
from aerobat_pin.observers import AllBut, JointFriction, MomentumObserver, low_passed, row_names, typical_step

SEEN_INTERVALS = 10_000  # of a record that are looked at
MOST_INSTANTS, FEWEST_INSTANTS = 500, 50  # that are weighed
EXPECTATION_ROUNDS = 30  # of expectation and maximisation; what a record tells has settled by then
LEAST_SHOWN = 1e-9  # share of a coefficient's information that is added to it: one that the record does not show is 0


def fit_beside_forces(forces: KnownForces) -> KnownForces:
    """Return known forces with the friction of a record's joints and the errors of its rows, if it tells them."""
    record, values, points = forces.record, forces.values, points_of(forces.record.map)
    told = values.row_noise or record.map.joints.friction is not None or "joints.effort" not in record.channels
    inputs = inputs_between(record, forces)
    expected = expected_of(record, inputs, values, points) if points and not told else None
    if expected is None:
        return forces
    stretches = [inputs(*ends) for ends in record.spread(SEEN_INTERVALS)]
    robot, gain, rows = record.robot, float(record.map.observer.gain), stretches[0].rows
    kept = rows.kept(robot.model) if isinstance(rows, AllBut) else list(range(robot.model.nv))
    joints = [joint for joint in record.driven if robot.v_index(joint) in kept]
    at = [kept.index(robot.v_index(joint)) for joint in joints]
    every = max(sum(len(one.tau) for one in stretches) // MOST_INSTANTS, 1)
    observer, parts, jacobians = MomentumObserver(robot.model, points, gain, rows), [], []
    for one in stretches:
        v, share = 0.5 * (one.v[1:] + one.v[:-1]), -np.expm1(-gain * typical_step(one.time))
        y = observer.run(one.time, one.q, one.v, one.tau, one.known).residual
        sliding = np.tanh(v / expected.stiction_rate)
        settled = np.flatnonzero(one.time[:-1] - one.time[0] > TIME_CONSTANTS_TO_SETTLE / gain)
        chosen = settled[::every]
        table = np.stack([y, sliding, low_passed(-sliding, share), low_passed(-v, share)])
        parts.append(table[:, chosen][:, :, kept])
        jacobians += [observer.applications.jacobian(one.q[k + 1])[:, kept] for k in chosen]
    y, sliding, *regressors = np.concatenate(parts, axis=1)
    if len(kept) <= len(expected.force) or len(y) < FEWEST_INSTANTS:
        return forces
    sliding[:, [k for k in range(len(kept)) if k not in at]] = 1.0
    likely = most_likely(
        y, np.stack(regressors)[:, :, at], np.stack(jacobians), at, sliding, expected.force, expected.row_error[kept]
    )
    (coulomb, viscous), size, left = likely
    level, names = max(1.0, float(np.mean(size))), list(row_names(robot.model))
    errors = np.sqrt(size / level) * expected.row_error[kept]
    before, zero = column_rms(y), np.zeros(len(at))
    fits = [
        Fit(
            f"friction of {joint}{BESIDE}",
            {"coulomb": float(coulomb[k]), "viscous": float(viscous[k])},
            "N" if robot.slides(joint) else "N m",
            float(before[at[k]]),
            float(left[at[k]]),
            float("nan"),
        )
        for k, joint in enumerate(joints)
    ]
    found = replace(
        values,
        joints=tuple(joints),
        friction=JointFriction(coulomb, viscous, zero, zero, float(expected.stiction_rate.max())),
        scale=np.ones(len(at)),
        row_noise={names[row]: float(error) for row, error in zip(kept, errors, strict=True)},
        doubt=level,
        fits=(*values.fits, *fits),
    )
    return replace(forces, values=found)


def most_likely(
    y: Array, regressors: Array, jacobians: Array, at: list[int], sliding: Array, force: Array, error: Array
) -> tuple[Array, Array, Array]:
    """Return friction's coefficients b (2, n), the sizes r (k,) of the squared errors, and the rms (k,) of the errors.

    Args:
        y: (m, k) rows.
        regressors: (2, m, n) what Coulomb and viscous friction of size 1 are in the rows `at`.
        jacobians: (m, c, k) of the components.
        at: the rows that have friction.
        sliding: (m, k) tanh(v / v_s): at rest a row has stiction, and says nothing of its errors in motion.
        force: (c,) S.
        error: (k,) square roots of R.
    """
    k, n = y.shape[1], len(at)
    forces = np.einsum("mci,c,mcj->mij", jacobians, force**2, jacobians, optimize=True)
    b, size, stiction = np.zeros((2, n)), np.ones(k), np.zeros(k)
    for _ in range(EXPECTATION_ROUNDS):
        R = size * error**2 + stiction**2 / 3.0 * (1.0 - sliding**2)
        cov = forces.copy()
        cov[:, range(k), range(k)] += R
        inverse = np.linalg.inv(cov)
        own = inverse[:, at][:, :, at]
        told = np.einsum("ami,mij,bmj->aibj", regressors, own, regressors, optimize=True).reshape(2 * n, 2 * n)
        target = np.einsum("ami,mij,mj->ai", regressors, inverse[:, at], y, optimize=True).ravel()
        told[range(2 * n), range(2 * n)] *= 1.0 + LEAST_SHOWN
        told[range(2 * n), range(2 * n)] += np.finfo(float).tiny
        b = np.maximum(np.linalg.solve(told, target).reshape(2, n), 0.0)
        stiction[at] = b[0]
        left = y.copy()
        left[:, at] -= np.einsum("ami,ai->mi", regressors, b)
        mean = R * np.einsum("mij,mj->mi", inverse, left)  # of e, given the rows
        square = mean**2 + R - R**2 * np.diagonal(inverse, axis1=1, axis2=2)
        size = np.sum(sliding**2 * square, axis=0) / np.maximum(np.sum(sliding**2, axis=0), 1e-9) / error**2
    return b, size, column_rms(mean)
