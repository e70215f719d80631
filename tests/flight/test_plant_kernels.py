"""The kernels of the plant equal their numpy twins, instant by instant and over a flight."""

import gc
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from support import twins
from support.kernel_cases import (
    CASES,
    MORPHOLOGIES,
    SEEDS,
    assert_equal,
    assert_spatial,
    built,
    compiled_only,
    instant,
    robot_with_a_turned_frame,
)
from support.section_law import evaluate

from aerobat_pin.aerobat import RobotAir
from aerobat_pin.aerobat.air.robot_in_air import warm_up
from aerobat_pin.aerodynamics import strips_of
from aerobat_pin.flight import Plant
from aerobat_pin.flight.attitude_hold import AttitudeHold, attitude_error, hold_wrench, rotation_vector
from aerobat_pin.flight.plant import kernels as plant_kernels
from aerobat_pin.numerics import small_matrices

SPATIAL = ("aerodynamic", "thrusters", "unknown", "link_wrench")
GUSTY = 0.07  # [s] in the middle of the gust of the cases


@compiled_only
def test_what_is_not_positive_definite_gives_nan_and_not_a_plausible_number() -> None:
    """Nothing checks the matrix: its failure has to show in the result, which the callers look at."""
    x = np.ones(2)
    small_matrices.solve_positive(np.diag([1.0, -1.0]), x)
    assert np.isnan(x[1])


