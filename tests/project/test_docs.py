"""The pages of the documentation: their code runs and gives what they say, and no observer is left out."""

import ast
import re
import runpy
import shlex
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.commands import call
from support.further import further
from support.pages import run
from support.walking_log import FEET, urdf, walk

from aerobat_pin.aerobat import belief_about, visual_model_with_bars
from aerobat_pin.aerobat.closed_model import bar_placements
from aerobat_pin.aerobat.kind_of_log import RAW_TABLE, STATE_TABLE, table_units
from aerobat_pin.observers import OBSERVERS

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
PAGE = (DOCS / "observers.md").read_text()
[QUADRUPED] = re.findall(r"^## A quadruped's log.*?(?=^## )", PAGE, re.DOTALL | re.MULTILINE)
RECORDED = (DOCS / "recorded.md").read_text()
WRITTEN = ("lifting_line/lifting_line.py", "crank.py", "results.py", "observer_study.py", "section_law.py")


def blocks(text: str) -> list[str]:
    return re.findall(r"```python\n(.*?)```", text, re.DOTALL)


def ran(name: str, *codes: str) -> dict[str, Any]:
    """Return the names left behind by blocks of code of a page, run in turn."""
    names: dict[str, Any] = {}
    for block in codes:
        exec(compile(block, f"docs/{name}", "exec"), names)
    return names


def test_the_observers_page_finds_the_push_it_makes_and_leaves_out_a_rail_that_sticks() -> None:
    """Force, place, onset, end, full rank, no bias; noise as predicted, to 10 %; friction belies the model."""
    page = ran("observers.md", *blocks(PAGE.replace(QUADRUPED, "")))  # the quadruped's needs files
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
    assert page["stands"].rows == "all but rail"
    assert page["stands"].redundancy.verdict == "consistent"
    everything = page["ForceLevelObserver"](page["carried"], ["effector_body"], 100.0)
    still, held = page["still"], np.tile(page["held"], (8000, 1))
    assert everything.run(page["time"], *still, held).redundancy.verdict == "inconsistent"
    predicted = page["predict"](page["observer"], page["q"], 1e-3, page["noise"]).deviation
    np.testing.assert_allclose(np.std(page["estimate"].components[:5000], axis=0), predicted, rtol=0.1)


def test_the_calibrations_page_finds_the_blow_it_flies() -> None:
    """Its code runs: inside the learnt range, and one blow at 0.7 s on the left wing."""
    names = ran("calibration.md", *blocks((DOCS / "calibration.md").read_text()))
    [contact] = names["scores"].events
    assert names["result"].model.verdict == "unchanged"
    assert contact.point == "left"
    assert contact.alarm == pytest.approx(0.703, abs=2e-3)


def test_the_robots_page_places_the_bars_at_the_crank_angle_it_says() -> None:
    """Its code runs; each bar stands where `bar_placements` puts it at 0.5 rad, not where it was made."""
    names = ran("robot.md", *blocks((DOCS / "robot.md").read_text()))
    robot, picture = names["robot"], names["picture"]
    placed, made = bar_placements(robot, 0.5), visual_model_with_bars(robot)
    assert len(placed) == 10
    for name, placement in placed.items():
        assert picture.geometryObjects[picture.getGeometryId(name)].placement == placement
        assert made.geometryObjects[made.getGeometryId(name)].placement != placement


def test_the_quadrupeds_log_gives_the_force_on_every_foot(here: Path) -> None:
    """Each within 1.2 % of the load; one alone is wrong by a tenth or more, although rank and condition are fine."""
    (here / "quadruped.urdf").write_text(urdf())
    walked = walk(0.5, 1000.0)
    log, truth = np.column_stack([walked.time, walked.q, walked.v, walked.tau]), walked.force
    np.savetxt(here / "stance.csv", log, delimiter=",", header="time, q, v, joint torques")
    names = ran("observers.md", *blocks(QUADRUPED))
    found, load = names["estimate"], truth[-1, :, 2].max()
    assert found.frames == FEET
    assert found.identifiability.rank == 12
    np.testing.assert_allclose(found.force[-1], 0.5 * (truth[-1] + truth[-2]), atol=0.012 * load)
    for foot in range(4):
        observer = names["ForceLevelObserver"](names["model"], [FEET[foot]], gain=200.0)
        alone = observer.run(names["time"][:, 0], names["q"], names["v"], names["tau"])
        assert np.linalg.norm(alone.force[-1, 0] - truth[-1, foot]) > 0.1 * load
        assert alone.identifiability.rank == 3
        assert alone.identifiability.condition < 20.0


@pytest.mark.parametrize("name", OBSERVERS)
def test_every_observer_has_a_row_in_the_table(name: str) -> None:
    assert len(re.findall(rf"^\| `{name}` \|", PAGE, re.MULTILINE)) == 1


def test_the_page_on_recorded_flights_lists_every_column_with_its_unit() -> None:
    """Names that follow each other, as `a` ... `b`, stand for those between them."""
    units_of = table_units(STATE_TABLE) | table_units(RAW_TABLE)
    names = list(units_of)
    told: dict[str, str] = {}
    table = RECORDED.split("<!-- columns -->")[1].split("<!-- /columns -->")[0]
    for columns, units in re.findall(r"^\| (`.*?) \| (.*?) \|", table, re.MULTILINE):
        for part in columns.split(", "):
            first, *last = re.findall(r"`(\w+)`", part)
            for name in names[names.index(first) : names.index(last[0] if last else first) + 1]:
                told[name] = units
    assert set(told) == set(units_of)
    for name, units in told.items():
        assert units_of[name] in units.split(", ")


