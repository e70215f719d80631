"""The page a stranger reads: its snippets run, its numbers are the files' numbers, its frames are the model's."""

import ast
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from matplotlib.image import imread
from support.readers import PACKAGE, ROBOTS, URDF
from support.tools import need

import aerobat_description as description

PAGE = (PACKAGE / "README.md").read_text(encoding="utf-8")
SECTIONS = dict(re.findall(r"^### (.*?)\n(.*?)(?=^###? |\Z)", PAGE, flags=re.M | re.S))
SNIPPETS = {title: code for title, text in SECTIONS.items() for code in re.findall(r"```python\n(.*?)```", text, re.S)}
OURS = {"aerobat_description", "pinocchio"}
UNITS = {
    **dict.fromkeys(("-", "rad", "kg m2", "m", "m2", "m/s", "rad/s", "N", "N m"), 1.0),
    **dict.fromkeys(("g", "mm"), 1e-3),
    "deg": np.pi / 180.0,
}


def rows(text: str, header: str) -> Iterator[list[str]]:
    """Yield the cells of the table whose header line starts with some words."""
    for line in text[text.index(f"| {header}") :].splitlines()[2:]:
        if not line.startswith("|"):
            return
        yield [cell.strip() for cell in line.strip("|").split("|")]


def quoted(cell: str) -> list[str]:
    return re.findall(r"`([^`]+)`", cell)


def numbers(value: Any) -> list[float]:
    """Return the numbers of a TOML value, in order; texts have none."""
    if isinstance(value, list):
        return [number for item in value for number in numbers(item)]
    return [] if isinstance(value, str) else [float(value)]


def own_numbers(name: str) -> dict[tuple[str, str], list[float]]:
    """Return section and key -> numbers of what a morphology's own file says; tables in a list follow each other."""
    found: dict[tuple[str, str], list[float]] = {}
    for section, tables in tomllib.loads((PACKAGE / "morphologies" / f"{name}.toml").read_text()).items():
        for table in [tables] if isinstance(tables, dict) else tables if isinstance(tables, list) else []:
            for key, value in table.items():
                found.setdefault((section, key), []).extend(numbers(value))
    return {where: values for where, values in found.items() if values}


@pytest.mark.parametrize("title", SNIPPETS)
def test_a_snippet_runs_as_it_stands(title: str, tmp_path: Path) -> None:
    """In a process of its own, from an empty folder; it prints something, complains of nothing and leaves nothing."""
    code = SNIPPETS[title]
    imports = [node for node in ast.walk(ast.parse(code)) if isinstance(node, ast.Import | ast.ImportFrom)]
    names = {name.name for node in imports if isinstance(node, ast.Import) for name in node.names}
    names |= {node.module or "" for node in imports if isinstance(node, ast.ImportFrom)}
    for tool in sorted({name.split(".")[0] for name in names} - OURS - sys.stdlib_module_names):
        need(tool)
    if "quadprog" in code:
        need("quadprog")
    command = [sys.executable, "-c", f"import sys; sys.path.insert(0, {description.REPOSITORY_PATH!r})\n{code}"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=600)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip()
    if "kg" in code:
        assert float(done.stdout.split()[0]) == pytest.approx(0.04213224, rel=1e-9)
    assert list(tmp_path.iterdir()) == []


def test_every_tool_that_is_promised_has_a_snippet_and_was_tried() -> None:
    """One python block each, except where the tool is no Python; `make tools` wrote when, and none of them failed."""
    tools = "Pinocchio RobotWrapper pink Crocoddyl PlaCo MuJoCo MJX yourdfpy robot_descriptions MeshCat Drake PyBullet"
    more = "viser rerun urchin adam-robotics"
    assert set(SNIPPETS) == {*tools.split(), *more.split(), "MuJoCo, closed linkage"}
    assert len(re.findall("```python", PAGE)) == len(SNIPPETS)
    assert "```js" in SECTIONS["three.js"]
    assert "colcon" in SECTIONS["ROS 2 and RViz"]
    table = PAGE[PAGE.index("<!-- tools") : PAGE.index("<!-- /tools")]
    assert re.search(r"Tried on 20\d\d-\d\d-\d\d, Python 3", table)
    found = {title: (version, result) for title, version, result, _ in rows(table, "tool | version")}
    titles = {re.match(r"\[(.*?)\]\(#[a-z_-]+\)", title)[1] for title in found}
    assert titles == set(SNIPPETS) - {"RobotWrapper", "MeshCat", "MuJoCo, closed linkage"} | {"three.js"}
    assert all(re.match(r"\d+\.\d", version) for version, _ in found.values())
    assert not [title for title, (_, result) in found.items() if "fails" in result]


@ROBOTS
def test_every_number_of_a_morphology_has_its_provenance(name: str) -> None:
    """Each key stands in one row with the file's value, a source of the list, and a grade."""
    expected, seen = own_numbers(name), []
    for keys, value, unit, source, _, grade in rows(SECTIONS[f"`{name}`"], "keys"):
        section, *names = quoted(keys)
        seen += [(section, key) for key in names]
        written = [float(number) * UNITS[unit] for number in value.split(",")]
        said = [number for key in names for number in expected[section, key]]
        assert written == pytest.approx(said, rel=1e-5, abs=0.0), keys
        assert source in {"[PAR]", "[V8]", "[GH]", "own"}, keys
        assert grade in {"A", "B", "C"}, keys
        assert (source == "own") == (grade == "C"), keys
    assert sorted(seen) == sorted(expected)


def test_the_frames_are_those_of_the_urdf() -> None:
    """Every link and joint of `aerobat_guard` once, with parent, place and axis; other robots have no further ones."""
    root = ET.parse(URDF["aerobat_guard"])
    joints = {joint.find("child").get("link"): joint for joint in root.findall("joint")}
    seen = []
    for link, joint, parent, place, _ in rows(PAGE, "link | joint"):
        (name,) = quoted(link)
        seen.append(name)
        if name == "base_link":
            continue
        said = joints[name]
        assert quoted(joint) == [said.get("name")]
        assert quoted(parent) == [said.find("parent").get("link")]
        origin = [float(number) for number in said.find("origin").get("xyz").split()]
        assert [float(number) * 1e-3 for number in place.split(",")] == pytest.approx(origin, abs=5e-8), name
        axis = said.find("axis")
        turns = {"1.0 0.0 0.0": "about +x", "-1.0 0.0 0.0": "about -x"}
        assert joint.partition(", ")[2] == ("" if axis is None else turns[axis.get("xyz")])
    assert sorted(seen) == sorted(link.get("name") for link in root.findall("link"))
    for name in URDF:
        assert {link.get("name") for link in ET.parse(URDF[name]).findall("link")} <= set(seen)


def test_the_reference_configurations_are_named_and_the_picture_of_the_frames_is_small() -> None:
    """Those of the SRDF, of all morphologies; that the picture names every kind of frame, its script checks."""
    text = PAGE[PAGE.index("The SRDF names") :].split("\n\n")[0]
    for name in description.MORPHOLOGIES:
        states = ET.parse(PACKAGE / "srdf" / f"{name}.srdf").findall("group_state")
        assert quoted(text) == [state.get("name") for state in states]
    assert (PACKAGE / "frames.png").stat().st_size < 100_000
    pixels = imread(PACKAGE / "frames.png")
    assert pixels.shape[1] > 1000
    assert pixels[..., :3].std() > 0.05
