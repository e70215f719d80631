"""The closed linkage in Pinocchio and MuJoCo: accelerations, ten turns, and one file that both read."""

from functools import partial
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from support.closed import (
    DOWN,
    HINGES,
    MJCF,
    RATE,
    closed_data,
    exact_acceleration,
    fly_in_mujoco,
    fly_prescribed,
    miss,
    placed,
    symmetric,
)
from support.commands import aerobat
from support.readers import ROBOTS, in_pinocchio
from support.stepping import step

import aerobat_description as description
import aerobat_pin
from aerobat_description.bars import bar_bodies, bar_body, linkage_bars
from aerobat_description.morphology import Morphology
from aerobat_description.morphology_tables import Body
from aerobat_pin.aerobat import closed_model, closed_settings, closed_state, load_aerobat
from aerobat_pin.errors import FrameNotFoundError, MorphologyFileError
from aerobat_pin.linkage import KineticSculpture
from aerobat_pin.observers import euler_angles

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


SIDES = ("left", "right")


def columns(twin: mujoco.MjModel, rows: np.ndarray, side: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return crank, shoulder and elbow over time [rad]."""
    return tuple(rows[:, twin.joint(f"{side}_{name}").qposadr[0]] for name in ("crank", "shoulder", "elbow"))


@ROBOTS
def test_mujoco_turns_the_linkage_from_rest(name: str) -> None:
    """Three turns at 4.75 Hz with the file's own settings: shoulder and elbow within 2.5e-3 rad of the closed form."""
    robot, twin = load_aerobat(name), mujoco.MjModel.from_xml_path(MJCF[name])
    data = mujoco.MjData(twin)
    rows = fly_in_mujoco(twin, data, round((3.0 / 4.75 + 0.05) / twin.opt.timestep))
    assert data.joint("left_crank").qpos[0] + np.pi / 2 > 3.0 * 2.0 * np.pi
    assert data.joint("left_crank").qvel[0] == pytest.approx(RATE, rel=0.05)
    for side in SIDES:
        assert max(miss(robot.linkage, *columns(twin, rows, side))) < 2.5e-3
    assert np.max(np.abs(columns(twin, rows, "left")[0] - columns(twin, rows, "right")[0])) < 2e-6


@ROBOTS
def test_a_second_of_free_flight_is_the_packages(name: str) -> None:
    """No air, no gravity: pitch within 0.1 deg and height within 0.1 mm of the flight with prescribed joints."""
    robot, twin = load_aerobat(name, gravity=0.0), mujoco.MjModel.from_xml_path(MJCF[name])
    twin.opt.gravity[:] = 0.0
    model = closed_model(name)[0]
    rows = fly_in_mujoco(twin, placed(twin, model, *closed_state(model, robot.linkage, -np.pi / 2, RATE)[:2]), 2000)
    ours, theirs = fly_prescribed(robot, 500, 2e-3), rows[3::4][:, [0, 1, 2, 4, 5, 6, 3]]
    pitch = [np.degrees(euler_angles(q)[:, 1]) for q in (ours, theirs)]
    assert np.ptp(pitch[0]) > 10.0
    assert np.max(np.abs(pitch[0] - pitch[1])) < 0.1
    assert np.max(np.abs(ours[:, 2] - theirs[:, 2])) < 1e-4


@ROBOTS
def test_the_file_is_the_robot(name: str) -> None:
    """Names, mass, limits, one actuator; wings and force points are where the URDF has them; nothing ever touches."""
    robot, twin = load_aerobat(name), mujoco.MjModel.from_xml_path(MJCF[name])
    assert twin.body_mass.sum() == pytest.approx(robot.mass, rel=1e-12)
    assert {twin.joint(i).name for i in range(1, twin.njnt)} == {f"{at}_{hinge}" for at in SIDES for hinge in HINGES}
    assert [twin.actuator(i).name for i in range(twin.nu)] == ["crank"]
    assert twin.joint("left_elbow").range == pytest.approx(robot.morphology.joints.elbow_limits)
    tree, model = in_pinocchio(name), closed_model(name)[0]
    data = tree.createData()
    for crank in np.radians(np.arange(0.0, 360.0, 10.0)):
        state = placed(twin, model, *closed_state(model, robot.linkage, crank)[:2])
        mujoco.mj_fwdPosition(twin, state)
        assert state.ncon == 0
        joined = twin.eq_type[state.efc_id[: state.ne]] == mujoco.mjtEq.mjEQ_CONNECT
        assert np.max(np.abs(state.efc_pos[: state.ne][joined])) < 1e-9
        closure = robot.linkage.solve(crank)
        q = robot.configuration([0, 0, 0, 0, 0, 0, 1], closure.theta_s, closure.theta_e)
        pin.framesForwardKinematics(tree, data, q)
        for side in SIDES:
            for link in (f"{side}_proximal", f"{side}_distal"):
                place = data.oMf[tree.getFrameId(link)]
                assert state.body(link).xpos == pytest.approx(place.translation, abs=1e-12)
                assert state.body(link).xmat.reshape(3, 3) == pytest.approx(place.rotation, abs=1e-12)
            at = data.oMf[tree.getFrameId(f"{side}_force_point")].translation
            assert state.site(f"{side}_force_point").xpos == pytest.approx(at, abs=1e-12)


def test_light_bars_weigh_a_hundredth_and_the_robot_the_same() -> None:
    """Masses of Flappy_v8.xml of one side; what the bars weigh, the body lacks."""
    shape = Morphology.load("aerobat")
    cad = {"L1": 0.16e-3, "L2": 0.20e-3, "L4": 0.19e-3, "L5": 0.55e-3, "L6": 0.18e-3}
    for bars, share in (("cad", 1.0), ("light", 0.01)):
        model, _ = closed_model("aerobat", bars)
        masses = {name: body.mass for name, body in bar_bodies(shape, bars).items()}
        assert masses == pytest.approx({name: share * mass for name, mass in cad.items()})
        assert pin.computeTotalMass(model) == pytest.approx(shape.mass, rel=1e-12)
        base = model.inertias[model.getJointId("root_joint")]
        assert base.mass == pytest.approx(31.3e-3 - 2.0 * share * 1.28e-3, rel=1e-12)


def test_the_inertia_of_a_bar_is_that_of_its_struts() -> None:
    """L5, two struts at an angle: against small pieces summed by themselves; and the body can exist."""
    bar = linkage_bars(Morphology.load("aerobat").linkage)["L5"]
    body = bar_body(bar, 1.0)
    assert isinstance(body, Body)
    body.check("bar")
    points = np.concatenate([s + (np.arange(4000) + 0.5) / 4000 * (e - s) for s, e in bar.struts])
    weights = np.repeat([abs(e - s) / 4000 for s, e in bar.struts], 4000)
    weights /= weights.sum()
    com = np.sum(weights * points)
    away = points - com
    assert body.com == pytest.approx((0.0, com.real, com.imag), abs=1e-12)
    thin = 1e-6 * 2.6**2 / 12 + 1e-6 * 1.1**2 / 12  # the struts' cross-section adds this at most
    assert body.inertia[0] == pytest.approx(np.sum(weights * np.abs(away) ** 2), abs=thin)
    assert body.inertia[1] == pytest.approx(np.sum(weights * away.imag**2), abs=thin)
    assert body.inertia[5] == pytest.approx(-np.sum(weights * away.real * away.imag), abs=thin)


def test_the_command_writes_it(tmp_path: Path) -> None:
    """Printed as it was committed; a robot of one's own with its meshes."""
    assert aerobat("urdf", "--format", "mjcf", cwd=tmp_path).stdout == Path(description.MJCF_PATH).read_text()
    (tmp_path / "mine.toml").write_text('extends = "aerobat"\nname = "mine"\n[linkage]\nL3b = 6.8e-3\n')
    done = aerobat("urdf", "mine.toml", "--format", "mjcf", "--bars", "cad", "-o", "mine.xml", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    twin = mujoco.MjModel.from_xml_path(str(tmp_path / "mine.xml"))
    assert twin.body("left_L1").mass[0] == pytest.approx(0.16e-3)
    assert twin.nmesh == len(list((tmp_path / "meshes").iterdir()))
