"""The closed linkage in Pinocchio: accelerations, ten turns, and one file for Pinocchio and MuJoCo."""

from functools import partial

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from support.closed import DOWN, MJCF, RATE, closed_data, exact_acceleration, fly_prescribed, miss, symmetric
from support.readers import ROBOTS
from support.stepping import step

import aerobat_pin
from aerobat_pin.aerobat import closed_model, closed_settings, closed_state, load_aerobat
from aerobat_pin.errors import FrameNotFoundError, MorphologyFileError
from aerobat_pin.linkage import KineticSculpture

CRANKS = ("left_crank", "right_crank")


@ROBOTS
@pytest.mark.parametrize("bars", ["light", "cad"])
def test_accelerations_are_those_of_prescribed_joints(name: str, bars: str) -> None:
    """Within 1e-9 of the largest entry, the base's within 3e-9 of its own; random placements, twists and torques."""
    model, constraints = closed_model(name, bars)
    linkage, (data, datas) = load_aerobat(name).linkage, closed_data(model, constraints)
    rng, worst = np.random.default_rng(3), []
    for _ in range(10):
        crank, rate = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(10.0, 40.0)
        q, v, _ = closed_state(model, linkage, crank, rate)
        q[:7] = pin.randomConfiguration(model, -np.ones(model.nq), np.ones(model.nq))[:7]
        v[:6], tau = rng.standard_normal(6), np.zeros(model.nv)
        for joint in CRANKS:
            tau[model.joints[model.getJointId(joint)].idx_v] = rng.uniform(-0.05, 0.05)
        settings = closed_settings()
        found = pin.constraintDynamics(model, data, q, v, tau, constraints, datas, settings)
        exact = exact_acceleration(model, linkage, q, v, tau, crank, rate)
        away, size = np.abs(found - exact), np.abs(exact)
        worst.append([away.max() / size.max(), away[:6].max() / size[:6].max()])
    whole, base = np.max(worst, axis=0)
    assert whole < 1e-9
    assert base < 3e-9


@pytest.mark.parametrize("bars", ["light", "cad"])
def test_a_free_flight_keeps_its_momenta(bars: str) -> None:
    """No gravity, heavy rotors: angular momentum to 1 % in 200 steps of 1 ms; light bars as prescribed, to 0.03 mm."""
    model, constraints = closed_model("aerobat", bars, gravity=0.0)
    robot = load_aerobat(gravity=0.0)
    model.armature = 10.0 * np.isin(np.arange(model.nv), [model.joints[model.getJointId(one)].idx_v for one in CRANKS])
    data, datas = closed_data(model, constraints)
    q, v, _ = closed_state(model, robot.linkage, DOWN, RATE)
    tau, settings, momenta, rows = np.zeros(model.nv), closed_settings(), [], []

    def rates(t: float, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray, None]:
        return v, pin.constraintDynamics(model, data, q, v, tau, constraints, datas, settings), None

    for _ in range(200):
        momenta.append(pin.computeCentroidalMomentum(model, data, q, v).vector)
        q, v, _ = step(rates, partial(pin.integrate, model), 0.0, q, v, 1e-3)
        rows.append(q[:3])
    assert np.ptp(np.array(momenta)[:, 3:], axis=0).max() < 1e-2 * np.abs(momenta[0][4])
    if bars == "light":
        assert np.max(np.abs(rows - fly_prescribed(robot, 200, 1e-3)[:, :3])) < 3e-5


