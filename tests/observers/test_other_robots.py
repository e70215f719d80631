"""Robots that are not Aerobat: each observer finds a known force in an exact motion; see `support.without_coriolis`."""

from dataclasses import dataclass
from functools import cache

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as draw
from support import without_coriolis
from support.arm import arm
from support.further import further
from support.kernel_cases import streamed
from support.stepping import step
from support.without_coriolis import AXES, JOINTS, chain, drift, links, mjcf_leg, random_record

from aerobat_pin import observers
from aerobat_pin.errors import LogError, ObserverError
from aerobat_pin.records.robot_files import FREE, named_robot

FRAMES = {"borinot": "flying_arm_2__ee", "hector": "base_link", "solo12": "FL_FOOT", "talos": "gripper_left_base_link"}
MORE = {"kinova": "j2s6s200_end_effector", "panda": "panda_hand", "ur5": "tool0", "anymal_c": "LF_FOOT"}
KINDS = {  # of robots that are few joints or none that turns
    "a hinge": links(pin.JointModelRY()),
    "a slide": links(pin.JointModelPrismaticUnaligned(AXES[1])),
    "a turning wheel": links(pin.JointModelRUBY()),
    "a screw": links(pin.JointModelHX(0.3)),
    "a gantry": links(pin.JointModelPX(), pin.JointModelPY(), pin.JointModelPZ()),
    "a planar base": links(pin.JointModelPlanar()),
    "a planar base with an arm": links(pin.JointModelPlanar(), pin.JointModelRZ(), pin.JointModelPX()),
    "a ball": links(pin.JointModelSpherical()),
    "a ball by angles": links(JOINTS["SphericalZYX"], pin.JointModelRY()),
    "a universal joint": links(JOINTS["Universal"]),
    "an arm on the ground": links(pin.JointModelRZ(), pin.JointModelRY(), pin.JointModelRY()),
    "a free body": links(pin.JointModelFreeFlyer()),
    "a free body with an arm": links(pin.JointModelFreeFlyer(), pin.JointModelRY(), pin.JointModelPX()),
    "a free body with a ball": links(pin.JointModelFreeFlyer(), pin.JointModelSpherical()),
}
DT, COUNT, PUSHED = 1e-3, 150, 20  # [s]; intervals; the first in which the force is on


def robot(name: str) -> tuple[pin.Model, str]:
    if name == "arm":
        return arm()
    if name == "humanoid":
        return pin.buildSampleModelHumanoid(), "larm_effector_body"
    if name == "mjcf leg":
        return mjcf_leg()
    if name in KINDS:
        return KINDS[name], f"tip{KINDS[name].njoints - 2}"
    root = [pin.JointModelFreeFlyer()] if name in FREE else []
    return pin.buildModelFromUrdf(installed(name), *root), (FRAMES | MORE)[name]


