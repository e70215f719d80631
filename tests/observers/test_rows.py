"""Rows of the residual: each has its unit, some may be named as not believed; friction of joints as a known input."""

import pickle

import numpy as np
import pinocchio as pin
import pytest
from support.arm import push, rest
from support.kernel_cases import assert_equal, record
from support.observer_twins import point_jacobian
from support.robot_parts import efforts
from support.without_coriolis import mjcf_leg

from aerobat_pin import observers
from aerobat_pin.errors import ObserverError
from aerobat_pin.observers.rows import BelievedRows


def arm_on_a_rail() -> tuple[pin.Model, str]:
    """Return an arm of six hinges on a carriage that slides along x, and the frame at the arm's end."""
    rail = pin.Model()
    rail.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), "rail")
    rail.appendBodyToJoint(1, pin.Inertia(8.0, np.array([0.0, 0.0, 0.1]), 0.1 * np.eye(3)), pin.SE3.Identity())
    rail.addFrame(pin.Frame("carriage", 1, 0, pin.SE3.Identity(), pin.FrameType.BODY))
    arm = pin.buildSampleModelManipulator()
    model = pin.appendModel(rail, arm, rail.getFrameId("carriage"), pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.2])))
    return model, "effector_body"


def error_at_rest(kind: type[observers.Observer], rows: observers.Rows, friction: float) -> float:
    """Return the error [N] of the force on an arm that stands still, with friction on rail and shoulder [N, N m]."""
    model, frame = arm_on_a_rail()
    q = np.array([0.3, 0.4, -0.6, 0.5, 0.9, -0.3, 0.2])
    force = np.array([2.0, -3.0, 4.0])
    tau = rest(model, q) - push(model, frame, q, force)
    tau[[0, 3]] += friction
    time = np.arange(401) * 1e-3
    record = np.tile(q, (401, 1)), np.zeros((401, model.nv)), np.tile(tau, (400, 1))
    return float(np.linalg.norm(kind(model, [frame], 500.0, rows).run(time, *record).components[-1] - force))


@pytest.mark.parametrize("kind", observers.OBSERVERS.values(), ids=observers.OBSERVERS)
def test_joints_whose_friction_is_not_known_are_left_out(kind: type[observers.Observer]) -> None:
    """6 N on a rail and 6 N m in a shoulder spoil a force of 5.4 N at the tool, unless their rows are left out."""
    assert error_at_rest(kind, "all", 6.0) > 1.0
    assert error_at_rest(kind, observers.AllBut("rail", "shoulder3_joint"), 6.0) < 0.02
    assert error_at_rest(kind, "all", 0.0) < 0.02


def test_rows_without_a_name_that_is_unknown_or_without_any_are_refused() -> None:
    """The message lists the names: joints, parts of joints with several rows, parts of the base."""
    model, frame = mjcf_leg()
    with pytest.raises(ObserverError, match=r"no joint or part 'hip'.* there are base.Fx, .*Composite_hip_x.0, .*knee"):
        observers.MomentumObserver(model, [frame], rows=observers.AllBut("hip"))
    with pytest.raises(ObserverError, match="no row is left without Composite_hip_x, knee, Composite_ankle, base"):
        observers.MomentumObserver(
            model, [frame], rows=observers.AllBut("Composite_hip_x", "knee", "Composite_ankle", "base")
        )
    with pytest.raises(ObserverError, match="no joint or part 'base'"):
        observers.MomentumObserver(arm_on_a_rail()[0], rows=observers.AllBut("base"))


def test_names_stand_for_a_joint_or_a_part_of_it_and_appear_in_the_result() -> None:
    """A leg's hip of three hinges, one component of its ball joint, one of the base; observers can be pickled."""
    model, frame = mjcf_leg()
    rows = observers.AllBut("Composite_hip_x", "Composite_ankle.0.My", "base.Fz")
    observer = pickle.loads(pickle.dumps(observers.ForceLevelObserver(model, [frame], rows=rows)))
    assert observer.believed.name == "all but Composite_hip_x, Composite_ankle.0.My, base.Fz"
    assert observer.believed.count == model.nv - 5
    chosen = observer.believed.map(np.zeros(model.nv))
    assert list(np.flatnonzero(~chosen.any(axis=1))) == [2, 6, 7, 8, 11]


