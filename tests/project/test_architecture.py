"""The map of the house: every path and every name that docs/architecture.md shows is there."""

# `room/file.py:name` or `:Class.method` are in that file; of `room/*.py` one exists, `room/<name>.py` is to come.

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
HOUSES = (ROOT, ROOT / "aerobat_pin")
PAGE = ROOT / "docs" / "architecture.md"
FOLDERS = sorted({path.name for house in HOUSES for path in house.iterdir() if path.is_dir()} - {".git"})
ELSEWHERE = ("runs/", "http", "../")  # what runs write, and links, which tests/project/test_house.py follows
NAME = r"[A-Za-z_][\w.]*"


def mentions(page: str) -> set[str]:
    """Return all paths of a page, with the name behind: in backticks with a slash or `.py`, else by our folders."""
    alone = {token for token in re.findall(r"`([^`\s]+)`", page) if "/" in token or re.search(r"\.py(:|$)", token)}
    ours = rf"(?:{'|'.join(map(re.escape, FOLDERS))})/[\w./*-]*|(?:[\w-]+/)*\w+\.py\b"
    anywhere = {match[0].rstrip(".") for match in re.finditer(rf"(?<![\w./<>-])(?:{ours})(?::{NAME})?", page)}
    links = set(re.findall(r"\]\(([^)]+)\)", page))
    return {word for word in (alone | anywhere) - links if not word.startswith(ELSEWHERE) and "<" not in word}


def defined(body: list[ast.stmt], prefix: str = "") -> Iterator[str]:
    """Yield the names that statements define, those of classes dotted."""
    for node in body:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            yield prefix + node.name
        if isinstance(node, ast.ClassDef):
            yield from defined(node.body, f"{prefix}{node.name}.")
        if isinstance(node, ast.Assign | ast.AnnAssign):
            for target in node.targets if isinstance(node, ast.Assign) else [node.target]:
                yield from (prefix + part.id for part in ast.walk(target) if isinstance(part, ast.Name))


@cache
def names_in(file: Path) -> frozenset[str]:
    """Return the names that a file defines; only Python has any."""
    return frozenset(defined(ast.parse(file.read_text(encoding="utf-8")).body) if file.suffix == ".py" else ())


def missing(page: str) -> list[str]:
    wrong = []
    for word in sorted(mentions(page)):
        path, _, name = word.partition(":")
        found = [file for house in HOUSES for file in house.glob(path)]
        if not found:
            wrong.append(f"{word}: no such path")
        elif name and not any(name in names_in(file) for file in found):
            wrong.append(f"{word}: the file defines no such name")
    return wrong


def test_every_path_and_name_of_the_map_is_there() -> None:
    """At least sixty of them, and every room."""
    page = PAGE.read_text(encoding="utf-8")
    assert missing(page) == []
    assert len(mentions(page)) >= 60
    rooms = {path.parent.name for path in (ROOT / "aerobat_pin").glob("*/__init__.py")}
    assert rooms <= {part for word in mentions(page) for part in word.split("/")}


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("`flight/simulate.py:simulate`", None),
        ("`flight/plant/plant.py:Plant.fly`", None),
        ("`errors/`, `observers/`, `docs/design/`, `aerobat_description/morphologies/aerobat.toml`", None),
        ("speeds in m/s, and/or `runs/paper`", None),
        ("`visualization/figures/*.py`, a new `observers/<name>.py`", None),
        ("`visualization/figures/*.toml`", "visualization/figures/*.toml: no such path"),
        ("`flight/simulate.py:simulated`", "flight/simulate.py:simulated: the file defines no such name"),
        ("`flight/plant/plant.py:Plant.swim`", "flight/plant/plant.py:Plant.swim: the file defines no such name"),
        ("`flight/simulation.py`", "flight/simulation.py: no such path"),
        ("`kitchen/`", "kitchen/: no such path"),
        ("open tests/flight/test_swim.py there", "tests/flight/test_swim.py: no such path"),
        ("```\nscenario.toml -> flight/swim.py:stroke\n```", "flight/swim.py:stroke: no such path"),
    ],
)
def test_a_map_that_is_wrong_is_found_out(text: str, complaint: str | None) -> None:
    assert missing(text) == ([] if complaint is None else [complaint])
