"""Every compiled kernel equals its readable numpy twin, looks at Pinocchio's own memory, and is never out of date.

Tolerances are relative to the natural scale of what is compared: 1e-12 for one evaluation, 1e-10 for a whole flight.
"""

from __future__ import annotations

import copy
import os
import pickle
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pinocchio as pin
import pytest
import twins

import aerobat_pin
from aerobat_pin import jit, plant_kernels, plant_layout
from aerobat_pin.aerodynamics import RobotAir
from aerobat_pin.hold import AttitudeHold, rotation_vector
from aerobat_pin.integrators import next_stage
from aerobat_pin.observers import OBSERVERS, Observer, kernels
from aerobat_pin.observers.force_points import ROWS, Rows
from aerobat_pin.plant import AXES, Plant
from aerobat_pin.robot import FORCE_POINTS, Aerobat, load_aerobat
from aerobat_pin.scenario import load_scenario, parse_scenario
from aerobat_pin.simulation import held_parts
from aerobat_pin.wing import LINKS, Wing

PACKAGE = Path(aerobat_pin.__file__).parent
MORPHOLOGIES = ("aerobat", "aerobat_guard", "aerobat_light")
KINDS = list(OBSERVERS.values())
SEEDS = range(3)
TURNED = "turned_frame"  # a frame that is neither at its joint nor along its axes
COPIES: dict[str, Callable[[Any], Any]] = {
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
    "pickle": lambda thing: pickle.loads(pickle.dumps(thing)),
}
HOLD = load_scenario("paper").hold
compiled_only = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="NUMBA_DISABLE_JIT is set")


def assert_equal(actual: Any, expected: Any, tolerance: float = 1e-12) -> None:
    """Compare relative to the largest expected entry; NaN and other shapes never pass."""
    actual, expected = np.asarray(actual), np.asarray(expected)
    assert actual.shape == expected.shape
    if expected.size:
        scale = np.max(np.abs(expected)) or 1.0
        np.testing.assert_allclose(actual / scale, expected / scale, rtol=0.0, atol=tolerance, equal_nan=False)


def assert_spatial(actual: Any, expected: Any, tolerance: float = 1e-12) -> None:
    """Compare forces and moments (..., 6), or generalised forces with the base first, each on their own scale."""
    assert_equal(actual[..., :3], expected[..., :3], tolerance)
    assert_equal(actual[..., 3:], expected[..., 3:], tolerance)


def robot_with_a_turned_frame(morphology: str, tail: str = "own") -> Aerobat:
    """Load a robot with one frame more, and with its own tail, one off the middle at an incidence, or none."""
    robot = load_aerobat(morphology)
    joint = robot.model.getJointId("left_shoulder")
    turned = pin.SE3(pin.exp3(np.array([0.4, -0.7, 1.1])), np.array([0.01, 0.03, -0.004]))
    robot.model.addFrame(pin.Frame(TURNED, joint, 0, turned, pin.FrameType.OP_FRAME))
    shape = robot.morphology
    if tail == "none":
        shape = replace(shape, tail=None)
    elif tail == "tilted":
        own = load_aerobat("aerobat").morphology.tail
        shape = replace(shape, tail=replace(own, incidence=0.3, position=(-0.11, 0.02, 0.015)))
    return replace(robot, morphology=shape, wing=Wing(shape))


def force(frame: str, axes: str, direction: tuple[float, float, float] = (0.3, -0.5, 0.8)) -> dict[str, Any]:
    """Return one unknown force of a scenario."""
    return {"frame": frame, "axes": axes, "direction": list(direction), "amplitude": 0.3}


# Every mode of axes at a link's own frame, at a turned one and at the base; two forces at one point.
ALL_FORCES = [
    *(force(FORCE_POINTS[i % 2], axes, (0.1 * i, 0.7, -0.4)) for i, axes in enumerate(AXES)),
    *(force(TURNED, axes) for axes in AXES),
    *(force("base_link", axes) for axes in AXES),
]
CASES = {
    "all forces, hold": (ALL_FORCES, True, "own"),
    "all forces, no hold, tail tilted": (ALL_FORCES, False, "tilted"),
    **{f"{axes} axes, hold": ([force(TURNED, axes)], True, "own") for axes in AXES},
    "no force, hold, no tail": ([], True, "none"),
    "no force, no hold": ([], False, "own"),
}


@cache
def built(morphology: str, case: str) -> Plant:
    """Build a plant of one morphology in one case, rolled, pitched and yawed, without a long warm-up."""
    forces, held, tail = CASES[case]
    values = {
        "name": "twin",
        "flight": {"roll_deg": 10.0, "pitch_deg": 7.0, "yaw_deg": -20.0},
        "air": {"warm_up_cycles": 1},
        "unknown_force": forces,
        **({"hold": HOLD.model_dump()} if held else {}),
    }
    return Plant(robot_with_a_turned_frame(morphology, tail), parse_scenario(values, "twin"))


