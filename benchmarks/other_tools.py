"""Try the robot's files, and MCAP files, in other people's tools, each in an environment of its own, and write tables.

    make tools                                          # all; ARGS="--only drake viser" for some
    python benchmarks/other_tools.py --only mujoco

Each tool of the robot runs its block of aerobat_description/README.md as it stands, then, where there is one, its check
in benchmarks/tools/, which compares it with Pinocchio. The one for MCAP files, of docs/recordings.md, has a check
alone, which compares what is read with what was written. Environments are kept in `.venv-tools/`.
"""

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from importlib import metadata
from pathlib import Path
from typing import NamedTuple

from support.pages import ROOT, fill, measured, table

CHECKS = ROOT / "benchmarks" / "tools"
PLACES = ROOT / ".venv-tools"


class Tool(NamedTuple):
    """A tool: title of its block, what pip installs (nothing: it stands beside our Pinocchio), and its trap."""

    title: str
    packages: str
    check: str
    trap: str


TOOLS = (
    Tool(
        "Pinocchio", "", "", "joints are ordered by name: use `idx_q`; `package_dirs` wants the parent of this folder"
    ),
    Tool("pink", "", "", "its tasks know the tree alone: the linkage is in `closed_model`"),
    Tool("MuJoCo", "", "check_mujoco.py", "URDF: add the free joint yourself; MJCF: has one, and the linkage"),
    Tool("yourdfpy", "", "", "its import takes two seconds"),
    Tool("robot_descriptions", "", "", "put the module where its loaders look"),
    Tool("MJX", "mujoco-mjx", "", "the first call compiles for half a minute; set double precision"),
    Tool("Drake", "drake", "check_drake.py", "`AddPackageXml`; MJCF: drops sites, motor and the tie of the two cranks"),
    Tool("PyBullet", "pybullet numpy robot_descriptions", "", "without the flag it makes inertias up"),
    Tool("viser", "viser yourdfpy", "", "visuals named like their links would not move: ours are not"),
    Tool("rerun", "rerun-sdk", "", "finds packages through `ROS_PACKAGE_PATH`; shows the zero pose"),
    Tool("urchin", "urchin", "", "knows relative mesh paths only: write the URDF for it"),
    Tool("adam-robotics", "adam-robotics numpy", "", "frames without an inertia's origin crash it: ours have"),
    Tool(
        "three.js",
        "npm three urdf-loader jsdom",
        "check_three.mjs",
        "its y axis is up: turn the robot; serve the folder over HTTP",
    ),
    Tool(
        "Crocoddyl", "crocoddyl pin==4.0.0", "", "built for Pinocchio 4.0: beside 4.1 it reads wrong memory; no loops"
    ),
    Tool("PlaCo", "placo", "", "wants Pinocchio 3.8; asks `ROS_PACKAGE_PATH`; adds the free base itself"),
)


MCAP_TOOLS = (
    Tool(
        "Foxglove",
        "npm @foxglove/schemas @mcap/core @foxglove/rosmsg @foxglove/rosmsg2-serialization",
        "check_foxglove.mjs",
        "these are the libraries that its window reads by",
    ),
)


SUITES = (  # page of the table, what writes the reference of the checks, tools that read the same files
    ("aerobat_description/README.md", "reference.py", TOOLS),
    ("docs/recordings.md", "mcap_reference.py", MCAP_TOOLS),
)


def slug(title: str) -> str:
    """Return a title as a folder, or the anchor of its heading, has it."""
    return re.sub(r"[^a-z0-9_-]", "", title.lower().replace(" ", "-"))


def run(*words: str | Path, cwd: Path) -> str:
    """Run a program that sees this repository's packages, and return what it prints; it must succeed."""
    paths = f"{ROOT}{os.pathsep}{ROOT / 'tests'}"
    environment = {**os.environ, "PYTHONPATH": paths, "PIP_DISABLE_PIP_VERSION_CHECK": "1"}
    command = [str(word) for word in words]
    done = subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        said = [line for line in done.stderr.splitlines() if line.strip()]
        raise RuntimeError(said[-1] if said else f"it ended with {done.returncode}, without a word")
    return done.stdout


