"""The robot in Pinocchio: models, frames, wing and prescribed-joint dynamics, made from description and linkage."""

from aerobat_pin.robot.aerobat import CRANK_START, FORCE_POINTS, JOINTS, Aerobat, load_aerobat, load_morphology
from aerobat_pin.robot.closed_model import closed_model, closed_settings, closed_state
from aerobat_pin.robot.closing_bars import place_bars, visual_model_with_bars
from aerobat_pin.robot.frames import euler_angles, external_forces, joint_wrench, rotations, world_velocity
from aerobat_pin.robot.link_kernels import chain, climb
from aerobat_pin.robot.link_tree import Tree, tree_of
from aerobat_pin.robot.load import believed_robot, load_robot
from aerobat_pin.robot.prescribed_joints import BASE_SIZE, joint_table, prescribed_joint_dynamics
from aerobat_pin.robot.wing import LINKS, Wing

__all__ = [
    "BASE_SIZE",
    "CRANK_START",
    "FORCE_POINTS",
    "JOINTS",
    "LINKS",
    "Aerobat",
    "Tree",
    "Wing",
    "believed_robot",
    "chain",
    "climb",
    "closed_model",
    "closed_settings",
    "closed_state",
    "euler_angles",
    "external_forces",
    "joint_table",
    "joint_wrench",
    "load_aerobat",
    "load_morphology",
    "load_robot",
    "place_bars",
    "prescribed_joint_dynamics",
    "rotations",
    "tree_of",
    "visual_model_with_bars",
    "world_velocity",
]
