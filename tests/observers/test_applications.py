"""What acts where: wrenches, directions, axes, ties, matrix gains; and what of it cannot be known, in words."""

import itertools

import numpy as np
import pinocchio as pin
import pytest
import xarray as xr
from scipy.linalg import expm
from support.arm import ALIGNED, arm, identifiability, push, rest, settled
from support.kernel_cases import COPIES, record
from support.observer_twins import point_jacobian

from aerobat_pin.aerobat import load_aerobat
from aerobat_pin.errors import ArgumentError, ObserverError
from aerobat_pin.observers import (
    Application,
    Applications,
    ForceLevelObserver,
    KalmanObserver,
    MomentumObserver,
    Rows,
    SuperTwistingObserver,
    Tie,
    tie_joints,
)
from aerobat_pin.observers.identifiability import judge
from aerobat_pin.observers.rows import BelievedRows

WINGS = ["left_force_point", "right_force_point"]
PAIRS = {"left_shoulder": "right_shoulder", "left_elbow": "right_elbow"}


@pytest.mark.parametrize("axes", ["world", "frame"])
def test_a_wrench_is_found_in_world_and_in_frame_axes(axes: str) -> None:
    """Six joints hold a known force and moment at the tool, whose frame is turned, against Pinocchio's Jacobian."""
    model, _ = arm()
    turned = pin.SE3(pin.exp3(np.array([0.4, -0.7, 1.1])), np.array([0.05, -0.02, 0.3]))
    model.addFrame(pin.Frame("hand", model.njoints - 1, 0, turned, pin.OP_FRAME))
    q = np.random.default_rng(2).uniform(-1.0, 1.0, model.nq)
    wrench = np.array([1.5, -2.0, 0.7, 0.1, -0.05, 0.2])
    frame = pin.LOCAL if axes == "frame" else ALIGNED
    J = pin.computeFrameJacobian(model, model.createData(), q, model.getFrameId("hand"), frame)
    observer = ForceLevelObserver(model, [Application("hand", "wrench", axes)], gain=1e4)  # type: ignore[arg-type]
    np.testing.assert_allclose(settled(observer, q, rest(model, q) - J.T @ wrench).components, wrench, rtol=1e-6)


@pytest.mark.parametrize("axes", ["world", "frame"])
def test_a_force_along_a_line_is_one_number(axes: str) -> None:
    """Its size along the line, with sign; the line need not be given by a unit vector."""
    model, frame = arm()
    q = np.random.default_rng(4).uniform(-1.0, 1.0, model.nq)
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    R = data.oMf[model.getFrameId(frame)].rotation if axes == "frame" else np.eye(3)
    line = np.array([2.0, 0.0, -1.0])
    tau = rest(model, q) - push(model, frame, q, -3.0 * R @ line / np.linalg.norm(line))
    acting = Application(frame, axes=axes, direction=tuple(line))  # type: ignore[arg-type]
    found = settled(ForceLevelObserver(model, [acting], gain=1e4), q, tau).components
    np.testing.assert_allclose(found, [-3.0], rtol=1e-6)


def test_components_have_labels_and_forces_in_world_axes_keep_their_shape() -> None:
    """`force` is for plain forces; everything is there by label, and a label that is not lists those that are."""
    model, frame = arm()
    time, q, v, tau, known = record(model)
    plain = MomentumObserver(model, [frame]).run(time, q, v, tau, known)
    np.testing.assert_array_equal(plain.force[:, 0, 2], plain.component("tool.Fz"))
    mixed = MomentumObserver(model, [Application(frame, "wrench", "frame")]).run(time, q, v, tau, known)
    assert mixed.identifiability.components[3] == "tool.Mx'"
    with pytest.raises(ObserverError, match="not all components are forces in world axes"):
        _ = mixed.force
    with pytest.raises(ObserverError, match=r"no component 'tool.Mx'; there are tool.Fx', .*tool.Mz'"):
        mixed.component("tool.Mx")
    for kind, direction in (("wrench", (1.0, 0.0, 0.0)), ("force", (0.0, 0.0, 0.0))):
        with pytest.raises(ObserverError, match="a direction of three finite numbers"):
            MomentumObserver(model, [Application(frame, kind, direction=direction)])  # type: ignore[arg-type]


