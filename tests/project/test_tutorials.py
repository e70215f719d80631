"""The first steps of somebody new: tutorials, the notebook, the README's commands as they are typed, an old Python."""

import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import nbformat
import numpy as np
import pytest
from nbclient import NotebookClient
from support.commands import call
from support.further import further

ROOT = Path(__file__).resolve().parents[2]
TUTORIALS = sorted((ROOT / "docs" / "tutorials").glob("*.md"))
BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
CHECKS = {
    "01-first-flight": 'found["force_level"][-1] > 0.999 and r2["windy"][1] < r2["paper"][1]',
    "02-your-log": '(table.filter(like="F").abs().max() < 1.0).all()',
    "03-your-robot": "np.allclose(estimate.force[-1, 0], [3.0, 0.0, 0.0], atol=0.05) and known.rank == 3",
    "04-your-wing": 'flight["aerodynamic_lift_over_weight"] > 0.1',
    "05-a-sweep": "r2.loc[0.0, 1000.0] > r2.loc[0.01, 1000.0]",
    "06-closing-the-loop": 'sideways["gust_closed_loop"] < timid < sideways["without"] < 0.1 and not roll.stable',
    "07-your-simulator": "0.0 < apart[-1] < 5e-3",
    "08-a-law-that-learns": "returns[-1] > (1.5 * returns[0] if len(returns) < 40 else max(300.0, 3.0 * returns[0]))",
}


@pytest.mark.usefixtures("unrendered")
@pytest.mark.parametrize(
    ("page", "steps"),
    [*((page, "12") for page in TUTORIALS), *further((TUTORIALS[-1], "40"))],
    ids=lambda one: Path(one).stem,
)
def test_a_tutorial_does_what_it_says(page: Path, steps: str, monkeypatch: pytest.MonkeyPatch, here: Path) -> None:
    """Commands end with code 0, files appear; `console` shows what needs several machines; learning takes 12 steps."""
    monkeypatch.setenv("MPLBACKEND", "agg")
    names: dict[str, Any] = {"np": np}
    for language, text in BLOCK.findall(page.read_text("utf-8").replace("range(40)", f"range({steps})")):
        if language == "sh":
            for line in text.replace("\\\n", " ").splitlines():
                program, *words = shlex.split(line, comments=True)
                assert program == "aerobat", line
                assert call(*words) == 0, line
        elif language in ("toml", "xml"):
            name = text.split("\n")[0].strip("# <!->")
            (here / name).write_text(text, encoding="utf-8")
        elif language == "python":
            exec(compile(text, page.name, "exec"), names)
        else:
            assert language == "console"
    assert eval(CHECKS[page.stem], names) if page.stem in CHECKS else True


def test_the_python_of_the_page_on_studies_reads_a_sweep(here: Path) -> None:
    """Of a sweep with the name that it says, two short flights large."""
    (here / "small.toml").write_text(
        'name = "morphology"\nbase = "paper"\n[set]\n"simulation.duration" = 0.02\n"air.warm_up_cycles" = 1\n'
        '[ranges]\n"crank.frequency" = [4.75, 5.0]\n'
    )
    assert call("sweep", "small.toml", "--jobs", "1") == 0
    [script] = re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "studies.md").read_text("utf-8"), re.DOTALL)
    *before, last = script.strip().splitlines()
    names: dict[str, Any] = {}
    exec(compile("\n".join(before), "docs/studies.md", "exec"), names)
    assert set(eval(last, names).dims) == {"point", "seed"}


def test_the_notebook_runs_and_shows_what_it_says(tmp_path: Path) -> None:
    """In a kernel of its own, in an empty folder: fly, estimate, plot, replay."""
    book = nbformat.read(Path(__file__).resolve().parents[2] / "examples" / "first_flight.ipynb", as_version=4)
    assert [cell for cell in book.cells if cell.get("outputs") or cell.get("execution_count")] == []
    NotebookClient(book, timeout=900, resources={"metadata": {"path": str(tmp_path)}}).execute()
    code = [cell for cell in book.cells if cell.cell_type == "code"]
    shown = [{kind: text for one in cell.outputs for kind, text in one.get("data", {}).items()} for cell in code]
    printed = ["".join(one.get("text", "") for one in cell.outputs) for cell in code]
    assert "<th>R2</th>" in shown[0]["text/html"]
    assert "<td>crank_angle</td>" in shown[1]["text/html"]
    assert len(shown[2]["image/png"]) > 10_000
    assert "all torques: rank 6\nno torque: rank 5 equal and opposite along the line" in printed[3]
    assert shown[4]["text/html"].startswith("<iframe srcdoc=")
    assert len(shown[4]["text/html"]) > 1_000_000
    assert list(tmp_path.iterdir()) == []


