"""Friction of joints as a known input: its fit, what a record does not show, and what leaving it out costs a foot."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from aerobat_pin.errors import ObserverError
from aerobat_pin.observers import ForceLevelObserver, JointFriction, MomentumObserver, fit_friction

TIME = 1e-3 * np.arange(4001)
TRUE = JointFriction(
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
    model.appendBodyToJoint(
        at, pin.Inertia.FromCylinder(0.3, 0.02, 0.25), pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.12]))
    )
    model.addFrame(pin.Frame("foot", at, 0, pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.25])), pin.FrameType.OP_FRAME))
    return model


def walked(force: np.ndarray) -> tuple[pin.Model, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return a leg that swings with a force (3,) [N] on its foot: model, q, v, mean accelerations, motor torques."""
    model = leg()
    data = model.createData()
    swing, v, _ = moved()
    q = swing + np.array([0.0, 0.3, -1.0])
    tau = np.empty((len(TIME) - 1, 3))
    for k in range(len(tau)):
        middle, rate, bend = 0.5 * (q[k] + q[k + 1]), 0.5 * (v[k] + v[k + 1]), (v[k + 1] - v[k]) / 1e-3
        needed = pin.rnea(model, data, middle, rate, bend)
        J = pin.computeFrameJacobian(
            model, data, middle, model.getFrameId("foot"), pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        )[:3]
        tau[k] = needed - J.T @ force - TRUE.torque(rate, bend)
    return model, q, v, np.diff(v, axis=0) / 1e-3, tau


def test_a_foot_reads_right_once_friction_is_known() -> None:
    """0.2 to 0.3 N m a joint hides up to 3 N of 6.1 N; fitted to a free swing, friction leaves less than 0.05 N."""
    model, q, v, a, tau = walked(np.zeros(3))
    rate = 0.5 * (v[1:] + v[:-1])
    free = MomentumObserver(model, (), 1e9).run(TIME, q, v, tau)
    friction = fit_friction(q[:-1], rate, a, free.residual)
    for name in ("coulomb", "viscous", "inertia", "offset"):
        np.testing.assert_allclose(getattr(friction, name), getattr(TRUE, name), atol=2e-3, err_msg=name)
    assert friction.unseen == []
    pushed = np.array([1.0, 0.5, 6.0])
    model, q, v, a, tau = walked(pushed)
    observer = ForceLevelObserver(model, ["foot"], 200.0)
    blind = observer.run(TIME, q, v, tau).force[500:, 0]
    seeing = observer.run(TIME, q, v, tau, {"friction": friction.torque(rate, a)}).force[500:, 0]
    assert np.ptp(np.linalg.norm(blind, axis=1)) > 2.0
    np.testing.assert_allclose(seeing, np.broadcast_to(pushed, seeing.shape), atol=0.05)


def test_what_the_motion_does_not_show_is_zero_and_said() -> None:
    """A joint that stands still shows its offset alone; one that turns steadily, nothing that needs two rates."""
    q, v, a = moved()
    q[:, 1], v[:, 1], a[:, 1] = 0.2, 0.0, 0.0
    q[:, 2], v[:, 2], a[:, 2] = 3.0 * TIME, 3.0, 0.0
    friction = fit_friction(q, v, a, TRUE.torque(v, a))
    assert friction.unseen == [
        f"{name} of joint {joint}" for joint in (1, 2) for name in ("coulomb", "viscous", "inertia")
    ]
    assert friction.coulomb[0] == pytest.approx(0.3, abs=1e-6)
    assert friction.coulomb[1] == friction.viscous[2] == 0.0
    assert friction.offset[2] == pytest.approx(TRUE.coulomb[2] + 3.0 * TRUE.viscous[2] + TRUE.offset[2])
    noisy = fit_friction(q, v, a, TRUE.torque(v, a) + np.random.default_rng(1).normal(0.0, 0.1, v.shape))
    assert noisy.deviation is not None
    error = np.abs(
        [noisy.coulomb[0], noisy.viscous[0], noisy.inertia[0], noisy.offset[0]] - np.array([0.3, 0.05, 0.01, 0.05])
    )
    assert np.all(error < 4.0 * noisy.deviation[0])
    with pytest.raises(ObserverError, match="3 intervals"):
        fit_friction(q[:3], v[:3], a[:3], q[:3])
