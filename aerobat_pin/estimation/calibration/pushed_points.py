"""Whether a force at the points explains a free record better than friction and offsets of its joints.

A force that lasts looks like offsets of the joints, as long as no row is to spare: then it would be learnt, and be
missing from every later record. Where rows are to spare, a force moves them by its Jacobian, which changes with the
pose, and an offset does not. So friction, inertia of rotors, offsets and the errors of rows are found beside the
forces, as in a record that is pushed (`fit_beside_forces.py`), and what is found at the points must not stand out from
its errors.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from aerobat_pin.forces import (
    CHECKED,
    FEWEST_INSTANTS,
    LASTING,
    SURE_OF_CONTACT,
    TINY,
    KnownForces,
    burst_noise,
    column_rms,
    expected_of,
    inputs_between,
    looked_at,
    most_likely,
    point_label,
    points_of,
    quantity,
    spare_share,
)
from aerobat_pin.numerics import Array
from aerobat_pin.observers import Applications, robot_length, scale_of_forces

LEAST_PUSH = 0.02  # of the moving weight: a smaller force is no push


def pushed_points(forces: KnownForces) -> tuple[list[str], list[str]]:
    """Return in words what pushed at the points of a record that was taken as free, and what it cannot tell.

    Friction, if the forces have some, was fitted as if nothing pushed.
    """
    record = forces.record
    if not record.robot.limits_forces:
        return [], []
    plain = replace(forces, values=replace(forces.values, friction=None, row_noise={}), series=None)
    inputs, points = inputs_between(record, plain), points_of(record.map)
    instants = looked_at(record, inputs, plain.values, closely=True)
    if instants is None or len(instants.rows) < FEWEST_INSTANTS or not instants.joints:
        return [], []
    expected = expected_of(record, instants, plain.values)
    kept, at, y = instants.kept, instants.at, instants.rows[:, instants.kept]
    J, error, S = instants.jacobians[:, :, kept], expected.row_error[kept], expected.force
    force = np.broadcast_to(S, J.shape[:2])
    offset = np.broadcast_to(-column_rms(instants.columns[3][:, at]) - error[at], (1, len(y), len(at)))
    x = np.concatenate([instants.columns[:3, :, at], offset])
    b, size, _, _ = most_likely(y, x, np.array([np.inf, np.inf, np.inf, 1.0]), J, at, instants.sliding, force, error)
    if not points or np.all(spare_share(J, force, np.sqrt(size) * error) < CHECKED):
        text = "no row is to spare: a force that lasts would have been learnt as friction and offset of "
        untold = f"{record.title}: {text}{', '.join(instants.joints)}; make sure that nothing pushed"
        return [], [] if forces.values.friction is None else [untold]
    left, stiction = y.copy(), np.zeros(len(kept))
    left[:, at] -= np.einsum("ami,ai->mi", x, b)
    stiction[at] = b[0]
    error = np.sqrt(size * error**2 + stiction**2 / 3.0 * (1.0 - instants.sliding**2))
    B = J / error[:, None]
    P = np.linalg.inv(B @ np.swapaxes(B, 1, 2) + np.diag(S**-2.0))
    found = np.einsum("mcd,mdk,mk->mc", P, B, left / error)
    deviation = np.sqrt(np.diagonal(P, axis1=1, axis2=2) + burst_noise(found) ** 2)  # that of velocities is in all rows
    components = Applications(record.robot.model, points).components
    return list(_in_words(forces, components, instants.time, found, deviation)), []


def _in_words(
    forces: KnownForces, components: Sequence[str], time: Array, found: Array, deviation: Array
) -> Iterator[str]:
    """Yield what stands out of forces (m, c), with standard deviations (m, c), at times (m,) [s]."""
    record = forces.record
    for k in range(0, len(components), 3):
        force, sure = found[:, k : k + 3], deviation[:, k : k + 3]
        place, _, axis = components[k].rpartition(".")
        scale = 1.0 if axis.startswith("F") else robot_length(record.robot.model)
        size = np.linalg.norm(force, axis=1)
        along = np.sqrt(np.sum((force * sure) ** 2, axis=1)) / np.maximum(size, TINY) + TINY
        shares, least = size / np.linalg.norm(sure, axis=1), LEAST_PUSH * scale_of_forces(record.robot.model) * scale
        rms, lasting = float(np.sqrt(np.mean(size**2))), float(np.sqrt(np.mean(shares**2)))
        bar = np.maximum(SURE_OF_CONTACT * 3**0.5 * along, least)
        beyond = size / bar
        at = int(np.argmax(beyond))
        if beyond[at] > 1.0 or (lasting > LASTING and rms > least):
            when = time[beyond >= min(1.0, beyond[at])] - record.start
            unit = "N" if axis.startswith("F") else "N m"
            weight = "has a weight too much" if unit == "N" and force[:, 2].mean() > 0.0 else "lacks a weight"
            mean = ", ".join(f"{part:.3g}" for part in force.mean(axis=0))
            yield (
                f"{record.title}: something pushed at {point_label(place)}, or the model {weight}, most from "
                f"{when[0]:.2f} to {when[-1]:.2f} s, with up to {quantity(float(size[at]), unit)} "
                f"(+-{along[at]:.2g}), in the mean ({mean}) {unit} in world axes: that explains the rows of the "
                "joints, and offsets do not"
            )
