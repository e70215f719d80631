"""Other people's tools take the description as it is: same mass, joints and places, worked out here by hand."""

# Crocoddyl's and PlaCo's wheels want other releases of Pinocchio than this project: `make tools` tries them.

import sys
from os.path import join
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pinocchio as pin
import pytest
from support.tools import need

import aerobat_description as description

JOINTS = {"left_shoulder", "left_elbow", "right_shoulder", "right_elbow"}
ANGLES = {"left_shoulder": 0.3, "left_elbow": -0.8, "right_shoulder": -0.2, "right_elbow": 0.5}  # [rad]
MASS = 31.3e-3 + 2.0 * (1.70505e-3 + 3.71107e-3)  # [kg], Flappy_v8.xml: body, proximal and distal wing
UP = np.array([0.0, 0.0, 0.02])  # [m], where the force point is sent
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


def test_pink_moves_the_force_point_where_it_is_told() -> None:
    """Inverse kinematics with one frame task, 2 cm up, solved by a quadratic program at each of 30 steps."""
    need("pink")
    need("quadprog")
    import pink

    robot = pin.RobotWrapper.BuildFromURDF(description.URDF_PATH, description.PACKAGE_DIRS, pin.JointModelFreeFlyer())
    configuration = pink.Configuration(robot.model, robot.data, robot.q0)
    assert_is_aerobat(configuration.model)
    target = configuration.get_transform_frame_to_world("left_force_point")
    np.testing.assert_allclose(target.translation, force_point(), atol=1e-15, rtol=0)
    target.translation = target.translation + UP
    task = pink.FrameTask("left_force_point", position_cost=1.0, orientation_cost=0.0)
    task.set_target(target)
    for _ in range(30):
        velocity = pink.solve_ik(configuration, [task], 0.1, solver="quadprog")
        configuration.integrate_inplace(velocity, 0.1)
    reached = configuration.get_transform_frame_to_world("left_force_point").translation
    np.testing.assert_allclose(reached, force_point() + UP, atol=1e-6, rtol=0)


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
    need("yourdfpy")
    from robot_descriptions.loaders.yourdfpy import load_robot_description

    tree = load_robot_description(named_for_robot_descriptions)
    assert sum(link.inertial.mass for link in tree.robot.links) == pytest.approx(MASS, rel=1e-12, abs=0)
    assert set(tree.actuated_joint_names) == JOINTS
    tree.update_cfg(ANGLES)
    place = tree.get_transform("left_force_point", "base_link")
    np.testing.assert_allclose(place[:3, 3], force_point(0.3, -0.8), atol=1e-15, rtol=0)
    assert len(tree.scene.geometry) == VISIBLE_PARTS


def test_robot_descriptions_loads_it_in_mujoco(named_for_robot_descriptions: str) -> None:
    """Its loader takes `MJCF_PATH`: the closed linkage on a free base, with its motor, and sites for the frames."""
    need("mujoco")
    import mujoco
    from robot_descriptions.loaders.mujoco import load_robot_description

    model = load_robot_description(named_for_robot_descriptions)
    assert model.body_mass.sum() == pytest.approx(MASS, rel=1e-12, abs=0)
    assert (model.nq, model.nu, model.njnt) == (7 + 14, 1, 1 + 14)
    assert {model.joint(i).name for i in range(model.njnt)} > JOINTS
    assert model.nmesh == VISIBLE_PARTS + 10
    data = mujoco.MjData(model)
    for joint, angle in ANGLES.items():
        data.joint(joint).qpos[0] = angle
    mujoco.mj_kinematics(model, data)
    np.testing.assert_allclose(data.site("left_force_point").xpos, force_point(0.3, -0.8), atol=1e-12, rtol=0)


def test_robot_descriptions_finds_the_other_morphologies_as_variants(named_for_robot_descriptions: str) -> None:
    """Its MuJoCo loader replaces the file's name by the variant's, in the same folder."""
    need("mujoco")
    from robot_descriptions.loaders.mujoco import load_robot_description

    masses = [
        load_robot_description(named_for_robot_descriptions, variant=name).body_mass.sum()
        for name in description.MORPHOLOGIES
    ]
    assert masses == pytest.approx([0.0421, 0.0921, 0.020], abs=5e-5)


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