@pytest.mark.parametrize("below", [np.pi, np.pi - 1e-9, 3.0, 2.0, 1.0, 0.5, 0.04, 1e-2, 1e-4, 1e-6, 1e-9, 1e-12, 0.0])
def test_the_rotation_vector_is_exact_up_to_half_a_turn(below: float) -> None:
    """Also where sin(angle) vanishes, at half a turn with either sign; all branches of the quaternion, any axis."""
    axes = np.vstack([np.eye(3), -np.eye(3), np.random.default_rng(1).standard_normal((20, 3))])
    for axis in axes / np.linalg.norm(axes, axis=1, keepdims=True):
        half = np.sin(below / 2.0)  # cos(angle / 2), without cancellation
        R, found = pin.Quaternion(half, *(np.cos(below / 2.0) * axis)).matrix(), np.empty(3)
        rotation_vector(R, found)
        if below < 1e-9:
            found *= np.sign(found @ axis)
        np.testing.assert_allclose(found, (np.pi - below) * axis, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("axis", [*np.eye(3), np.array([0.48, -0.6, 0.64])])
def test_the_holds_attitude_error_passes_half_a_turn_without_a_jump(axis: np.ndarray) -> None:
    """The rotation vector up to 90 deg, to the last bit; then ever less, with slope and curvature 0 at 180 deg."""
    h, found, vector = 1e-3, np.empty(3), np.empty(3)

    def error(angle: float) -> np.ndarray:
        attitude_error(pin.exp3(angle * axis), found)
        return found.copy()

    for angle in (0.0, 1e-9, 0.3, 1.5, 1.57):
        rotation_vector(pin.exp3(angle * axis), vector)
        np.testing.assert_array_equal(error(angle), vector)
    np.testing.assert_allclose(error(1.75 * np.pi), -0.25 * np.pi * axis, rtol=1e-12)
    for angle in (0.5 * np.pi, np.pi, 1.5 * np.pi):
        before, here, after = (error(angle + step) @ axis for step in (-h, 0.0, h))
        slope = 1.0 if angle != np.pi else 0.0
        assert (after - before) / (2.0 * h) == pytest.approx(slope, abs=1e-4)
        assert (after - 2.0 * here + before) / h**2 == pytest.approx(0.0, abs=0.03)
    sizes = [np.linalg.norm(error(angle)) for angle in np.linspace(1.9, np.pi, 50)]
    assert np.all(np.diff(sizes) < 0.0)
    assert sizes[-1] < 1e-12


def test_the_hold_pushes_as_its_twin() -> None:
    """Inside the limits and outside, per axis; errors of the attitude up to half a turn."""
    rng = np.random.default_rng(0)
    for _ in range(20):
        gains = [rng.uniform(0.1, 1.0, 3) for _ in range(3)]
        hold = AttitudeHold(pin.exp3(rng.uniform(-1, 1, 3)), *rng.uniform(-1, 1, 2), *gains, *rng.uniform(0.1, 1.0, 6))
        rotation, (position, linear, angular) = pin.exp3(rng.uniform(-2, 2, 3)), rng.uniform(-2.0, 2.0, (3, 3))
        twist = np.concatenate([linear, 0.3 * angular])
        packed, wrench = AttitudeHold(*(np.asarray(value) for value in hold)), np.empty(6)
        hold_wrench(packed, np.append(rotation.ravel(order="F"), position), twist, np.empty((3, 3)), wrench)
        assert_spatial(wrench, twins.hold_wrench(hold, position, rotation, twist))


@pytest.mark.parametrize("options", [{}, {"lift_limit": 1.2}, {"model": "quasi_steady"}])
@pytest.mark.parametrize("tail", ["own", "tilted", "none"])
def test_the_air_loads_equal_their_twin(tail: str, options: dict[str, Any]) -> None:
    """Random twists, also backwards, and a random state; strips at rest among them."""
    robot = robot_with_a_turned_frame("aerobat", tail)
    air = RobotAir(robot.wing, strips=13, air_density=1.1, **options)
    for seed in range(6):
        rng = np.random.default_rng(seed)
        twists = rng.uniform(-4.0, 4.0, (5, 6)) * np.repeat([1.0, 8.0], 3)
        twists[seed % 5] *= seed % 2
        state = rng.uniform(-0.1, 0.1, air.state_size)
        wrenches, rates, strips = evaluate(air, twists, state)
        expected, expected_rates, loads = twins.air_loads(air, robot.wing.morphology, twists, state)
        assert_spatial(wrenches, expected)
        for part, whole in zip(air.line.split(rates), air.line.split(expected_rates), strict=True):
            assert_equal(part, whole)
        for name, part in strips._asdict().items():
            assert_equal(part, getattr(strips_of(loads), name))
        assert_equal(strips.incidence, np.arctan2(loads[1] + 0.0, loads[0] + 0.0))


@pytest.mark.parametrize("seed", SEEDS)
def test_the_warm_up_is_runge_kutta_on_the_air_alone(seed: int, paper_plant: Plant) -> None:
    """Five steps under random twists, each given at its start, middle and end."""
    air, rng = paper_plant.air, np.random.default_rng(seed)
    twists = rng.uniform(-1.0, 1.0, (11, 5, 6)) * np.repeat([1.0, 10.0], 3) + np.array([3.0, 0, 0, 0, 0, 0])
    start = rng.uniform(-0.02, 0.02, air.state_size)
    in_air = paper_plant.in_air
    in_air.fields.state[:] = start
    warm_up(in_air.memory, twists, 2e-3)
    assert_equal(in_air.fields.state, twins.warmed_up(air, paper_plant.robot.morphology, twists, 2e-3, start))


@pytest.mark.parametrize(
    ("morphology", "case"),
    [*(("aerobat", case) for case in CASES), *((name, "all forces, hold") for name in MORPHOLOGIES[1:])],
)
def test_one_instant_of_the_plant_equals_the_twin_plant(morphology: str, case: str) -> None:
    """Inverse dynamics needs what all forces add up to; motor and added mass apart, they equal their twins."""
    plant = built(morphology, case)
    for seed in SEEDS:
        q, v, joints, air, held = instant(plant, seed)
        acceleration, air_rate, forces = plant.rates(q, v, joints, air, held, GUSTY)
        found = {name: part[0] for name, part in forces._asdict().items()}
        expected = twins.forces_of(plant, q, v, joints[0, 1], air, held, GUSTY)
        split = plant.air.line.split
        for part, whole in zip(split(air_rate), split(expected.pop("air_rate")), strict=True):
            assert_equal(part, whole)
        for name, twin in expected.items():
            (assert_spatial if name in SPATIAL else assert_equal)(found[name], twin)
        air_force, body = found["aerodynamic"] + found["added_mass"], found["thrusters"]
        a = plant.robot.velocity(acceleration, *joints[2])
        needed = pin.rnea(plant.model, plant.model.createData(), q, v, a)
        assert not found["motor"][:6].any()
        assert_spatial(air_force + body + found["motor"] + found["unknown"], needed, 1e-11)
        powers = {"motor": found["motor"], "air": air_force, "thruster": body, "unknown": found["unknown"]}
        for name, force in powers.items():
            assert_equal(found[f"{name}_power"], force @ v, 1e-11)


def test_a_state_outlives_the_plant_that_made_it() -> None:
    """All that its kernels read goes on to live with it: air, robot in air, and Pinocchio's results."""
    plant = built("aerobat", "all forces, hold")
    q, v, joints, air, held = instant(plant, 3)
    state, wind = np.concatenate([v[:6], air]), np.zeros((2, 3))
    rate, expected = np.empty_like(state), np.empty_like(state)
    plant.evaluate(q, v, joints, wind, held[:, :, None].copy(), state, expected)
    memory, fields = plant.memory, plant.fields
    del plant
    gc.collect()
    litter = [np.full(size, np.nan) for size in range(1, 2000)]
    plant_kernels.evaluate(memory, joints, wind, held[:, :, None].copy(), 0, state, rate)
    np.testing.assert_array_equal(rate, expected)
    assert np.isfinite(fields.robot.results.M).all()
    assert np.isnan(litter[-1]).all()
