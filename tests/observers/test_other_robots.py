"""Robots that are not Aerobat: every registered observer finds a known force in an exactly simulated motion.

An arm and a humanoid come with Pinocchio; Borinot, Hector, Solo and Talos with the optional `example-robot-data`.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from support.arm import arm

from aerobat_pin.numerics.lie_runge_kutta import step
from aerobat_pin.observers import OBSERVERS, Observer
from aerobat_pin.robot.frames import external_forces, joint_wrench

DATA = Path("cmeel.prefix", "share", "example-robot-data", "robots")
FILES = {
    "borinot": ("borinot_description/urdf/borinot_flying_arm_2.urdf", "flying_arm_2__ee"),
    "hector": ("hector_description/robots/quadrotor_base.urdf", "base_link"),
    "solo12": ("solo_description/robots/solo12.urdf", "FL_FOOT"),
    "talos": ("talos_data/robots/talos_reduced.urdf", "gripper_left_base_link"),
}
DT, COUNT, PUSHED = 1e-3, 150, 20  # [s]; intervals; the first in which the force is on


def robot(name: str) -> tuple[pin.Model, str]:
    """Return a robot and the frame at which it is pushed; skip where its description is not installed."""
    if name == "arm":
        return arm()
    if name == "humanoid":
        return pin.buildSampleModelHumanoid(), "larm_effector_body"
    file, frame = FILES[name]
    for folder in sys.path:
        if (Path(folder) / DATA / file).exists():
            return pin.buildModelFromUrdf(str(Path(folder) / DATA / file), pin.JointModelFreeFlyer()), frame
    pytest.skip("example-robot-data is not installed: pip install 'aerobat-pinocchio[robots]'")


@dataclass(frozen=True)
class Motion:
    """A simulated motion: samples, and what acted in between."""

    time: np.ndarray
    q: np.ndarray
    v: np.ndarray
    tau: np.ndarray
    thrust: np.ndarray
    force: np.ndarray


@cache
def motion(name: str) -> Motion:
    """Shake a robot's joints while a constant world force of a tenth of its weight pushes at its frame.

    A free base is carried by a thrust along its z axis, which the observers know. Fourth order, joint torques held
    over each interval.
    """
    model, frame = robot(name)
    data, free = model.createData(), model.joints[1].nv == 6
    weight = 9.81 * pin.computeTotalMass(model)
    direction = np.array([0.6, -0.5, 0.4])
    thrust = np.zeros(model.nv)
    if free:
        thrust[2] = weight
    rng = np.random.default_rng(1)
    q = pin.neutral(model) if free else rng.uniform(-1.0, 1.0, model.nq)
    v = 0.3 * rng.normal(size=model.nv)
    states, torques, forces = [(q, v)], [], []
    for k in range(COUNT):
        force = 0.1 * weight * direction * (k >= PUSHED)
        tau = np.diag(pin.crba(model, data, q)) * (np.sin(20.0 * k * DT + np.arange(model.nv)) - v)
        if free:
            tau[:6] = 0.0
        else:
            tau += pin.computeGeneralizedGravity(model, data, q)

        def rates(
            _: float, q: np.ndarray, v: np.ndarray, u: np.ndarray = tau + thrust, f: np.ndarray = force
        ) -> tuple[np.ndarray, np.ndarray, None]:
            pin.forwardKinematics(model, data, q)
            wrench = np.concatenate([f, np.zeros(3)])
            pushed = joint_wrench(model, data, frame, wrench, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
            return v, pin.aba(model, data, q, v, u, external_forces(model, [pushed])).copy(), None

        q, v, _ = step(rates, lambda q, xi: pin.integrate(model, q, xi), k * DT, q, v, DT)
        states.append((q, v))
        torques.append(tau)
        forces.append(force)
    time = np.arange(COUNT + 1) * DT
    known = np.tile(thrust, (COUNT, 1))
    samples = (np.array(part) for part in zip(*states, strict=True))
    return Motion(time, *samples, np.array(torques), known, np.array(forces))


@pytest.mark.parametrize("kind", OBSERVERS.values(), ids=OBSERVERS)
@pytest.mark.parametrize("name", ["arm", "humanoid", *FILES])
def test_every_observer_finds_a_known_force_on_other_robots(name: str, kind: type[Observer]) -> None:
    """Silent before the push, and within 1 % of it from 80 ms after its onset on, in world axes.

    `momentum` within 5 %: it filters what turns with a limb, and a limb that is pushed turns.
    """
    model, frame = robot(name)
    flown = motion(name)
    assert np.abs(flown.v).max() > 0.3
    estimate = kind(model, [frame], 500.0).run(flown.time, flown.q, flown.v, flown.tau, {"thrust": flown.thrust})
    size = float(np.linalg.norm(flown.force[-1]))
    errors = np.linalg.norm(estimate.force[:, 0] - flown.force, axis=1) / size
    assert estimate.identifiability.rank == 3
    if kind.name != "smoother":  # who knows the future sees a step coming
        assert errors[:PUSHED].max() < 0.01
    assert errors[PUSHED + 80 :].max() < (0.01 if kind.project_first else 0.05)
