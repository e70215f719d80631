"""What a user gets wrong at the command line costs one message and exit code 2, and leaves nothing behind."""

from __future__ import annotations

from pathlib import Path

import pytest
from support.commands import aerobat

FLIGHT = ["run", "paper", "--set", "simulation.duration=0.01"]
THRUSTER = 'name = "left_force_point"\nposition = [0.1, 0, 0]\ndirection = [0, 0, 1]\nthrust = 0.1\n'
FILES = {
    **dict.fromkeys(("kept", "kept.png", "aerobat.png", "there.urdf"), "mine"),
    "stuck.toml": 'extends = "aerobat"\nname = "stuck"\n[linkage]\nL3b = 4e-3\n',
    "heavy.toml": 'extends = "aerobat_guard"\nname = "heavy"\n[body]\nmass = 0.09\n',
    "twice.toml": f'extends = "aerobat"\nname = "twice"\n[[thrusters]]\n{THRUSTER}',
    "motion.csv": "time,hinge\n0,0\n1,0.5\n",
    "nan.toml": 'name = "nan"\n[flight]\nvelocity = [nan, 0.0, 0.0]\n',
}


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
        (
            [*FLIGHT, "--set", "robot.morphology=twice.toml"],
            "'left_force_point': another link, joint or frame has this name",
        ),
        ([*FLIGHT, "--out", "kept"], "error: output"),
        ([*FLIGHT, "--out", "kept/below"], "error: output"),
        (["run", "nan.toml"], "flight.velocity.0 = nan: input should be a finite number"),
        *((["run", "paper", "--seeds", words], "run: --seeds") for words in ("3-1", "one", "1-", "", "1-99999")),
        (["run", "paper", "--seeds", "1-2", "--seed", "1"], "--seed and --seeds: one of them was expected"),
        (["linkage", "--out", "kept.png"], "output kept.png exists; --force overwrites it"),
        (["linkage", "--out", "."], "output aerobat.png exists; --force overwrites it"),
        (["linkage", "--out", "kept"], "output kept: is a file; a folder, or a .png, .pdf or .svg file was expected"),
        (["linkage", "--out", "new.jpg"], "output new.jpg: .jpg is none of .png, .pdf and .svg"),
        (["linkage", "--out", "missing/new.png"], "there is no folder missing"),
        (["linkage", "--out", "kept/new"], "output kept/new"),
        (["urdf", "--output", 300 * "n" + ".urdf"], "a name of 246 bytes at most was expected"),
        (["urdf", "heavy.toml"], "robot heavy: its meshes must be written somewhere; give --output FILE"),
        (["urdf", "no_robot.toml"], "morphology file no_robot.toml: there is no such file"),
        (["urdf", "heavy.toml", "-o", "nowhere/x.urdf"], "there is no folder nowhere"),
        (["urdf", "heavy.toml", "-o", "there.urdf"], "there.urdf exists; --force overwrites it"),
        (["urdf", "heavy.toml", "--meshes", "somewhere"], "'package'"),
        (["urdf", "--format", "mjcf", "--meshes", "package"], "relative or absolute was expected"),
        (["urdf", "--bars", "cad"], "--format mjcf was expected"),
        (["crank", "aerobot", "--output", "a.html"], "no morphology named 'aerobot'"),
        (["crank", "--output", "kept"], "--force"),
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
        (["play", "--from-csv", "motion.csv", "--urdf", "b.urdf"], "robot b.urdf: there is no such file"),
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
    arguments: list[str], message: str, tmp_path: Path
) -> None:
    """No traceback, no file, no folder, not even `runs/`; what was there before stays as it was."""
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    done = aerobat(*arguments, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert message in done.stderr
    assert "Traceback" not in done.stderr
    assert done.stderr.count("error: ") == 1 or "Usage:" in done.stderr
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == FILES