def instant(plant: Plant, seed: int) -> tuple[np.ndarray, ...]:
    """Return a random q, v, joints (3, 2), air state and held noise and steps."""
    rng = np.random.default_rng([seed, 100])
    joints = rng.uniform(-1.0, 1.0, (3, 2)) * np.array([[1.0], [30.0], [900.0]])
    rotation = pin.exp3(rng.uniform(-1.0, 1.0, 3))
    placement = np.concatenate([rng.uniform(-1.0, 1.0, 3), pin.Quaternion(rotation).coeffs()])
    twist = np.array([3.0, 0.0, 0.0, 0.0, 0.0, 0.0]) + rng.uniform(-1.0, 1.0, 6) * np.repeat([1.0, 5.0], 3)
    q, v = plant.robot.configuration(placement, *joints[0]), plant.robot.velocity(twist, *joints[1])
    air = rng.uniform(-0.05, 0.05, plant.air.state_size)
    return q, v, joints, air, rng.uniform(-0.2, 0.2, (2, len(plant.forces)))


def posed(plant: Plant, seed: int) -> tuple[pin.Data, np.ndarray]:
    """Return data with placements, Jacobians and frames at a random instant, and its `liMi` as the kernels see it."""
    q, v, *_ = instant(plant, seed)
    data = plant.model.createData()
    pin.forwardKinematics(plant.model, data, q, v)
    pin.computeJointJacobians(plant.model, data, q)
    pin.updateFramePlacements(plant.model, data)
    return data, jit.placements(data.liMi)


# ------------------------------------------------------------------------------------------------------ linear algebra


@pytest.mark.parametrize("size", [1, 2, 3, 6, 9, 12])
def test_solve_positive_solves_what_numpy_solves(size: int) -> None:
    """Cholesky by hand, in place, reading only the lower triangle, against LAPACK."""
    rng = np.random.default_rng(size)
    root = rng.standard_normal((size, size))
    A, b = root @ root.T + size * np.eye(size), rng.standard_normal(size)
    x, lower = b.copy(), np.tril(A)
    jit.solve_positive(lower, x)
    assert_equal(x, np.linalg.solve(A, b))
    assert_equal(np.tril(lower), np.linalg.cholesky(A))


@compiled_only
def test_what_is_not_positive_definite_gives_nan_and_not_a_plausible_number() -> None:
    """Nothing checks the matrix: its failure has to show in the result, which the callers look at."""
    x = np.ones(2)
    jit.solve_positive(np.diag([1.0, -1.0]), x)
    assert np.isnan(x[1])


# ------------------------------------------------------------------------------------------------ rotation and the hold


