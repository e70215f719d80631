"""The pages of the documentation: their code runs and gives what they say, and no observer is left out."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

import ladder
import lifting_line
import numpy as np
import on_the_robot
import pytest
import strips
from support.commands import call
from support.quadruped import FEET, write_log, write_urdf

from aerobat_pin.estimation.estimate import belief_about
from aerobat_pin.flight.csv_log import UNITS
from aerobat_pin.observers import OBSERVERS
from aerobat_pin.robot.closing_bars import bar_placements, visual_model_with_bars

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGE = (DOCS / "observers.md").read_text()
[QUADRUPED] = re.findall(r"^## A quadruped's log.*?(?=^## )", PAGE, re.DOTALL | re.MULTILINE)
RECORDED = (DOCS / "recorded.md").read_text()
LINE = (DOCS / "lifting_line.md").read_text()


def blocks(text: str) -> list[str]:
    """Return the Python of a page."""
    return re.findall(r"```python\n(.*?)```", text, re.DOTALL)


@pytest.fixture(scope="module")
def page() -> dict[str, Any]:
    """Return the names left behind by the code blocks of the observers' page, run one after the other.

    The quadruped's is left to its own test: it needs files.
    """
    names: dict[str, Any] = {}
    for block in blocks(PAGE.replace(QUADRUPED, "")):
        exec(compile(block, "docs/observers.md", "exec"), names)
    return names


def test_the_observers_page_finds_the_push_it_makes(page: dict[str, Any]) -> None:
    """Force and place of the push, its onset and end, full rank, and a bias that is none."""
    np.testing.assert_allclose(page["estimate"].components[6900], page["wrench"], atol=0.2)
    assert page["known"].rank == 6
    assert page["known"].describe() == []
    [event] = page["events"]
    assert event.onset == pytest.approx(6.0, abs=0.01)
    assert event.end == pytest.approx(7.0, abs=0.05)
    assert event.alarm - event.onset < 2.0 * page["level"].latency(4.0)
    assert np.all(np.abs(page["bias"].mean) < 4.0 * page["bias"].standard_error)
    assert page["line"].verdict == "a point force"
    assert page["crossing"].verdict == "inside"
    deviation = np.sqrt(np.diag(page["crossing"].covariance))
    assert np.all(np.abs(page["crossing"].point - [0.05, 0.0, 0.0]) <= 4.0 * deviation + 1e-9)
    assert deviation.max() < 0.05


def test_the_observers_page_predicts_the_noise_it_shows(page: dict[str, Any]) -> None:
    """The free run of the page against its own prediction, 10 %."""
    predicted = page["predict"](page["observer"], page["q"], 1e-3, page["noise"]).deviation
    np.testing.assert_allclose(np.std(page["estimate"].components[:5000], axis=0), predicted, rtol=0.1)


def test_the_robots_page_places_the_bars_at_the_crank_angle_it_says() -> None:
    """Its code runs; each bar stands where `bar_placements` puts it at 0.5 rad, not where it was made."""
    names: dict[str, Any] = {}
    [block] = re.findall(r"```python\n(.*?)```", (DOCS / "robot.md").read_text(), re.DOTALL)
    exec(compile(block, "docs/robot.md", "exec"), names)
    robot, picture = names["robot"], names["picture"]
    placed, made = bar_placements(robot, 0.5), visual_model_with_bars(robot)
    assert len(placed) == 10
    for name, placement in placed.items():
        assert picture.geometryObjects[picture.getGeometryId(name)].placement == placement
        assert made.geometryObjects[made.getGeometryId(name)].placement != placement


def test_the_quadrupeds_log_gives_the_force_on_every_foot(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Each within 1 % of the load; one foot alone is wrong by a tenth or more, although rank and condition are fine."""
    monkeypatch.chdir(tmp_path)
    write_urdf(tmp_path / "quadruped.urdf")
    truth = write_log(tmp_path / "quadruped.urdf", tmp_path / "stance.csv")
    names: dict[str, Any] = {}
    [block] = blocks(QUADRUPED)
    exec(compile(block, "docs/observers.md", "exec"), names)
    found, load = names["estimate"], truth[-1, :, 2].max()
    assert found.frames == FEET
    assert found.identifiability.rank == 12
    np.testing.assert_allclose(found.force[-1], 0.5 * (truth[-1] + truth[-2]), atol=0.01 * load)
    for foot in range(4):
        observer = names["ForceLevelObserver"](names["model"], [FEET[foot]], gain=200.0)
        alone = observer.run(names["time"][:, 0], names["q"], names["v"], names["tau"])
        assert np.linalg.norm(alone.force[-1, 0] - truth[-1, foot]) > 0.1 * load
        assert alone.identifiability.rank == 3
        assert alone.identifiability.condition < 20.0


