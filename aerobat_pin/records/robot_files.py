"""Build the robot that a map names: from a URDF or MJCF file, by its name, or one rigid body by numbers."""

from __future__ import annotations

import os
import re
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pinocchio as pin

from aerobat_description.reading import did_you_mean
from aerobat_pin.errors import LogError
from aerobat_pin.numerics import IN_STEPS, checked_robot, guarded, read_robot
from aerobat_pin.observers import has_free_base
from aerobat_pin.records.robot_tables import RobotTable
from aerobat_pin.records.robots import Mimic, PlainRobot

MIMIC_NUMBERS = ("multiplier", "1"), ("offset", "0")  # of a URDF, and what they are when left out
KINDS_OF_JOINTS = {  # what Pinocchio calls a joint of more coordinates than one -> what it is, what to do
    "JointModelSpherical": ("is a ball joint", IN_STEPS),
    "JointModelPlanar": ("is planar", IN_STEPS),
    "JointModelComposite": ("stands for several joints of one body", IN_STEPS),
    "JointModelFreeFlyer": ("floats freely", "Leave what floats beside the base out of the file"),
}
ROBOT_HEAD = 65536  # bytes of a robot's file in which its outermost element begins
MOST_JOINTS = 150  # that move: TIAGo with two arms and hands has 101; what is expected of 200 takes 1 GB
FOLDER = Path("share", "example-robot-data", "robots")  # in an environment, or in the folder where cmeel installs
FREE = {  # robots whose base moves: name -> file
    "a1": "a1_description/urdf/a1.urdf",
    "alex": "alex_description/urdf/alex_nub_hands.urdf",
    "anymal": "anymal_b_simple_description/robots/anymal.urdf",
    "anymal_c": "anymal_c_simple_description/urdf/anymal.urdf",
    "anymal_kinova": "anymal_b_simple_description/robots/anymal-kinova.urdf",
    "b1": "b1_description/urdf/b1.urdf",
    "b1_z1": "b1_description/urdf/b1-z1.urdf",
    "bolt": "bolt_description/robots/bolt.urdf",
    "borinot": "borinot_description/urdf/borinot_flying_arm_2.urdf",
    "centauro": "centauro_description/urdf/centauro.urdf",
    "g1": "g1_description/urdf/g1_29dof_rev_1_0.urdf",
    "go1": "go1_description/urdf/go1.urdf",
    "go2": "go2_description/urdf/go2.urdf",
    "hector": "hector_description/robots/quadrotor_base.urdf",
    "hextilt": "hextilt_description/urdf/hextilt_flying_arm_5.urdf",
    "hyq": "hyq_description/robots/hyq_no_sensors.urdf",
    "icub": "icub_description/robots/icub.urdf",
    "icub_reduced": "icub_description/robots/icub_reduced.urdf",
    "iris": "iris_description/robots/iris_simple.urdf",
    "laikago": "laikago_description/urdf/laikago.urdf",
    "romeo": "romeo_description/urdf/romeo.urdf",
    "simple_humanoid": "simple_humanoid_description/urdf/simple_humanoid.urdf",
    "solo8": "solo_description/robots/solo.urdf",
    "solo12": "solo_description/robots/solo12.urdf",
    "talos": "talos_data/robots/talos_reduced.urdf",
    "talos_full": "talos_data/robots/talos_full_v2.urdf",
}
FIXED = {  # robots that stand on the ground
    "allegro_left_hand": "allegro_hand_description/urdf/allegro_left_hand.urdf",
    "allegro_right_hand": "allegro_hand_description/urdf/allegro_right_hand.urdf",
    "baxter": "baxter_description/urdf/baxter.urdf",
    "double_pendulum": "double_pendulum_description/urdf/double_pendulum.urdf",
    "finger_edu": "finger_edu_description/robots/finger_edu.urdf",
    "kinova": "kinova_description/robots/kinova.urdf",
    "panda": "panda_description/urdf/panda.urdf",
    "so100": "so_arm_description/urdf/so100.urdf",
    "so101": "so_arm_description/urdf/so101.urdf",
    "talos_arm": "talos_data/robots/talos_left_arm.urdf",
    "tiago": "tiago_description/robots/tiago.urdf",
    "tiago_dual": "tiago_description/robots/tiago_dual.urdf",
    "tiago_pro": "tiago_pro_description/robots/tiago_pro.urdf",
    "ur3": "ur_description/urdf/ur3_robot.urdf",
    "ur5": "ur_description/urdf/ur5_robot.urdf",
    "ur10": "ur_description/urdf/ur10_robot.urdf",
    "xarm7": "xarm_description/urdf/xarm7.urdf",
    "z1": "z1_description/urdf/z1.urdf",
}


