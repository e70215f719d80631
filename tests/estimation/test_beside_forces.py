"""Friction and errors of rows that are found beside unknown forces: by records of which the answer is known."""

import re
from pathlib import Path
from typing import Literal

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import minimize
from scipy.signal import lfilter

from aerobat_pin.forces import FittedValues, expected_from, row_scale, settled_instants
from aerobat_pin.forces.explanations import coefficient_covariance
from aerobat_pin.forces.fit_beside_forces import most_likely, with_blows
from aerobat_pin.numerics import Array
from aerobat_pin.observers import AllBut, moving_weight, row_names
from aerobat_pin.records import RobotTable, robot_of_map

SLIDING = 1.0  # tanh(v / v_s) of joints that never rest: no stiction


def unlikely(b: Array, y: Array, x: Array, cov: Array) -> float:
    """Return minus the log-likelihood, up to a constant, of rows (m, k) with friction b (2 k,) beside forces."""
    remainder = y - np.einsum("ami,ai->mi", x, b.reshape(2, -1))
    return 0.5 * float(np.einsum("mi,ij,mj->", remainder, np.linalg.inv(cov), remainder))


def test_friction_that_cannot_be_negative_leaves_the_rest_as_likely_as_can_be() -> None:
    """Four joints, of which two move alike, without friction; by scipy's search of the likelihood from five starts."""
    rng, m, k = np.random.default_rng(7), 400, 4
    rate = rng.standard_normal((m, 2))[:, [0, 0, 1, 1]] + 0.05 * rng.standard_normal((m, k))
    x = np.stack([-np.sign(rate), -rate])
    J = np.broadcast_to(np.array([[1.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 1.0]]), (m, 2, k))
    error, force = np.full(k, 0.1), np.full((m, 2), 20.0)
    y = np.einsum("mck,mc->mk", J, 3.0 * rng.standard_normal((m, 2))) + error * rng.standard_normal((m, k))
    b, size, *_ = most_likely(y, x, np.full(2, np.inf), J, list(range(k)), np.full((m, k), SLIDING), force, error)
    cov = J[0].T @ np.diag(force[0] ** 2) @ J[0] + np.diag(size * error**2)
    best = min(
        minimize(unlikely, start, (y, x, cov), method="L-BFGS-B", bounds=[(0.0, None)] * (2 * k)).fun
        for start in rng.uniform(0.0, 1.0, (5, 2 * k))
    )
    assert unlikely(b.ravel(), y, x, cov) == pytest.approx(best, abs=0.05)
    assert b.min() >= 0.0


