"""The joint smoother's kernels against independent implementations in numpy."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from support.kernel_cases import assert_equal
from support.raw_twins import twin_accelerometer, twin_rows

from aerobat_pin.estimation.raw.air import AirForces
from aerobat_pin.estimation.raw.dynamics import LinearDynamics
from aerobat_pin.estimation.raw.dynamics_kernels import linearise
from aerobat_pin.estimation.raw.layout import Layout
from aerobat_pin.estimation.raw.rows_kernels import accelerometer_rows, felt_accelerations


def test_rows_of_the_dynamics_and_of_an_accelerometer_are_those_of_their_twins() -> None:
    """Random numbers in place of a robot's: the algebra does not know one."""
    rng = np.random.default_rng(2)
    m, nv, layout, joints = 3, 10, Layout(2, mass=True, air=True), [6, 7, 8, 9]
    draw = rng.standard_normal
    dt, crank, slopes, ad_half = rng.uniform(1e-3, 2e-3, m), draw((m, 2)), draw((m, 4, 4)), draw((m, 6, 6))
    rotation = np.array([pin.exp3(one) for one in draw((m, 3))])
    ID, Dq, Dv, M = draw((m, nv)), draw((m, nv, nv)), draw((m, nv, nv)), draw((m, nv, nv)) + 8.0 * np.eye(nv)
    air = AirForces(draw((m, nv)), 0.1 * draw((m, nv, nv)), draw((m, nv, 6)))
    known, J, force = draw((m, nv)), draw((m, 6, nv)), draw((m, 2, 3))
    shape = (m, 6, layout.size)
    pose, twist, A = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    kick, push = np.empty((m, 6)), np.empty((m, 6))
    torque, torque_at = np.empty((m, 4, layout.size)), np.empty((m, 4))
    places = [layout.walk.start, layout.white.start, layout.mass_at, layout.air_at, 12]
    linearise(
        np.array(places, dtype=np.intp), np.array(joints, dtype=np.intp), layout.by_mode, dt, crank, slopes,
        ad_half, rotation, Dq, Dv, air.by_twist, M + air.added_mass, ID, ID - air.force - known, air.force, J,
        force.reshape(m, -1), pose, twist, kick, A, push, torque, torque_at,
    )  # fmt: skip
    known_rows = twin_rows(layout, joints, dt, crank, slopes, ad_half, rotation, (ID, Dq, Dv, M), air, known, J, force)
    for found, expected in zip((A, push, torque, torque_at), known_rows, strict=True):
        assert_equal(found, expected)
    assert_equal(kick, 0.5 * dt[:, None] * push)

    place, turn = draw(3), np.asarray(pin.exp3(draw(3)))
    middle_twist, rate, up = draw((m, 6)), draw((m, 6)), draw((m, 3))
    none = np.empty(0)
    d = LinearDynamics(none, none, A, push, pose, twist, kick, torque, torque_at, none, middle_twist, rate, up)
    felt, h, constant = np.empty((m, 3)), np.zeros((m, 3, layout.size)), np.empty((m, 3))
    felt_accelerations(middle_twist, rate, up, place, felt)
    accelerometer_rows(
        np.arange(m), turn, place, middle_twist, rate, up, A, push, pose, twist, kick, h, constant, np.empty((m, 3, 3))
    )
    for one, other in zip((felt @ turn, h, constant), twin_accelerometer(d, place, turn), strict=True):
        assert_equal(one, other)