@guarded()
def load_robot(name: str) -> PlainRobot:
    """Load one of the robots of the optional package `example-robot-data`, such as `solo12`; needs no network.

    Its base is free if the robot walks or flies.

    Raises:
        LogError: there is no robot of that name, which lists those that there are, or the package is not installed.
    """
    return _built(RobotTable(name=name), Path())


def robot_of_map(table: RobotTable, folder: Path) -> PlainRobot:
    """Build the model of a map's robot; relative paths begin at `folder`.

    Raises LogError if not exactly one robot is given, its file cannot be read, or a joint has several coordinates.
    """
    robot = _built(table, folder)
    model, title = robot.model, robot.title
    names = ", ".join(frame.name for frame in model.frames.tolist()[1:41])
    for frame in (*table.points, *table.wrenches):
        if not model.existFrame(frame):
            raise LogError(f"map: no frame '{frame}' (robot.points) in robot {title}; it has {names}")
    if not (table.points or table.wrenches) and "points" not in table.model_fields_set:
        raise LogError(f"map: robot.points: where may something push? Name frames of {title}: {names}")
    return robot


def urdf_of(table: RobotTable, folder: Path) -> Path | None:
    """Return the URDF of a map's robot; None if it is given otherwise."""
    if table.name is not None:
        return named_robot(table.name)[0]
    return None if table.urdf is None else folder / table.urdf


def option_of_robot(said: str) -> dict[str, str]:
    """Return what a map says of a robot that an option gives: a URDF or MJCF file, or a name (without / and ending)."""
    if not os.path.isfile(said):
        named = Path(said).name == said and not Path(said).suffix
        return {"name": said} if named else {"urdf": os.path.abspath(said)}
    with open(said, "rb") as file:
        outermost = re.search(rb"<(mujoco|robot)\b", file.read(ROBOT_HEAD))
    return {"mjcf" if outermost and outermost[1] == b"mujoco" else "urdf": os.path.abspath(said)}


def _built(table: RobotTable, folder: Path) -> PlainRobot:
    given = [name for name in ("body", "urdf", "mjcf", "name") if getattr(table, name) is not None]
    if len(given) != 1:
        raise LogError(
            f"map: robot has {' and '.join(given) or 'none'}: exactly one of body = {{...}}, urdf = FILE, mjcf = FILE, "
            "name = ROBOT was expected"
        )
    free = table.root != "fixed"
    mimics, unread = dict[str, Mimic](), tuple[str, ...]()
    if table.body is not None:
        model, title = _one_body(table), f"one body of {1e3 * table.body.mass:g} g"
        if not free:
            raise LogError('map: robot.root = "fixed": one rigid body cannot move then; "free_flyer" was expected')
    else:
        path = urdf_of(table, folder) or folder / (table.mjcf or "")
        if table.name is not None and table.root is None:
            free = named_robot(table.name)[1]
        model, title = model_of_file(path, mjcf=table.mjcf is not None, free=free), table.name or path.stem
        free, (mimics, unread) = has_free_base(model), _beside_the_model(path, mjcf=table.mjcf is not None)
    down = np.array(table.down)
    if not np.any(down) or (free and np.any(down != (0.0, 0.0, -1.0))):
        why = "the attitude of a free base says how it stands" if free else "a direction was expected"
        raise LogError(f"map: robot.down = {list(table.down)}: {why}")
    if free and table.root == "fixed":
        raise LogError(
            f"map: robot.root = \"fixed\", but by its file robot {title} floats (joint '{model.names[1]}'): a file "
            'without that joint, or "free_flyer" was expected'
        )
    model.gravity.linear = table.gravity * down / np.linalg.norm(down)
    joints = tuple(model.names.tolist()[2 if free else 1 :])
    if len(joints) > MOST_JOINTS:
        raise LogError(f"robot {title}: {len(joints)} joints: at most {MOST_JOINTS} were expected")
    for name in joints:
        joint = model.joints[model.getJointId(name)]
        if (joint.nq, joint.nv) != (1, 1):
            what, instead = KINDS_OF_JOINTS.get(joint.shortname(), (f"has {joint.nq} coordinates", IN_STEPS))
            expected = "joints of one angle or one length were expected"
            raise LogError(f"robot {title}: joint '{name}' {what}: {expected}. {instead}")
    return PlainRobot(model, free, joints, title, mimics=mimics, unread=unread)


