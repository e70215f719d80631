"""One robot everywhere: Pinocchio, yourdfpy and MuJoCo read the committed files alike, and other tools as well."""

import os
import re
import shutil
import subprocess

# Crocoddyl's and PlaCo's wheels want other releases of Pinocchio than this project: `make tools` tries them.
import sys
import tomllib
from functools import cache
from os.path import join
from pathlib import Path
from xml.etree import ElementTree as ET

import mujoco
import numpy as np
import pinocchio as pin
import pytest
import yourdfpy
from support.commands import aerobat
from support.readers import PACKAGE, ROBOTS, URDF, in_mujoco, in_pinocchio, in_yourdfpy, plain
from support.tools import need

import aerobat_description as description
from aerobat_description.meshes import parts
from aerobat_description.morphology import Morphology
from aerobat_pin.aerobat import JOINTS, load_aerobat

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


ANGLES = {"left_shoulder": 0.3, "left_elbow": -0.8, "right_shoulder": -0.2, "right_elbow": 0.5}  # [rad]
MASS = 31.3e-3 + 2.0 * (1.70505e-3 + 3.71107e-3)  # [kg], Flappy_v8.xml: body, proximal and distal wing
VISIBLE_PARTS = Path(description.URDF_PATH).read_text().count("<mesh ")


def force_point(shoulder: float = 0.0, elbow: float = 0.0) -> np.ndarray:
    """Return the left force point from the body's COM [m]: Aerobat_MuJoCo's parameter.py, Flappy_v8.xml."""
    twenty, fifteen = np.radians([20.0, 15.0])
    to_shoulder = np.array([7.5, 22.0 * np.cos(twenty), 22.0 * np.sin(twenty)])
    to_elbow = np.array([0.0, 50.0 - 6.0 * np.sin(fifteen), 6.0 * np.cos(fifteen)])
    to_point = np.array([(-0.409 + 8.003) / 2.0, 52.524, -4.401])
    return 1e-3 * (to_shoulder + lift(shoulder) @ (to_elbow + lift(elbow) @ to_point))


def lift(angle: float) -> np.ndarray:
    """Return the rotation about x."""
    return np.array([[1, 0, 0], [0, np.cos(angle), -np.sin(angle)], [0, np.sin(angle), np.cos(angle)]])


def assert_is_aerobat(model: pin.Model) -> None:
    """Mass, size, joint names, and the left force point with bent wings, in a floating Pinocchio model."""
    assert pin.computeTotalMass(model) == pytest.approx(MASS, rel=1e-12, abs=0)
    assert (model.nq, model.nv) == (11, 10)
    assert set(model.names) == {"universe", "root_joint", *JOINTS}
    data, q = model.createData(), pin.neutral(model)
    for joint, angle in ANGLES.items():
        q[model.joints[model.getJointId(joint)].idx_q] = angle
    pin.framesForwardKinematics(model, data, q)
    place = data.oMf[model.getFrameId("left_force_point")]
    np.testing.assert_allclose(place.translation, force_point(0.3, -0.8), atol=1e-15, rtol=0)
    np.testing.assert_allclose(place.rotation, lift(0.3 - 0.8), atol=1e-15, rtol=0)


class Loader:
    """A loader as example-robot-data has them: a subclass names folder, files, base and posture, and makes a robot."""

    path = "aerobat_description"
    urdf_filename = "aerobat.urdf"
    srdf_filename = "aerobat.srdf"
    free_flyer = True
    ref_posture = "neutral"

    def __init__(self) -> None:
        root = pin.JointModelFreeFlyer() if self.free_flyer else None
        folder, packages = join(description.REPOSITORY_PATH, self.path), [description.REPOSITORY_PATH]
        self.robot = pin.RobotWrapper.BuildFromURDF(join(folder, "urdf", self.urdf_filename), packages, root)
        srdf = join(folder, "srdf", self.srdf_filename)
        pin.loadReferenceConfigurations(self.robot.model, srdf)
        self.robot.q0 = self.robot.model.referenceConfigurations[self.ref_posture]
        self.robot.collision_model.addAllCollisionPairs()
        self.pairs = len(self.robot.collision_model.collisionPairs)
        pin.removeCollisionPairs(self.robot.model, self.robot.collision_model, srdf)


@pytest.mark.parametrize("name", description.MORPHOLOGIES)
def test_a_loader_shaped_like_example_robot_datas_loads_every_morphology(name: str) -> None:
    """A subclass a robot, as there: folders `urdf`, `srdf`, posture and pairs; all visible parts, boxes on links."""
    files = {"urdf_filename": f"{name}.urdf", "srdf_filename": f"{name}.srdf"}
    loader = type("AerobatLoader", (Loader,), files)()
    assert set(loader.robot.model.names) == {"universe", "root_joint", *JOINTS}
    assert np.array_equal(loader.robot.q0, pin.neutral(loader.robot.model))
    assert loader.pairs > 0
    assert len(loader.robot.collision_model.collisionPairs) == 0
    if name == "aerobat":
        assert_is_aerobat(loader.robot.model)
        assert len(loader.robot.visual_model.geometryObjects) == VISIBLE_PARTS
        assert len(loader.robot.collision_model.geometryObjects) == 5


