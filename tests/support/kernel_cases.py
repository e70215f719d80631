"""Robots, plants, records and comparisons that the tests of the kernels share."""

import copy
import pickle
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pinocchio as pin
import pytest

import aerobat_pin
from aerobat_pin.aerobat import FORCE_POINTS, Aerobat, Wing, flown_robot, load_aerobat
from aerobat_pin.flight import Plant
from aerobat_pin.flight.plant.plant_state import DIRECTION_AXES
from aerobat_pin.observers import OBSERVERS, KalmanObserver, Observer, Sample
from aerobat_pin.scenario import load_scenario, parse_scenario

PACKAGE = Path(aerobat_pin.__file__).parent
MORPHOLOGIES = ("aerobat", "aerobat_guard", "aerobat_light")
KINDS = [kind for kind in OBSERVERS.values() if not issubclass(kind, KalmanObserver)]  # which has twins of its own
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
    return {"frame": frame, "axes": axes, "direction": list(direction), "amplitude": 0.3}


# Every mode of axes at a link's own frame, at a turned one and at the base; two forces at one point.
ALL_FORCES = [
    *(force(FORCE_POINTS[i % 2], axes, (0.1 * i, 0.7, -0.4)) for i, axes in enumerate(DIRECTION_AXES)),
    *(force(TURNED, axes) for axes in DIRECTION_AXES),
    *(force("base_link", axes) for axes in DIRECTION_AXES),
]
GUST = {"amplitude": [0.3, -0.5, 0.8], "start": 0.0, "duration": 0.2}
WIND = {"wind": [-0.7, 0.4, 0.2], "gust": GUST}
CASES: dict[str, tuple[list[dict[str, Any]], bool, str, dict[str, Any]]] = {
    "all forces, hold": (ALL_FORCES, True, "own", {}),
    "all forces, no hold, tail tilted": (ALL_FORCES, False, "tilted", WIND),
    **{f"{axes} axes, hold": ([force(TURNED, axes)], True, "own", {}) for axes in DIRECTION_AXES},
    "no force, hold, no tail": ([], True, "none", {"added_mass": 0.0, "strips": 7}),
    "no force, no hold": ([], False, "own", {}),
    "stall, wind": ([], False, "own", {"lift_limit": 1.2, **WIND}),
    "quasi-steady, wind": ([], True, "own", {"model": "quasi_steady", **WIND}),
}


@cache
def built(morphology: str, case: str) -> Plant:
    """Build a plant of one morphology in one case, rolled, pitched and yawed, without a long warm-up."""
    forces, held, tail, air = CASES[case]
    values = {
        "name": "twin",
        "flight": {"roll_deg": 10.0, "pitch_deg": 7.0, "yaw_deg": -20.0},
        "air": {"warm_up_cycles": 1, **air},
        "unknown_force": forces,
        **({"hold": HOLD.model_dump()} if held else {}),
    }
    return Plant(robot_with_a_turned_frame(morphology, tail), parse_scenario(values, "twin"))


def plant_of(name: str, *settings: str) -> Plant:
    scenario = load_scenario(name, settings)
    return Plant(flown_robot(scenario), scenario)


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


def random_motion(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return q, v, a of the robot; every joint moves on its own."""
    rng = np.random.default_rng(seed)
    quaternion = rng.standard_normal(4)
    q = np.concatenate([rng.uniform(-1.0, 1.0, 3), quaternion / np.linalg.norm(quaternion), rng.uniform(-1.5, 0.8, 4)])
    v = rng.standard_normal(10) * np.array([3.0] * 3 + [2.0] * 3 + [10.0] * 4)
    return q, v, rng.standard_normal(10) * np.array([10.0] * 3 + [50.0] * 3 + [200.0] * 4)


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


def streamed(
    observer: Observer, time: np.ndarray, q: np.ndarray, v: np.ndarray, tau: np.ndarray, known: Mapping[str, np.ndarray]
) -> Iterator[Sample]:
    """Yield what an observer finds in a record that comes sample by sample."""
    observer.reset(q[0], v[0], time[0])
    for k, torque in enumerate(tau):
        now = {name: values[k] for name, values in known.items()}
        yield observer.update(time[k + 1], q[k + 1], v[k + 1], torque, now)
