"""A robot changes consistently: geometry, masses, linkage and poses move together, or the change is refused."""

import builtins
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from support.further import further
from support.readers import ROBOTS

from aerobat_description.morphology import Morphology, stretched
from aerobat_description.morphology_tables import Body
from aerobat_description.position_closure import ClosureError, close_linkage, remedies, turn
from aerobat_description.write_urdf import poses
from aerobat_pin.aerobat import load_aerobat
from aerobat_pin.errors import MorphologyFileError
from aerobat_pin.linkage import KineticSculpture


def body_of_points(points: np.ndarray, masses: np.ndarray) -> Body:
    """Return the body that point masses (n,) [kg] at (n, 3) [m] make."""
    com = masses @ points / masses.sum()
    arms = points - com
    J = sum(m * (a @ a * np.eye(3) - np.outer(a, a)) for m, a in zip(masses, arms, strict=True))
    return Body(float(masses.sum()), (*np.diag(J), J[0, 1], J[0, 2], J[1, 2]), tuple(com))


def test_a_stretched_body_is_the_body_of_the_stretched_particles() -> None:
    """Fifty random point masses, moved one by one: an independent derivation of mass, COM and inertia."""
    random = np.random.default_rng(5)
    points, masses = random.normal(size=(50, 3)), random.uniform(0.5, 1.5, 50)
    made = stretched(body_of_points(points, masses), 1.7, 0.8, 1.3)
    expected = body_of_points(points * [0.8, 1.3, 1.0], 1.7 * masses)
    assert made.mass == pytest.approx(expected.mass, rel=1e-14)
    assert made.com == pytest.approx(expected.com, abs=1e-14)
    assert made.inertia == pytest.approx(expected.inertia, rel=1e-12, abs=1e-12)


@ROBOTS
def test_scales_change_what_they_name_and_nothing_else(name: str) -> None:
    """Span is the arc from tip to tip; chord multiplies the area; masses by link."""
    robot = load_aerobat(name)
    wide = robot.with_changes({"scale": {"span": 1.2}})
    assert wide.wing.span == pytest.approx(1.2 * robot.wing.span, rel=1e-14)
    assert wide.mass == pytest.approx(robot.mass, rel=1e-14)
    assert wide.morphology.linkage == robot.morphology.linkage
    deep = robot.with_changes({"scale": {"chord": 0.9}})
    assert deep.morphology.wing_area == pytest.approx(0.9 * robot.morphology.wing_area, rel=1e-14)
    assert deep.wing.span == robot.wing.span
    heavy = robot.with_changes({"scale": {"wing_mass": 2.0, "body_mass": 0.5}}).morphology
    assert heavy.proximal.mass == 2.0 * robot.morphology.proximal.mass
    assert heavy.distal.mass == 2.0 * robot.morphology.distal.mass
    assert heavy.body.mass == 0.5 * robot.morphology.body.mass
    back = wide.with_changes({"scale": {"span": 1.0 / 1.2}})
    assert back.morphology.distal.inertia == pytest.approx(robot.morphology.distal.inertia, rel=1e-12)


