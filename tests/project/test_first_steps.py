"""The first steps of somebody new: a Python that is too old, and every command of the README as it is typed."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from support.commands import call

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text()
# The commands are typed as they stand; these words, added at the end, make a flight last a moment instead of seconds.
SHORTER = {
    "run": ["--set", "simulation.duration=0.1", "--set", "air.warm_up_cycles=1", "--no-report"],
    "play": ["--html", "replay.html"],
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
    """Yield the words of every command of the README's table, in its order."""
    table = README.split("| you want |")[1].split("\n## ")[0]
    for text in re.findall(r"`((?:aerobat|cp) [^`]+)`", table):
        yield shlex.split(text)


def test_every_command_of_the_readme_works_as_it_is_typed(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """In a new folder, one after the other after the demo. A sweep is laid out only: its flights take minutes."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    assert call(monkeypatch, "run", "paper", "--force", *SHORTER["run"]) == 0
    typed = []
    for program, *words in commands():
        if program == "cp":
            shutil.copy(*words)
            continue
        name, *rest = words
        if name == "sweep":
            from aerobat_pin.experiments import load_sweep

            assert len(load_sweep(rest[0]).scenarios) > 1
        elif name == "trim":  # takes a minute from so far; tests/cli/test_cli.py finds one
            rest = [word for word in rest if word != "trimmed.toml" and word != "--out"]
        else:
            shorter = ["--no-report"] if "runs/free" in rest and name == "run" else SHORTER.get(name, [])  # whole flaps
            code = call(monkeypatch, name, *rest, *shorter)
            assert code == 0, f"aerobat {' '.join(words)}: {capsys.readouterr().err}"
        typed.append(name)
    assert set(typed) >= {"run", "list", "play", "estimate", "compare", "describe", "linkage", "sweep", "doctor"}


def test_the_readme_shows_the_way_without_make() -> None:
    """A virtual environment first: Debian's own Python takes no packages."""
    [block] = [text for text in re.findall(r"```sh\n(.*?)```", README, re.DOTALL) if "pip install ." in text]
    assert [line.split("#")[0].strip() for line in block.splitlines()] == [
        "python3 -m venv .venv",
        ". .venv/bin/activate",
        "pip install .",
        "aerobat run paper --force",
    ]