def test_a_tie_hides_what_acts_against_it_and_is_named_in_the_result() -> None:
    """Eight rows still tell six components apart, through the base, but every one of them less surely than ten."""
    robot = load_aerobat()
    tie = tie_joints(robot.model, PAIRS)
    time, q, v, tau, known = record(robot.model)
    tied = ForceLevelObserver(robot.model, WINGS, rows=tie).run(time, q, v, tau, known)
    assert tied.rows == "left_shoulder with right_shoulder, left_elbow with right_elbow"
    free = ForceLevelObserver(robot.model, WINGS).run(time, q, v, tau, known)
    assert free.rows == "all"
    assert np.abs(tied.force - free.force).max() > 1e-3
    assert tied.identifiability.rank == 6
    assert np.all(tied.identifiability.deviation > free.identifiability.deviation)
    for alone in ("left_force_point", Application("left_force_point")):
        with pytest.raises(ArgumentError, match=r"applications = .*: a list was expected"):
            ForceLevelObserver(robot.model, alone)  # type: ignore[arg-type]
    joints = ("left_shoulder", "left_elbow", "right_elbow")
    together = robot.model.nv * [0.0]
    for joint in joints:
        together[robot.model.joints[robot.model.getJointId(joint)].idx_v] = 1.0
    for pairs in (itertools.pairwise(joints), ((joint, joints[-1]) for joint in joints[:2])):  # a chain, and two to one
        assert together in tie_joints(robot.model, dict(pairs)).map.T.tolist()
    with pytest.raises(ObserverError, match="'left_wrist' is not a joint of one degree of freedom"):
        tie_joints(robot.model, {"left_wrist": "right_elbow"})
    with pytest.raises(ObserverError, match="tie odd: a finite map of 10 rows"):
        MomentumObserver(robot.model, WINGS, rows=Tie("odd", np.zeros((3, 3))))


@pytest.mark.parametrize("kind", [MomentumObserver, ForceLevelObserver])
def test_a_gain_matrix_filters_along_its_own_directions(kind: type[MomentumObserver]) -> None:
    """R' = K (phi - r) with K symmetric: the step answer is (1 - expm(-K t)) phi, here by scipy."""
    model, frame = arm()
    q, v = pin.neutral(model), np.zeros(model.nv)
    q[2:4] = 0.7, -0.9
    force = np.array([0.3, 0.1, -0.2])
    pushed = push(model, frame, q, force)
    value = pushed if kind is MomentumObserver else force
    A = np.random.default_rng(3).normal(size=(len(value), len(value)))
    K = 100.0 * (A @ A.T + np.eye(len(value)))
    observer = kind(model, [frame], gain=K)
    observer.reset(q, v)
    sample = observer.update(3e-3, q, v, rest(model, q) - pushed)
    found = sample.residual if kind is MomentumObserver else sample.components
    np.testing.assert_allclose(found, value - expm(-3e-3 * K) @ value, rtol=1e-6, atol=1e-9)
    with pytest.raises(ObserverError, match="a symmetric one"):
        kind(model, [frame], gain=np.triu(K))
    with pytest.raises(ObserverError, match="positive gain"):
        kind(model, [frame], gain=-K)


def test_the_squeeze_is_reported_in_words_and_its_components_as_unknowable() -> None:
    """Two wing forces and the base rows alone: rank five; no confident number for what lies along the line."""
    robot = load_aerobat()
    squeezed, full = identifiability(robot, WINGS, "base"), identifiability(robot, WINGS, "base+power")
    assert squeezed.rank == 5
    assert squeezed.describe() == ["equal and opposite along the line from left_force_point to right_force_point"]
    line = dict(zip(squeezed.components, squeezed.deviation, strict=True))
    assert np.isinf(line["left_force_point.Fy"])
    assert np.isinf(line["right_force_point.Fy"])
    assert np.isfinite(line["left_force_point.Fx"])
    assert full.rank == 6
    assert full.describe() == []
    assert full.null_direction is None
    assert 1.0 < full.condition < 100.0
    assert np.all(np.isfinite(full.deviation))


