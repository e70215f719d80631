"""The MJCF with the closed linkage: what MuJoCo makes of the shipped files, by themselves and beside the package."""

from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from support.closed import HINGES, MJCF, RATE, fly_in_mujoco, fly_prescribed, miss, placed
from support.commands import aerobat
from support.readers import ROBOTS, in_pinocchio

import aerobat_description as description
from aerobat_description.bars import bar_bodies, bar_body, linkage_bars
from aerobat_description.morphology import Morphology
from aerobat_description.morphology_tables import Body
from aerobat_pin.aerobat import closed_model, closed_state, load_aerobat
from aerobat_pin.observers import euler_angles

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