def blocks(page: Path) -> dict[str, str]:
    """Return title -> code of the Python blocks of a page's sections."""
    return dict(re.findall(r"^### ([^\n]*)\n(?:(?!^##).)*?```python\n(.*?)```", page.read_text(), flags=re.M | re.S))


def prepared(tool: Tool) -> tuple[Path, str]:
    """Return the program that runs a tool's check, and the tool's version; make its environment if there is none."""
    place = PLACES / slug(tool.title)
    names = tool.packages.split()
    if not names:
        name = {"Pinocchio": "pin", "pink": "pin-pink"}.get(tool.title, tool.title.lower())
        return Path(sys.executable), metadata.version(name)
    if names[0] == "npm":
        package = place / "node_modules" / names[2] / "package.json"
        if not package.exists():
            place.mkdir(parents=True, exist_ok=True)
            run("npm", "install", "--silent", "--prefix", place, *names[1:], cwd=place)
        return Path("node"), json.loads(package.read_text())["version"]
    python = place / "bin" / "python"
    if not python.exists():
        run(sys.executable, "-m", "venv", place, cwd=ROOT)
        run(python, "-m", "pip", "install", "--quiet", *names, cwd=ROOT)
    asked = f"from importlib import metadata; print(metadata.version({names[0]!r}))"
    return python, run(python, "-c", asked, cwd=ROOT).strip()


def tried(tool: Tool, page: Path, reference: Path) -> tuple[bool, list[str]]:
    """Run a tool's block, if the page has any, and its check; return whether they succeed, and its row of the table."""
    version, found, code = "?", "its block runs", blocks(page)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        try:
            program, version = prepared(tool)
            if code and program.name != "node":
                run(program, "-c", code[tool.title], cwd=folder)
            if tool.check:
                check = CHECKS / tool.check
                if program.name == "node":  # which looks for packages beside the script
                    check = Path(shutil.copy(check, PLACES / slug(tool.title)))
                said = run(program, check, reference, page.parent, cwd=folder).splitlines()
                found = next(line for line in said if line.startswith("found: ")).removeprefix("found: ")
            good = True
        except (RuntimeError, OSError) as error:
            good, found = False, f"**fails**: {error}"
    title = f"[{tool.title}](#{slug(tool.title)})" if code else tool.title
    return good, [title, version, found, tool.trap]


def main() -> None:
    """Try tools, and write the tables of which all were tried; exit with an error if one fails."""
    parser = argparse.ArgumentParser(description="Try the robot's files, and MCAP files, in other people's tools.")
    parser.add_argument("--only", nargs="+", metavar="TOOL", help="try these, and print their rows")
    only = parser.parse_args().only
    bad = []
    for page, writer, tools in SUITES:
        chosen = tuple(tool for tool in tools if only is None or slug(tool.title) in map(slug, only))
        rows = []
        with tempfile.TemporaryDirectory() as name:
            reference = Path(name, "reference")
            if chosen:
                run(sys.executable, CHECKS / writer, reference, cwd=ROOT)
            for tool in chosen:
                good, row = tried(tool, ROOT / page, reference)
                rows.append(row)
                bad += [] if good else [tool.title]
                print(row, flush=True)
        if chosen == tools:
            when = f"Tried on {measured()}, Python {sys.version_info[0]}.{sys.version_info[1]}, by `make tools`:"
            laid_out = table("tool | version | what was found | trap", rows)
            fill(page, {"tools": f"{when}\n\n{laid_out}"})
    if bad:
        sys.exit(f"failed: {', '.join(bad)}")


if __name__ == "__main__":
    main()