@pytest.mark.parametrize("angle", [0.0, 1e-300, 1e-15, 1e-9, 1e-6, 1e-3, 0.5, 1.5, 2.0, 2.5, 3.0, 3.1])
def test_the_rotation_vector_is_log3(angle: float) -> None:
    """All four branches of the quaternion, around random axes and the three axes of the frame."""
    axes = np.vstack([np.eye(3), -np.eye(3), np.random.default_rng(1).standard_normal((20, 3))])
    for axis in axes / np.linalg.norm(axes, axis=1, keepdims=True):
        R, found = pin.exp3(angle * axis), np.empty(3)
        rotation_vector(R, found)
        np.testing.assert_allclose(found, pin.log3(R), rtol=0.0, atol=1e-12)
        np.testing.assert_allclose(found, angle * axis, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("below", [1e-2, 1e-4, 1e-6, 1e-9, 1e-12, 0.0])
def test_the_rotation_vector_is_exact_near_half_a_turn(below: float) -> None:
    """Where sin(angle) vanishes; at half a turn itself both signs are right. R by Rodrigues' formula."""
    angle = np.pi - below
    for axis in np.random.default_rng(2).standard_normal((20, 3)):
        axis /= np.linalg.norm(axis)
        half = np.sin(below / 2.0)  # cos(angle / 2), without cancellation
        R, found = pin.Quaternion(half, *(np.cos(below / 2.0) * axis)).matrix(), np.empty(3)
        rotation_vector(R, found)
        if below < 1e-9:
            found *= np.sign(found @ axis)
        np.testing.assert_allclose(found, angle * axis, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("seed", range(20))
def test_the_hold_pushes_as_its_twin(seed: int) -> None:
    """Inside the limits and outside, per axis."""
    rng = np.random.default_rng(seed)
    gains = [rng.uniform(0.1, 1.0, 3) for _ in range(3)]
    hold = AttitudeHold(pin.exp3(rng.uniform(-1, 1, 3)), *rng.uniform(-1, 1, 2), *gains, *rng.uniform(0.1, 1.0, 6))
    rotation, (position, linear, angular) = pin.exp3(rng.uniform(-1, 1, 3)), rng.uniform(-2.0, 2.0, (3, 3))
    twist = np.concatenate([linear, 0.3 * angular])
    assert_spatial(hold.wrench(position, rotation, twist), twins.hold_wrench(hold, position, rotation, twist))


# ----------------------------------------------------------------------------------------------------------------- air


@pytest.mark.parametrize("tail", ["own", "tilted", "none"])
@pytest.mark.parametrize("morphology", MORPHOLOGIES)
def test_the_air_loads_equal_their_twin(morphology: str, tail: str) -> None:
    """Random twists, also backwards, and a random state; strips at rest among them."""
    robot = robot_with_a_turned_frame(morphology, tail)
    air = RobotAir(robot.wing, strips=13, air_density=1.1)
    for seed in range(10):
        rng = np.random.default_rng(seed)
        twists = rng.uniform(-4.0, 4.0, (5, 6)) * np.repeat([1.0, 8.0], 3)
        twists[seed % 5] *= seed % 2
        state = rng.uniform(-0.1, 0.1, air.state_size)
        wrenches, rates, strips = air.evaluate(twists, state)
        expected, expected_rates, loads = twins.air_loads(air, robot.wing.morphology, twists, state)
        assert_spatial(wrenches, expected)
        for part, whole in zip(air.line.split(rates), air.line.split(expected_rates), strict=True):
            assert_equal(part, whole)
        u, w, w_eff, force_x, force_z = loads
        assert_equal(strips.incidence, np.arctan2(w, u))
        assert_equal(strips.effective_velocity, w_eff)
        assert_equal(strips.force_x, force_x)
        assert_equal(strips.force_z, force_z)


@pytest.mark.parametrize("seed", SEEDS)
def test_the_warm_up_is_runge_kutta_on_the_air_alone(seed: int) -> None:
    """Five steps under random twists, each given at its start, middle and end."""
    robot = robot_with_a_turned_frame("aerobat")
    air, rng = RobotAir(robot.wing), np.random.default_rng(seed)
    twists = rng.uniform(-1.0, 1.0, (11, 5, 6)) * np.repeat([1.0, 10.0], 3) + np.array([3.0, 0, 0, 0, 0, 0])
    start = rng.uniform(-0.02, 0.02, air.state_size)
    state = start.copy()
    plant_kernels.warm_up(air.arrays, twists, 2e-3, state)
    assert_equal(state, twins.warmed_up(air, robot.wing.morphology, twists, 2e-3, start))


# ---------------------------------------------------------------------------------------------------------- integrator


@pytest.mark.parametrize("stage", range(4))
def test_each_stage_follows_the_tableau(stage: int) -> None:
    """Vector state, and the way of q in its first columns; the rest of the tangent belongs to the joints."""
    rng = np.random.default_rng(stage)
    k, rate, start = rng.standard_normal((4, 6)), rng.standard_normal((4, 11)), rng.standard_normal(11)
    state, tangent = np.full(11, np.nan), np.full((2, 8), 7.0)
    next_stage(stage, 0.1, k, rate, start, state, tangent)
    expected, ways = twins.next_stage(stage, 0.1, k, rate, start)
    assert_equal(state, expected)
    assert_equal(tangent[: len(ways), :6], ways)
    assert np.all(tangent[:, 6:] == 7.0)


# --------------------------------------------------------------------------------------------------------------- plant


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("morphology", MORPHOLOGIES)
def test_climbing_the_tree_is_the_sum_of_transposed_jacobians(morphology: str, seed: int) -> None:
    """Link wrenches become the generalised force that Pinocchio's Jacobians give."""
    plant = built(morphology, "all forces, hold")
    data, liMi = posed(plant, seed)
    wrenches = np.random.default_rng(seed).standard_normal((5, 6))
    expected = twins.at_joints(plant.model, data, wrenches)
    found = np.full(plant.model.nv, np.nan)
    plant_kernels.climb(plant.constants.tree, liMi, wrenches, found)
    assert_equal(found, expected)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("morphology", MORPHOLOGIES)
def test_rotations_down_the_tree_are_those_of_pinocchio(morphology: str, seed: int) -> None:
    """Chained placements in the parents against `oMi`."""
    plant = built(morphology, "all forces, hold")
    data, liMi = posed(plant, seed)
    found = np.full((5, 3, 3), np.nan)
    plant_kernels.rotations(plant.constants.tree, liMi, found)
    joints = [plant.model.frames[plant.model.getFrameId(link)].parentJoint for link in LINKS]
    assert_equal(found, [data.oMi[joint].rotation for joint in joints])


@pytest.mark.parametrize("case", [case for case in CASES if "hold" in case])
@pytest.mark.parametrize("morphology", MORPHOLOGIES)
def test_unknown_forces_push_where_and_along_what_they_should(morphology: str, case: str) -> None:
    """In axes of the link, the body and the world, several at a point, at frames that are turned in their link."""
    plant = built(morphology, case)
    held = np.random.default_rng(5).uniform(-0.3, 0.3, (2, len(plant.forces), 4))
    for seed in SEEDS:
        data, liMi = posed(plant, seed)
        rotation, wrenches = np.empty((5, 3, 3)), np.full((5, 6), np.nan)
        at_points, found = np.full((2, len(plant.points), 3), np.nan), np.empty(plant.model.nv)
        plant_kernels.rotations(plant.constants.tree, liMi, rotation)
        plant_kernels.push(plant.constants.unknown, 0.6, held, seed, rotation, wrenches, at_points)
        expected = twins.forces_at_points(
            plant.model, data, plant.forces, plant.points, 0.6, held[0, :, seed], held[1, :, seed]
        )
        assert_equal(at_points, expected)
        plant_kernels.climb(plant.constants.tree, liMi, wrenches, found)
        assert_spatial(found, twins.at_frames(plant.model, data, plant.points, expected[0]))


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("morphology", MORPHOLOGIES)
def test_one_instant_of_the_plant_equals_the_twin_plant(morphology: str, case: str) -> None:
    """Accelerations, rates of the air, all generalised forces, point forces, motor torque and power."""
    plant = built(morphology, case)
    for seed in SEEDS:
        q, v, joints, air, held = instant(plant, seed)
        acceleration, air_rate, forces = plant.rates(q, v, joints, air, held)
        expected, expected_rate, expected_forces, _ = twins.plant_rates(plant, q, v, joints, air, held)
        assert_spatial(acceleration, expected)
        for part, whole in zip(plant.air.line.split(air_rate), plant.air.line.split(expected_rate), strict=True):
            assert_equal(part, whole)
        for name in forces._fields:
            actual, twin = getattr(forces, name)[0], getattr(expected_forces, name)
            (assert_spatial if name in ("aerodynamic", "thrusters", "unknown") else assert_equal)(actual, twin)


@pytest.fixture(scope="module")
def paper_plant() -> Plant:
    """Build the paper's plant."""
    scenario = load_scenario("paper")
    return Plant(load_aerobat(scenario.robot.morphology, scenario.robot.changes), scenario)


def test_a_flight_of_the_paper_equals_the_flight_of_the_twin(paper_plant: Plant) -> None:
    """0.1 s with the same held noise; the twin steps the base on SE(3) with the general integrator."""
    held = held_parts(paper_plant.forces, np.arange(101) * 1e-3, seed=1)
    found, expected = paper_plant.fly(100, 1e-3, held), twins.fly(paper_plant, 100, 1e-3, held)
    assert_equal(found.q[:, :3], expected.q[:, :3], 1e-10)
    assert_equal(found.q[:, 3:], expected.q[:, 3:], 1e-10)
    assert_spatial(found.v[:, :6], expected.v[:, :6], 1e-10)
    assert_equal(found.v[:, 6:], expected.v[:, 6:], 1e-10)
    for part, whole in zip(np.split(found.air, 3, axis=1), np.split(expected.air, 3, axis=1), strict=True):
        assert_equal(part, whole, 1e-10)
    for name, mean, twin in zip(found.forces._fields, found.forces, expected.forces, strict=True):
        (assert_spatial if name in ("aerodynamic", "thrusters", "unknown") else assert_equal)(mean, twin, 1e-10)
    for row in range(5):
        assert_equal(found.loads[:, row], expected.loads[:, row], 1e-10)


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("morphology", MORPHOLOGIES)
def test_a_few_steps_in_every_case_equal_the_twin(morphology: str, case: str) -> None:
    """Three steps from a warmed-up start, so that every stage of `advance` is met with every kind of load."""
    plant = built(morphology, case)
    held = np.random.default_rng(11).uniform(-0.2, 0.2, (2, len(plant.forces), 3))
    found, expected = plant.fly(3, 2e-3, held), twins.fly(plant, 3, 2e-3, held)
    assert_equal(found.q, expected.q)
    assert_equal(found.v, expected.v)
    assert_equal(found.air, expected.air)
    for mean, twin in zip(found.forces, expected.forces, strict=True):
        assert_equal(mean, twin)


@pytest.mark.parametrize("case", CASES)
def test_packed_constants_come_back_as_views_of_the_same_numbers(case: str) -> None:
    """`unpack` undoes `pack`, without copying, with and without forces and hold; nothing is left over."""
    constants = built("aerobat", case).constants
    numbers, integers = plant_layout.pack(constants)
    air, tree, unknown, hold = plant_layout.unpack(numbers, integers)
    doubles = (air.strips, air.downwash, air.numbers, air.tail, tree.axis, unknown.numbers, unknown.points, hold)
    whole = (air.link, tree.table, unknown.table)
    expected = constants.air, constants.tree, constants.unknown
    for found, original in zip((air, tree, unknown), expected, strict=True):
        for actual, value in zip(found, original, strict=True):
            np.testing.assert_array_equal(actual, value)
    np.testing.assert_array_equal(hold, constants.hold)
    assert sum(part.size for part in doubles) == numbers.size
    assert 4 + sum(part.size for part in whole) == integers.size
    assert all(np.shares_memory(part, numbers) for part in doubles if part.size)
    assert all(np.shares_memory(part, integers) for part in whole if part.size)


def test_the_scratch_is_cut_into_parts_that_do_not_overlap() -> None:
    """Each double of the scratch belongs to exactly one name."""
    flat = plant_layout.scratch(7)
    work = plant_layout.unpack_work(flat)
    assert [part.shape for part in work] == [(3, 5, 6), (5, 3, 3), (5, 7), (7, 6), (4, 6)]
    for part in work:
        part += 1.0
    np.testing.assert_array_equal(flat, 1.0)


# ----------------------------------------------------------------------------------------------------------- observers


def sample_models() -> dict[str, tuple[pin.Model, list[str]]]:
    """Return a free-flyer with wings, a fixed arm and a humanoid, each with points on several bodies."""
    robot = robot_with_a_turned_frame("aerobat")
    arm, humanoid = pin.buildSampleModelManipulator(), pin.buildSampleModelHumanoid()
    frames: dict[str, list[str]] = {"arm": [], "humanoid": []}
    for name, model, joints in (
        ("arm", arm, (arm.njoints - 1,)),
        ("humanoid", humanoid, (1, humanoid.njoints // 2, humanoid.njoints - 1)),
    ):
        for joint in joints:
            place = pin.SE3(pin.exp3(np.array([0.3, 0.2, -0.9])), np.array([0.1, -0.2, 0.3]))
            model.addFrame(pin.Frame(f"point_{joint}", joint, 0, place, pin.FrameType.OP_FRAME))
            frames[name].append(f"point_{joint}")
    return {
        "aerobat": (robot.model, list(FORCE_POINTS)),
        "aerobat, turned frame": (robot.model, [TURNED, FORCE_POINTS[1]]),
        "arm": (arm, frames["arm"]),
        "humanoid": (humanoid, frames["humanoid"]),
    }


MODELS = sample_models()


def believable(name: str, rows: str) -> bool:
    """Say whether a model has the free base that a choice of rows needs."""
    return rows == "all" or MODELS[name][0].joints[1].nv == 6


def record(model: pin.Model, count: int = 40, seed: int = 3) -> tuple[Any, ...]:
    """Return a random record: uneven stamps with one repeated, configurations near each other, known forces."""
    rng = np.random.default_rng(seed)
    steps = rng.uniform(2e-4, 5e-3, count)
    steps[count // 2] = 0.0
    time = 1.0 + np.concatenate([[0.0], np.cumsum(steps)])
    q = [pin.integrate(model, pin.neutral(model), rng.uniform(-0.6, 0.6, model.nv))]
    for k in range(count):
        q.append(q[k] if steps[k] == 0.0 else pin.integrate(model, q[k], rng.uniform(-0.05, 0.05, model.nv)))
    v = rng.uniform(-1.0, 1.0, (count + 1, model.nv))
    v[count // 2 + 1] = v[count // 2]
    tau, *known = rng.uniform(-1.0, 1.0, (3, count, model.nv))
    return time, np.array(q), v, tau, dict(zip(("air", "other"), known, strict=True))


@pytest.mark.parametrize("gain", ["one", "each"])
@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
@pytest.mark.parametrize(("name", "rows"), [(name, rows) for name in MODELS for rows in ROWS if believable(name, rows)])
def test_observers_equal_their_twins_in_stream_and_batch(
    name: str, rows: Rows, kind: type[Observer], gain: str
) -> None:
    """Random record, uneven stamps, one repeated; one gain for all or each its own; every choice of believed rows."""
    model, frames = MODELS[name]
    frames = frames if rows == "all" else frames[-1:]  # six or seven rows tell no more than one point apart
    size = 3 * len(frames) if kind.project_first else model.nv
    K = 300.0 if gain == "one" else np.random.default_rng(4).uniform(50.0, 2000.0, size)
    time, q, v, tau, known = record(model)
    twin = twins.ObserverTwin(model, frames, K, rows, project_first=kind.project_first)
    residual, points = twin.run(time, q, v, tau, known)
    observer = kind(model, frames, K, rows)
    estimate = observer.run(time, q, v, tau, known)
    assert_equal(estimate.residual, residual)
    assert_equal(estimate.force, points)
    observer.reset(q[0], v[0], time[0])
    for k in range(len(tau)):
        now = {channel: values[k] for channel, values in known.items()}
        sample = observer.update(time[k + 1], q[k + 1], v[k + 1], tau[k], now)
        assert_equal(sample.residual / np.max(np.abs(residual)), residual[k] / np.max(np.abs(residual)))
        assert_equal(sample.force / np.max(np.abs(points)), points[k] / np.max(np.abs(points)))


def test_without_points_the_residual_equals_the_twin() -> None:
    """The momentum observer alone, on the arm."""
    model, _ = MODELS["arm"]
    time, q, v, tau, known = record(model)
    estimate = OBSERVERS["momentum"](model, (), 500.0).run(time, q, v, tau, known)
    residual, _ = twins.ObserverTwin(model, (), 500.0, project_first=False).run(time, q, v, tau, known)
    assert_equal(estimate.residual, residual)


@pytest.mark.parametrize("name", MODELS)
def test_a_remembered_sample_is_momentum_drift_and_jacobians(name: str) -> None:
    """Read through the addresses of Pinocchio's results, against its own Jacobians of the frames."""
    model, frames = MODELS[name]
    observer = OBSERVERS["momentum"](model, frames)
    _, q, v, _, _ = record(model, count=4)
    memory = np.full((len(v), 3 + 3 * len(frames), model.nv), np.nan)
    places, store = observer._fixed
    for k in range(len(v)):
        pin.crba(model, observer.data, q[k])
        pin.computeCoriolisMatrix(model, observer.data, q[k], v[k])
        pin.computeGeneralizedGravity(model, observer.data, q[k])
        kernels.collect(places, store, v, k, memory)
        expected = twins.remembered(model, frames, q[k], v[k])
        assert_equal(memory[k, 0], expected[0])
        assert_equal(memory[k, 1], expected[1])
        assert_equal(memory[k, 2], v[k])
        assert_equal(memory[k, 3:], expected[3:])


@pytest.mark.parametrize("moving", [True, False])
@pytest.mark.parametrize(("points", "rows"), [(1, "all"), (2, "all"), (3, "all"), (1, "base"), (1, "base+power")])
def test_the_projection_is_weighted_damped_least_squares(points: int, rows: Rows, moving: bool) -> None:
    """Normal equations by Cholesky against an orthogonal factorisation of the stacked problem.

    At rest the row of the joints' power is empty, and the base's six rows remain.
    """
    model = MODELS["humanoid"][0]
    rng, nv = np.random.default_rng(points), model.nv
    before, after = rng.standard_normal((2, 3 + 3 * points, nv)) * np.where(np.arange(nv) < 6, 1.0, 0.1)
    before[2], after[2] = moving * before[2], moving * after[2]
    phi, mean = rng.standard_normal(nv), 0.5 * (before + after)
    weight = np.diag(twins.believed(model, "all", mean[2]))
    place = np.zeros((points, 4)), np.zeros((points, nv))
    flat = kernels.new_store(np.ones(nv), weight, *place, project_first=False, rows=ROWS.index(rows))
    store, found = kernels.unpack(flat), np.full(3 * points, np.nan)
    store.jacobian[:] = mean[3:]
    kernels.project(store, before, after, phi, found)
    assert_equal(found, twins.project(mean[3:], twins.believed(model, rows, mean[2]), phi))


@pytest.mark.parametrize("name", MODELS)
def test_the_mean_of_both_end_jacobians_is_the_middle_one_to_second_order(name: str) -> None:
    """Halving the interval quarters the difference from the Jacobian at the interpolated configuration."""
    model, frames = MODELS[name]
    rng = np.random.default_rng(8)
    q, way = pin.integrate(model, pin.neutral(model), rng.uniform(-0.5, 0.5, model.nv)), rng.uniform(-1, 1, model.nv)

    def difference(length: float) -> float:
        ends = [pin.integrate(model, q, sign * length / 2.0 * way) for sign in (-1.0, 1.0)]
        mean = 0.5 * sum(twins.point_jacobian(model, frames, end) for end in ends)
        return float(np.linalg.norm(mean - twins.point_jacobian(model, frames, pin.interpolate(model, *ends, 0.5))))

    ratios = [difference(h / 2.0) / difference(h) for h in (0.1, 0.05, 0.025)]
    np.testing.assert_allclose(ratios, 0.25, atol=2e-3)


# ------------------------------------------------------------------------------------------------- Pinocchio's memory


@pytest.mark.parametrize("name", MODELS)
def test_views_share_memory_with_pinocchio_and_change_with_it(name: str) -> None:
    """Placements, velocities, and matrices by address."""
    model, _ = MODELS[name]
    data, rng = model.createData(), np.random.default_rng(6)
    oMi, liMi, v = jit.placements(data.oMi), jit.placements(data.liMi), jit.motions(data.v)
    M = jit.doubles_at(int(jit.addresses(data.M)[0]), model.nv, model.nv)
    assert np.shares_memory(M, data.M)
    for _ in range(2):
        q = pin.integrate(model, pin.neutral(model), rng.uniform(-0.5, 0.5, model.nv))
        pin.forwardKinematics(model, data, q, rng.standard_normal(model.nv))
        pin.crba(model, data, q)
        np.testing.assert_array_equal(M, data.M)
        for joint in range(1, model.njoints):
            assert np.shares_memory(v, data.v[joint].vector)
            np.testing.assert_array_equal(v[joint], data.v[joint].vector)
            for view, placement in ((oMi, data.oMi[joint]), (liMi, data.liMi[joint])):
                assert np.shares_memory(view, placement.rotation)
                assert np.shares_memory(view, placement.translation)
                np.testing.assert_array_equal(view[joint, :9].reshape(3, 3, order="F"), placement.rotation)
                np.testing.assert_array_equal(view[joint, 9:], placement.translation)


def test_a_matrix_by_address_is_read_by_columns() -> None:
    """As Eigen lays it out: C and the Jacobian are not symmetric."""
    matrix = np.asfortranarray(np.arange(6.0).reshape(2, 3))
    np.testing.assert_array_equal(jit.doubles_at(int(jit.addresses(matrix)[0]), 2, 3), matrix)


def test_views_that_do_not_follow_pinocchio_are_refused() -> None:
    """A copy, as after another memory layout, would go stale without a word."""
    model = MODELS["aerobat"][0]
    for copied in (None, 0, 1, 2):
        data = model.createData()
        views = [jit.placements(data.oMi), jit.placements(data.liMi), jit.motions(data.v)]
        if copied is None:
            jit.check_views(model, data, *views)
            continue
        views[copied] = views[copied].copy()
        with pytest.raises(RuntimeError, match="do not lie in memory"):
            jit.check_views(model, data, *views)
    for bad in (np.zeros(3, dtype=int), np.zeros((4, 4))[::2, ::2]):
        with pytest.raises(RuntimeError, match="contiguous arrays of doubles"):
            jit.addresses(bad)


@pytest.mark.parametrize("way", COPIES)
@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_a_copied_observer_estimates_like_a_new_one(kind: type[Observer], way: str) -> None:
    """Copied in mid-stream: it looks at data of its own, and neither disturbs the other."""
    model, frames = MODELS["aerobat"]
    time, q, v, tau, known = record(model)
    twin = twins.ObserverTwin(model, frames, 400.0, project_first=kind.project_first)
    residual, points = twin.run(time, q, v, tau, known)
    observer = kind(model, frames, 400.0)
    observer.reset(q[0], v[0], time[0])
    copied = COPIES[way](observer)
    assert copied.data is not observer.data
    estimate = copied.run(time, q, v, tau, known)
    assert_equal(estimate.residual, residual)
    assert_equal(estimate.force, points)
    now = {channel: values[0] for channel, values in known.items()}
    assert_equal(observer.update(time[1], q[1], v[1], tau[0], now).residual, residual[0])


@pytest.mark.parametrize("way", COPIES)
def test_a_copied_plant_flies_the_same_flight(way: str, paper_plant: Plant) -> None:
    """Its kernels look at the data that its Pinocchio calls fill, not at an array left behind by the copy."""
    held = np.zeros((2, len(paper_plant.forces), 5))
    expected = paper_plant.fly(5, 1e-3, held)
    copied = COPIES[way](paper_plant)
    assert any(np.shares_memory(part, copied.data.M) for part in copied._fixed)
    found = copied.fly(5, 1e-3, held)
    np.testing.assert_array_equal(found.q, expected.q)
    np.testing.assert_array_equal(found.v, expected.v)


# ------------------------------------------------------------------------------------------------ compiling and caching


INTERPRETED = """
import sys
import numba
import numpy as np
import pinocchio as pin
from aerobat_pin.observers import OBSERVERS
from aerobat_pin.scenario import load_scenario
from aerobat_pin.simulation import simulate
from aerobat_pin.known_inputs import known_inputs

settings = ["simulation.duration=0.005", "air.warm_up_cycles=1", "air.strips=6"]
log = simulate(load_scenario("paper", settings))
found = {name: log.measured[name].values for name in ("q", "v", "motor_torque")}
found["force"], found["air"] = log.truth["force_W"].values, log.truth["air_state"].values
model = pin.buildSampleModelHumanoid()
model.addFrame(pin.Frame("point", model.njoints - 1, 0, pin.SE3.Random(), pin.FrameType.OP_FRAME))
model.frames[model.getFrameId("point")].placement = pin.SE3(np.eye(3), np.array([0.1, 0.2, 0.3]))
rng = np.random.default_rng(1)
q = np.array([pin.integrate(model, pin.neutral(model), step) for step in rng.uniform(-0.5, 0.5, (6, model.nv))])
v, tau = rng.uniform(-1.0, 1.0, (6, model.nv)), rng.uniform(-1.0, 1.0, (5, model.nv))
time = np.cumsum(rng.uniform(1e-3, 3e-3, 6))
for name, kind in OBSERVERS.items():
    observer = kind(model, ["point"], 400.0)
    estimate = observer.run(time, q, v, tau)
    found[name], found[name + "_residual"] = estimate.force, estimate.residual
    observer.reset(q[0], v[0], time[0])
    found[name + "_stream"] = np.array([observer.update(*now).force for now in zip(time[1:], q[1:], v[1:], tau)])
np.savez(sys.argv[1], compiled=not numba.config.DISABLE_JIT, **found)
"""


def test_kernels_that_are_not_compiled_give_the_same_numbers(tmp_path: Path) -> None:
    """NUMBA_DISABLE_JIT=1, for debugging and coverage: a short flight and both observers, batch and stream."""
    results = []
    for disabled in ("0", "1"):
        path = tmp_path / f"disabled_{disabled}.npz"
        done = subprocess.run(
            [sys.executable, "-c", INTERPRETED, str(path)],
            env={**os.environ, "NUMBA_DISABLE_JIT": disabled, "PYTHONPATH": str(PACKAGE.parent)},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr[-2000:]
        results.append(dict(np.load(path)))
    compiled, interpreted = results
    assert compiled.pop("compiled")
    assert not interpreted.pop("compiled")
    for name, expected in compiled.items():
        assert_equal(interpreted[name], expected)


def test_every_file_with_a_kernel_is_in_the_cache_stamp() -> None:
    """A file that is not listed could change without outdating the kernels that its own are compiled into."""
    with_kernels = {
        path.relative_to(PACKAGE).as_posix()
        for path in PACKAGE.rglob("*.py")
        if re.search(r"^@(jit\.)?kernel\b", path.read_text(), re.MULTILINE)
    }
    assert with_kernels <= set(jit.KERNEL_SOURCES)
    assert all((PACKAGE / name).is_file() for name in jit.KERNEL_SOURCES)
    assert len(set(jit.KERNEL_SOURCES)) == len(jit.KERNEL_SOURCES)


@compiled_only
def test_a_change_in_any_kernel_file_changes_the_stamp(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each file counts, and the stamp is the one that numba compares."""
    assert jit.solve_positive._cache._cache_file._source_stamp == jit.sources_stamp()
    assert plant_kernels.advance._cache._cache_file._source_stamp == jit.sources_stamp()
    for name in jit.KERNEL_SOURCES:
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text("before\n")
    monkeypatch.setattr(jit, "__file__", str(tmp_path / "jit.py"))
    stamps = [jit.sources_stamp.__wrapped__()]
    for name in jit.KERNEL_SOURCES:
        (tmp_path / name).write_text("after it was changed\n")
        stamps.append(jit.sources_stamp.__wrapped__())
    assert len(set(stamps)) == len(stamps)


@compiled_only
def test_kernels_compile_where_no_cache_can_be_written(monkeypatch: pytest.MonkeyPatch) -> None:
    """Numba raises RuntimeError where it finds no folder: for code without a file, and in a read-only installation."""
    scope: dict[str, Any] = {}
    exec("def triple(x):\n    return 3.0 * x\n", scope)
    with pytest.raises(RuntimeError, match="cannot cache"):
        numba.njit(cache=True)(scope["triple"])
    assert jit.kernel(scope["triple"])(2.0) == 6.0
    njit = numba.njit

    def read_only(*arguments: Any, **options: Any) -> Any:
        if options.get("cache"):
            raise RuntimeError("cannot cache function: no locator available")
        return njit(*arguments, **options)

    monkeypatch.setattr(jit.numba, "njit", read_only)
    solve = jit.kernel(jit.solve_positive.py_func)
    A, x = np.diag([2.0, 4.0]), np.ones(2)
    solve(A, x)
    assert solve.signatures
    assert solve.stats.cache_path is None
    np.testing.assert_allclose(x, [0.5, 0.25])
