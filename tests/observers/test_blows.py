"""Blows that no size of a force expects: a box in free flight that is hit, of which all is known."""

from functools import cache

import numpy as np
import pinocchio as pin
import pytest

from aerobat_pin.observers import Application, Expected, KalmanObserver, SmootherObserver

DT, COUNT, HIT = 1e-3, 1000, slice(500, 510)
BLOW = np.array([300.0, -200.0, 1000.0, 0.0, 0.0, 0.0])  # at the centre of mass, world axes


@cache
def hit_box() -> tuple[pin.Model, np.ndarray, np.ndarray, np.ndarray]:
    """Return a box of 3 kg that spins as it falls, and times, q, v of its flight; it is hit for ten milliseconds."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root")
    model.appendBodyToJoint(joint, pin.Inertia(3.0, np.zeros(3), np.diag([0.03, 0.05, 0.06])), pin.SE3.Identity())
    model.addFrame(pin.Frame("box", joint, 0, pin.SE3.Identity(), pin.FrameType.BODY))
    data, q, v = model.createData(), [pin.neutral(model)], [np.array([0.3, 0.0, 0.0, 1.0, 20.0, 5.0])]
    for k in range(10 * COUNT):
        turn = pin.Quaternion(q[-1][3:]).matrix().T
        push = turn @ BLOW[:3] if HIT.start <= k // 10 < HIT.stop else np.zeros(3)
        a = pin.aba(model, data, q[-1], v[-1], np.concatenate([push, np.zeros(3)]))
        v.append(v[-1] + 0.1 * DT * a)
        q.append(pin.integrate(model, q[-1], 0.1 * DT * v[-1]))
    return model, DT * np.arange(COUNT + 1), np.array(q[::10]), np.array(v[::10])


@pytest.mark.parametrize("kind", [KalmanObserver, SmootherObserver])
def test_errors_of_rows_do_not_keep_a_share_of_a_blow(kind: type[KalmanObserver]) -> None:
    """Before and after it nothing pushes, and within two deviations nothing is said to; the blow itself is found."""
    model, time, q, v = hit_box()
    v = v + 2e-3 * np.random.default_rng(1).standard_normal(v.shape)
    rows = np.array([2.0, 4.0, 1.0, 0.1, 0.2, 0.1])
    expected = Expected(np.array([10.0] * 3 + [2.0] * 3), rows, np.zeros(6), np.ones(6))
    observer = kind(model, [Application("box", "wrench")], 100.0, expected=expected)
    found = observer.run(time, q, v, np.zeros((COUNT, 6)))
    truth = np.zeros((COUNT, 6))
    truth[HIT] = BLOW
    within = np.abs(found.components - truth) < 2.0 * found.standard_deviation
    assert np.all(within[100:].mean(axis=0) > 0.95)
    assert np.max(np.abs(found.components[HIT.stop + 20 :])) < 10.0
    assert found.components[HIT, 2].mean() == pytest.approx(1000.0, rel=0.1)


def test_rates_of_usual_noise_hide_no_blow() -> None:
    """300 N on a slide of 1 kg for 20 ms, 0.03 m/s of noise: what says little of a component is relative to others."""
    model = pin.Model()
    slide = model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), "slide")
    model.appendBodyToJoint(slide, pin.Inertia(1.0, np.zeros(3), 1e-3 * np.eye(3)), pin.SE3.Identity())
    model.addFrame(pin.Frame("tool", slide, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    at = np.arange(2 * COUNT + 1)
    v = DT * np.cumsum(np.where((at > COUNT) & (at <= COUNT + 20), 300.0, 0.0))[:, None]
    seen = v + 0.03 * np.random.default_rng(1).standard_normal(v.shape)
    expected = Expected(np.full(3, 3.3), np.array([0.05]), np.zeros(1), np.ones(1))
    observer = KalmanObserver(model, ["tool"], 100.0, expected=expected)
    found = observer.run(DT * at, DT * np.cumsum(v, axis=0), seen, np.zeros((2 * COUNT, 1)))
    assert found.components[COUNT + 10 : COUNT + 20, 0].mean() == pytest.approx(300.0, abs=30.0)


def test_what_leaves_no_trace_does_not_jump() -> None:
    """A glitch of an upright pendulum's rate was 4e6 N across it; in a log, forces grew beyond all numbers."""
    model = pin.Model()
    arm = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "arm")
    upright = model.addJoint(arm, pin.JointModelRX(), pin.SE3(np.eye(3), np.array([0.2, 0.0, 0.0])), "pendulum")
    for joint, centre in ((arm, [0.1, 0.0, 0.0]), (upright, [0.0, 0.0, 0.15])):
        model.appendBodyToJoint(joint, pin.Inertia(0.2, np.array(centre), 1e-3 * np.eye(3)), pin.SE3.Identity())
    tip = pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.3]))
    model.addFrame(pin.Frame("tip", upright, 0, tip, pin.FrameType.OP_FRAME))
    q, v = np.tile([0.0, 1e-7], (COUNT + 1, 1)), 1e-4 * np.random.default_rng(1).standard_normal((COUNT + 1, 2))
    v[600, 1] += 0.05
    expected = Expected(np.full(3, 1.0), np.array([0.01, 0.002]), np.zeros(2), np.ones(2))
    observer = KalmanObserver(model, ["tip"], 100.0, expected=expected)
    found = observer.run(DT * np.arange(COUNT + 1), q, v, np.zeros((COUNT, 2)))
    assert np.max(np.abs(found.components)) < 100.0


@pytest.mark.parametrize(("q0", "tip", "blow"), [(0.015, [1.0, 0.0, 0.0], 200.0), (0.3, [0.0, 0.0, 0.2], 0.0)])
def test_a_door_that_is_hit_says_across_it_alone(q0: float, tip: list[float], blow: float) -> None:
    """One row explains each component: -12 kN came along the door, and 4e19 N at a point on its axis."""
    model = pin.Model()
    place = pin.SE3(pin.rpy.rpyToMatrix(1.3 if not blow else 0.0, 0.4 if not blow else 0.0, 0.0), np.zeros(3))
    hinge = model.addJoint(0, pin.JointModelRZ(), place, "hinge")
    inertia = pin.Inertia(5.0, np.array([0.5, 0.0, 0.0]), np.diag([0.1, 0.5, 0.5]))
    model.appendBodyToJoint(hinge, inertia, pin.SE3.Identity())
    model.addFrame(pin.Frame("tip", hinge, 0, pin.SE3(np.eye(3), np.array(tip)), pin.FrameType.OP_FRAME))
    model.gravity.linear = np.zeros(3)
    q, v, hit = [q0], [0.0], range(COUNT, COUNT + 10)
    for k in range(3 * COUNT // 2):
        v.append(v[-1] + DT * (200.0 * np.cos(q[-1]) / 1.75 if k in hit else 0.0))
        q.append(q[-1] + 0.5 * DT * (v[-1] + v[-2]))
    seen = np.array(v)[:, None] + 1e-3 * np.random.default_rng(1).standard_normal((len(v), 1))
    expected = Expected(np.full(3, 10.0), np.array([0.3]), np.zeros(1), np.ones(1))
    observer = KalmanObserver(model, ["tip"], 100.0, expected=expected)
    found = observer.run(DT * np.arange(len(q)), np.array(q)[:, None], seen, np.zeros((len(q) - 1, 1))).components
    assert found[COUNT + 2 : hit.stop, 1].mean() == pytest.approx(blow, abs=5.0)
    assert np.max(np.abs(found[:, [0, 2]])) < 20.0