def installed(name: str) -> str:
    """Return the path of a robot's description; skip where it is not installed."""
    try:
        return str(named_robot(name)[0])
    except LogError as error:
        pytest.skip(str(error))


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
    """Shake joints while a tenth of the weight pushes at a frame, a thrust carries the base; order four."""
    model, frame = robot(name)
    data, free = model.createData(), model.joints[1].nv == 6
    weight = 9.81 * pin.computeTotalMass(model)
    direction = np.array([0.6, -0.5, 0.4])
    thrust = np.zeros(model.nv)
    if free:
        thrust[2] = weight
    rng = np.random.default_rng(1)
    q = pin.neutral(model) if free else pin.integrate(model, pin.neutral(model), rng.uniform(-1.0, 1.0, model.nv))
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
            pushed = observers.joint_wrench(model, data, frame, wrench, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
            return v, pin.aba(model, data, q, v, u, observers.external_forces(model, [pushed])).copy(), None

        q, v, _ = step(rates, lambda q, xi: pin.integrate(model, q, xi), k * DT, q, v, DT)
        states.append((q, v))
        torques.append(tau)
        forces.append(force)
    time = np.arange(COUNT + 1) * DT
    known = np.tile(thrust, (COUNT, 1))
    samples = (np.array(part) for part in zip(*states, strict=True))
    return Motion(time, *samples, np.array(torques), known, np.array(forces))


@pytest.mark.parametrize("kind", observers.OBSERVERS.values(), ids=observers.OBSERVERS)
@pytest.mark.parametrize("name", ["arm", "mjcf leg", "solo12", *further("humanoid", "borinot", "hector", "talos")])
def test_every_observer_finds_a_known_force_on_other_robots(name: str, kind: type[observers.Observer]) -> None:
    """Silent before the push, within 1 % from 80 ms after it on; `momentum` 5 %: it filters what turns with a limb."""
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


@settings(max_examples=12, deadline=None)
@given(name=draw.sampled_from(sorted(KINDS)), wanted=draw.sampled_from(["force", "wrench", "along"]), data=draw.data())
@pytest.mark.parametrize("kind", observers.OBSERVERS.values(), ids=observers.OBSERVERS)
def test_observers_are_right_on_any_robot(
    kind: type[observers.Observer], name: str, wanted: str, data: draw.DataObject
) -> None:
    """What the rows that it believes show of the force that pushed is what it finds, as a record and as a stream."""
    model, frame = robot(name)
    believed: list[observers.Rows] = ["all", "base", "base+power", observers.AllBut("joint0")]
    rows, flown = data.draw(draw.sampled_from(believed)), motion(name)
    point = observers.Application(frame, "wrench") if wanted == "wrench" else observers.Application(frame)
    if wanted == "along":
        point = observers.Application(frame, direction=tuple(flown.force[-1]))
    try:
        observer = kind(model, [point], 500.0, rows)
    except ObserverError:
        return
    inputs = {"tau": flown.tau, "known": {"thrust": flown.thrust}}
    found = observer.run(flown.time, flown.q, flown.v, **inputs).components
    assert np.isfinite(found).all()
    force = flown.force[-1]
    true = np.array([np.linalg.norm(force)]) if wanted == "along" else np.pad(force, (0, found.shape[1] - 3))
    seen = observer.applications.jacobian(flown.q[-1]) @ observer.believed.map(flown.v[-1])
    assert np.linalg.norm((found[-1] - true) @ seen) <= 0.05 * np.linalg.norm(true @ seen) + 1e-9
    if kind.name != "smoother":  # whose stream is the causal filter
        *_, sample = streamed(observer, flown.time, flown.q, flown.v, **inputs)
        np.testing.assert_allclose(sample.components, found[-1], rtol=1e-6, atol=1e-9)


def check_residual(model: pin.Model) -> None:
    """Compare the residual with that of `without_coriolis`, to 1e-8 of the largest drift."""
    time, q, v, u = random_record(model)
    found = observers.MomentumObserver(model, gain=1e6).run(time, q, v, u).residual  # a filter that follows at once
    sizes = [np.abs(drift(model, model.createData(), *sample)).max() for sample in zip(q, v, strict=True)]
    error = np.abs(found - without_coriolis.residual(model, time, q, v, u)).max()
    assert error < 1e-8 * max(sizes)


@pytest.mark.parametrize(
    "name", ["arm", "humanoid", "mjcf leg", "solo12", *further(*(one for one in FRAMES | MORE if one != "solo12"))]
)
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
            observers.MomentumObserver(chain(joint))
    gripper = pin.buildModelFromUrdf(installed("panda"), mimic=True)
    with pytest.raises(ObserverError, match=r"joint 'panda_finger_joint2' of type Mimic: .* mimic=False"):
        observers.MomentumObserver(gripper)


def test_a_tied_gripper_is_the_mimic_gripper() -> None:
    """Both fingers of an arm as one coordinate: S^T times the residual is that of Pinocchio's own mimic model."""
    file = installed("panda")
    gripper, free = pin.buildModelFromUrdf(file, mimic=True), pin.buildModelFromUrdf(file)
    time, q, v, u = random_record(gripper)
    tie = observers.Tie("fingers", np.vstack([np.eye(8), np.eye(8)[7]]))
    both = [np.hstack([part, part[:, 7:]]) for part in (q, v)]
    force = np.hstack([u, np.zeros((len(u), 1))])
    found = observers.MomentumObserver(free, ["panda_hand"], gain=1e6, rows=tie).run(time, *both, force).residual
    expected = without_coriolis.residual(gripper, time, q, v, u)
    np.testing.assert_allclose(found @ tie.map, expected, rtol=0.0, atol=1e-8 * np.abs(expected).max())
