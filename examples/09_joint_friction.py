"""Friction in a leg's joints, taken for contact at the foot: learn it from a swing in free air, then subtract it."""

import numpy as np
import pinocchio as pin

from aerobat_pin.observers import ForceLevelObserver, JointFriction, MomentumObserver, fit_friction

# A leg: hip (roll, pitch) and knee, 0.25 m each.
model, parent = pin.Model(), 0
for name, joint, drop, mass in (
    ("roll", pin.JointModelRX(), 0.0, 0.4),
    ("pitch", pin.JointModelRY(), 0.05, 0.8),
    ("knee", pin.JointModelRY(), 0.25, 0.3),
):
    parent = model.addJoint(parent, joint, pin.SE3(np.eye(3), np.array([0.0, 0.0, -drop])), name)
    half = pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.12]))
    model.appendBodyToJoint(parent, pin.Inertia.FromCylinder(mass, 0.02, 0.25), half)
model.addFrame(pin.Frame("foot", parent, 0, pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.25])), pin.FrameType.OP_FRAME))
data, foot = model.createData(), model.getFrameId("foot")

# The joints swing for 4 s; 0.3 N m of friction each, which no observer knows of.
time = 1e-3 * np.arange(4001)
pulsation = 2.0 * np.pi * np.array([1.0, 1.3, 1.7])
turned = pulsation * time[:, None] + np.array([0.0, 1.0, 2.0])
q, v = np.array([0.0, 0.3, -1.0]) + 0.4 * np.sin(turned), 0.4 * pulsation * np.cos(turned)
rate, acceleration = 0.5 * (v[1:] + v[:-1]), np.diff(v, axis=0) / 1e-3  # means over the intervals
true = JointFriction(np.full(3, 0.3), np.full(3, 0.02), np.full(3, 0.01), np.zeros(3))


def motor_torque(force: np.ndarray) -> np.ndarray:
    """Return what the motors' currents show while a force (3,) [N] acts on the foot."""
    torque = np.empty_like(rate)
    for k in range(len(rate)):
        middle = 0.5 * (q[k] + q[k + 1])
        needed = pin.rnea(model, data, middle, rate[k], acceleration[k])
        J = pin.computeFrameJacobian(model, data, middle, foot, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)[:3]
        torque[k] = needed - J.T @ force
    return torque - true.torque(rate, acceleration)


free = MomentumObserver(model, gain=1e9).run(time, q, v, motor_torque(np.zeros(3)))  # so fast that it filters nothing
friction = fit_friction(q[:-1], rate, acceleration, free.residual)
print("Coulomb friction [N m]:", friction.coulomb.round(3), " rotor inertia [kg m2]:", friction.inertia.round(4))

loaded = motor_torque(np.array([1.0, 0.5, 6.0]))  # 6.1 N on the foot
observer = ForceLevelObserver(model, ["foot"], gain=200.0)
for words, known in (("without", {}), ("with", {"friction": friction.torque(rate, acceleration)})):
    size = np.linalg.norm(observer.run(time, q, v, loaded, known).force[500:, 0], axis=1)
    print(f"{words} the friction the foot reads {size.min():.1f} to {size.max():.1f} N")
