"""The project itself: its front door and old names, examples run, no path of a machine, documents keep promises."""

import importlib
import re
import runpy
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.image import imread
from mutants import MUTANTS
from PIL import Image

import aerobat_pin
from aerobat_pin import load_aerobat, load_scenario, simulate
from aerobat_pin.aerobat import known_inputs

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text()
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
TEXT = {".py", ".toml", ".md", ".cff", ".urdf", ".srdf", ".cfg", ".yml", ""}


def text_files() -> list[Path]:
    skipped = {"runs", "build", "dist", "__pycache__"}
    tops = [top for top in ROOT.iterdir() if top.name == ".ci" or (top.is_dir() and not top.name.startswith("."))]
    return [
        path
        for path in [*ROOT.glob("[!.]*"), *(path for top in tops for path in top.rglob("*"))]
        if path.is_file()
        and path.suffix in TEXT
        and not any(part in skipped or part.endswith(".egg-info") for part in path.relative_to(ROOT).parts)
    ]


def test_every_mutant_can_still_be_made() -> None:
    """The lines that `make mutants` changes stand where it looks for them, and the tests that should notice, too."""
    for mutant in MUTANTS:
        assert (ROOT / "aerobat_pin" / mutant.file).read_text().count(mutant.text) == 1, mutant.name
        assert all((ROOT / word.partition("::")[0]).exists() for word in mutant.tests.split()), mutant.name


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_is_short_and_runs(example: Path, here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """At most 80 lines, no output but what it prints."""
    assert len(example.read_text().splitlines()) <= 80
    with np.printoptions():
        runpy.run_path(str(example), run_name="__main__")
    assert capsys.readouterr().out.strip()
    assert list(here.iterdir()) == []


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


def test_every_wall_stands_in_the_table_and_its_lines_are_counted() -> None:
    """What holds against strangers' files and sudden ends: each wall with its tests, and the page counts lines."""
    page = (ROOT / "docs" / "walls.md").read_text()
    walls = re.findall(r"^\| `([\w/]+\.py)`", page, re.MULTILINE)
    count = sum(len((ROOT / "aerobat_pin" / wall).read_text().splitlines()) for wall in walls)
    assert count <= 1500
    assert f"({count:,}, at most 1,500)" in page
    assert all((ROOT / test).is_file() for test in re.findall(r"`(tests/[\w/]+\.py)`", page))


def test_the_readme_leads_with_the_two_commands() -> None:
    """Whoever opens it sees `make demo` and `make test` first."""
    first_block = README.split("```")[1]
    assert first_block.index("make demo") < first_block.index("make test")


RECORDINGS = (ROOT / "docs" / "recordings.md").read_text()
NAMES = ("load_aerobat", "Aerobat", "load_scenario", "Scenario", "simulate", "run", "FlightLog")
DOORS = (
    "aerobat_pin",
    *sorted(f"aerobat_pin.{path.parent.name}" for path in (ROOT / "aerobat_pin").glob("*/__init__.pyi")),
)


@pytest.mark.parametrize("name", NAMES)
def test_a_name_of_the_front_door_is_its_rooms_own(name: str) -> None:
    """Listed, and the same object as behind the door of its room."""
    assert name in dir(aerobat_pin)
    room = next(room for room, names in aerobat_pin._ROOMS.items() if name in names)
    assert getattr(aerobat_pin, name) is getattr(importlib.import_module(f"aerobat_pin.{room}"), name)


@pytest.mark.parametrize("door", DOORS)
def test_every_name_of_a_lazy_door_is_there_and_no_other(door: str) -> None:
    """What is listed can be imported; anything else is the usual error."""
    module = importlib.import_module(door)
    for name in module.__all__:
        assert getattr(module, name) is not None, name
    told = f"module '{door}' has no attribute 'nonsense'|No {door} attribute nonsense"
    with pytest.raises(AttributeError, match=told):
        module.nonsense  # noqa: B018


def test_the_doors_alone_import_nothing_heavy() -> None:
    """One after the other in a fresh process: no library but the command line's own."""
    heavy = "{'numpy', 'pinocchio', 'matplotlib', 'xarray', 'scipy', 'jinja2', 'rich', 'pydantic'}"
    doors = (*DOORS, "aerobat_pin.cli")
    code = "".join(f"import sys, {door}; print('{door}', *({heavy} & set(sys.modules)))\n" for door in doors)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == [*DOORS, "aerobat_pin.cli"]


def test_the_first_script_of_the_readme_does_what_it_says(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, here: Path
) -> None:
    """Nine lines print the table and the score that stands beside it, and plot the force of the shape that is named."""
    monkeypatch.setenv("MPLBACKEND", "agg")
    names: dict[str, Any] = {}
    script = re.findall(r"```python\n(.*?)```", README, re.DOTALL)[0]
    assert len([line for line in script.splitlines() if line]) == 9
    exec(compile(script, "README.md", "exec"), names)
    printed = capsys.readouterr().out
    assert "79 % thruster-borne" in printed
    score = float(re.findall(r"r2\) *# ([0-9.]+)", README)[0])
    assert names["left"]["Fy"].r2 == pytest.approx(score, abs=1e-4)
    assert names["force"].shape == (2000, 2, 3)
    assert np.isfinite(names["force"]).all()
    assert imread(here / "left_wing.png")[..., :3].std() > 0.01


def test_the_second_script_of_the_readme_observes_sample_by_sample() -> None:
    """As it stands, given the samples of a short flight; the force has the shape that it names."""
    log = simulate(load_scenario("paper", ["simulation.duration=0.02", "air.warm_up_cycles=1"]))
    inputs = known_inputs(log, load_aerobat("aerobat_guard"))
    known = sum(inputs.known.values())
    first, *later = zip(inputs.time, inputs.q, inputs.v, strict=True)
    names: dict[str, Any] = dict(zip("tqv", first, strict=True))
    names["samples"] = [(*one, *given) for one, given in zip(later, zip(inputs.tau, known, strict=True), strict=True)]
    exec(compile(re.findall(r"```python\n(.*?)```", README, re.DOTALL)[1], "README.md", "exec"), names)
    assert names["force"].shape == (2, 3)
    assert 0.01 < np.abs(names["force"]).max() < 1.0


def test_the_animated_picture_of_the_readme_moves_and_is_small() -> None:
    """Made by docs/scripts/screenshots.py: under 3 MB, two flaps in at least forty pictures."""
    [path] = re.findall(r"\]\((\S+\.gif)\)", README)
    file = ROOT / path
    assert file.stat().st_size < 3_000_000
    with Image.open(file) as picture:
        assert picture.n_frames >= 40
        assert picture.info["loop"] == 0


@pytest.mark.parametrize("page", [README, RECORDINGS.partition("## A map")[0]])
def test_what_a_recording_that_nobody_touched_is_good_for_is_said_at_once(page: str) -> None:
    """Beside the commands that estimate: two commands, which need no line of the map."""
    assert "joints' friction" in page
    words = [line.split() for line in re.findall(r"^aerobat (.*)", page, re.MULTILINE)]
    made = [one[one.index("--out") + 1] for one in words if one[0] == "calibrate" and "--map" in one]
    used = [command[command.index("--calibration") + 1] for command in words if "--calibration" in command]
    assert made == used == ["robot.nc"]


@pytest.mark.parametrize(
    ("door", "old", "place", "new"),
    [
        ("flight", "Flown", "flight", "Trajectory"),
        ("estimation", "Compared", "estimation", "PairedEstimate"),
        ("aerobat.raw", "RawChannel", "aerobat.raw", "SensorSamples"),
        ("robot", "load_aerobat", "aerobat", "load_aerobat"),
        ("estimation", "r_squared", "forces", "r_squared"),
        ("estimation", "ForceNode", "experiments", "ForceNode"),
        ("aerodynamics", "RobotAir", "aerobat", "RobotAir"),
    ],
)
def test_a_name_of_before_works_and_warns(door: str, old: str, place: str, new: str) -> None:
    """Of what is called otherwise, and of what has moved."""
    room, now = (importlib.import_module(f"aerobat_pin.{each}") for each in (door, place))
    with pytest.warns(DeprecationWarning, match=f"{old} is called aerobat_pin.{place}.{new} now"):
        assert getattr(room, old) is getattr(now, new)
    with pytest.raises(AttributeError):
        room.nothing  # noqa: B018


def test_a_room_of_before_is_found_however_it_is_imported() -> None:
    """The package had no attribute `robot`, and a star brought nothing without a word."""
    script = (
        "import aerobat_pin.robot\naerobat_pin.robot.load_aerobat, aerobat_pin.robot.joint_wrench\n"
        "from aerobat_pin.robot import *\nload_aerobat, joint_wrench"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stderr.count("aerobat_pin.robot.load_aerobat is called aerobat_pin.aerobat.load_aerobat now") == 2