def test_a_row_in_newtons_is_not_divided_by_a_lever_arm() -> None:
    """Rails, translations and the x and y of a plane are forces; a force along a rail is seen with factor one."""
    model, frame = arm_on_a_rail()
    np.testing.assert_array_equal(BelievedRows(model, "all").weight, [1.0] + 6 * [20.0])
    leg, _ = mjcf_leg()
    assert observers.MomentumObserver(leg).believed.weight[-4:].tolist() == [20.0, 20.0, 20.0, 1.0]
    turned = pin.Model()
    turned.addJoint(0, pin.JointModelPlanar(), pin.SE3.Identity(), "plane")
    turned.addJoint(1, pin.JointModelTranslation(), pin.SE3.Identity(), "shift")
    turned.addJoint(2, pin.JointModelPrismaticUnaligned(np.array([0.6, 0.8, 0.0])), pin.SE3.Identity(), "slide")
    assert BelievedRows(turned, "all").weight.tolist() == [1.0, 1.0, 20.0, 1.0, 1.0, 1.0, 1.0]
    others = observers.AllBut(*model.names.tolist()[2:])
    time, q, v, tau, known = record(model)
    alone = observers.ForceLevelObserver(model, [frame], rows=others).run(time, q, v, tau, known).identifiability
    np.testing.assert_allclose(alone.singular_values, [1.0, 0.0, 0.0], atol=1e-12)
    tie = BelievedRows(model, observers.tie_joints(model, {"rail": "elbow_joint"}))
    assert tie.tied[0, 0] == pytest.approx(np.sqrt(0.5))


def test_the_row_of_power_compares_sliding_and_turning_joints_in_one_unit() -> None:
    """Whichever joint is last, as weighted least squares by numpy; the power's row is v . phi / |v / w|, w weights."""
    model, frame = mjcf_leg()
    time, q, v, tau, known = record(model)
    observer = observers.ForceLevelObserver(model, [frame], 1e6, "base+power")
    force = observer.run(time, q, v, tau, known).force[:, 0]
    robot, weight = observer.model, observer.believed.weight
    phi = observers.MomentumObserver(model, gain=1e6).run(time, q, v, tau, known).residual
    for k in (3, 30):
        J = 0.5 * sum(point_jacobian(robot, [frame], q[i]) for i in (k, k + 1))
        mean = 0.5 * (v[k] + v[k + 1])[6:]
        row = np.concatenate([np.zeros(6), mean / np.linalg.norm(mean / weight[6:])])
        W = np.vstack([np.diag(weight)[:6], row])
        assert_equal(force[k], np.linalg.lstsq(W @ J.T, W @ phi[k])[0], 1e-9)


def test_a_tie_of_one_part_of_a_joint_is_found_by_its_name() -> None:
    """The parts of a composite joint are joints of one degree of freedom, with numbers."""
    model, frame = mjcf_leg()
    tie = observers.tie_joints(model, {"Composite_hip_x.1": "knee"})
    assert isinstance(tie, observers.Tie)
    assert tie.map[[7, 9], 7].tolist() == [1.0, 1.0]
    assert observers.MomentumObserver(model, [frame], rows=tie).believed.count == model.nv - 1


TIME = 1e-3 * np.arange(4001)
TRUE = observers.JointFriction(
    coulomb=np.array([0.3, 0.3, 0.2]),
    viscous=np.array([0.05, 0.02, 0.01]),
    inertia=np.array([0.01, 0.02, 0.005]),
    offset=np.array([0.05, -0.03, 0.0]),
)