@pytest.fixture
def named_for_robot_descriptions(monkeypatch: pytest.MonkeyPatch) -> str:
    """Put our module where robot_descriptions' loaders import a robot by name; nothing is fetched."""
    need("robot_descriptions")
    monkeypatch.setitem(sys.modules, "robot_descriptions.aerobat_description", description)
    return "aerobat_description"


def test_robot_descriptions_loads_it_in_pinocchio(named_for_robot_descriptions: str) -> None:
    """Its loader hands Pinocchio our constants as they are."""
    from robot_descriptions.loaders.pinocchio import load_robot_description

    robot = load_robot_description(named_for_robot_descriptions, root_joint=pin.JointModelFreeFlyer())
    assert_is_aerobat(robot.model)
    assert len(robot.visual_model.geometryObjects) == VISIBLE_PARTS


def test_robot_descriptions_loads_it_in_yourdfpy(named_for_robot_descriptions: str) -> None:
    """Its loader passes the package's folder as mesh folder; the meshes still arrive."""
    from robot_descriptions.loaders.yourdfpy import load_robot_description

    tree = load_robot_description(named_for_robot_descriptions)
    assert sum(link.inertial.mass for link in tree.robot.links) == pytest.approx(MASS, rel=1e-12, abs=0)
    assert set(tree.actuated_joint_names) == set(JOINTS)
    tree.update_cfg(ANGLES)
    place = tree.get_transform("left_force_point", "base_link")
    np.testing.assert_allclose(place[:3, 3], force_point(0.3, -0.8), atol=1e-15, rtol=0)
    assert len(tree.scene.geometry) == VISIBLE_PARTS


def test_robot_descriptions_loads_it_in_mujoco(named_for_robot_descriptions: str) -> None:
    """Its loader takes `MJCF_PATH`: the closed linkage with motor and sites; a variant lies in the same folder."""
    from robot_descriptions.loaders.mujoco import load_robot_description

    model = load_robot_description(named_for_robot_descriptions)
    assert model.body_mass.sum() == pytest.approx(MASS, rel=1e-12, abs=0)
    assert (model.nq, model.nu, model.njnt) == (7 + 14, 1, 1 + 14)
    assert {model.joint(i).name for i in range(model.njnt)} > set(JOINTS)
    assert model.nmesh == VISIBLE_PARTS + 10
    data = mujoco.MjData(model)
    for joint, angle in ANGLES.items():
        data.joint(joint).qpos[0] = angle
    mujoco.mj_kinematics(model, data)
    np.testing.assert_allclose(data.site("left_force_point").xpos, force_point(0.3, -0.8), atol=1e-12, rtol=0)
    variants = (load_robot_description(named_for_robot_descriptions, variant=one) for one in description.MORPHOLOGIES)
    assert [one.body_mass.sum() for one in variants] == pytest.approx([0.0421, 0.0921, 0.020], abs=5e-5)


def test_it_is_ready_for_robot_descriptions() -> None:
    """Names and kinds of its modules, and an entry of its table, with the licence that lies here."""
    need("robot_descriptions")
    from robot_descriptions._descriptions import Description, Format

    package = Path(description.PACKAGE_PATH)
    entry = Description(
        formats={Format.URDF, Format.SRDF, Format.MJCF},
        tags={"flying"},
        robot="Aerobat",
        maker="Northeastern University",
        dof=7,
        license_spdx="BSD-2-Clause",
        license_file="aerobat_description/LICENSE",
    )
    assert entry.has_urdf
    assert entry.has_mjcf
    assert entry.has_srdf
    licence = (package / "LICENSE").read_text()
    assert licence == Path(description.REPOSITORY_PATH, "LICENSE").read_text()
    assert licence.startswith("BSD 2-Clause License")
    assert ET.parse(package / "package.xml").findtext("license") == entry.license_spdx


