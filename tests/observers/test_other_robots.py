"""Robots that are not Aerobat: every registered observer finds a known force in an exactly simulated motion.

An arm and a humanoid come with Pinocchio; the robots of `FILES` with the optional `example-robot-data`. What their
residual must be comes from `support.without_coriolis`.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from support import without_coriolis
from support.arm import arm
from support.stepping import step
from support.without_coriolis import JOINTS, chain, drift, mjcf_leg, random_record

from aerobat_pin.errors import ObserverError
from aerobat_pin.observers import OBSERVERS, MomentumObserver, Observer, Tie
from aerobat_pin.robot.frames import external_forces, joint_wrench

DATA = Path("cmeel.prefix", "share", "example-robot-data", "robots")
FILES = {
    "borinot": ("borinot_description/urdf/borinot_flying_arm_2.urdf", "flying_arm_2__ee"),
    "hector": ("hector_description/robots/quadrotor_base.urdf", "base_link"),
    "solo12": ("solo_description/robots/solo12.urdf", "FL_FOOT"),
    "talos": ("talos_data/robots/talos_reduced.urdf", "gripper_left_base_link"),
}
ARMS = {  # on the ground
    "kinova": ("kinova_description/robots/kinova.urdf", "j2s6s200_end_effector"),
    "panda": ("panda_description/urdf/panda.urdf", "panda_hand"),
    "ur5": ("ur_description/urdf/ur5_robot.urdf", "tool0"),
}
MORE = {"anymal": ("anymal_c_simple_description/urdf/anymal.urdf", "LF_FOOT")}  # need a free-flyer, like FILES
DT, COUNT, PUSHED = 1e-3, 150, 20  # [s]; intervals; the first in which the force is on


def robot(name: str) -> tuple[pin.Model, str]:
    """Return a robot and the frame at which it is pushed."""
    if name == "arm":
        return arm()
    if name == "humanoid":
        return pin.buildSampleModelHumanoid(), "larm_effector_body"
    if name == "mjcf leg":
        return mjcf_leg()
    file, frame = (FILES | ARMS | MORE)[name]
    if name in ARMS:
        return pin.buildModelFromUrdf(installed(file)), frame
    return pin.buildModelFromUrdf(installed(file), pin.JointModelFreeFlyer()), frame


def installed(file: str) -> str:
    """Return the path of a robot's description; skip where it is not installed."""
    for folder in sys.path:
        if (Path(folder) / DATA / file).exists():
            return str(Path(folder) / DATA / file)
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
@pytest.mark.parametrize("name", ["arm", "humanoid", "mjcf leg", *FILES])
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


def check_residual(model: pin.Model) -> None:
    """Compare the residual with that of `without_coriolis`, to 1e-8 of the largest drift."""
    time, q, v, u = random_record(model)
    found = MomentumObserver(model, gain=1e6).run(time, q, v, u).residual  # a filter that follows at once
    sizes = [np.abs(drift(model, model.createData(), *sample)).max() for sample in zip(q, v, strict=True)]
    error = np.abs(found - without_coriolis.residual(model, time, q, v, u)).max()
    assert error < 1e-8 * max(sizes)


@pytest.mark.parametrize("name", ["arm", "humanoid", "mjcf leg", *FILES, *ARMS, *MORE])
def test_the_residual_of_a_robot_needs_no_coriolis_matrix(name: str) -> None:
    """Arms, quadrupeds, humanoids, a leg from MJCF; p, Mdot v and nle alone give the same."""
    check_residual(robot(name)[0])


@pytest.mark.parametrize("name", JOINTS)
@pytest.mark.parametrize("base", [None, pin.JointModelFreeFlyer()], ids=["fixed", "free"])
def test_the_residual_of_a_joint_needs_no_coriolis_matrix(name: str, base: pin.JointModel | None) -> None:
    """In the middle of a chain: joints whose axes turn with their own angles, and others."""
    check_residual(chain(JOINTS[name], base))


def test_joints_that_observers_cannot_use_are_refused_by_name() -> None:
    """The axes of an ellipsoid turn with its angles; a mimic joint has no coordinate of its own."""
    for joint in (pin.JointModelEllipsoid(0.3, 0.2, 0.5), without_coriolis.composite(pin.JointModelEllipsoid())):
        with pytest.raises(ObserverError, match=r"joint 'joint1' of type Ellipsoid: observers cannot use it; .* RX"):
            MomentumObserver(chain(joint))
    gripper = pin.buildModelFromUrdf(installed(ARMS["panda"][0]), mimic=True)
    with pytest.raises(ObserverError, match=r"joint 'panda_finger_joint2' of type Mimic: .* mimic=False"):
        MomentumObserver(gripper)


def test_a_tied_gripper_is_the_mimic_gripper() -> None:
    """Both fingers of an arm as one coordinate: S^T times the residual is that of Pinocchio's own mimic model."""
    file = installed(ARMS["panda"][0])
    gripper, free = pin.buildModelFromUrdf(file, mimic=True), pin.buildModelFromUrdf(file)
    time, q, v, u = random_record(gripper)
    tie = Tie("fingers", np.vstack([np.eye(8), np.eye(8)[7]]))
    both = [np.hstack([part, part[:, 7:]]) for part in (q, v)]
    force = np.hstack([u, np.zeros((len(u), 1))])
    found = MomentumObserver(free, ["panda_hand"], gain=1e6, rows=tie).run(time, *both, force).residual
    expected = without_coriolis.residual(gripper, time, q, v, u)
    np.testing.assert_allclose(found @ tie.map, expected, rtol=0.0, atol=1e-8 * np.abs(expected).max())
