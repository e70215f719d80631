"""One robot everywhere: Pinocchio, yourdfpy and MuJoCo read the committed files of every morphology alike."""

import re
from functools import cache

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from support.readers import PACKAGE, ROBOTS, URDF, in_mujoco, in_pinocchio, in_yourdfpy, plain

import aerobat_description as description
from aerobat_description.meshes import parts
from aerobat_description.morphology import Morphology
from aerobat_pin.aerobat import JOINTS

STATES = 20
FRAMES = {"base_link"} | {
    f"{side}_{frame}"
    for side in ("left", "right")
    for frame in ("proximal", "distal", "force_point", "linkage_J1", "linkage_J8")
}


@cache
def state(seed: int) -> tuple[dict[str, float], np.ndarray, np.ndarray]:
    """Draw joint angles [rad] between the stops, a base placement (7), and v (10) in Pinocchio's order and axes."""
    rng = np.random.default_rng([7, seed])
    quaternion = rng.standard_normal(4)
    placement = np.concatenate([rng.uniform(-1.0, 1.0, 3), quaternion / np.linalg.norm(quaternion)])
    angles = dict(zip(JOINTS, rng.uniform(-1.5, 0.65, 4), strict=True))
    return angles, placement, rng.standard_normal(10) * np.array([3.0] * 3 + [2.0] * 3 + [10.0] * 4)


def in_pinocchio_axes(model: pin.Model, seed: int) -> tuple[np.ndarray, np.ndarray]:
    angles, placement, v = state(seed)
    q = pin.neutral(model)
    q[:7] = placement
    for joint, angle in angles.items():
        q[model.joints[model.getJointId(joint)].idx_q] = angle
    return q, v


def in_mujoco_axes(model: pin.Model, twin: mujoco.MjModel, seed: int) -> tuple[mujoco.MjData, np.ndarray]:
    """Return MuJoCo's data at a drawn state, and P with v = P v_mj: quaternion w first, linear velocity in world."""
    angles, placement, v = state(seed)
    data = mujoco.MjData(twin)
    data.qpos[:7] = placement[[0, 1, 2, 6, 3, 4, 5]]
    P = np.zeros((10, 10))
    P[:3, :3] = pin.Quaternion(placement[3:]).matrix().T
    P[3:6, 3:6] = np.eye(3)
    for joint, angle in angles.items():
        data.joint(joint).qpos[0] = angle
        P[model.joints[model.getJointId(joint)].idx_v, twin.joint(joint).dofadr[0]] = 1.0
    data.qvel[:] = np.linalg.solve(P, v)
    mujoco.mj_forward(twin, data)
    return data, P


@ROBOTS
def test_every_reader_finds_the_same_mass(name: str) -> None:
    """Masses [kg] of the published models: 42.1 g, with guard 92.1 g, light 20 g; also link by link."""
    model, twin, tree = in_pinocchio(name), in_mujoco(name), in_yourdfpy(name)
    data = plain(name)
    panels = [(side, panel) for side in ("left", "right") for panel in ("proximal", "distal")]
    of_links = {"base_link": data["body"]["mass"]} | {f"{side}_{one}": data[one]["mass"] for side, one in panels}
    mass = sum(of_links.values())
    assert mass == pytest.approx({"aerobat": 42.1, "aerobat_guard": 92.1, "aerobat_light": 20.0}[name] / 1e3, abs=5e-5)
    assert Morphology.load(name).mass == pytest.approx(mass, rel=1e-12, abs=0)
    assert pin.computeTotalMass(model) == pytest.approx(mass, rel=1e-12, abs=0)
    assert twin.body_mass.sum() == pytest.approx(mass, rel=1e-12, abs=0)
    assert {link.name: link.inertial.mass for link in tree.robot.links if link.inertial.mass != 0.0} == of_links
    for link, expected in of_links.items():
        at = model.frames[model.getFrameId(link)].parentJoint
        assert model.inertias[at].mass == pytest.approx(expected, rel=1e-12, abs=0)
        assert twin.body(link).mass[0] == pytest.approx(expected, rel=1e-12, abs=0)


@ROBOTS
def test_every_reader_finds_the_same_degrees_of_freedom_and_limits(name: str) -> None:
    """A free base and four joints; stops, effort and velocity are the morphology's, exactly."""
    model, twin, tree = in_pinocchio(name), in_mujoco(name), in_yourdfpy(name)
    data = plain(name)["joints"]
    assert (model.nq, model.nv) == (twin.nq, twin.nv) == (11, 10)
    assert set(model.names) == {"universe", "root_joint", *JOINTS}
    hinges = np.flatnonzero(twin.jnt_type == mujoco.mjtJoint.mjJNT_HINGE)
    assert {twin.joint(int(i)).name for i in hinges} == set(JOINTS)
    assert set(tree.actuated_joint_names) == set(JOINTS)
    for joint in JOINTS:
        low, high = data[f"{joint.split('_')[1]}_limits"]
        index, rate = model.joints[model.getJointId(joint)].idx_q, model.joints[model.getJointId(joint)].idx_v
        assert (model.lowerPositionLimit[index], model.upperPositionLimit[index]) == (low, high)
        assert (model.upperEffortLimit[rate], model.upperVelocityLimit[rate]) == (data["effort"], data["velocity"])
        assert tuple(twin.joint(joint).range) == (low, high)
        limit = tree.joint_map[joint].limit
        assert (limit.lower, limit.upper, limit.effort, limit.velocity) == (low, high, data["effort"], data["velocity"])