def test_a_row_that_no_other_row_checks_is_no_worse_than_expected() -> None:
    """A push of 5 N that one row feels is no error of it; errors of 0.3 N that three rows show are found."""
    rng, m = np.random.default_rng(8), 400
    J = np.zeros((m, 2, 4))
    J[:, 0, 0], J[:, 1, 1:] = 1.0, 1.0
    error, sizes = np.full(4, 0.1), np.array([0.1, 0.3, 0.3, 0.3])
    y = sizes * rng.standard_normal((m, 4))
    y[m // 2 :, 0] += 5.0
    x, force, sliding = -rng.standard_normal((2, m, 4)), np.full((m, 2), 20.0), np.full((m, 4), SLIDING)
    _, size, *_ = most_likely(y, x, np.full(2, np.inf), J, list(range(4)), sliding, force, error)
    assert size[0] <= 1.0
    np.testing.assert_allclose(0.1 * size[1:] ** 0.5, 0.3, rtol=0.15)


def test_a_blow_is_no_error_of_the_rows() -> None:
    """Two of 400 instants have a force of 50 times its size; a force of its size stays what was expected."""
    rng, m = np.random.default_rng(9), 400
    J, error, force = np.broadcast_to(np.ones((1, 3)), (m, 1, 3)), np.full(3, 0.1), np.full((m, 1), 2.0)
    pushed = np.where(np.arange(m)[:, None] // 2 == 100, 100.0, 2.0 * rng.standard_normal((m, 1)))
    y = np.einsum("mck,mc->mk", J, pushed) + error * rng.standard_normal((m, 3))
    grown = with_blows(force, y, J)
    np.testing.assert_allclose(grown[200:202], 100.0, rtol=0.1)
    x, sliding, every = -rng.standard_normal((2, m, 3)), np.full((m, 3), SLIDING), [0, 1, 2]
    size = most_likely(y, x, np.full(2, np.inf), J, every, sliding, grown, error)[1]
    np.testing.assert_allclose(size, 1.0, rtol=0.25)


def test_a_robot_in_a_plane_has_rows_that_are_zero() -> None:
    """More of them than forces reach one by one, as of a simulation that is exact: no matrix is singular."""
    J = np.broadcast_to([[1.0, 0.0, 0.0], [0.0, 3.0, 3.0]], (20, 2, 3))
    y = np.array([1.0, 0.0, 0.0]) * np.random.default_rng(1).standard_normal((20, 1))
    np.testing.assert_array_equal(with_blows(np.full((20, 2), 30.0), y, J), 30.0)


@pytest.mark.parametrize("root", ["fixed", "free_flyer"])
def test_rows_are_known_to_a_share_of_what_they_move(root: Literal["fixed", "free_flyer"]) -> None:
    """An arm of a held humanoid, by its masses; of a free one the legs carry all. A measured row counts as such."""
    robot = robot_of_map(RobotTable(name="g1", root=root, points=("left_rubber_hand",)), Path())
    model, arm = robot.model, re.compile("left_(shoulder|elbow|wrist)")
    rows = AllBut(*(joint for joint in robot.joints if not arm.match(joint)))
    moved = [inertia.mass for name, inertia in zip(model.names, model.inertias, strict=True) if arm.match(name)]
    weight = moving_weight(model) if root == "free_flyer" else 9.81 * sum(moved)
    nothing, point = np.zeros(model.nv), ("left_rubber_hand",)
    found = expected_from(robot, rows, FittedValues(), point, nothing, nothing).row_error
    np.testing.assert_allclose(found, 1e-3 * weight * row_scale(model), rtol=1e-3)

    measured = FittedValues(row_noise=dict.fromkeys(row_names(model), 0.0))
    found, data = expected_from(robot, rows, measured, point, nothing, nothing).row_error, model.createData()
    pin.forwardKinematics(model, data, pin.neutral(model))
    for joint in model.joints.tolist()[1:]:
        about = [data.oMi[joint.id].actInv(data.oMi[k]).act(model.inertias[k]) for k in model.subtrees[joint.id]]
        mass = sum(each.mass for each in about)
        radius = sum(np.trace(each.inertia) / 2.0 + each.mass * each.lever @ each.lever for each in about) / mass
        wanted = 9.81e-3 * mass * np.repeat([1.0, radius**0.5], 3)[-joint.nv :]
        np.testing.assert_allclose(found[joint.idx_v : joint.idx_v + joint.nv], wanted, rtol=1e-3)


def test_friction_of_a_joint_that_hardly_moves_is_no_larger_than_its_row_ever_is() -> None:
    """It creeps at a twentieth of the rate from which friction is told, against 6 N m: 114 N m were found."""
    rng, m = np.random.default_rng(9), 400
    rate = 0.05 * np.sin(np.linspace(0.0, 12.0, m))[:, None] + 0.01 * rng.standard_normal((m, 2))
    J, error, force = np.zeros((m, 1, 2)), np.full(2, 0.1), np.full((m, 1), 20.0)
    y = -6.0 * np.sign(rate) + error * rng.standard_normal((m, 2))
    x = np.stack([-np.tanh(rate), -rate])
    b, size, *_ = most_likely(y, x, np.full(2, np.inf), J, [0, 1], np.tanh(rate), force, error)
    assert b[0].max() <= np.abs(y).max() * 1.001
    assert size.max() <= 3.0


def moving_alike(seed: int) -> tuple[Array, Array, Array, Array, Array]:
    """Return rows y (m, 4), friction's columns x, its size, forces (m, 2), J: pairs move alike, as a force has it."""
    rng, m = np.random.default_rng(seed), 200
    rate = rng.standard_normal((m, 2))[:, [0, 0, 1, 1]] + 0.1 * rng.standard_normal((m, 4))
    x, f = np.stack([-np.sign(rate), -rate]), 3.0 * rng.standard_normal((m, 2))
    J = np.broadcast_to(np.array([[1.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 1.0]]), (m, 2, 4))
    true = np.full((2, 4), 0.3)
    y = np.einsum("mck,mc->mk", J, f) + np.einsum("ami,ai->mi", x, true) + 0.1 * rng.standard_normal((m, 4))
    return y, x, true, f, J


def found_in(y: Array, x: Array, J: Array) -> tuple[Array, Array, Array]:
    """Return friction b, the errors' variance (4,) of the rows, and what friction's own errors add to it."""
    m, k = y.shape
    known, force = np.full(2, np.inf), np.full((m, 2), 20.0)
    b, size, unsure, _ = most_likely(y, x, known, J, list(range(k)), np.full((m, k), SLIDING), force, np.full(k, 0.1))
    return b, 0.01 * size, unsure


def test_friction_is_as_unsure_as_a_least_squares_of_all_unknowns_at_once_says() -> None:
    """Forces of every instant and friction by one lstsq: rows of weight 1 / 0.1, and the forces' sizes beside them."""
    y, x, _, _, J = moving_alike(1)
    _, m, k = x.shape
    table = np.zeros((m, k, 2 * m + 2 * k))
    for at in range(m):
        table[at, :, 2 * at : 2 * at + 2] = J[at].T
        table[at, :, 2 * m :] = np.concatenate([np.diag(x[0, at]), np.diag(x[1, at])], axis=1)
    sizes = np.concatenate([np.eye(2 * m) / 20.0, np.zeros((2 * m, 2 * k))], axis=1)
    whole = np.concatenate([table.reshape(m * k, -1) / 0.1, sizes])
    C = np.linalg.inv(whole.T @ whole)[2 * m :, 2 * m :]
    X = table[:, :, 2 * m :]
    expected = np.mean(np.einsum("mip,pq,miq->mi", X, C, X, optimize=True), axis=0)
    _, variance, unsure = found_in(y, x, J)
    np.testing.assert_allclose(np.sqrt(unsure), np.sqrt(expected), rtol=0.35)  # by 200 samples of scores
    assert np.sqrt(unsure.mean()) == pytest.approx(np.sqrt(expected.mean()), rel=0.15)
    assert np.sqrt(expected.mean()) > 0.5 * np.sqrt(variance.mean())


def test_forces_beside_friction_are_within_two_deviations() -> None:
    """Of thirty records: 85 % without the errors of friction, above 90 % with them; both rows of a pair err alike."""
    within, wrong, stated = np.zeros((30, 2)), np.zeros(30), np.zeros(30)
    for seed in range(30):
        y, x, true, f, J = moving_alike(seed)
        b, variance, unsure = found_in(y, x, J)
        wrong[seed] = np.mean(np.einsum("ami,ai->mi", x, b - true) ** 2)
        stated[seed] = unsure.mean()
        for k, R in enumerate((variance, variance + unsure)):
            P = np.linalg.inv((J[0] / R) @ J[0].T + np.eye(2) / 20.0**2)
            error = (y - np.einsum("ami,ai->mi", x, b)) @ (P @ (J[0] / R)).T - f
            within[seed, k] = np.mean(np.abs(error) < 2.0 * np.sqrt(np.diag(P)))
    assert within[:, 0].mean() < 0.88
    assert within[:, 1].mean() > 0.9
    assert np.sqrt(stated.mean()) == pytest.approx(np.sqrt(wrong.mean()), rel=0.15)


def test_errors_that_last_make_coefficients_less_sure() -> None:
    """A slope of a slow column under errors that last ten samples, in 400 records; one at its bound has no error."""
    found, stated = np.zeros(400), np.zeros(400)
    slow = np.sin(2.0 * np.pi * np.arange(600) / 200.0)
    for seed in range(400):
        e = lfilter([1.0], [1.0, -0.9], np.random.default_rng(seed).standard_normal(600))
        found[seed] = slow @ e / (slow @ slow)
        scores = np.stack([slow * (e - slow * found[seed]), slow], axis=1)
        free = np.array([True, False])
        C = coefficient_covariance(np.diag([slow @ slow, 1.0]), scores, np.zeros(2), free)
        stated[seed] = C[0, 0]
        assert not C[1].any()
        assert not C[:, 1].any()
    assert np.sqrt(np.mean(stated)) == pytest.approx(found.std(), rel=0.25)


@pytest.mark.parametrize("rate", [1000.0, 999.9999999999991, 1000.0000000001])
def test_the_last_digit_of_the_stamps_does_not_decide_which_instants_are_looked_at(rate: float) -> None:
    """Of a rate that was found, not given, the first was another one: every fifth then met an IMU's other samples."""
    assert settled_instants(np.arange(200) / rate, 100.0)[0] == 51
