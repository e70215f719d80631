"""What a robot's file must be before Pinocchio reads it: URDF and MJCF, which may come from a stranger.

Pinocchio calls itself for each level of a file and for each link of a chain, skips numbers that it cannot read, and
takes a mass of NaN as it is. So the file is looked at first.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import unquote, urlsplit

import numpy as np

from aerobat_description import PACKAGE_PATH
from aerobat_pin.errors import DEEPEST_XML, LogError, foreign_file, foreign_xml
from aerobat_pin.numerics.pinocchio_models import IN_STEPS

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

LARGEST_ROBOT = 20_000_000  # bytes; the largest of `example-robot-data` has 0.2e6
MOST_BODIES = 1000
OUTERMOST = {"urdf": "robot", "mjcf": "mujoco"}
PLACES = ("link", "joint", "body", "geom", "material")  # elements by whose name a message says where it is
LARGEST_NUMBERS = {  # keys with numbers -> the largest; of lengths and angles, no robot has larger ones
    **dict.fromkeys(("xyz", "rpy", "size", "radius", "length", "scale", "pos", "euler", "axisangle", "fromto"), 1e6),
    **dict.fromkeys(("rgba", "value", "lower", "upper", "effort", "velocity", "mass", "density", "armature"), 1e30),
    **dict.fromkeys(("ixx", "ixy", "ixz", "iyy", "iyz", "izz", "diaginertia", "fullinertia", "ref"), 1e30),
    **dict.fromkeys(("axis", "quat", "quat_xyzw", "zaxis", "xyaxes", "offset", "multiplier"), 1e30),
}
URDF_ELEMENTS = (  # whose numbers are read; others may have keys that are called alike
    *("origin", "mass", "inertia", "axis", "limit", "mimic", "box", "sphere", "cylinder", "capsule", "mesh", "color"),
)
URDF_JOINTS = {"revolute", "continuous", "prismatic", "fixed", "floating", "planar"}
DIRECTION_KEYS = ("axis", "quat", "quat_xyzw", "zaxis")  # keys whose numbers are not all 0
ROUNDED_INERTIA = 1e-15  # of inertias that files round to less than 0 [kg m2]
INSIDE = (
    "a file in the folder of the robot's file, in a folder above it that has a package.xml, in such a package beside "
    "these, or in one of ROS_PACKAGE_PATH was expected"
)
NEVER_NEGATIVE = ("mass", "density", "ixx", "iyy", "izz", "diaginertia", "size", "radius", "length")


def checked_robot(path: Path, kind: str) -> Element:
    """Return the outermost element of a robot's file of a kind, `urdf` or `mjcf`, in which everything can be.

    Raises:
        LogError: depth, number of bodies, a number, a class or a file's place cannot be. It names the link and the key.
    """
    name = f"robot {path}"
    root = foreign_xml(path, name, OUTERMOST[kind], LARGEST_ROBOT)
    bodies = sum(element.tag in ("link", "body") for element in root.iter())
    if bodies > MOST_BODIES:
        raise LogError(f"{name}: {bodies} bodies: at most {MOST_BODIES} were expected")
    if kind == "urdf" and _deeper_than(root, DEEPEST_XML):
        raise LogError(f"{name}: more than {DEEPEST_XML} links in a row, or a closed chain")
    for joint in root.iterfind("joint") if kind == "urdf" else ():
        if (said := joint.get("type", "")) not in URDF_JOINTS:
            what = f"joint '{joint.get('name', '')}' is of a type that URDF does not have, '{said}'"
            raise LogError(f"{name}: {what}: joints of one angle or one length were expected. {IN_STEPS}")
    classes = {element.get("class") for element in root.iter("default")}
    for element, where in _with_places(root, ""):
        if element.tag.startswith("xacro.") or any("${" in text or "$(" in text for text in element.attrib.values()):
            tag = element.tag.replace(".", ":")
            raise LogError(f"{name}: {where}<{tag}>: left for xacro to replace; what `xacro FILE` writes was expected")
        for key, text in element.attrib.items():
            rule = _broken_rule(element, key, text, kind)
            if kind == "mjcf" and key in ("class", "childclass") and text not in classes:
                rule = f"no such class; there are {', '.join(sorted(filter(None, classes))) or 'none'}"
            if key in ("file", "filename") and _lies_outside(path, text):
                rule = INSIDE
            if rule:
                raise LogError(f'{name}: {where}<{element.tag} {key}="{text[:80]}">: {rule}')
        if kind == "mjcf" and element.tag in ("include", "attach", "replicate"):
            raise LogError(f"{name}: <{element.tag}>: Pinocchio leaves it out; a whole robot in one file was expected")
    return root


def _deeper_than(root: Element, most: int) -> bool:
    """Return whether a chain of a URDF has more than so many joints, one behind the other; also for a closed chain."""
    above: dict[str, str] = {}
    for joint in root.iterfind("joint"):
        parent, child = joint.find("parent"), joint.find("child")
        if parent is not None and child is not None:
            above[child.get("link", "")] = parent.get("link", "")
    links = set(above)
    for _ in range(most):
        links = {above[link] for link in links if link in above}
    return bool(links & above.keys())


def _with_places(element: Element, where: str) -> Iterator[tuple[Element, str]]:
    """Yield an element and all below it, each with the nearest link, joint or body, for messages."""
    if element.tag in PLACES and element.get("name") is not None:
        where = f"{element.tag} '{element.get('name', '')[:80]}': "
    if not (element.tag == "joint" and element.get("type") == "fixed"):
        yield element, where
    for inner in element:
        if inner.tag != "gazebo" and not (inner.tag == "axis" and element.get("type") == "fixed"):  # not used
            yield from _with_places(inner, where)


def _broken_rule(element: Element, key: str, text: str, kind: str) -> str | None:
    """Return the rule that a number of a robot breaks; None if it breaks none, or is no number."""
    if key not in LARGEST_NUMBERS or (kind == "urdf" and element.tag not in URDF_ELEMENTS):
        return None
    try:
        numbers = np.array(text.split(), float)
    except ValueError:
        numbers = np.array([np.nan])
    if not numbers.size or not bool(np.all(np.abs(numbers) <= LARGEST_NUMBERS[key])):
        return f"numbers up to {LARGEST_NUMBERS[key]:g} were expected"
    if (key in DIRECTION_KEYS or (element.tag == "axis" and key == "xyz")) and not np.any(numbers):
        return "more than 0 was expected"
    if key == "axisangle" and not np.any(numbers[:3]):
        return "an axis longer than 0 was expected"
    if (key in NEVER_NEGATIVE or element.tag == "mass") and np.any(numbers < -ROUNDED_INERTIA):
        return "0 or more was expected"
    if key == "fullinertia" and np.any(numbers[:3] < 0.0):
        return "0 or more was expected on the diagonal"
    return None


def _lies_outside(robot: Path, named: str) -> bool:
    """Return whether a robot names an existing file by its absolute path that is not in its packages."""
    path = Path(unquote(urlsplit(named).path)) if named.startswith("file://") else Path(named)
    return path.is_absolute() and os.path.exists(path) and not Packages(robot).contains(path)


class Packages:
    """The folders whose files a robot may name; they follow from the place of its own file."""

    def __init__(self, robot: Path) -> None:
        self._name = f"robot {robot}"
        place = Path(os.path.abspath(robot)).parent
        above = [*dict.fromkeys([place, *place.parents, *Path(os.path.realpath(robot)).parents])]
        self._folders = [place.parent if place.name == "urdf" else place]
        self._folders += [folder for folder in above if _is_package(folder)] + [Path(PACKAGE_PATH)]
        self._above = above
        self._ros = [Path(folder) for folder in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if folder]

    def contains(self, path: Path, roots: list[Path] | None = None) -> bool:
        """Return whether a file is in one of these folders, or of `roots`, after all links."""
        place = Path(os.path.realpath(path))
        roots = self._folders + self._ros if roots is None else roots
        return any(place.is_relative_to(os.path.realpath(root)) for root in roots)

    def file(self, name: str, folder: Path, check: Callable[[Path, Packages], None]) -> Path:
        """Return the path of a file that the robot names; LogError if it lies outside, or `check` of it raises one.

        Args:
            name: `package://` or `file://` address, absolute path, or path relative to `folder`.
            folder: folder of the file that contains the name.
            check: called with the path and this object.
        """
        path, roots = Path(folder, name), self._folders + self._ros
        if name.startswith(("package://", "model://")):
            package, _, tail = name.partition("://")[2].partition("/")
            beside = [base / package for base in self._above]
            roots = [root for root in beside if root in self._folders or _is_package(root)]
            roots += [base / package for base in self._ros]
            path = next((root / tail for root in roots if os.path.isfile(root / tail)), Path(folder, tail))
        elif name.startswith("file://"):
            path = Path(unquote(urlsplit(name).path))
        if not self.contains(path, roots):
            raise LogError(f"{self._name} names {name}: {INSIDE}")
        place = foreign_file(os.path.realpath(path), f"{self._name} names {name}")
        try:
            check(place, self)
        except LogError as error:
            raise LogError(f"{self._name} names {name}: {error}") from error
        return place


def _is_package(folder: Path) -> bool:
    return os.path.isfile(folder / "package.xml")
