"""The thrusters as they are, and the thrusts that come nearest to a wanted wrench."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from aerobat_pin.aerobat import load_morphology
from aerobat_pin.control import Allocation
from aerobat_pin.control.allocation import EVEN, PRIORITY, THRUSTER_ARM
from aerobat_pin.errors import ScenarioError
from aerobat_pin.flight import LaggedThrust, ThrusterSet, thrusters_of
from aerobat_pin.scenario import ThrustersSection

LIFT = 0.77  # [N] that the guarded robot's nominal flight needs


def guard() -> ThrusterSet:
    return thrusters_of(load_morphology("aerobat_guard"))


def test_the_map_is_what_six_pushes_at_six_places_do() -> None:
    """Each column by hand: force along the direction, moment of the place, reaction of the propeller."""
    found, shape = guard(), load_morphology("aerobat_guard")
    assert found.names == tuple(f"thruster_{i}" for i in range(1, 7))
    for column, one in zip(found.map.T, shape.thrusters, strict=True):
        (x, y, z), (a, b, c) = one.position, one.direction
        moment = np.array([y * c - z * b, z * a - x * c, x * b - y * a]) + one.torque / one.thrust * np.array([a, b, c])
        np.testing.assert_allclose(column, [a, b, c, *moment], rtol=0.0, atol=1e-15)
    with pytest.raises(ScenarioError, match="has no thrusters"):
        thrusters_of(load_morphology("aerobat"))


def test_the_six_balance_yaw_where_they_lift_the_robot() -> None:
    """1 to 4 turn the nose right by 12 mN m, 5 and 6 by up to 56 mN m left; with the other sense it would fall."""
    found = guard()
    yaw = found.map[5] * found.limit
    assert np.sum(yaw[:4]) * LIFT / 1.4 == pytest.approx(-12.3e-3, abs=0.1e-3)
    assert np.sum(yaw[4:]) == pytest.approx(56e-3, abs=1e-3)
    allocation = Allocation(found)
    thrust = allocation.thrusts(np.array([0.0, 0.0, LIFT, 0.0, 0.0, 0.0]))
    np.testing.assert_allclose(found.map @ thrust, [0.0, 0.0, LIFT, 0.0, 0.0, 0.0], atol=1e-6)
    assert np.all(thrust > 0.0)
    assert np.linalg.matrix_rank(found.map) == 5
    reversed_sense = found.map.copy()
    reversed_sense[:, 4:] *= -1.0
    wrong = Allocation(ThrusterSet(found.names, reversed_sense, found.limit))
    level = np.array([0.0, 0.0, LIFT, 0.0, 0.0, 0.0])
    assert abs(wrong.unrealised(level, wrong.thrusts(level))[5]) > 10e-3


def test_limited_thrusts_are_those_of_scipys_bounded_least_squares() -> None:
    """Three hundred wrenches, most of them out of reach, against scipy's solver for the same weighted problem."""
    found, rng = guard(), np.random.default_rng(2)
    allocation = Allocation(found)
    weight = np.array(list(PRIORITY.values())) / np.array([1.0, 1.0, 1.0, *[THRUSTER_ARM] * 3])
    weighted = weight[:, None] * found.map
    even = np.sqrt(EVEN * np.sum(weighted**2)) * np.eye(6)
    stacked, limited = np.vstack([weighted, even]), 0
    for _ in range(300):
        wrench = rng.normal(0.0, 1.0, 6) * [0.05, 0.1, 0.4, 0.06, 0.05, 0.02] + [0.0, 0.0, LIFT, 0.0, 0.0, 0.0]
        thrust = allocation.thrusts(wrench)
        reach = np.sort([np.minimum(found.map, 0.0) @ found.limit, np.maximum(found.map, 0.0) @ found.limit], axis=0)
        target = np.append(weight * np.clip(wrench, *reach), np.zeros(6))
        best = lsq_linear(stacked, target, (0.0, found.limit), method="bvls", tol=1e-14)
        assert np.all(thrust >= 0.0)
        assert np.all(thrust <= found.limit)
        miss = np.linalg.norm(stacked @ thrust - target)
        assert miss <= np.linalg.norm(best.fun) * (1.0 + 1e-7) + 1e-9
        limited += int(np.any((thrust == 0.0) | (thrust == found.limit)))
    assert 100 < limited < 300


def test_roll_and_pitch_come_before_yaw_and_yaw_before_lift() -> None:
    """Too much of everything keeps most of its roll; too much lift is made rather than yaw."""
    allocation = Allocation(guard())
    wrench = np.array([0.2, 0.0, 1.4, 0.06, 0.0, 0.06])
    left = np.abs(allocation.unrealised(wrench, allocation.thrusts(wrench)) / [0.2, 1.0, 1.4, 0.06, 1.0, 0.06])
    assert left[3] < 0.1
    assert left[3] < min(left[2], left[5])
    assert left[0] > max(left[2], left[5])
    light = np.array([0.0, 0.0, 0.05, 0.01, 0.01, 0.0])
    left = allocation.unrealised(light, allocation.thrusts(light))
    assert np.all(np.abs(left[3:]) < 0.2e-3)
    assert left[2] < -0.05


def test_a_thrust_follows_its_command_late_and_slowly() -> None:
    """A step of the command: nothing for the delay, then 1 - exp(-t / lag); means are exact integrals."""
    section, dt = ThrustersSection(lag=0.045, delay=0.003, factor=0.8), 1e-3
    found = guard()
    thrust = LaggedThrust(found, section, dt, np.zeros(6))
    command = np.array([0.1, 0.2, 0.3, 9.0, -1.0, 0.05])
    kept = np.clip(command, 0.0, found.limit)
    for k in range(200):
        wrench = thrust.advance(command)
        t = np.array([k, k + 1]) * dt - 0.003
        t = np.maximum(t, 0.0)
        integral = kept * ((t[1] + 0.045 * np.exp(-t[1] / 0.045)) - (t[0] + 0.045 * np.exp(-t[0] / 0.045)))
        np.testing.assert_allclose(thrust.mean, 0.8 * integral / dt, rtol=0.0, atol=1e-12)
        np.testing.assert_allclose(wrench, found.map @ thrust.mean, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(thrust.thrust, kept, rtol=0.02)
