"""Estimate a known force on five other robots with every observer: two arms, two flying robots and a walking robot.

All but the first are installed by `pip install 'aerobat-pinocchio[robots]'` and skipped if not installed.
"""

import numpy as np
import pinocchio as pin

from aerobat_pin import load_robot
from aerobat_pin.errors import LogError
from aerobat_pin.observers import OBSERVERS, external_forces, joint_wrench

DT, STEPS = 1e-3, 100
FRAMES = {"borinot": "flying_arm_2__ee", "hector": "base_link", "solo12": "FL_FOOT", "ur5": "tool0"}


def load(name: str) -> pin.Model | None:
    """Return a robot by its name, or None if the robots are not installed."""
    try:
        return load_robot(name).model
    except LogError as error:
        print(error)
        return None


def fly(model: pin.Model, frame: str, force: np.ndarray, tau: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Simulate a constant world force at a frame and a constant generalised force; return all samples of q and v."""
    data, wrench = model.createData(), np.concatenate([force, np.zeros(3)])

    def acceleration(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        pin.forwardKinematics(model, data, q)
        pushed = joint_wrench(model, data, frame, wrench, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
        return pin.aba(model, data, q, v, tau, external_forces(model, [pushed])).copy()

    q, v = pin.integrate(model, pin.neutral(model), np.full(model.nv, 0.3)), np.full(model.nv, 0.2)
    samples = [(q, v)]
    for _ in range(STEPS):  # the midpoint method
        middle = v + 0.5 * DT * acceleration(q, v)
        q, v = (
            pin.integrate(model, q, DT * middle),
            v + DT * acceleration(pin.integrate(model, q, 0.5 * DT * v), middle),
        )
        samples.append((q, v))
    return np.array([q for q, _ in samples]), np.array([v for _, v in samples])


robots = {"arm": (pin.buildSampleModelManipulator(), "effector_body")}
robots |= {name: (model, frame) for name, frame in FRAMES.items() if (model := load(name)) is not None}
for name, (model, frame) in robots.items():
    weight = 9.81 * pin.computeTotalMass(model)
    force = 0.1 * weight * np.array([0.6, -0.5, 0.4])
    thrust = np.zeros(model.nv)
    if model.joints[1].nv == 6:
        thrust[2] = weight  # along the body's z; the observers know it
    q, v = fly(model, frame, force, thrust)
    time, tau = np.arange(STEPS + 1) * DT, np.zeros((STEPS, model.nv))
    print(f"{name:<9} {'true':<15} {np.round(force, 3)} N at {frame}")
    for observer in OBSERVERS.values():
        estimate = observer(model, [frame], 500.0).run(time, q, v, tau, {"thrust": np.tile(thrust, (STEPS, 1))})
        print(f"{'':<9} {observer.name:<15} {np.round(estimate.force[-1, 0], 3)} N")
