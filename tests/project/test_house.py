"""The project itself: rooms are in order, examples run, nothing points at somebody's machine, links lead somewhere."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tomllib
from collections import defaultdict
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path
from statistics import median

import pytest

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
PIN, DESCRIPTION = ROOT / "aerobat_pin", ROOT / "aerobat_description"
ROOMS = sorted(path.parent for path in PIN.glob("*/__init__.py"))
MODULES = {
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
    for package in (PIN, DESCRIPTION)
    for path in sorted(package.rglob("*.py"))
}
TREES = {name: ast.parse(path.read_text(encoding="utf-8")) for name, path in MODULES.items()}
SHARED = {"main": "where a program begins: `aerobat`, and `python -m aerobat_description.generate`"}
TEXT = {".py", ".toml", ".md", ".cff", ".urdf", ".srdf", ".cfg", ".yml", ""}


def text_files() -> list[Path]:
    """Return the project's own text files."""
    skipped = {"runs", "build", "dist", "__pycache__"}
    return [
        path
        for path in ROOT.rglob("*")
        if path.is_file()
        and path.suffix in TEXT
        and not any(part in skipped or part.endswith(".egg-info") for part in path.relative_to(ROOT).parts)
        and not (path.relative_to(ROOT).parts[0].startswith(".") and path.relative_to(ROOT).parts[0] != ".ci")
    ]


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_is_short_and_runs(example: Path, tmp_path: Path) -> None:
    """At most 80 lines, no output but what it prints."""
    assert len(example.read_text().splitlines()) <= 80
    done = subprocess.run([sys.executable, str(example)], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip()
    assert list(tmp_path.iterdir()) == []


def test_no_file_names_an_absolute_path() -> None:
    """Home folders and work folders belong to a machine, not to the project."""
    absolute = re.compile(r"(?<![\w.])/(?:home|root|Users|work|mnt|media)/\w")
    found = [f"{path.relative_to(ROOT)}" for path in text_files() if absolute.search(path.read_text(errors="ignore"))]
    assert found == []


def test_every_link_in_the_documents_leads_somewhere() -> None:
    """Relative links and pictures of README and docs exist."""
    missing = []
    for page in [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), ROOT / "aerobat_description" / "README.md"]:
        for target in re.findall(r"\]\(([^)#]+)", page.read_text()):
            if not target.startswith("http") and not (page.parent / target).exists():
                missing.append(f"{page.relative_to(ROOT)}: {target}")
    assert missing == []


def test_the_readme_leads_with_the_two_commands() -> None:
    """Whoever opens it sees `make demo` and `make test` first."""
    first_block = (ROOT / "README.md").read_text().split("```")[1]
    assert first_block.index("make demo") < first_block.index("make test")


def assigned(tree: ast.Module, name: str) -> list[ast.expr]:
    """Return what a module assigns to a name."""
    return [node.value for node in tree.body if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == name]


EXPORTED = {
    name: {entry for all_names in assigned(tree, "__all__") for entry in ast.literal_eval(all_names)}
    for name, tree in TREES.items()
}


def imports(module: str) -> Iterator[tuple[str, str]]:
    """Yield what a module imports of ours, in functions too: the module, and the name of it or nothing."""
    for node in ast.walk(TREES[module]):
        if isinstance(node, ast.ImportFrom) and node.module:
            for name in node.names:
                inner = f"{node.module}.{name.name}"
                exported = name.name in EXPORTED.get(node.module, ())
                yield (inner, "") if inner in MODULES and not exported else (node.module, name.name)
        elif isinstance(node, ast.Import):
            yield from ((name.name, "") for name in node.names)


def definitions(tree: ast.Module) -> Iterator[str]:
    """Yield the names that a module defines at its top."""
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield node.name
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            for target in node.targets if isinstance(node, ast.Assign) else [node.target]:
                yield from (part.id for part in ast.walk(target) if isinstance(part, ast.Name))


def is_command(node: ast.stmt) -> bool:
    """Return whether a statement defines a command of the command line, which has the name that a user types."""
    return isinstance(node, ast.FunctionDef) and any("command" in ast.unparse(mark) for mark in node.decorator_list)


def test_the_top_of_the_package_fits_on_a_screen() -> None:
    """At most sixteen entries."""
    assert len([path for path in PIN.iterdir() if path.name != "__pycache__"]) <= 16


@pytest.mark.parametrize("room", ROOMS, ids=lambda room: room.name)
def test_a_room_says_in_one_sentence_what_it_is_for(room: Path) -> None:
    """The docstring of its `__init__.py`; what else there is to say stands in its modules."""
    text = ast.get_docstring(TREES[f"aerobat_pin.{room.name}"]) or ""
    assert text.endswith(".")
    assert re.findall(r"[.?!](?=\s)|\n\n", text) == []


def test_no_file_is_long() -> None:
    """At most 330 lines; the median of `aerobat_pin` at most 120."""
    lines = {name: len(path.read_text(encoding="utf-8").splitlines()) for name, path in MODULES.items()}
    assert {name: count for name, count in lines.items() if count > 330} == {}
    assert median(count for name, count in lines.items() if name.startswith("aerobat_pin")) <= 120


def test_a_name_is_one_thing() -> None:
    """No function, class or constant is defined at the top of two modules; commands carry the names that users type."""
    places = defaultdict(list)
    for module, tree in TREES.items():
        kept = ast.Module([node for node in tree.body if not is_command(node)], [])
        for name in set(definitions(kept)) - set(SHARED):
            if not name.startswith("__"):  # Python's own: `__all__`, `__getattr__`
                places[name].append(module)
    assert {name: modules for name, modules in places.items() if len(modules) > 1} == {}


def test_rooms_are_entered_through_their_doors() -> None:
    """From another room: `from aerobat_pin.<room> import name`, a name that the room exports."""
    doors = {f"aerobat_pin.{room.name}" for room in ROOMS}
    wrong = []
    for module in TREES:
        for target, name in imports(module):
            door = ".".join(target.split(".")[:2])
            if door in doors and not f"{module}.".startswith(f"{door}."):
                wrong += [f"{module}: {target} {name}"] if target != door or name not in {"", *EXPORTED[door]} else []
    assert wrong == []


def test_no_module_imports_itself_by_a_detour() -> None:
    """No circle among the modules, imports within functions included."""
    TopologicalSorter({module: {target for target, _ in imports(module)} for module in TREES}).prepare()


def test_no_import_points_upward() -> None:
    """The contract of pyproject.toml: at most fourteen layers, every room in one of them, and all of it kept."""
    layers = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"][0]["layers"]
    assert len(layers) <= 14
    named = {name for layer in layers for name in layer.split(" | ")}
    assert {f"aerobat_pin.{room.name}" for room in ROOMS} <= named
    check = "from importlinter.cli import lint_imports; raise SystemExit(lint_imports(no_cache=True))"
    done = subprocess.run([sys.executable, "-c", check], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