@pytest.mark.parametrize("name", description.MORPHOLOGIES)
def test_names_suit_every_tool(name: str) -> None:
    """No visual is named like a link, every inertia has its origin, and files need nothing from outside the package."""
    root = ET.parse(Path(description.PACKAGE_PATH, "urdf", f"{name}.urdf")).getroot()
    links = {link.get("name") for link in root.findall("link")}
    assert links.isdisjoint({visual.get("name") for visual in root.iter("visual")})
    assert all(inertial.find("origin") is not None for inertial in root.iter("inertial"))
    meshes = {mesh.get("filename") for mesh in root.iter("mesh")}
    assert all(mesh.startswith("package://aerobat_description/meshes/") for mesh in meshes)
    assert all(Path(description.MESHES_PATH, mesh.rpartition("/")[2]).is_file() for mesh in meshes)
    twin = ET.parse(Path(description.PACKAGE_PATH, "mjcf", f"{name}.xml")).getroot()
    files = [mesh.get("file") for mesh in twin.iter("mesh")]
    assert all(Path(description.PACKAGE_PATH, "mjcf", "meshes", file).is_file() for file in files)


@pytest.fixture
def mine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Give a folder with a morphology file of somebody's own, and stand elsewhere."""
    folder = tmp_path / "lab"
    folder.mkdir()
    (folder / "my_robot.toml").write_text(
        'extends = "aerobat_guard"\nname = "mine"\n[scale]\nspan = 1.1\n[body]\nmass = 0.09\n'
    )
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    return folder


def read_everywhere(file: Path, dirs: list[str]) -> list[tuple[float, int]]:
    """Return mass [kg] and number of meshes in Pinocchio, MuJoCo and yourdfpy."""
    model, _, visual = pin.buildModelsFromUrdf(str(file), package_dirs=dirs, root_joint=pin.JointModelFreeFlyer())
    assert all(item.geometry.num_tris > 0 for item in visual.geometryObjects)
    twin, tree = mujoco.MjModel.from_xml_path(str(file)), yourdfpy.URDF.load(str(file))
    in_yourdfpy = sum(link.inertial.mass for link in tree.robot.links), len(tree.scene.geometry)
    return [(pin.computeTotalMass(model), visual.ngeoms), (twin.body_mass.sum(), twin.nmesh), in_yourdfpy]


@pytest.mark.parametrize("meshes", ["package", "relative", "absolute"])
def test_a_robot_of_ones_own_loads_from_another_folder(meshes: str, mine: Path) -> None:
    """Same mass and all visible parts in each tool; Pinocchio needs package folders unless paths are absolute."""
    target = mine / "x.urdf"
    done = aerobat("urdf", str(mine / "my_robot.toml"), "--meshes", meshes, "-o", str(target), cwd=Path.cwd())
    assert done.returncode == 0, done.stderr
    dirs = {"package": [str(mine.parent)], "relative": [str(mine)], "absolute": []}[meshes]
    robot = load_aerobat(mine / "my_robot.toml")
    assert read_everywhere(target, dirs) == [(pytest.approx(robot.mass, rel=1e-12), robot.visual_model.ngeoms)] * 3
    assert os.listdir() == []


def test_a_shipped_robot_is_printed_as_it_was_committed(tmp_path: Path) -> None:
    """`aerobat urdf` is the committed file; with absolute paths it loads from anywhere."""
    assert aerobat("urdf", cwd=tmp_path).stdout == Path(description.URDF_PATH).read_text()
    printed = aerobat("urdf", "aerobat_light", "--meshes", "absolute", cwd=tmp_path).stdout
    (tmp_path / "light.urdf").write_text(printed)
    light = load_aerobat("aerobat_light")
    expected = (pytest.approx(0.020, rel=1e-12), light.visual_model.ngeoms)
    assert read_everywhere(tmp_path / "light.urdf", []) == [expected] * 3


def test_poses_and_linkage_lie_beside_the_robot_and_leave_the_morphology_alone(mine: Path) -> None:
    """A URDF named like the morphology beside it: the linkage goes to a folder, and finds its meshes from there."""
    own = (mine / "my_robot.toml").read_text()
    done = aerobat("urdf", str(mine / "my_robot.toml"), "-o", str(mine / "my_robot.urdf"), cwd=mine)
    assert done.returncode == 0, done.stderr
    assert (mine / "my_robot.toml").read_text() == own
    model = pin.buildModelFromUrdf(str(mine / "my_robot.urdf"), pin.JointModelFreeFlyer())
    pin.loadReferenceConfigurations(model, str(mine / "my_robot.srdf"))
    poses = load_aerobat(mine / "my_robot.toml").model.referenceConfigurations
    assert {str(item.key()) for item in model.referenceConfigurations} == {str(item.key()) for item in poses}
    bars = tomllib.loads((mine / "linkage" / "my_robot.toml").read_text())["bars"]
    assert [bar["name"] for bar in bars] == [f"L{i}" for i in range(1, 8)]
    assert all((mine / bar[f"{side}_mesh"]).is_file() for bar in bars for side in ("left", "right"))