@pytest.mark.parametrize("name", OBSERVERS)
def test_every_observer_has_a_row_in_the_table(name: str) -> None:
    """By its name, once."""
    assert len(re.findall(rf"^\| `{name}` \|", PAGE, re.MULTILINE)) == 1


def test_the_page_on_recorded_flights_lists_every_column_with_its_unit() -> None:
    """Names that follow each other, as `a` ... `b`, stand for those between them."""
    names = list(UNITS)
    told: dict[str, str] = {}
    table = RECORDED.split("<!-- columns -->")[1].split("<!-- /columns -->")[0]
    for columns, units in re.findall(r"^\| (`.*?) \| (.*?) \|", table, re.MULTILINE):
        for part in columns.split(", "):
            first, *last = re.findall(r"`(\w+)`", part)
            for name in names[names.index(first) : names.index(last[0] if last else first) + 1]:
                told[name] = units
    assert set(told) == set(UNITS)
    for name, units in told.items():
        assert UNITS[name] in units.split(", ")


def test_the_page_on_recorded_flights_does_what_it_says(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its Python writes the table, its command estimates from it and finds its own pushes."""
    monkeypatch.chdir(tmp_path)
    exec(compile(blocks(RECORDED)[0], "docs/recorded.md", "exec"), {})
    command = shlex.split(re.findall(r"```sh\n(.*?)```", RECORDED, re.DOTALL)[0].replace("\\\n", " "))
    code = call(monkeypatch, *command[1:])
    printed = capsys.readouterr().out
    assert code == 0, printed
    assert "self-check: sign, frame and unit are right" in printed
    assert "aerodynamic    reconstructed" in printed
    assert (tmp_path / "runs" / "hall-estimate" / "estimate.csv").exists()


def test_every_option_of_the_page_on_recorded_flights_is_taken() -> None:
    """Each `--set` of its table is a value that a belief may have."""
    settings = re.findall(r"`--set ([^`]+)`", RECORDED)
    assert len(settings) > 6
    belief = belief_about(None, "hall", "aerobat_guard", ["smoother"], settings)
    assert belief.observers.frames == ("base_link",)
    assert belief.observers.settings("smoother")["known_error"] == {"aerodynamic": 0.2}


@pytest.mark.parametrize("draw", [*ladder.RUNGS, strips.stable_step, on_the_robot.law], ids=lambda draw: draw.__name__)
def test_the_lifting_lines_page_says_what_its_script_finds(draw: Callable[[], ladder.Rung]) -> None:
    """Every part but the count of strips and the wake, which take longer: title, figure and numbers, to the letter."""
    assert lifting_line.section(draw()) in LINE


def test_the_lifting_lines_page_holds_its_prose_and_some_of_its_longer_studies() -> None:
    """Prose as in the script; of the strip count, steady Aerobat and two columns of the robot in flapping flight."""
    for prose in (
        lifting_line.INTRODUCTION,
        lifting_line.WHY_SIXTEEN,
        lifting_line.SECTION_LAW,
        lifting_line.LIMITS,
    ):
        assert prose in LINE
    counted = LINE.split("## How many strips")[1].split("\n## ")[0]
    steady = [strips.wings()["Aerobat"](n).steady_coefficients(ladder.INCIDENCE)[0] for n in (16, 200)]
    assert f"Aerobat's planform {100.0 * abs(steady[0] / steady[1] - 1.0):.2f} %" in counted
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in counted.splitlines() if line.startswith("| ")]
    assert rows[0][1:] == [str(count) for count in strips.ON_THE_ROBOT]
    for count, (mean, rms) in strips.robot_errors((8, 16)).items():
        column = rows[0].index(str(count))
        assert [row[column] for row in rows[1:]] == [f"{mean:+.1f}", f"{rms:.1f}"]