def test_ten_turns_stay_closed() -> None:
    """Runge-Kutta at 1 ms: shoulder and elbow within 1e-6 rad of the closed form at the actual crank angle."""
    model, constraints = closed_model("aerobat", gravity=0.0)
    linkage, (data, datas) = KineticSculpture(), closed_data(model, constraints)
    cranks = [model.joints[model.getJointId(joint)].idx_v for joint in CRANKS]
    joints = [model.joints[model.getJointId(f"left_{hinge}")].idx_q for hinge in ("crank", "shoulder", "elbow")]
    q, v, _ = closed_state(model, linkage, DOWN, RATE)
    settings, tau, rows = closed_settings(), np.zeros(model.nv), []

    def rates(t: float, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray, None]:
        tau[cranks] = 5e-4 * (RATE - v[cranks])
        return v, pin.constraintDynamics(model, data, q, v, tau, constraints, datas, settings), None

    while q[joints[0]] < DOWN + 10.0 * 2.0 * np.pi:
        q, v, _ = step(rates, partial(pin.integrate, model), 0.0, q, v, 1e-3)
        rows.append(q[joints])
    assert len(rows) < 3000
    assert max(miss(linkage, *np.array(rows).T)) < 1e-6


@ROBOTS
def test_mujoco_and_pinocchio_read_one_robot_from_the_file(name: str) -> None:
    """Closing points to 1e-9 m, links to 1e-12 m, mass matrix to 1e-9 but for MuJoCo's armature, over a turn."""
    model, constraints = closed_model(name)
    twin, linkage = mujoco.MjModel.from_xml_path(MJCF[name]), load_aerobat(name).linkage
    assert len(constraints) == 6
    assert all(one.type == pin.ContactType.CONTACT_3D for one in constraints)
    data, state = model.createData(), mujoco.MjData(twin)
    columns = [twin.joint(joint).dofadr[0] for joint in list(model.names)[2:]]
    rows = [model.joints[i].idx_v for i in range(2, model.njoints)]
    for crank in np.radians(np.arange(0.0, 360.0, 15.0)):
        q, _, _ = closed_state(model, linkage, crank)
        pin.framesForwardKinematics(model, data, q)
        for one in constraints:
            first, second = data.oMi[one.joint1_id], data.oMi[one.joint2_id]
            gap = first.act(one.joint1_placement.translation) - second.act(one.joint2_placement.translation)
            assert np.linalg.norm(gap) < 1e-9
        for joint in list(model.names)[2:]:
            state.joint(joint).qpos[0] = q[model.joints[model.getJointId(joint)].idx_q]
        mujoco.mj_fwdPosition(twin, state)
        for body in range(1, twin.nbody):
            place = data.oMf[model.getFrameId(twin.body(body).name)]
            assert state.xpos[body] == pytest.approx(place.translation, abs=1e-12)
            at = model.frames[model.getFrameId(twin.body(body).name)].parentJoint
            assert twin.body_mass[body] == pytest.approx(model.inertias[at].mass, rel=1e-12)
        theirs = np.zeros((twin.nv, twin.nv))
        mujoco.mj_fullM(twin, state, theirs)
        theirs -= np.diag(twin.dof_armature)
        ours = symmetric(pin.crba(model, data, q))
        scale = np.sqrt(np.outer(np.diag(ours), np.diag(ours)))
        wing = np.ix_(rows, rows)
        assert np.max(np.abs(theirs[np.ix_(columns, columns)] - ours[wing]) / scale[wing]) < 1e-6


def test_the_front_door_gives_it_with_limits_and_a_pose() -> None:
    """The name that scripts use; limits of the morphology, no armature, a closed reference configuration."""
    assert aerobat_pin.closed_model is closed_model
    model, _ = closed_model("aerobat_guard", "cad")
    shape = load_aerobat("aerobat_guard").morphology
    index = model.joints[model.getJointId("right_shoulder")].idx_q
    assert (model.lowerPositionLimit[index], model.upperPositionLimit[index]) == shape.joints.shoulder_limits
    assert not np.any(model.armature)
    q = model.referenceConfigurations["closed"]
    assert q[model.joints[model.getJointId("left_crank")].idx_q] == -np.pi / 2


def test_what_is_no_closed_robot_is_refused() -> None:
    """A morphology that is not there, and a model without bars."""
    with pytest.raises(MorphologyFileError, match="did you mean 'aerobat'"):
        closed_model("aerobot")
    robot = load_aerobat()
    with pytest.raises(FrameNotFoundError, match="left_crank"):
        closed_state(robot.model, robot.linkage, 0.0)