def _beside_the_model(path: Path, *, mjcf: bool) -> tuple[dict[str, Mimic], tuple[str, ...]]:
    """Return which joints of a URDF follow another one, and what an MJCF file says that the model does not have."""
    root = checked_robot(path, "mjcf" if mjcf else "urdf")
    if not mjcf:
        pairs = ((joint.get("name"), joint.find("mimic")) for joint in root.iter("joint"))
        return {name: _mimic(mimic) for name, mimic in pairs if name and mimic is not None}, ()
    said = {f"{element.tag} {key}" for element in root.iter() for key in {"gravcomp", "stiffness"} & {*element.keys()}}
    said |= {"equality"} if next(root.iter("equality"), None) is not None else set()
    said |= {"option gravity"} if any(option.get("gravity") for option in root.iter("option")) else set()
    return {}, tuple(sorted(said))


def _mimic(element: ElementTree.Element) -> Mimic:
    return Mimic(element.get("joint", ""), *(float(element.get(key, default)) for key, default in MIMIC_NUMBERS))


def _one_body(table: RobotTable) -> pin.Model:
    body = table.body
    assert body is not None
    model = pin.Model()
    model.name = "body"
    root = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root_joint")
    model.addJointFrame(root)
    inertia = pin.Inertia(body.mass, np.array(body.centre), np.diag(body.inertia))
    model.appendBodyToJoint(root, inertia, pin.SE3.Identity())
    model.addFrame(pin.Frame("body", root, 0, pin.SE3.Identity(), pin.FrameType.BODY))
    centre = pin.SE3(np.eye(3), np.array(body.centre))
    model.addFrame(pin.Frame("centre", root, 0, centre, pin.FrameType.OP_FRAME))
    return model


def model_of_file(path: Path, *, mjcf: bool, free: bool) -> pin.Model:
    """Read a URDF or MJCF file, for a robot on a free base or one that stands.

    Raises LogError if it is none, or no robot can have its values: what Pinocchio prints about it is the message.
    """
    root = checked_robot(path, "mjcf" if mjcf else "urdf")
    text = "" if mjcf else with_angles(root)

    def read(*root: pin.JointModel) -> pin.Model:
        if not mjcf:
            return pin.buildModelFromXML(text, *root)
        return pin.buildModelFromMJCFAndRootJoint(str(path), *root) if root else pin.buildModelFromMJCF(str(path))

    model = read_robot(path, lambda: read(*([pin.JointModelFreeFlyer()] if free else [])))
    if model.njoints > 2 and all(joint.shortname() == "JointModelFreeFlyer" for joint in model.joints.tolist()[1:3]):
        model = read_robot(path, read)  # the file has a free joint of its own
    if model.nv == 0:
        raise LogError(f"robot {path}: no joint of it moves")
    if not pin.computeTotalMass(model) > 0.0:
        raise LogError(f"robot {path}: nothing that moves has a mass: links with an inertia were expected")
    return model


def with_angles(root: ElementTree.Element) -> str:
    """Return a URDF whose continuous joints are revolute: one angle, as logs have it, in place of cosine and sine."""
    for joint in root.iter("joint"):
        if joint.get("type") == "continuous":
            joint.set("type", "revolute")
            limit = joint.find("limit")
            limit = ElementTree.SubElement(joint, "limit") if limit is None else limit
            for key, value in (("lower", "-1e9"), ("upper", "1e9"), ("effort", "1e9"), ("velocity", "1e9")):
                if limit.get(key) is None or key in ("lower", "upper"):
                    limit.set(key, value)
    return ElementTree.tostring(root, encoding="unicode")


def named_robot(name: str) -> tuple[Path, bool]:
    """Return the file of a robot, and whether its base moves.

    Raises LogError if no robot has that name, or if `example-robot-data`, which has their files, is not installed.
    """
    known = FREE | FIXED
    if name not in known:
        raise LogError(f"robot '{name}': {did_you_mean(name, sorted(known), 'there are')}; any other by its file")
    for folder in (*(Path(entry, "cmeel.prefix") for entry in sys.path), Path(sys.prefix)):
        if (file := folder / FOLDER / known[name]).is_file():
            return file, name in FREE
    raise LogError(f"robot '{name}': its file is not installed: pip install 'aerobat-pinocchio[robots]'")