@ROBOTS
def test_every_reader_finds_the_meshes(name: str) -> None:
    """All visible parts arrive, through package:// (Pinocchio, yourdfpy) and through the mujoco tag."""
    expected = set(parts(Morphology.load(name)))
    folders = description.PACKAGE_DIRS
    visual = pin.buildGeomFromUrdf(in_pinocchio(name), URDF[name], pin.GeometryType.VISUAL, package_dirs=folders)
    assert len(visual.geometryObjects) == len(expected)
    assert all(item.geometry.num_vertices > 4 for item in visual.geometryObjects)
    assert len(in_yourdfpy(name).scene.geometry) == len(expected)
    assert {in_mujoco(name).mesh(i).name for i in range(in_mujoco(name).nmesh)} == {f"{name}_{p}" for p in expected}


@ROBOTS
def test_every_reader_places_every_frame_alike(name: str) -> None:
    """Links, force points, linkage pivots and thrusters at random states, to 1e-12 (m, and entries of the rotation)."""
    model, twin, tree = in_pinocchio(name), in_mujoco(name), in_yourdfpy(name)
    assert set(tree.link_map) == FRAMES | {thruster["name"] for thruster in plain(name).get("thrusters", [])}
    data, apart = model.createData(), 0.0
    for seed in range(STATES):
        pin.framesForwardKinematics(model, data, in_pinocchio_axes(model, seed)[0])
        other, _ = in_mujoco_axes(model, twin, seed)
        tree.update_cfg(state(seed)[0])
        base = data.oMf[model.getFrameId("base_link")]
        for link in tree.link_map:
            placement = data.oMf[model.getFrameId(link)]
            body = other.body(link)
            apart = max(
                apart,
                np.max(np.abs(tree.get_transform(link, "base_link") - base.actInv(placement).homogeneous)),
                np.max(np.abs(body.xpos - placement.translation)),
                np.max(np.abs(body.xmat.reshape(3, 3) - placement.rotation)),
            )
    assert apart < 1e-12


@ROBOTS
def test_mujoco_and_pinocchio_agree_on_mass_matrix_and_bias(name: str) -> None:
    """Derivation: v = P v_mj with P = diag(R^T, 1, joints), so M_mj = P^T M P and b_mj = P^T (nle + M P' v_mj)."""
    # P' v_mj = (-omega x v, 0). MuJoCo adds no damping and no fluid. Relative to each entry's size over states: 1e-9.
    model, twin = in_pinocchio(name), in_mujoco(name)
    data, found, expected, unturned = model.createData(), [], [], []
    for seed in range(STATES):
        q, v = in_pinocchio_axes(model, seed)
        other, P = in_mujoco_axes(model, twin, seed)
        M = pin.crba(model, data, q).copy()
        nle = pin.nonLinearEffects(model, data, q, v).copy()
        turning = np.concatenate([-np.cross(v[3:6], v[:3]), np.zeros(7)])
        M_mj = np.empty((10, 10))
        for column, unit in enumerate(np.eye(10)):
            mujoco.mj_mulM(twin, other, M_mj[column], unit)  # a row, since M is symmetric
        congruent = P.T @ M @ P
        size = np.sqrt(np.outer(np.diag(congruent), np.diag(congruent)))
        np.testing.assert_allclose(M_mj / size, congruent / size, atol=1e-9, rtol=0)
        np.testing.assert_array_equal(other.qfrc_passive, 0.0)
        found.append(other.qfrc_bias.copy())
        expected.append(P.T @ (nle + M @ turning))
        unturned.append(P.T @ nle)
    size = np.max(np.abs(expected), axis=0)
    assert np.max(np.abs(np.subtract(found, expected)) / size) < 1e-9
    assert np.max(np.abs(np.subtract(found, unturned)) / size) > 1e-2


def test_no_description_file_names_a_place_on_a_machine() -> None:
    """Meshes are reached by package name; neither an absolute path, a drive nor a file URL stands in any file."""
    place = re.compile(rb"(?<![\w.:/])/(?:[\w.-]+/)+[\w.-]+\.(?:stl|dae|obj|urdf|srdf|toml)|file://|[A-Za-z]:\\")
    data = {".urdf", ".srdf", ".stl", ".toml", ".xml", ".txt", ".py"}
    files = [file for file in PACKAGE.rglob("*") if file.suffix in data]
    assert len(files) > 20
    assert [file.name for file in files if place.search(file.read_bytes())] == []