README, START = ((ROOT / path).read_text() for path in ("README.md", "docs/start.md"))
# The commands are typed as they stand; these words, added at the end, make a flight last a moment instead of seconds.
SHORTER = {
    "run": ["--set", "simulation.duration=0.1", "--set", "air.warm_up_cycles=1", "--no-report"],
    "play": ["--out", "replay.html"],
}
FAKE = """#!/bin/sh
exec {python} -c "import sys; sys.version_info = (3, 10, 13, 'final', 0); exec(sys.argv.pop(1))" "$2" "$3"
"""


@pytest.mark.skipif(shutil.which("make") is None, reason="no make on this machine: apt-get install make")
@pytest.mark.parametrize("goal", ["demo", "test"])
def test_a_python_that_is_too_old_is_named_before_anything_is_made(tmp_path: Path, goal: str) -> None:
    """One message with what was found, what would do and how to name it; no `.venv` that would spoil the next try."""
    shutil.copy(ROOT / "Makefile", tmp_path)
    (tmp_path / "pyproject.toml").write_text("")
    old = tmp_path / "python-old"
    old.write_text(FAKE.format(python=sys.executable))
    old.chmod(0o755)
    done = subprocess.run(["make", goal, f"PYTHON={old}"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert f"{old} is Python 3.10: Python 3.11 to 3.13 was expected" in done.stderr
    assert f"make PYTHON=python3.12 {goal}" in done.stderr
    assert not (tmp_path / ".venv").exists()
    (tmp_path / ".venv" / "bin").mkdir(parents=True)  # what an earlier version left behind
    old.rename(tmp_path / ".venv" / "bin" / "python")
    done = subprocess.run(["make", goal], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert ".venv is Python 3.10" in done.stderr
    assert "make clean" in done.stderr


def commands() -> Iterator[list[str]]:
    """Yield the words of every command of the tables of README and docs/start.md, in their order, each once."""
    tables = [table.split("\n\n")[0] for page in (README, START) for table in page.split("| you want |")[1:]]
    typed = re.findall(r"`((?:aerobat|cp) [^`]+)`", "\n".join(tables))
    yield from (shlex.split(text) for text in dict.fromkeys(typed))


@pytest.mark.usefixtures("unrendered")
def test_every_command_of_the_readme_works_as_it_is_typed(
    monkeypatch: pytest.MonkeyPatch, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """In a new folder, one after the other after the demo. A sweep is laid out only: its flights take minutes."""
    monkeypatch.syspath_prepend(here)
    assert call("run", "paper", "--force", *SHORTER["run"]) == 0
    typed = []
    for program, *words in commands():
        if program == "cp":
            shutil.copy(*words)
            continue
        name, *rest = words
        if name == "sweep":
            from aerobat_pin.experiments import load_sweep

            assert len(load_sweep(rest[0]).scenarios) > 1
        elif name in ("node", "live"):  # run until Ctrl-C; test_ros_node.py and test_live_page.py talk to them
            assert not rest or rest[0] in ("--map", "ur5", "go2")
        elif name == "trim":  # takes a minute from so far; tests/cli/test_cli.py finds one
            rest = [word for word in rest if word != "trimmed.toml" and word != "--out"]
        else:
            shorter = ["--no-report"] if "runs/free" in rest and name == "run" else SHORTER.get(name, [])  # whole flaps
            code = call(name, *rest, *shorter)
            assert code == 0, f"aerobat {' '.join(words)}: {capsys.readouterr().err}"
        typed.append(name)
    assert set(typed) >= {"run", "list", "play", "estimate", "compare", "describe", "linkage", "sweep", "doctor"}


def test_the_readme_shows_the_way_without_make() -> None:
    """A virtual environment first: Debian's own Python takes no packages."""
    [block] = [text for text in re.findall(r"```sh\n(.*?)```", README, re.DOTALL) if "pip install" in text]
    assert [line.split("#")[0].strip() for line in block.splitlines()] == [
        "python3 -m venv .venv",
        ". .venv/bin/activate",
        "pip install --no-compile .",
        "aerobat run paper --force",
    ]