def test_a_change_reaches_every_model_and_the_disk_is_not_touched(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pinocchio model, collision and visual geometry, linkage and wing agree; opening any file would fail here."""
    robot = load_aerobat("aerobat_guard")

    def refuse(*_: Any, **__: Any) -> None:
        raise AssertionError("the disk was touched")

    for holder, method in ((builtins, "open"), (Path, "open"), (Path, "read_text"), (Path, "read_bytes")):
        monkeypatch.setattr(holder, method, refuse)
    changes: dict[str, Any] = {
        "linkage": {"L3b": 7.0e-3, "L5a": 11.5e-3, "L5b": 9.8e-3},
        "wing": {"offset_x": -0.02},
        "scale": {"span": 0.9, "chord": 1.1},
        "tail": None,
    }
    made = robot.with_changes(changes)
    shapes = made.visual_model, made.collision_model
    monkeypatch.undo()
    shoulder = made.model.jointPlacements[made.model.getJointId("left_shoulder")].translation
    assert shoulder == pytest.approx([-0.02, *robot.morphology.linkage.P5])
    assert made.linkage.lengths.L3b == 7.0e-3
    assert "tail" not in {item.name for item in shapes[0].geometryObjects}
    assert {item.name for item in shapes[0].geometryObjects} < {i.name for i in robot.visual_model.geometryObjects}
    assert np.array_equal(made.model.gravity.linear, robot.model.gravity.linear)
    at_once = load_aerobat("aerobat_guard", {**changes, "tail": False})
    assert at_once.model == made.model
    assert at_once.text == made.text


@pytest.mark.parametrize(
    ("bar", "factors"),
    # The lengths the laboratory sets, and a longer humerus.
    [("L3b", (3.0,)), ("L5a", (0.876, 1.648)), ("L5b", (1.166,)), ("L3a", (1.1,))],
)
@pytest.mark.filterwarnings("ignore::aerobat_pin.errors.NearSingularWarning")
def test_limits_hold_whatever_a_changed_linkage_reaches(bar: str, factors: tuple[float, ...], tmp_path: Path) -> None:
    """In memory, at loading, or by a file that extends: one robot, within Pinocchio's limits with a tenth to spare."""
    robot = load_aerobat()
    for factor in factors:
        length = factor * getattr(robot.morphology.linkage, bar)
        made = robot.with_changes({"linkage": {bar: length}})
        (tmp_path / "mine.toml").write_text(f'extends = "aerobat"\nname = "mine"\n[linkage]\n{bar} = {length!r}\n')
        for other in (load_aerobat("aerobat", {"linkage": {bar: length}}), load_aerobat(tmp_path / "mine.toml")):
            assert other.morphology.joints == made.morphology.joints
        cycle = made.linkage.solve(np.radians(np.arange(0.0, 360.0, 0.5)))
        joints = list(made.idx_q)
        low, high = made.model.lowerPositionLimit[joints], made.model.upperPositionLimit[joints]
        angles = np.column_stack([cycle.theta_s, cycle.theta_e] * 2)
        assert np.all((low <= angles.min(axis=0) - 0.1 + 1e-9) & (angles.max(axis=0) + 0.1 - 1e-9 <= high))
        least, most = robot.model.lowerPositionLimit[joints], robot.model.upperPositionLimit[joints]
        assert np.all((low <= least) & (most <= high))
        for item in made.model.referenceConfigurations:
            assert np.all((low <= item.data()[joints]) & (item.data()[joints] <= high)), item.key()


@pytest.mark.parametrize("joint", ["shoulder", "elbow"])
def test_stated_limits_that_the_linkage_leaves_are_refused_and_just_outside_they_are_kept(joint: str) -> None:
    """By `KineticSculpture`; limits that a change states with its linkage are judged, not mended."""
    robot = load_aerobat()
    changes: dict[str, Any] = {"linkage": {"L5a": 1.3 * robot.morphology.linkage.L5a}}
    for linkage in ({}, changes):
        cycle = robot.with_changes(linkage).linkage.solve(np.radians(np.arange(0.0, 360.0, 0.5)))
        angle = {"shoulder": cycle.theta_s, "elbow": cycle.theta_e}[joint]
        low, high = float(angle.min()), float(angle.max())
        for limits in ((low + 1e-6, 3.0), (-3.0, high - 1e-6)):
            with pytest.raises(MorphologyFileError) as caught:
                robot.with_changes({**linkage, "joints": {f"{joint}_limits": limits}})
            key, rule = str(caught.value).split(": the linkage reaches ")
            assert key == f"morphology: joints.{joint}_limits = {limits}"
            said = [float(word) for word in rule.split() if word not in ("to", "rad")]
            assert said == pytest.approx([low - 5e-4, high + 5e-4], abs=5e-4)  # rounded outward: they can be typed
        kept = (low - 1e-6, high + 1e-6)
        made = robot.with_changes({**linkage, "joints": {f"{joint}_limits": kept}}).morphology
        assert getattr(made.joints, f"{joint}_limits") == kept


@ROBOTS
def test_the_free_base_has_finite_limits_and_draws_configurations(name: str) -> None:
    """Pinocchio leaves a free-flyer at +-1.8e308, from which nothing can be drawn."""
    model = load_aerobat(name).model
    for limit in (model.lowerPositionLimit, model.upperPositionLimit, model.velocityLimit, model.effortLimit):
        assert np.max(np.abs(limit)) < 1e3
    q = pin.randomConfiguration(model)
    assert np.all((q >= model.lowerPositionLimit) & (q <= model.upperPositionLimit))
    assert np.linalg.norm(q[3:7]) == pytest.approx(1.0)


@ROBOTS
def test_reference_configurations_are_what_their_names_say(name: str) -> None:
    """All but neutral are poses of the closed linkage: reach of the tips, sense of the stroke by `KineticSculpture`."""
    robot = load_aerobat(name)
    found = {str(item.key()): np.array(item.data()) for item in robot.model.referenceConfigurations}
    names = {"neutral", "glide", "mid_downstroke", "mid_upstroke", "folded"}
    assert set(found) == set(poses(robot.morphology)) == names
    assert np.array_equal(found.pop("neutral"), pin.neutral(robot.model))
    cycle = robot.linkage.solve(np.radians(np.arange(0.0, 360.0, 0.1)), 1.0)
    angles = {key: q[[robot.idx_q[0], robot.idx_q[1]]] for key, q in found.items()}
    where = {}
    for key, (s, e) in angles.items():
        gap = np.hypot(cycle.theta_s - s, cycle.theta_e - e)
        where[key] = int(np.argmin(gap))
        assert gap[where[key]] < 5e-3
    data, tip = robot.model.createData(), [0.0, robot.morphology.wing.distal_stations[-1], 0.0]

    def reach(s: float, e: float) -> float:
        pin.framesForwardKinematics(robot.model, data, robot.configuration(pin.neutral(robot.model)[:7], s, e))
        return float(data.oMf[robot.model.getFrameId("left_distal")].act(np.array(tip))[1])

    reached = [reach(s, e) for s, e in zip(cycle.theta_s[::10], cycle.theta_e[::10], strict=True)]
    assert reach(*angles["glide"]) == pytest.approx(max(reached), abs=1e-4)
    assert reach(*angles["folded"]) == pytest.approx(min(reached), abs=1e-4)
    middle = 0.5 * (cycle.theta_s.min() + cycle.theta_s.max())
    for key, sign in (("mid_downstroke", -1.0), ("mid_upstroke", 1.0)):
        assert angles[key][0] == pytest.approx(middle, abs=0.01)
        assert sign * cycle.theta_s_dot[where[key]] > 0.0


def test_both_closures_of_the_linkage_agree() -> None:
    """The description's, in plain complex numbers, against `KineticSculpture`, over a turn, to 1e-12."""
    bars = Morphology.load("aerobat").linkage
    angles = np.radians(np.arange(0.0, 360.0, 3.7))
    closed = KineticSculpture(bars).solve(angles)
    for i, angle in enumerate(angles):
        pose = close_linkage(bars, float(angle))
        assert pose.theta_s == pytest.approx(closed.theta_s[i], abs=1e-12)
        assert pose.theta_e == pytest.approx(closed.theta_e[i], abs=1e-12)
        for name, point in pose.pins.items():
            assert (point.real, point.imag) == pytest.approx(tuple(closed.pins[name][i]), abs=1e-12)


@pytest.mark.parametrize(
    ("key", "value", "dyad"),
    [("L3b", 4e-3, "J4"), ("L5a", 30e-3, "J10"), *further(("L6", 60e-3, "J10"), ("L4", 60e-3, "J7"))],
)
def test_a_linkage_that_cannot_turn_is_refused_with_what_would_do(key: str, value: float, dyad: str) -> None:
    """Each remedy, put in alone, lets the crank turn, and a thousandth beyond it does not."""
    robot = load_aerobat()
    with pytest.raises(MorphologyFileError, match=f"crank cannot turn: .* at {dyad} for a crank angle of .* {key} = "):
        robot.with_changes({"linkage": {key: value}})
    bars = replace(robot.morphology.linkage, **{key: value})
    with pytest.raises(ClosureError) as caught:
        turn(bars)
    assert caught.value.dyad == dyad
    found = remedies(bars, dyad)
    assert key in found
    for name, length in found.items():
        own = getattr(bars, name)
        turn(replace(bars, **{name: length}))
        with pytest.raises(ClosureError):
            turn(replace(bars, **{name: length + 1e-3 * (own - length)}))


def test_a_thruster_pushes_along_the_z_axis_of_its_frame() -> None:
    """Position, direction and name of the guard's six thrusters, through Pinocchio; those that lift lift upward."""
    robot = load_aerobat("aerobat_guard")
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, pin.neutral(robot.model))
    assert len(robot.morphology.thrusters) == 6
    for thruster in robot.morphology.thrusters:
        frame = data.oMf[robot.model.getFrameId(thruster.name)]
        assert frame.translation == pytest.approx(thruster.position, abs=1e-15)
        assert frame.rotation[:, 2] == pytest.approx(thruster.direction, abs=1e-15)
    lift = sum(one.thrust * one.direction[2] for one in robot.morphology.thrusters)
    assert lift == pytest.approx(4 * 0.35)
