"""Find friction, and the errors of rows, while unknown forces push: in a record of which nothing else tells them.

    y = J^T f + X b + e,    f ~ N(0, S^2),    b ~ N(0, B^2),    e ~ N(0, r R + stiction)

At some instants y are the rows behind the observer's low-pass, X b Coulomb and viscous friction of the driven joints
behind the same, and R is what is expected of the rows' errors without a record. Those b and r that make the rows most
likely, whatever the forces are, follow by expectation maximisation (Dempster, Laird and Rubin 1977). Rows to spare tell
errors from forces; without any a force would pass for an error, and nothing is sought.

A foot in the air carries nothing, S = 0: its leg shows friction and errors whatever the other feet do. Only then are
factors of efforts sought, too: else what pushes elsewhere than at the points would pass for them. An accelerometer with
an offset, which looks like a tilt, moves b; that counts as an error of the rows. Without rows of the base, factors
follow from the weight (`factors_by_balance.py`).

Where no foot lifts, what pushes elsewhere than at the points passes for errors. So the mean of r is handed on as the
least k, which the output judges, and the sizes of the rows over it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from aerobat_pin.estimation.added_deviations import tilt_of
from aerobat_pin.estimation.contacts import END_SHARE, walks_on
from aerobat_pin.estimation.expected_of_record import EFFORT_ERROR, column_rms, expected_of, lifted_feet, row_scale
from aerobat_pin.estimation.factors_by_balance import factors_by_balance
from aerobat_pin.estimation.known_forces import BESIDE, Fit, KnownForces
from aerobat_pin.estimation.run_observers import inputs_between, points_of
from aerobat_pin.estimation.stored_estimate import TIME_CONSTANTS_TO_SETTLE
from aerobat_pin.numerics import Array
from aerobat_pin.observers import AllBut, JointFriction, MomentumObserver, low_passed, row_names, typical_step
from aerobat_pin.records import rotation_matrices

SEEN_INTERVALS = 10_000  # of a record that are looked at
MOST_INSTANTS, FEWEST_INSTANTS = 500, 50  # that are weighed
EXPECTATION_ROUNDS = 30  # of expectation and maximisation; what a record tells has settled by then
UNKNOWN_SPEED = 1.0  # [m/s] that a robot may gain over a record
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
    model = robot.model
    kept = rows.kept(model) if isinstance(rows, AllBut) else list(range(model.nv))
    joints = [joint for joint in record.driven if robot.v_index(joint) in kept]
    at = [kept.index(robot.v_index(joint)) for joint in joints]
    every = max(sum(len(one.tau) for one in stretches) // MOST_INSTANTS, 1)
    observer, parts, places = MomentumObserver(model, points, gain, rows), [], []
    for one in stretches:
        v, share = 0.5 * (one.v[1:] + one.v[:-1]), -np.expm1(-gain * typical_step(one.time))
        y = observer.run(one.time, one.q, one.v, one.tau, one.known).residual
        sliding = np.tanh(v / expected.stiction_rate)
        settled = np.flatnonzero(one.time[:-1] - one.time[0] > TIME_CONSTANTS_TO_SETTLE / gain)
        chosen = settled[::every]
        table = np.stack([y, sliding, *(low_passed(values, share) for values in (-sliding, -v, one.tau))])
        parts.append(table[:, chosen])
        places.append(one.q[chosen + 1])
    whole, q = np.concatenate(parts, axis=1), np.concatenate(places)
    jacobians = np.stack([observer.applications.jacobian(one) for one in q])
    (y, sliding, *regressors), J = whole[:, :, kept], jacobians[:, :, kept]
    (m, k), n = y.shape, len(at)
    force, walks = np.broadcast_to(expected.force, J.shape[:2]), walks_on(robot, record.map)
    if walks:
        lifted, _ = lifted_feet(y, J, END_SHARE * robot.weight)
        force, walks = force * np.where(np.repeat(lifted, 3, axis=1), 0.0, 1.0), bool(lifted.any())
    if k * m <= np.count_nonzero(force) or m < FEWEST_INSTANTS:
        return forces
    sliding[:, [row for row in range(k) if row not in at]] = 1.0
    sought = walks and kept[0] == 0  # factors, by rows of the base
    X = np.concatenate([one.T[at, :, None] * np.eye(k)[at, None] for one in regressors[: 3 if sought else 2]])
    known = np.repeat([np.inf, np.inf, EFFORT_ERROR], n)[: len(X)]
    g = float(np.linalg.norm(model.gravity.linear))
    offset = g * tilt_of(record.map)  # [m/s2] of an accelerometer that shows gravity so much tilted
    tables = y, X, known, J, at, sliding, force, expected.row_error[kept]
    b, size, unsure, left = most_likely(*tables, offset=robot.mass * offset if sought else 0.0)
    level, names = 1.0 if walks else max(1.0, float(np.mean(size))), list(row_names(model))
    factors = b[2 * n :] if sought else np.zeros(n)
    if walks and not sought:
        whole[0][:, kept] -= np.einsum("pmi,p->mi", X, b)
        least = robot.mass * row_scale(model)[:6] * (UNKNOWN_SPEED / (m * every * record.dt) + offset)
        attitude = rotation_matrices(q[:, 3:7])
        SJ = force[..., None] ** 2 * J
        G = SJ @ np.linalg.inv(np.swapaxes(J, 1, 2) @ SJ + np.diag(size * expected.row_error[kept] ** 2))
        factors, deviation = factors_by_balance(
            whole[0], jacobians, G, kept, regressors[2], attitude, least, EFFORT_ERROR
        )
        unsure = np.mean((regressors[2] * deviation) ** 2, axis=0)
    square = size * expected.row_error[kept] ** 2 + unsure
    before, zero, (coulomb, viscous) = column_rms(y), np.zeros(n), b[: 2 * n].reshape(2, n)
    fits = [
        Fit(
            f"friction of {joint}{BESIDE}",
            {"coulomb": float(coulomb[i]), "viscous": float(viscous[i])}
            | ({"effort times": float(1.0 + factors[i])} if walks else {}),
            "N" if robot.slides(joint) else "N m",
            float(before[at[i]]),
            float(left[at[i]]),
            float("nan"),
        )
        for i, joint in enumerate(joints)
    ]
    found = replace(
        values,
        joints=tuple(joints),
        friction=JointFriction(coulomb, viscous, zero, zero, float(expected.stiction_rate.max())),
        scale=1.0 + factors,
        row_noise={names[row]: float(error) for row, error in zip(kept, np.sqrt(square / level), strict=True)},
        doubt=level,
        fits=(*values.fits, *fits),
    )
    return replace(forces, values=found)


def most_likely(
    y: Array,
    X: Array,
    known: Array,
    J: Array,
    at: list[int],
    sliding: Array,
    force: Array,
    error: Array,
    *,
    offset: float = 0.0,
) -> tuple[Array, Array, Array, Array]:
    """Return b (p,), the sizes r (k,), what an offset makes of b in the rows (k,), squared, and the errors' rms (k,).

    Args:
        y: (m, k) rows.
        X: (p, m, k) what each coefficient of size 1 does: Coulomb friction of the rows `at`, viscous friction, others.
        known: (p,) B; infinite for friction, which is positive.
        J: (m, c, k) Jacobian of the components.
        at: the rows that have friction.
        sliding: (m, k) tanh(v / v_s): at rest a row has stiction, and says nothing of its errors in motion.
        force: (m, c) S.
        error: (k,) square roots of R.
        offset: force [N] that a base's accelerometer with an offset may find in each of the first three rows for ever.
    """
    (m, k), p, rubs = y.shape, len(X), np.isinf(known)
    forces = np.einsum("mci,mc,mcj->mij", J, force**2, J, optimize=True)
    b, size, stiction = np.zeros(p), (column_rms(y) / error) ** 2, np.zeros(k)  # from below they would hardly move
    for _ in range(EXPECTATION_ROUNDS):
        R = size * error**2 + stiction**2 / 3.0 * (1.0 - sliding**2)
        cov = forces.copy()
        cov[:, range(k), range(k)] += R
        inverse = np.linalg.inv(cov)
        weighed = np.einsum("mij,pmj->pmi", inverse, X).reshape(p, -1)
        told = weighed @ X.reshape(p, -1).T
        told[range(p), range(p)] += LEAST_SHOWN * np.diag(told) + np.finfo(float).tiny + known**-2.0
        b = np.linalg.solve(told, weighed @ y.ravel())
        b[rubs] = np.maximum(b[rubs], 0.0)
        stiction[at] = b[: len(at)]
        left = y - np.einsum("pmi,p->mi", X, b)
        mean = R * np.einsum("mij,mj->mi", inverse, left)  # of e, given the rows
        square = mean**2 + R - R**2 * np.diagonal(inverse, axis1=1, axis2=2)
        size = np.sum(sliding**2 * square, axis=0) / np.maximum(np.sum(sliding**2, axis=0), 1e-9) / error**2
    pushed = weighed.reshape(p, m, k)[:, :, :3].sum(axis=1) * offset  # what an offset of each axis adds to the target
    moved = np.einsum("pmi,po->omi", X, np.linalg.solve(told, pushed))
    return b, size, np.sum(np.mean(moved**2, axis=1), axis=0), column_rms(mean)
