"""The joint smoother's kernels against independent implementations in numpy."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from support.kernel_cases import assert_equal
from support.raw_twins import twin_accelerometer, twin_rows

from aerobat_pin.aerobat.raw.air import AirForces
from aerobat_pin.aerobat.raw.dynamics_kernels import LinearDynamics, Middle, linearise
from aerobat_pin.aerobat.raw.layout import Layout
from aerobat_pin.aerobat.raw.rows_kernels import accelerometer_rows, felt_accelerations


def test_rows_of_the_dynamics_and_of_an_accelerometer_are_those_of_their_twins() -> None:
    """Random numbers in place of a robot's: the algebra does not know one."""
    rng = np.random.default_rng(2)
    m, nv, layout, joints = 3, 10, Layout(2, mass=True, air=True), [6, 7, 8, 9]
    draw = rng.standard_normal
    dt, slopes, ad_half = rng.uniform(1e-3, 2e-3, m), draw((m, 4, 4)), draw((m, 6, 6))
    rotation = np.array([pin.exp3(one) for one in draw((m, 3))])
    ID, Dq, Dv, M = draw((m, nv)), draw((m, nv, nv)), draw((m, nv, nv)), draw((m, nv, nv)) + 8.0 * np.eye(nv)
    air = AirForces(draw((m, nv)), 0.1 * draw((m, nv, nv)), draw((m, nv, 6)))
    known, J, force = draw((m, nv)), draw((m, 6, nv)), draw((m, 2, 3))
    middle_twist, rate, up, none = draw((m, 6)), draw((m, 6)), draw((m, 3)), np.empty(0)
    shape, n = (m, 6, layout.size), layout.size
    d = LinearDynamics(
        np.zeros((m, layout.moving, n)), np.empty((m, layout.moving)), np.zeros(shape), np.empty((m, 6)),
        np.zeros(shape), np.zeros(shape), np.empty((m, 6)), np.empty((m, 4, n)), np.empty((m, 4)),
        none, middle_twist, rate, up,
    )  # fmt: skip
    A, push, torque, torque_at = d.acceleration, d.push, d.torque, d.torque_at
    ad, defect, knots = draw((m, 6, 6)), draw((m, 6)), draw((m + 1, 3))
    crank = np.stack([knots[:-1, 1] + 0.5 * dt * knots[:-1, 2], knots[:-1, 2]], axis=1)
    middle = Middle(rotation, ID, Dq, Dv, M + air.added_mass, J, ad_half, ad, defect)
    linearise(
        layout.places, np.array(joints, dtype=np.intp), layout.by_mode, dt, knots, slopes, middle,
        ID - air.force - known, air.force, air.by_twist, force.reshape(m, -1), d,
    )  # fmt: skip
    known_rows = twin_rows(layout, joints, dt, crank, slopes, ad_half, rotation, (ID, Dq, Dv, M), air, known, J, force)
    for found, expected in zip((A, push, torque, torque_at), known_rows, strict=True):
        assert_equal(found, expected)
    assert_equal(d.kick, 0.5 * dt[:, None] * push)
    h, step, twist = dt[:, None, None], np.zeros(shape), slice(6, 12)
    step[:, :, :6], step[:, :, twist] = ad, h * np.eye(6)
    assert_equal(d.transition[:, :6], step + 0.5 * h**2 * A)
    assert_equal(d.transition[:, twist, twist], np.eye(6) + h * A[:, :, twist])
    assert_equal(d.shift[:, :12], np.concatenate([defect + 0.5 * h[:, 0] ** 2 * push, h[:, 0] * push], axis=1))
    angle, turning, speeding = knots[:-1].T
    ahead = np.stack([angle + dt * turning + 0.5 * dt**2 * speeding, turning + dt * speeding, speeding], axis=1)
    assert_equal(d.shift[:, 12:15], ahead - knots[1:])

    place, turn = draw(3), np.asarray(pin.exp3(draw(3)))
    felt, h, constant = np.empty((m, 3)), np.zeros((m, 3, layout.size)), np.empty((m, 3))
    felt_accelerations(d, place, felt)
    accelerometer_rows(d, np.arange(m), turn, place, h, constant, np.empty((m, 3, 3)))
    for one, other in zip((felt @ turn, h, constant), twin_accelerometer(d, place, turn), strict=True):
        assert_equal(one, other)
