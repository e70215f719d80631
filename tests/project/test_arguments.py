"""Wrong arguments: every public function names the one that is wrong, in an error of the package."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from support.wrong_values import EXCLUDED, WRONG, api_case, calls, fault, public_callables

from aerobat_pin import load_aerobat, load_scenario
from aerobat_pin.errors import ArgumentError, ObserverError, ScenarioError, ShapeError
from aerobat_pin.numerics import guarded
from aerobat_pin.observers import OBSERVERS, ForceLevelObserver, KalmanObserver, MomentumObserver, Observer

KINDS = [ForceLevelObserver, KalmanObserver, MomentumObserver]


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Write where a wrong path may lead."""
    monkeypatch.chdir(tmp_path)


def test_every_public_function_has_its_wrong_calls() -> None:
    """Or stands on a list that says why not."""
    assert set(public_callables()) - {name.strip().partition(".")[0] for name in calls()} - EXCLUDED == set()
    assert [name for name, call in calls().items() if not call.arguments] == []


@pytest.mark.filterwarnings("ignore")
def test_every_wrong_argument_is_refused_by_name() -> None:
    """Each argument of each public function, with values of some twenty kinds that do not belong there."""
    cases = [(name, argument, kind) for name, call in calls().items() for argument in call.arguments for kind in WRONG]
    assert len(cases) > 5000
    assert [said for case in cases if (said := fault(*case))] == []


@pytest.mark.filterwarnings("ignore")
def test_a_drawn_case_is_one_of_them() -> None:
    """What the generator of bad inputs calls."""
    rng = np.random.default_rng(3)
    assert [said for _ in range(50) if (said := api_case(rng)[1])] == []


def test_arguments_reach_the_function_as_they_are_needed() -> None:
    """Lists as arrays, iterables as lists, numbers as floats; sizes that share a name must agree."""

    @guarded(size="positive", free="free")
    def call(a: Iterable[float], size: float, free: int = 0, *rest: int, **named: int) -> tuple[object, ...]:
        return a, size, free, rest, named

    found = call(iter([1.0]), np.float32(0.5), "x", 1, 2, c=3)  # type: ignore[arg-type]
    assert found == ([1.0], 0.5, "x", (1, 2), {"c": 3})
    with pytest.raises(ShapeError, match=r"size = -1\.0: a finite number, positive, was expected"):
        call([1.0], -1.0)
    with pytest.raises(ArgumentError, match=r"a = 'abc': a list was expected"):
        call("abc", 1.0)  # type: ignore[arg-type]
    robot = load_aerobat()
    with pytest.raises(ShapeError, match=r"theta_s has shape \(2,\): \(\) or \(3,\) was expected"):
        robot.configuration(np.tile(robot.q0[:7], (3, 1)), [0.1, 0.2], 0.0)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("length", [0.0, 3.0])
def test_a_stream_refuses_a_quaternion_that_is_none(kind: type[Observer], length: float) -> None:
    """Pinocchio would take it for some attitude; the estimate and the stream stay as they were."""
    robot = load_aerobat()
    model, q, v = robot.model, robot.q0, np.zeros(robot.model.nv)
    wrong = q.copy()
    wrong[3:7] *= length
    observer, other = (kind(model, ["left_force_point"], 200.0) for _ in range(2))
    for one in (observer, other):
        one.reset(q, v)
    with pytest.raises(ShapeError, match=rf"q\[3:7\] of sample 0 has length {length:g}: 1 was expected"):
        observer.update(1e-3, wrong, v, v)
    np.testing.assert_array_equal(observer.update(1e-3, q, v, v).force, other.update(1e-3, q, v, v).force)
    far = q.copy()
    far[2] = -1e9
    for place in (observer.reset, lambda q, v: observer.update(2e-3, q, v, v)):
        with pytest.raises(ShapeError, match=r"q\[2\] of sample 0 = -1e\+09: at most 1e\+06 m or rad was expected"):
            place(far, v)


def test_wheels_and_planar_joints_stream_too() -> None:
    """Their pairs of cosine and sine are unit vectors as well."""
    model = pin.Model()
    model.addJoint(0, pin.JointModelPlanar(), pin.SE3.Identity(), "plane")
    model.appendBodyToJoint(1, pin.Inertia.Random(), pin.SE3.Identity())
    observer = MomentumObserver(model)
    q, v = pin.neutral(model), np.zeros(model.nv)
    observer.reset(q, v)
    observer.update(1e-3, q, v, v)
    with pytest.raises(ShapeError, match=r"q\[2:4\] of sample 0 has length 2"):
        observer.update(2e-3, q * 2.0, v, v)


def test_numbers_that_no_robot_has_are_refused() -> None:
    """Each was taken in silence before, or ended in NaN."""
    robot = load_aerobat()
    for gravity in (np.nan, np.inf, -9.81, 1e300):
        with pytest.raises(ShapeError, match="gravity = "):
            load_aerobat(gravity=gravity)
    for kind in OBSERVERS.values():
        with pytest.raises(ObserverError, match=r"gain = 1e\+300"):
            kind(robot.model, ["left_force_point"], 1e300)
    observer = ForceLevelObserver(robot.model, ["left_force_point"])
    with pytest.raises(ShapeError, match="time = nan: a finite number was expected"):
        observer.reset(robot.q0, np.zeros(10), np.nan)


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("observers.gain=1e300", r"observers.gain = 1e\+300: .* 1000000000000"),
        ('observers.names=["momentum", "momentum"]', "'momentum' is there twice"),
        ('observers.frames=["left_distal", "left_distal"]', "'left_distal' is there twice"),
        ("unknown_force.0.step_end=0.5", "step from step_start = 1.0 s to step_end = 0.5 s: step_end comes later"),
        ("sensors.gyro.delay=1e300", r"sensors.gyro.delay = 1e\+300"),
        ("sensors.gyro.delay=100", "sensors.gyro.delay = 100.* 60"),
        ("flight.position=[0, 0, -1e9]", "flight.position.2 = -1000000000.0.*-1000000"),
    ],
)
def test_settings_that_make_no_sense_are_refused(setting: str, message: str) -> None:
    """By key, value and rule."""
    with pytest.raises(ScenarioError, match=message):
        load_scenario("paper", [setting])