def moved(phases: tuple[float, ...] = (0.0, 1.0, 2.0)) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return angles, rates and accelerations (4001, 3) of three joints that swing to and fro."""
    pulsation = 2.0 * np.pi * np.array([1.0, 1.3, 1.7])
    turned = pulsation * TIME[:, None] + np.array(phases)
    return 0.4 * np.sin(turned), 0.4 * pulsation * np.cos(turned), -0.4 * pulsation**2 * np.sin(turned)


def leg() -> pin.Model:
    """Return a leg on a fixed base: hip roll, hip pitch, knee; a foot 0.25 m below the knee."""
    model, at = pin.Model(), 0
    for name, joint, drop in (("roll", pin.JointModelRX(), 0.0), ("pitch", pin.JointModelRY(), 0.05)):
        at = model.addJoint(at, joint, pin.SE3(np.eye(3), np.array([0.0, 0.0, -drop])), name)
        model.appendBodyToJoint(at, pin.Inertia.FromCylinder(0.8, 0.03, 0.2), pin.SE3.Identity())
    at = model.addJoint(at, pin.JointModelRY(), pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.25])), "knee")
    model.appendBodyToJoint(at, pin.Inertia.FromCylinder(0.3, 0.02, 0.25), pin.SE3(np.eye(3), np.array([0, 0, -0.12])))
    model.addFrame(pin.Frame("foot", at, 0, pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.25])), pin.FrameType.OP_FRAME))
    return model


def walked(force: np.ndarray) -> tuple[pin.Model, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return a leg that swings with a force (3,) [N] on its foot: model, q, v, mean accelerations, motor torques."""
    model, (swing, v, _) = leg(), moved()
    q = swing + np.array([0.0, 0.3, -1.0])
    middle, rate, a = 0.5 * (q[1:] + q[:-1]), 0.5 * (v[1:] + v[:-1]), np.diff(v, axis=0) / 1e-3
    tau = efforts(model, "foot", middle, rate, a, np.tile(force, (len(a), 1))) - TRUE.torque(rate, a)
    return model, q, v, a, tau


def test_a_foot_reads_right_once_friction_is_known() -> None:
    """0.2 to 0.3 N m a joint hides up to 3 N of 6.1 N; fitted to a free swing, friction leaves less than 0.05 N."""
    model, q, v, a, tau = walked(np.zeros(3))
    rate = 0.5 * (v[1:] + v[:-1])
    free = observers.MomentumObserver(model, (), 1e9).run(TIME, q, v, tau)
    friction = observers.fit_friction(q[:-1], rate, a, free.residual)
    for name in ("coulomb", "viscous", "inertia", "offset"):
        np.testing.assert_allclose(getattr(friction, name), getattr(TRUE, name), atol=2e-3, err_msg=name)
    assert friction.unseen == []
    pushed = np.array([1.0, 0.5, 6.0])
    model, q, v, a, tau = walked(pushed)
    observer = observers.ForceLevelObserver(model, ["foot"], 200.0)
    blind = observer.run(TIME, q, v, tau).force[500:, 0]
    seeing = observer.run(TIME, q, v, tau, {"friction": friction.torque(rate, a)}).force[500:, 0]
    assert np.ptp(np.linalg.norm(blind, axis=1)) > 2.0
    np.testing.assert_allclose(seeing, np.broadcast_to(pushed, seeing.shape), atol=0.05)


def test_what_the_motion_does_not_show_is_zero_and_said() -> None:
    """A joint that stands still shows its offset alone; one that turns steadily, nothing that needs two rates."""
    q, v, a = moved()
    q[:, 1], v[:, 1], a[:, 1] = 0.2, 0.0, 0.0
    q[:, 2], v[:, 2], a[:, 2] = 3.0 * TIME, 3.0, 0.0
    friction = observers.fit_friction(q, v, a, TRUE.torque(v, a))
    assert friction.unseen == [f"{name} of joint {k}" for k in (1, 2) for name in ("coulomb", "viscous", "inertia")]
    assert friction.coulomb[0] == pytest.approx(0.3, abs=1e-6)
    assert friction.coulomb[1] == friction.viscous[2] == 0.0
    assert friction.offset[2] == pytest.approx(TRUE.coulomb[2] + 3.0 * TRUE.viscous[2] + TRUE.offset[2])
    noisy = observers.fit_friction(q, v, a, TRUE.torque(v, a) + np.random.default_rng(1).normal(0.0, 0.1, v.shape))
    found = np.array([noisy.coulomb[0], noisy.viscous[0], noisy.inertia[0], noisy.offset[0]])
    error = np.abs(found - [0.3, 0.05, 0.01, 0.05])
    assert np.all(error < 4.0 * noisy.deviation[0])
    with pytest.raises(ObserverError, match="3 intervals"):
        observers.fit_friction(q[:3], v[:3], a[:3], q[:3])
