"""The kernels of the plant equal their numpy twins, instant by instant and over a flight."""

from __future__ import annotations

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
    posed,
    robot_with_a_turned_frame,
)

from aerobat_pin.aerodynamics import RobotAir
from aerobat_pin.aerodynamics.robot_air import strips_of
from aerobat_pin.flight.attitude_hold import AttitudeHold, rotation_vector
from aerobat_pin.flight.plant import kernels as plant_kernels
from aerobat_pin.flight.plant import memory as plant_layout
from aerobat_pin.flight.plant.plant import Plant
from aerobat_pin.flight.point_forces import held_parts
from aerobat_pin.numerics import pinocchio_views, small_matrices
from aerobat_pin.numerics.lie_runge_kutta import next_stage
from aerobat_pin.robot.wing import LINKS

SPATIAL = ("aerodynamic", "added_mass", "thrusters", "unknown", "link_wrench")
GUSTY = 0.07  # [s] in the middle of the gust of the cases

# ------------------------------------------------------------------------------------------------------ linear algebra


@pytest.mark.parametrize("size", [1, 2, 3, 6, 9, 12])
def test_solve_positive_solves_what_numpy_solves(size: int) -> None:
    """Cholesky by hand, in place, reading only the lower triangle, against LAPACK."""
    rng = np.random.default_rng(size)
    root = rng.standard_normal((size, size))
    A, b = root @ root.T + size * np.eye(size), rng.standard_normal(size)
    x, lower = b.copy(), np.tril(A)
    small_matrices.solve_positive(lower, x)
    assert_equal(x, np.linalg.solve(A, b))
    assert_equal(np.tril(lower), np.linalg.cholesky(A))


@compiled_only
def test_what_is_not_positive_definite_gives_nan_and_not_a_plausible_number() -> None:
    """Nothing checks the matrix: its failure has to show in the result, which the callers look at."""
    x = np.ones(2)
    small_matrices.solve_positive(np.diag([1.0, -1.0]), x)
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


@pytest.mark.parametrize("options", [{}, {"lift_limit": 1.2}, {"model": "quasi_steady"}])
@pytest.mark.parametrize("tail", ["own", "tilted", "none"])
@pytest.mark.parametrize("morphology", MORPHOLOGIES)
def test_the_air_loads_equal_their_twin(morphology: str, tail: str, options: dict[str, Any]) -> None:
    """Random twists, also backwards, and a random state; strips at rest among them."""
    robot = robot_with_a_turned_frame(morphology, tail)
    air = RobotAir(robot.wing, strips=13, air_density=1.1, **options)
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
        for name, part in vars(strips).items():
            assert_equal(part, getattr(strips_of(loads), name))
        assert_equal(strips.incidence, np.arctan2(loads[1] + 0.0, loads[0] + 0.0))


@pytest.mark.parametrize("seed", SEEDS)
def test_the_warm_up_is_runge_kutta_on_the_air_alone(seed: int, paper_plant: Plant) -> None:
    """Five steps under random twists, each given at its start, middle and end."""
    air, rng = paper_plant.air, np.random.default_rng(seed)
    twists = rng.uniform(-1.0, 1.0, (11, 5, 6)) * np.repeat([1.0, 10.0], 3) + np.array([3.0, 0, 0, 0, 0, 0])
    start = rng.uniform(-0.02, 0.02, air.state_size)
    state = start.copy()
    plant_kernels.warm_up(paper_plant._places, None, twists, 2e-3, state)
    assert_equal(state, twins.warmed_up(air, paper_plant.robot.morphology, twists, 2e-3, start))


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
def test_placements_down_the_tree_are_those_of_pinocchio(morphology: str, seed: int) -> None:
    """Chained placements in the parents against `oMi`, seen from the body."""
    plant = built(morphology, "all forces, hold")
    data, liMi = posed(plant, seed)
    rotation, origin = np.full((5, 3, 3), np.nan), np.full((5, 3), np.nan)
    plant_kernels.chain(plant.constants.tree, liMi, rotation, origin)
    joints = [plant.model.frames[plant.model.getFrameId(link)].parentJoint for link in LINKS]
    places = [data.oMi[joints[0]].actInv(data.oMi[joint]) for joint in joints]
    assert_equal(rotation, [place.rotation for place in places])
    assert_equal(origin, [place.translation for place in places])


