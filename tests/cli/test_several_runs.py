"""Commands about more than one run: several seeds of a scenario, and two runs side by side; and small comforts."""

from __future__ import annotations

import csv
import json
import os
import re
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from support.commands import call

import aerobat_pin

SHORT = ["--set", "simulation.duration=0.02", "--set", "air.warm_up_cycles=1"]


def test_several_seeds_are_runs_of_their_own_and_one_table(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Each folder is that of `--seed N`; the table holds its scores, and mean and least R2 are printed."""
    out = tmp_path / "seeds"
    assert call(monkeypatch, "run", "paper", "--seeds", "2,5-6", "--out", str(out), "--no-report", *SHORT) == 0
    printed = capsys.readouterr().out
    alone = tmp_path / "alone"
    assert call(monkeypatch, "run", "paper", "--seed", "5", "--out", str(alone), "--no-report", *SHORT) == 0
    assert (out / "seed_5" / "metrics.json").read_bytes() == (alone / "metrics.json").read_bytes()
    with (out / "seeds.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["seed"] for row in rows] == ["2"] * 12 + ["5"] * 12 + ["6"] * 12
    r2 = [
        float(row["r2"]) for row in rows if (row["observer"], row["point"], row["axis"]) == ("momentum", "left", "Fy")
    ]
    line = next(line for line in printed.splitlines() if re.match(r"momentum +left +Fy +3 ", line))
    assert float(line.split()[4]) == pytest.approx(sum(r2) / 3, abs=6e-6)
    assert float(line.split()[5]) == pytest.approx(min(r2), abs=6e-6)
    assert printed.endswith(f"open {out / 'seeds.csv'}\n")


def test_two_runs_stand_side_by_side(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """What differs, both scores of every axis as `metrics.json` has them, the forces, and figures that both have."""
    monkeypatch.chdir(tmp_path)
    for name, words in (("one", []), ("two", ["--set", "believed.air.density=1.47"])):
        assert call(monkeypatch, "run", "paper", "--out", name, "--no-report", *SHORT, *words) == 0
        (tmp_path / name / "figures").mkdir()
        (tmp_path / name / "figures" / "states.png").write_bytes(b"\x89PNG")
    capsys.readouterr()
    assert call(monkeypatch, "compare", "one", "two") == 0
    printed = capsys.readouterr().out
    assert "in two: believed.air.density = 1.47\n" in printed
    both = [json.loads((tmp_path / name / "metrics.json").read_text())["observers"] for name in ("one", "two")]
    score = [f"{found['force_level']['right']['Fz']['r2']:.5f}" for found in both]
    assert re.search(rf"force_level +right +Fz +{score[0]} +{score[1]} ", printed)
    folder = tmp_path / "runs" / "compare-one-two"
    names = ["comparison.csv", "comparison.html", "forces.pdf", "forces.png", "replay.html"]
    assert sorted(path.name for path in folder.iterdir()) == names
    assert len((folder / "comparison.csv").read_text().splitlines()) == 13
    page = (folder / "comparison.html").read_text()
    assert page.count("data:image/png;base64,") == 3
    assert score[1] in page
    assert call(monkeypatch, "compare", "one", "runs") == 2
    assert "runs is not the folder of a run: it has no scenario.toml" in capsys.readouterr().err
    (tmp_path / "two" / "metrics.json").write_text("[]")
    assert call(monkeypatch, "compare", "one", "two", "--force") == 2
    assert "the scores of a run were expected" in capsys.readouterr().err


def test_the_version_is_told(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """The package's own."""
    assert call(monkeypatch, "--version") == 0
    assert capsys.readouterr().out == f"aerobat {aerobat_pin.__version__}\n"


@pytest.mark.parametrize(
    ("typed", "offered"),
    [
        ("run pap", "paper_open_loop"),
        ("sweep gain", "gain_noise"),
        ("urdf aerobat_l", "aerobat_light"),
        ("com", "compare"),
    ],
)
def test_a_shell_completes_what_can_be_named(typed: str, offered: str) -> None:
    """As bash asks for it: commands, scenarios, sweeps and morphologies."""
    words = typed.split()
    asked = {"COMP_WORDS": f"aerobat {typed}", "COMP_CWORD": str(len(words)), "_AEROBAT_COMPLETE": "complete_bash"}
    code = "import sys; from aerobat_pin.cli import main; sys.argv = ['aerobat']; main()"
    done = subprocess.run(
        [sys.executable, "-c", code], env=os.environ | asked, capture_output=True, text=True, check=False
    )
    assert offered in done.stdout.split(), done.stderr


def test_a_port_that_is_taken_is_one_message(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """`play --port`: which port, and why not."""
    from aerobat_pin.errors import OutputError
    from aerobat_pin.visualization import serve

    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(OutputError, match=rf"--port {port}: Address already in use"):
            serve("page", print, port)
