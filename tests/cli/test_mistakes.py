"""What a user gets wrong at the command line costs one message and exit code 2, and leaves nothing behind."""

from __future__ import annotations

from pathlib import Path

import pytest
from support.commands import call

FLIGHT = ["run", "paper", "--set", "simulation.duration=0.01"]
STUCK = 'extends = "aerobat"\nname = "stuck"\n[linkage]\nL3b = 4e-3\n'


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run", "papr"], "no scenario 'papr'"),
        ([*FLIGHT, "--set", "simulation.dt=-1"], "simulation.dt = -1"),
        ([*FLIGHT, "--set", "observers.gain=-1"], "observers.gain = -1"),
        ([*FLIGHT, "--set", "unknown_force.0.frame=wing"], "the robot's frames are"),
        ([*FLIGHT, "--set", "robot.changes.linkage.L3b=0.002"], "cannot close at J4"),
        ([*FLIGHT, "--observer", "magic"], "choose from momentum, force_level"),
        ([*FLIGHT, "--seed", "-3"], "simulation.seed = -3"),
        ([*FLIGHT, "--set", "flight.velocity=[300, 0, 0]"], "the flight diverged at t = "),
        ([*FLIGHT, "--set", "simulation.dt=0.0015"], "duration = 0.01 s is not a whole number of steps"),
        ([*FLIGHT, "--set", "crank.frequency=0.001"], "at most 60 s are allowed"),
        (["linkage", "--out", "kept.png"], "output kept.png exists; --force overwrites it"),
        (["linkage", "--out", "."], "output aerobat.png exists; --force overwrites it"),
        (["linkage", "--out", "kept"], "output kept: is a file; a folder, or a .png, .pdf or .svg file was expected"),
        (["linkage", "--out", "new.jpg"], "output new.jpg: .jpg is none of .png, .pdf and .svg"),
        (["linkage", "--out", "missing/new.png"], "there is no folder missing"),
        (["linkage", "--out", "kept/new"], "output kept/new"),
        (["urdf", "--output", 300 * "n" + ".urdf"], "a name of 246 bytes at most was expected"),
        (["linkage", "--out", 300 * "n" + ".png"], "a name of 246 bytes at most was expected"),
        (["run", "paper", "--out", 300 * "n"], "File name too long"),
        (["run", 300 * "n"], "no scenario 'nnn"),
        (["linkage", "albatross"], "no morphology named 'albatross'"),
        (["linkage", "stuck.toml"], "cannot close at J4"),
        (["play"], "a run or a log was expected"),
        (["play", "nowhere.nc"], "there is no such file"),
        (["play", "."], "has no scenario.toml, flight.nc, estimate.nc"),
        (["play", "--from-csv", "a.csv"], "with --urdf FILE"),
        (["play", "--from-csv", "a.csv", "--urdf", "b.urdf"], "motion a.csv: there is no such file"),
        (["play", "nowhere.nc", "--from-csv", "a.csv", "--urdf", "b.urdf"], "a run or a log was expected"),
        (["play", "nowhere.nc", "--rate", "0"], "--rate"),
        (["play", "nowhere.nc", "--rate", "inf"], "--rate inf: a finite number was expected"),
        (["play", "nowhere.nc", "--morphology", "aerobot"], "there is no such file"),
        (
            ["play", ".", "--morphology", "aerobat_guard"],
            "--morphology says which robot is believed to have flown a log",
        ),
    ],
)
def test_a_mistake_costs_one_message_exit_code_2_and_leaves_nothing(
    arguments: list[str],
    message: str,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """No traceback, no file, no folder, not even `runs/`; what was there before stays as it was."""
    monkeypatch.chdir(tmp_path)
    for name in ("kept.png", "aerobat.png", "kept"):
        (tmp_path / name).write_text("mine")
    (tmp_path / "stuck.toml").write_text(STUCK)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert call(monkeypatch, *arguments) == 2
    printed = capsys.readouterr()
    assert message in printed.err
    assert "Traceback" not in printed.err
    assert printed.out == ""
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