def test_force_overwrites_and_another_robots_meshes_are_not_overwritten_without_it(mine: Path) -> None:
    """Every file that would be replaced counts, not the URDF alone."""
    aerobat("urdf", "aerobat", "-o", str(mine / "a.urdf"), cwd=mine)
    again = aerobat("urdf", "aerobat", "-o", str(mine / "b.urdf"), cwd=mine)
    assert again.returncode == 2
    assert "exists; --force" in again.stderr
    assert not (mine / "b.urdf").exists()
    assert aerobat("urdf", "aerobat", "-o", str(mine / "b.urdf"), "--force", cwd=mine).returncode == 0


PROJECT = tomllib.loads((Path(__file__).resolve().parents[2] / "pyproject.toml").read_text())["project"]
CMAKE = shutil.which("cmake")
# What ament_package() does, as far as a package of data sees it: install the manifest, leave a mark in the index.
AMENT = """
macro(ament_package)
  install(FILES package.xml DESTINATION share/${PROJECT_NAME})
  file(WRITE ${CMAKE_CURRENT_BINARY_DIR}/mark "")
  install(FILES ${CMAKE_CURRENT_BINARY_DIR}/mark
    DESTINATION share/ament_index/resource_index/packages RENAME ${PROJECT_NAME})
endmacro()
"""


def visible_parts(urdf: str | Path) -> int:
    """Count the meshes that Pinocchio finds without being told any folder."""
    model = pin.buildModelFromUrdf(str(urdf), pin.JointModelFreeFlyer())
    return int(pin.buildGeomFromUrdf(model, str(urdf), pin.GeometryType.VISUAL).ngeoms)


def test_the_manifest_is_of_format_3_and_agrees_with_the_project() -> None:
    """REP 149: name, version, description, maintainer with an address and licence; built by ament_cmake."""
    package = ET.parse(PACKAGE / "package.xml").getroot()
    assert (package.tag, package.get("format")) == ("package", "3")
    required = {"name", "version", "description", "maintainer", "license"}
    assert required <= {element.tag for element in package}
    assert package.findtext("name") == description.__name__
    assert package.findtext("version") == PROJECT["version"]
    assert package.findtext("license") == PROJECT["license"]
    assert package.find("maintainer").text == PROJECT["authors"][0]["name"]
    assert re.fullmatch(r"[\w.]+@[\w.]+\.[a-z]{2,}", package.find("maintainer").get("email"))
    assert package.findtext("buildtool_depend") == package.findtext("export/build_type") == "ament_cmake"


def test_whoever_looks_in_ros_package_path_finds_the_meshes(monkeypatch: pytest.MonkeyPatch) -> None:
    """ROS's variable names the folder that holds the package's folder."""
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    monkeypatch.setenv("ROS_PACKAGE_PATH", description.REPOSITORY_PATH)
    assert visible_parts(description.URDF_PATH) == VISIBLE_PARTS


@pytest.mark.skipif(CMAKE is None, reason="no CMake on this machine: install it, e.g. `apt-get install cmake`")
@pytest.mark.parametrize("ament", [True, False], ids=["ament", "plain"])
def test_cmake_installs_all_data_where_ros_looks(ament: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With ament_cmake (a stand-in of it) and without; then Pinocchio finds the meshes through AMENT_PREFIX_PATH."""
    build, prefix, stand_in = tmp_path / "build", tmp_path / "prefix", tmp_path / "ament"
    stand_in.mkdir()
    if ament:
        (stand_in / "ament_cmakeConfig.cmake").write_text(AMENT)
    found = f"-Dament_cmake_DIR={stand_in}" if ament else "-DCMAKE_DISABLE_FIND_PACKAGE_ament_cmake=ON"
    for command in (
        [CMAKE, "-S", PACKAGE, "-B", build, f"-DCMAKE_INSTALL_PREFIX={prefix}", found],
        [CMAKE, "--install", build],
    ):
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=600)
        assert done.returncode == 0, done.stderr
        assert "warning" not in (done.stdout + done.stderr).lower()
    share = prefix / "share" / "aerobat_description"
    data = {name: PACKAGE / name for name in ("LICENSE", "package.xml")}
    for folder in ("linkage", "meshes", "mjcf", "morphologies", "srdf", "urdf"):
        data |= {str(file.relative_to(PACKAGE)): file for file in (PACKAGE / folder).rglob("*") if file.is_file()}
    assert {str(file.relative_to(share)) for file in share.rglob("*") if file.is_file()} == set(data)
    assert all((share / name).read_bytes() == file.read_bytes() for name, file in data.items())
    assert (prefix / "share/ament_index/resource_index/packages/aerobat_description").exists() == ament
    monkeypatch.delenv("ROS_PACKAGE_PATH", raising=False)
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(prefix))
    assert visible_parts(share / "urdf" / "aerobat.urdf") == VISIBLE_PARTS
