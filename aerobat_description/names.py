"""Check the names of links and joints: tools reject a robot in which a name occurs twice."""

from __future__ import annotations

from collections.abc import Sequence

from aerobat_description.reading import require

# Links and joints of every robot, and Pinocchio's names for the world and for the joint of the free base.
FRAMES = ("force_point", "linkage_J1", "linkage_J8")
WING = ("proximal", "distal", "shoulder", "elbow", *FRAMES, *(f"{frame}_fixed" for frame in FRAMES))
LONGEST_ROBOT_NAME = 100  # bytes: files are named after a robot, and no file system takes names above 255 bytes
BUILT_IN = {"universe", "root_joint", "base_link", *(f"{side}_{name}" for side in ("left", "right") for name in WING)}


def check_name(name: str, key: str) -> None:
    """Raise MorphologyError unless a name can be used for files, links and joints.

    Args:
        name: the name.
        key: dotted key of the name in the morphology, for the message.
    """
    plain = 0 < len(name.encode()) <= LONGEST_ROBOT_NAME and all(letter.isalnum() or letter in "_-" for letter in name)
    require(plain, key, repr(name), f"letters, digits, _ and - only, {LONGEST_ROBOT_NAME} at most")


def check_frames(names: Sequence[str], table: str) -> None:
    """Raise MorphologyError if adding frames with these names, and their fixed joints, would repeat a name.

    Args:
        names: names of the frames.
        table: name of the morphology's table that contains them, for the message.
    """
    taken = set(BUILT_IN)
    for i, name in enumerate(names):
        own = {name, f"{name}_fixed"}
        rule = "another link, joint or frame has this name or that of its joint; each needs a name of its own"
        require(not own & taken, f"{table}[{i}].name", repr(name), rule)
        taken |= own