@pytest.mark.parametrize("case", [case for case in CASES if "hold" in case])
@pytest.mark.parametrize("morphology", MORPHOLOGIES)
def test_unknown_forces_push_where_and_along_what_they_should(morphology: str, case: str) -> None:
    """In axes of the link, the body and the world, several at a point, at frames that are turned in their link."""
    plant = built(morphology, case)
    held = np.random.default_rng(5).uniform(-0.3, 0.3, (2, len(plant.forces), 4))
    for seed in SEEDS:
        data, liMi = posed(plant, seed)
        rotation, origin, wrenches = np.empty((5, 3, 3)), np.empty((5, 3)), np.full((5, 6), np.nan)
        at_points, found = np.full((2, len(plant.points), 3), np.nan), np.empty(plant.model.nv)
        plant_kernels.chain(plant.constants.tree, liMi, rotation, origin)
        world = liMi[plant.constants.tree.table[0, 0]]
        plant_kernels.push(plant.constants.unknown, 0.6, held, seed, world, rotation, wrenches, at_points)
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
        acceleration, air_rate, forces = plant.rates(q, v, joints, air, held, GUSTY)
        expected, expected_rate, expected_forces, _ = twins.plant_rates(plant, q, v, joints, air, held, GUSTY)
        assert_spatial(acceleration, expected)
        for part, whole in zip(plant.air.line.split(air_rate), plant.air.line.split(expected_rate), strict=True):
            assert_equal(part, whole)
        for name in forces._fields:
            actual, twin = getattr(forces, name)[0], getattr(expected_forces, name)
            (assert_spatial if name in SPATIAL else assert_equal)(actual, twin)


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
        (assert_spatial if name in SPATIAL else assert_equal)(mean, twin, 1e-10)
    for row in range(9):
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


@compiled_only
@pytest.mark.parametrize("case", CASES)
def test_packed_constants_come_back_as_views_of_the_same_numbers(case: str) -> None:
    """`unpack` undoes `layout`, without copying, with and without forces and hold; nothing is left over."""
    plant = built("aerobat", case)
    numbers, _ = plant._arrays
    numbers[:] = plant_layout.pack(plant.constants)[0]  # the hold keeps its own scratch among them
    unpacked = plant_layout.unpack(plant._places)
    whole, doubles = 0, 0
    for found, original in zip(unpacked, plant.constants, strict=True):
        both = zip(found, original, strict=True) if isinstance(original, tuple) else [(found, original)]
        for actual, value in both:
            np.testing.assert_array_equal(actual, value)
            if value.dtype == np.float64:
                doubles += value.size
                assert not value.size or np.shares_memory(actual, numbers)
            else:
                whole += value.size
                assert not value.size or np.shares_memory(actual, plant._places)
    assert doubles == numbers.size
    assert plant_layout.PLACES + plant_layout.SIZES + whole == plant._places.size
    data = plant.data
    results = (
        data.M,
        data.nle,
        pinocchio_views.placements(data.liMi),
        pinocchio_views.motions(data.v),
        pinocchio_views.motions(data.a_gf),
    )
    for actual, value in zip(plant_layout.unpack_found(plant._places), results, strict=True):
        assert actual.shape == value.shape
        assert np.shares_memory(actual, value)


@compiled_only
def test_the_scratch_is_cut_into_parts_that_do_not_overlap() -> None:
    """Each double of the scratch belongs to exactly one name."""
    plant = built("aerobat", "no force, no hold")
    scratch = plant._arrays[1]
    work = plant_layout.unpack_work(plant._places)
    shapes = [(4, 5, 6), (5, 3, 3), (5, 3), (3, 3), (3, 8), (11, 10), (7, 6), (9, 16), (4, 6)]
    assert [part.shape for part in work] == shapes
    scratch[:] = 0.0
    for part in work:
        part += 1.0
    np.testing.assert_array_equal(scratch, 1.0)