def test_a_moment_counts_as_a_force_at_fifty_millimetres() -> None:
    """A wrench at the origin of a free body is its six base rows: all singular values are 1, in rows and unknowns."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "body")
    model.appendBodyToJoint(joint, pin.Inertia(0.1, np.zeros(3), 1e-4 * np.eye(3)), pin.SE3.Identity())
    model.addFrame(pin.Frame("centre", joint, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    applications = Applications(model, [Application("centre", "wrench")])
    found = judge(applications, np.eye(6)[None], np.zeros((1, 6)), BelievedRows(model, "all"))
    np.testing.assert_allclose(found.singular_values, 1.0, rtol=1e-12)
    np.testing.assert_allclose(found.deviation, [1.0, 1.0, 1.0, 0.05, 0.05, 0.05], rtol=1e-12)  # N and N m
    assert found.condition == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("more", "rows", "rank", "believed"),
    [(["left_linkage_J1", "right_linkage_J1"], "base", 6, 6), (["left_distal"], "all", 8, 10)],
)
def test_every_pattern_that_leaves_no_trace_is_listed(more: list[str], rows: Rows, rank: int, believed: int) -> None:
    """Two wings, two points on the body, base rows: six patterns by J; a second point on a wing: one, along both."""
    robot, frames = load_aerobat(), [*WINGS, *more]
    found = identifiability(robot, frames, rows)
    assert (found.rank, found.condition) == (rank, np.inf)
    assert found.null_space.shape == (3 * len(frames) - rank, 3 * len(frames))
    assert len(found.describe()) == len(found.null_space)
    J = point_jacobian(robot.model, frames, robot.q0)[:, :believed]
    np.testing.assert_allclose(found.null_space @ J, 0.0, atol=1e-6)
    np.testing.assert_allclose(np.abs(np.ravel(found.null_direction)), np.abs(found.null_space[-1]), atol=1e-9)


def test_a_pattern_with_moments_leaves_no_trace_as_it_is_told() -> None:
    """A wrench and a force 0.1 m beside it: 1 N there is undone by 1 N and 0.1 N m, not by 2 N m."""
    model = load_aerobat().model.copy()
    wing = model.frames[model.getFrameId("left_distal")]
    beside = wing.placement * pin.SE3(np.eye(3), np.array([0.1, 0.0, 0.0]))
    model.addFrame(pin.Frame("beside", wing.parentJoint, 0, beside, pin.FrameType.OP_FRAME))
    there = [Application(frame, kind, "frame") for frame, kind in (("left_distal", "wrench"), ("beside", "force"))]
    applications = Applications(model, there)
    J = applications.jacobian(pin.neutral(model))
    found = judge(applications, J[None], np.zeros((1, model.nv)), BelievedRows(model, "all"))
    np.testing.assert_allclose(found.null_space @ J, 0.0, atol=1e-9)
    for pattern in found.null_space:
        np.testing.assert_allclose(pattern[4:6], -0.1 * pattern[[8, 7]] * [-1.0, 1.0], atol=1e-9)


def test_the_deviation_of_a_component_is_that_of_many_noisy_fits() -> None:
    """White noise on the weighted rows, ten thousand times through the pseudo-inverse."""
    robot = load_aerobat()
    found = identifiability(robot, WINGS)
    observer = MomentumObserver(robot.model, WINGS)
    A = (point_jacobian(robot.model, WINGS, robot.q0) @ observer.believed.map(np.ones(10))).T
    noise = np.random.default_rng(8).normal(size=(10000, len(A)))
    np.testing.assert_allclose(np.std(noise @ np.linalg.pinv(A).T, axis=0), found.deviation, rtol=0.05)


def test_an_estimate_labels_itself_and_joins_others_along_observer() -> None:
    """Names, dimensions and units of `estimate.nc`; where an observer knows no deviation it is NaN."""
    model, frame = arm()
    time, q, v, tau, known = record(model, count=5)
    estimates = [kind(model, [frame]).run(time, q, v, tau, known) for kind in (ForceLevelObserver, KalmanObserver)]
    both = xr.concat([estimate.to_xarray() for estimate in estimates], "observer", combine_attrs="identical")
    assert list(both.observer.values) == ["force_level", "kalman"]
    found = both.force_W
    assert found.dims == ("observer", "interval", "point", "axis")
    assert list(both.point.values) == ["tool"]
    assert found.attrs["units"] == "N"
    wrench = ForceLevelObserver(model, [Application(frame, "wrench")]).run(time, q, v, tau, known).to_xarray()
    assert wrench.components.dims == ("observer", "interval", "component")
    assert list(wrench.unit.values) == ["N"] * 3 + ["N m"] * 3
    for k, estimate in enumerate(estimates):
        np.testing.assert_array_equal(found[k].values.reshape(5, -1), estimate.components)
        np.testing.assert_array_equal(both.residual[k], estimate.residual)
    assert np.all(np.isnan(both.standard_deviation[0]))
    np.testing.assert_array_equal(both.standard_deviation[1].values.reshape(5, -1), estimates[1].standard_deviation)
    np.testing.assert_array_equal(both.interval, time[:-1])
    np.testing.assert_array_equal(both.interval_end, time[1:])


@pytest.mark.parametrize("way", COPIES)
def test_copies_keep_what_one_kind_alone_is_told(way: str) -> None:
    """The slope of the sliding mode, as the settings of the Kalman filter."""
    model, frame = arm()
    observer = SuperTwistingObserver(model, [frame], 200.0, slope=7.0)
    time, q, v, tau, known = record(model)
    copied = COPIES[way](observer)
    assert copied.slope == 7.0
    np.testing.assert_array_equal(copied.run(time, q, v, tau, known).force, observer.run(time, q, v, tau, known).force)