@pytest.mark.usefixtures("unrendered")
def test_the_page_on_recorded_flights_does_what_it_says(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its Python writes the table, its command estimates from it and finds its own pushes."""
    ran("recorded.md", blocks(RECORDED)[0])
    command = shlex.split(re.findall(r"```sh\n(.*?)```", RECORDED, re.DOTALL)[0].replace("\\\n", " "))
    code = call(*command[1:])
    printed = capsys.readouterr().out
    assert code == 0, printed
    assert "self-check: sign, frame and unit are right" in printed
    assert "aerodynamic reconstructed" in printed
    assert (here / "runs" / "hall-estimate" / "estimate.csv").exists()


def test_every_option_of_the_page_on_recorded_flights_is_taken() -> None:
    """Each `--set` of its table is a value that a belief may have."""
    settings = re.findall(r"`--set ([^`]+)`", RECORDED)
    assert len(settings) > 6
    belief = belief_about(None, "hall", "aerobat_guard", ["smoother"], settings)
    assert belief.observers.frames == ("base_link",)
    assert belief.observers.settings("smoother")["known_error"] == {"aerodynamic": 0.2}


def test_every_message_that_a_page_quotes_is_one_that_the_program_prints() -> None:
    """Word by word, between numbers and names that vary; titles and cells, too, but not what scripts have copied."""
    pages = {path: path.read_text() for path in (ROOT / "README.md", *DOCS.glob("*.md"), *DOCS.glob("tutorials/*.md"))}
    shown = "".join(line for text in pages.values() for line in text.splitlines() if line.startswith(("#", "|")))
    nodes = [
        node
        for folder in ("aerobat_pin", "aerobat_description")
        for path in (ROOT / folder).rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text()))
    ]
    told = "\n".join(node.value for node in nodes if isinstance(node, ast.Constant) and isinstance(node.value, str))
    found = []
    for page, text in pages.items():
        prose = re.sub(r"^```.*?^```|`[^`]*`", "0", text, flags=re.DOTALL | re.MULTILINE)
        quotes = [quote for part in prose.split("\n\n") for quote in re.findall(r'"([^"]*)"', part)]
        for message in [*quotes, *re.findall(r"`((?!aerobat )[a-z]+(?: \w+){2,})`", text)]:
            words = re.findall(r"(?<![\w.'])[a-z]+(?: [a-z]+)+(?![\w])", " ".join(message.split()))
            found += [(page.name, piece) for piece in words if piece not in shown]
    assert [(page, piece) for page, piece in found if piece not in told and page != "paper.md"] == []
    assert len(found) > 8


@pytest.mark.parametrize("name", [*WRITTEN[:3], *further(*WRITTEN[3:])])
def test_a_page_says_what_its_script_finds(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """All numbers that are quick to find, to the letter."""
    path = DOCS / "scripts" / name
    monkeypatch.setattr(sys, "argv", [str(path), "--check"])
    monkeypatch.syspath_prepend(path.parent)
    runpy.run_path(str(path), run_name="__main__")


def test_a_page_that_was_changed_by_hand_is_found_out(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "page.md").write_text("<!-- a -->1<!-- /a --> and\n<!-- b -->\n| 2 |\n<!-- /b -->\n")
    monkeypatch.setattr(sys, "argv", ["script.py", "--check", str(tmp_path)])
    run(dict, lambda: {"page.md": {"a": "1", "b": "| 2 |"}})
    with pytest.raises(SystemExit) as stop:
        run(dict, lambda: {"page.md": {"a": "1", "b": "| 3 |"}})
    assert stop.value.code == "page.md: 'b' is not what the script finds"  # which Python prints, with exit code 1


PAGES = [
    ROOT / "README.md",
    *DOCS.glob("*.md"),
    *DOCS.glob("tutorials/*.md"),
    ROOT / "examples" / "recordings" / "README.md",
]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_no_command_of_a_page_finds_its_folder_full(page: Path) -> None:
    """Typed one after the other, behind the demo: two that write into one folder are told apart, or say --force."""
    full = {"runs/paper"}
    for block in re.findall(r"^```(?:sh|bash|console)\n(.*?)^```", page.read_text(), re.DOTALL | re.MULTILINE):
        for line in block.replace("\\\n", " ").splitlines():
            program, command, *words = [*shlex.split(line, comments=True), "", ""]
            if program != "aerobat" or command not in ("run", "estimate") or "--suggest" in words:
                continue
            usual = f"runs/{Path(words[0]).stem}{'-estimate' if command == 'estimate' else ''}"
            folder = words[words.index("--out") + 1] if "--out" in words else usual
            assert folder not in full or "--force" in words, line
            full.add(folder)


def test_make_docs_runs_every_script() -> None:
    """Those that draw alone too; the parts of the lifting line's page are run by its script."""
    scripts = {path.relative_to(DOCS / "scripts").as_posix() for path in (DOCS / "scripts").rglob("*.py")}
    programs = {name for name in scripts if '__name__ == "__main__"' in (DOCS / "scripts" / name).read_text()}
    makefile = (ROOT / "Makefile").read_text().replace("\\\n", " ")
    [listed] = re.findall(r"^SCRIPTS := (.*)$", makefile, re.MULTILINE)
    assert sorted(f"{name}.py" for name in listed.split()) == sorted(programs)
    assert programs > set(WRITTEN)
