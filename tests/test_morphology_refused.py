"""Robots whose parts do not fit each other are refused on load, by key, value and rule."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pytest
from commands import aerobat
from readers import URDF

from aerobat_description.morphology import Morphology
from aerobat_description.names import TAKEN
from aerobat_description.reading import MorphologyError
from aerobat_pin.robot import load_aerobat


def thruster(name: str) -> dict[str, Any]:
    """Return a thruster of a name."""
    return {"name": name, "position": [0.1, 0.0, 0.0], "direction": [0.0, 0.0, 1.0], "thrust": 0.1}


def test_the_names_that_are_taken_are_those_of_the_tree() -> None:
    """Links and joints of the committed URDF, and the two that Pinocchio adds to its model."""
    root = ET.parse(URDF["aerobat"]).getroot()
    tree = {str(one.get("name")) for kind in ("link", "joint") for one in root.findall(kind)}
    model = load_aerobat().model
    assert tree | set(model.names) | {frame.name for frame in model.frames} == TAKEN


@pytest.mark.parametrize("name", sorted(TAKEN))
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


def test_a_robot_that_is_refused_costs_a_run_one_line_and_exit_code_2(tmp_path: Path) -> None:
    """With a thruster named like a force point."""
    text = 'extends = "aerobat"\nname = "twice"\n[[thrusters]]\nname = "left_force_point"\nposition = [0.1, 0, 0]\n'
    (tmp_path / "twice.toml").write_text(f"{text}direction = [0, 0, 1]\nthrust = 0.1\n")
    done = aerobat("run", "paper", "--set", "robot.morphology=twice.toml", cwd=tmp_path)
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    assert "thrusters[0].name = 'left_force_point': another link, joint or frame has this name" in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["twice.toml"]
