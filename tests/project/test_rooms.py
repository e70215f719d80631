"""The rooms of `aerobat_pin`: each with one purpose and one door, every name one thing; and the map of the house."""

import ast
import functools
import importlib
import re
import tomllib
from collections import defaultdict
from collections.abc import Iterator

# `room/file.py:name` or `:Class.method` are in that file; of `room/*.py` one exists, `room/<name>.py` is to come.
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PIN, DESCRIPTION = ROOT / "aerobat_pin", ROOT / "aerobat_description"
ROOMS = sorted(path.parent for path in PIN.glob("*/__init__.py"))
MODULES = {
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
    for package in (PIN, DESCRIPTION)
    for path in sorted(package.rglob("*.py"))
}
SHARED = {"main": "where a program begins: `aerobat`, and `python -m aerobat_description.generate`"}


EXPORTED = {
    name: set(getattr(importlib.import_module(name), "__all__", ()))
    for name, path in MODULES.items()
    if path.name == "__init__.py"
}


@functools.cache
def trees() -> dict[str, ast.Module]:
    return {name: ast.parse(path.read_text(encoding="utf-8")) for name, path in MODULES.items()}


def imports(module: str) -> Iterator[tuple[str, str]]:
    """Yield what a module imports of ours, in functions too: the module, and the name of it or nothing."""
    for node in ast.walk(trees()[module]):
        if isinstance(node, ast.ImportFrom) and node.module:
            for name in node.names:
                inner = f"{node.module}.{name.name}"
                exported = name.name in EXPORTED.get(node.module, ())
                yield (inner, "") if inner in MODULES and not exported else (node.module, name.name)
        elif isinstance(node, ast.Import):
            yield from ((name.name, "") for name in node.names)


def definitions(tree: ast.Module) -> Iterator[str]:
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield node.name
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            for target in node.targets if isinstance(node, ast.Assign) else [node.target]:
                yield from (part.id for part in ast.walk(target) if isinstance(part, ast.Name))


def test_the_top_of_the_package_fits_on_a_screen() -> None:
    assert len([path for path in PIN.iterdir() if path.name != "__pycache__"]) <= 18


@pytest.mark.parametrize("room", ROOMS, ids=lambda room: room.name)
def test_a_room_says_in_one_sentence_what_it_is_for(room: Path) -> None:
    """The first paragraph of its door's docstring; how the door works may follow."""
    said = (ast.get_docstring(trees()[f"aerobat_pin.{room.name}"]) or "").split("\n\n")[0]
    assert said.endswith(".")
    assert re.findall(r"[.?!](?=\s)", said) == []


def test_no_file_is_long() -> None:
    lines = {name: len(path.read_text(encoding="utf-8").splitlines()) for name, path in MODULES.items()}
    assert {name: count for name, count in lines.items() if count > 330} == {}


def test_a_name_is_one_thing() -> None:
    """No function, class or constant is defined at the top of two modules; commands carry the names that users type."""
    places = defaultdict(list)
    for module, tree in trees().items():
        marks = {node: [ast.unparse(one) for one in getattr(node, "decorator_list", [])] for node in tree.body}
        kept = ast.Module([node for node in tree.body if not any("command" in mark for mark in marks[node])], [])
        for name in set(definitions(kept)) - set(SHARED):
            if not name.startswith("__"):  # Python's own: `__all__`, `__getattr__`
                places[name].append(module)
    assert {name: modules for name, modules in places.items() if len(modules) > 1} == {}


def test_no_modules_import_each_other_in_a_circle() -> None:
    """Found where nothing is left that imports nothing of the rest; a name of a door stands for where it is defined."""
    home = {name: module for module, tree in trees().items() for name in definitions(tree)}
    named = {module: [one for one in imports(module) if one[0] in MODULES] for module in MODULES}
    left = {module: {home.get(name, target) for target, name in found} - {module} for module, found in named.items()}
    assert sum(map(len, left.values())) > 500
    while free := [module for module, found in left.items() if not found & left.keys()]:
        for module in free:
            del left[module]
    assert not left, f"among these there is a circle: {sorted(left)}"


def test_rooms_are_entered_through_their_doors() -> None:
    """From another room: `from aerobat_pin.<room> import name`, a name that the room exports."""
    doors = {f"aerobat_pin.{room.name}" for room in ROOMS}
    wrong = []
    for module in MODULES:
        for target, name in imports(module):
            door = ".".join(target.split(".")[:2])
            if door in doors and not f"{module}.".startswith(f"{door}."):
                wrong += [f"{module}: {target} {name}"] if target != door or name not in {"", *EXPORTED[door]} else []
    assert wrong == []


def test_every_room_has_its_layer_in_the_import_contract() -> None:
    """At most fifteen layers; that no import points upward, not for types either, lint-imports checks."""
    layers = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"][0]["layers"]
    assert len(layers) <= 15
    assert {f"aerobat_pin.{room.name}" for room in ROOMS} <= {name for layer in layers for name in layer.split(" | ")}


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
