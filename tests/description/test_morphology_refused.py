"""Robots whose parts do not fit each other are refused on load, by key, value and rule."""

from __future__ import annotations

import math
from typing import Any
from xml.etree import ElementTree as ET

import pytest
from support.readers import URDF

from aerobat_description.morphology import Morphology
from aerobat_description.reading import BUILT_IN, MorphologyError
from aerobat_pin.robot.aerobat import load_aerobat

EDGES = {"proximal_leading_edge": [0.0635, 0.07, 0.0765], "proximal_trailing_edge": [-0.0956, -0.1, -0.111]}


def thruster(name: str) -> dict[str, Any]:
    """Return a thruster of a name."""
    return {"name": name, "position": [0.1, 0.0, 0.0], "direction": [0.0, 0.0, 1.0], "thrust": 0.1}


def test_the_names_that_are_taken_are_those_of_the_tree() -> None:
    """Links and joints of the committed URDF, and the two that Pinocchio adds to its model."""
    root = ET.parse(URDF["aerobat"]).getroot()
    tree = {str(one.get("name")) for kind in ("link", "joint") for one in root.findall(kind)}
    model = load_aerobat().model
    assert tree | set(model.names) | {frame.name for frame in model.frames} == BUILT_IN


@pytest.mark.parametrize("name", sorted(BUILT_IN))
def test_a_thruster_does_not_take_the_name_of_anything_else(name: str) -> None:
    """Any link, joint or frame of the robot; two thrusters; and a thruster and another one's joint."""
    rule = "another link, joint or frame has this name"
    with pytest.raises(MorphologyError, match=rf"thrusters\[0\]\.name = '{name}': {rule}"):
        Morphology.load("aerobat", {"thrusters": [thruster(name)]})


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (("a", "a"), r"thrusters\[1\]\.name = 'a': another link"),
        (("a", "b", "a_fixed"), r"thrusters\[2\]\.name = 'a_fixed': another link"),
        (("a_fixed", "a"), r"thrusters\[1\]\.name = 'a': another link"),
        (("",), r"thrusters\[0\]\.name = '': letters, digits, _ and - only"),
        (("a b",), r"thrusters\[0\]\.name = 'a b': letters"),
    ],
)
def test_thrusters_have_plain_names_of_their_own(names: tuple[str, ...], message: str) -> None:
    """Their fixed joints are named too."""
    with pytest.raises(MorphologyError, match=message):
        Morphology.load("aerobat", {"thrusters": [thruster(name) for name in names]})
    load_aerobat("aerobat", {"thrusters": [thruster("a"), thruster("b")]})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"wing": {"proximal_stations": [0, 0.1]}},
            r"wing\.proximal_stations = \(0\.0, 0\.1\): the last one is at the elbow",
        ),
        (
            {"wing": {"proximal_stations": [0, 0.046]}},
            r"wing\.proximal_stations = .*, 0\.04879 m .*, to 5 %",
        ),
        ({"wing": {"proximal_leading_edge": [0.06, 0.0765, 0.08]}}, r"wing\.proximal_stations = .*: .* same length"),
        (
            {"wing": {"distal_leading_edge": [0.2, 0.0807, 0.118, 0.101]}},
            r"wing\.distal_leading_edge = \(0\.2, .*\): it starts where the proximal one ends, at 0\.0765 m",
        ),
        (
            {"wing": {"proximal_trailing_edge": [-0.0956, -0.112]}},
            r"wing\.distal_trailing_edge = .*: it starts where the proximal one ends, at -0\.112 m",
        ),
        ({"wing": {"minimum_chord": 3.0}}, r"wing\.minimum_chord = 3\.0: the wing's largest chord is 0\.1957 m"),
        ({"scale": {"chord": 0.1}}, r"wing\.minimum_chord = 0\.025: the wing's largest chord is 0\.01957 m"),
        (
            {"wing": {"force_point": [0.0, -0.01, 0.0]}},
            r"wing\.force_point = .* x is -0\.115 to",
        ),
        ({"wing": {"force_point": [0.0, 0.14, 0.0]}}, r"wing\.force_point = .*: .* y 0 to 0\.132 m"),
        ({"wing": {"force_point": [0.12, 0.1, 0.0]}}, r"wing\.force_point = .*: .* to 0\.118 m"),
        ({"wing": {"force_point": [0.0, 0.1, 0.07]}}, r"wing\.force_point = .*: .* z is within half of that"),
        ({"wing": {"offset_x": 1.0}}, r"wing\.offset_x = 1\.0: it is not larger than the span, 0\.403 m"),
        (
            {"guard": {"radius": [0.1, 0.3], "centre": 0.0, "tube": 0.3}},
            r"guard\.tube = 0\.3: it is smaller than the ring's half axes, 0\.1 m at least",
        ),
    ],
)
def test_parts_that_do_not_fit_are_refused_by_key_value_and_rule(changes: dict[str, Any], message: str) -> None:
    """Planform against linkage and itself, force point, wing and guard."""
    with pytest.raises(MorphologyError, match=message):
        Morphology.load("aerobat", changes)


def test_what_just_fits_is_a_robot() -> None:
    """Values at their bounds; the chord at most the largest one, the force point on a corner of the panel."""
    wing = Morphology.load("aerobat").wing
    at = (min(wing.distal_trailing_edge), wing.distal_stations[-1], 0.0)
    made = Morphology.load("aerobat", {"wing": {"minimum_chord": 0.195, "force_point": at, "offset_x": -0.4}})
    assert made.force_point == at
    Morphology.load("aerobat", {"wing": {"proximal_stations": [0.0, 0.047]}})


def test_the_proximal_stations_follow_the_elbow_unless_they_are_said() -> None:
    """A humerus 1.2 times as long carries a panel stretched alike, whose middle stays in the middle."""
    robot = Morphology.load("aerobat", {"wing": {"proximal_stations": [0.0, 0.03, 0.05], **EDGES}})
    longer = {"linkage": {"L3a": 1.2 * robot.linkage.L3a}}
    made = robot.with_changes(longer)
    stretch = math.hypot(*made.elbow) / math.hypot(*robot.elbow)
    assert stretch > 1.15
    assert made.wing.proximal_stations == pytest.approx([0.0, 0.03 * stretch, 0.05 * stretch], rel=1e-14)
    own = {**longer, "wing": {"proximal_stations": [0.0, 0.04, 0.059]}}
    assert robot.with_changes(own).wing.proximal_stations == (0.0, 0.04, 0.059)
    with pytest.raises(MorphologyError, match=r"wing\.proximal_stations = .*: the last one is at the elbow"):
        robot.with_changes({**longer, "wing": {"proximal_stations": [0.0, 0.03, 0.05]}})
