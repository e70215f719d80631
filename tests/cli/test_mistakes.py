"""What a user gets wrong costs one message and exit code 2, and leaves nothing behind; commands about several runs."""

import csv
import json
import os
import re
import shutil
import socket
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import h5py
import pytest
import xarray as xr
from support.commands import aerobat, call
from typer.main import get_command

import aerobat_pin
from aerobat_pin.aerobat import FlightLog
from aerobat_pin.cli.app import app
from aerobat_pin.experiments import Experiment, run, write
from aerobat_pin.experiments.write_results import read_estimates
from aerobat_pin.scenario import load_scenario
from aerobat_pin.visualization.comparison import compare_runs

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
TWICE, MCAP = "robot.morphology=twice.toml", ["--out-mcap", "b.mcap"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run", "papr"], "no scenario 'papr': did you mean 'paper'? Shipped are guard, gust,"),
        (["sweep", "gain_nois"], "no sweep 'gain_nois': did you mean 'gain_noise'?"),
        (["describe", "scenario", "crank.frequncy"], "did you mean 'crank.frequency'?"),
        ([*FLIGHT, "--observer", "kalmann"], "did you mean 'kalman'? Choose from momentum, force_level"),
        ([*FLIGHT, "--set", "unknown_force.0.frame=left_forcepoint"], "did you mean 'left_force_point'?"),
        ([*FLIGHT, "--observer", "kalman,momentum"], "--observer kalman --observer momentum"),
        ([*FLIGHT, "--seed", "-3"], "simulation.seed = -3"),
        ([*FLIGHT, "--set", "flight.velocity=[300, 0, 0]"], "the flight diverged at t = "),
        ([*FLIGHT, "--set", "crank.frequency=0.001"], "at most 60 s are allowed"),
        ([*FLIGHT, "--set", TWICE], "'left_force_point': another link, joint or frame has this name"),
        ([*FLIGHT, "--correct"], "what changed since a calibration: --calibration FILE was expected"),
        (["estimate"], "a recorded flight was expected, or --self-check"),
        (["estimate", "."], "a map says what its columns mean"),
        (["estimate", "motion.csv", "--out", "a.mcap"], "--out-mcap is for recordings by --map; `aerobat convert RUN`"),
        ([*FLIGHT, "--out", "kept"], "error: output"),
        ([*FLIGHT, "--out", "kept/below"], "error: output"),
        (["run", "nan.toml"], "flight.velocity.0 = nan: input should be a finite number"),
        *((["run", "paper", "--seeds", words], "run: --seeds") for words in ("3-1", "one", "1-99999")),
        (["run", "paper", "--seeds", "1-2", "--seed", "1"], "--seed and --seeds: one of them was expected"),
        ([*FLIGHT, "--seeds", "1-2", "--set", "flight.velocity=[300,0,0]"], "paper: the flight diverged at t = 0.0000"),
        (["linkage", "--out", "kept.png"], "output kept.png exists; --force overwrites it"),
        (["linkage", "--out", "."], "output aerobat.png exists; --force overwrites it"),
        (["linkage", "--out", "kept"], "output kept: is a file; a folder, or a .png, .pdf or .svg file was expected"),
        (["estimate", "--self-check", "--map", "no.toml", "--correct"], "--map, --correct without a log"),
        (["estimate", "log.csv", "--suggest", "--out", "map.toml"], "--suggest > map.toml`, without --out"),
        (["estimate", "log.csv", "-o", "a.mcap", *MCAP], "--out-mcap b.mcap: one MCAP file was expected"),
        (["linkage", "--out", "new.jpg"], "output new.jpg: .jpg is none of .png, .pdf and .svg"),
        (["linkage", "--out", "kept/new"], "output kept/new"),
        (["urdf", "--out", 300 * "n" + ".urdf"], "a name of 246 bytes at most was expected"),
        (["urdf", "heavy.toml"], "robot heavy: its meshes must be written somewhere; give --out FILE"),
        (["urdf", "no_robot.toml"], "morphology file no_robot.toml: there is no such file"),
        (["urdf", "heavy.toml", "-o", "kept/x.urdf"], "kept is no folder"),
        (["urdf", "heavy.toml", "-o", "there.urdf"], "there.urdf exists; --force overwrites it"),
        (["urdf", "heavy.toml", "--meshes", "somewhere"], "'package'"),
        (["urdf", "--format", "mjcf", "--meshes", "package"], "relative or absolute was expected"),
        (["urdf", "--bars", "cad"], "--format mjcf was expected"),
        (["crank", "aerobot", "--out", "a.html"], "no morphology named 'aerobot': did you mean 'aerobat'?"),
        (["crank", "--out", "kept"], "--force"),
        (["run", "paper", "--out", 300 * "n"], "File name too long"),
        (["run", 300 * "n"], "no scenario 'nnn"),
        (["linkage", "stuck.toml"], "cannot close at J4"),
        (["live", "hover_closed_loop", "--points", "tip"], "--points is for a robot by name or URDF file"),
        (["live", "ur5", "--set", "crank.frequency=3"], "--set is for a scenario"),
        (["live", "motion.csv"], "log motion.csv: a map says what its columns mean"),
        (["play"], "a run or a log was expected"),
        (["play", "nowhere.nc"], "there is no such file"),
        (["play", "."], "has no scenario.toml, flight.nc, estimate.nc"),
        (["play", "--from-csv", "a.csv"], "with --urdf FILE"),
        (["play", "--from-csv", "a.csv", "--urdf", "b.urdf"], "log a.csv: there is no such file"),
        (["play", "--from-csv", "motion.csv", "--urdf", "b.urdf"], "robot b.urdf: there is no such file"),
        (["play", "nowhere.nc", "--rate", "0"], "--rate"),
        (["play", "nowhere.nc", "--rate", "inf"], "--rate inf: a finite number was expected"),
        (["play", ".", "--morphology", "aerobat"], "--morphology says which robot is believed to have flown a log"),
    ],
)
def test_a_mistake_costs_one_message_and_leaves_nothing(arguments: list[str], message: str, tmp_path: Path) -> None:
    """No traceback, no file, no folder, not even `runs/`; what was there before stays as it was."""
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    done = aerobat(*arguments, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert message in done.stderr
    assert "Traceback" not in done.stderr
    assert done.stderr.count("error: ") == 1 or "Usage:" in done.stderr
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == FILES


SHORT = ["--set", "simulation.duration=0.02", "--set", "air.warm_up_cycles=1"]


def test_several_seeds_are_runs_of_their_own_and_one_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Each folder is that of `--seed N`; the table holds its scores, and mean and least R2 are printed."""
    out = tmp_path / "seeds"
    assert call("run", "paper", "--seeds", "2,5-6", "--out", str(out), "--no-report", *SHORT) == 0
    printed = capsys.readouterr().out
    alone = tmp_path / "alone"
    assert call("run", "paper", "--seed", "5", "--out", str(alone), "--no-report", *SHORT) == 0
    assert (out / "seed_5" / "metrics.json").read_bytes() == (alone / "metrics.json").read_bytes()
    with (out / "seeds.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["seed"] for row in rows] == ["2"] * 12 + ["5"] * 12 + ["6"] * 12
    wanted = ("momentum", "left", "Fy")
    r2 = [float(row["r2"]) for row in rows if (row["observer"], row["point"], row["axis"]) == wanted]
    line = next(line for line in printed.splitlines() if re.match(r"momentum +left +Fy +3 ", line))
    assert float(line.split()[4]) == pytest.approx(sum(r2) / 3, abs=6e-6)
    assert float(line.split()[5]) == pytest.approx(min(r2), abs=6e-6)
    assert printed.endswith(f"open {out / 'seeds.csv'}\n")
    assert call("run", "paper", "--seeds", "7", "--out", str(out), *SHORT) == 2
    assert "seeds.csv exists; --force overwrites it" in capsys.readouterr().err
    assert call("run", "paper", "--seeds", "6", "--out", str(out), "--no-report", "--force", *SHORT) == 0
    assert capsys.readouterr().out.endswith("of earlier runs, and not in the table: seed_2, seed_5\n")


def test_two_runs_stand_side_by_side(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What differs, both scores of every axis as `metrics.json` has them, the forces, and figures that both have."""
    for name, words in (("one, calm", []), ("two", ["--set", "believed.air.density=1.47"])):
        assert call("run", "paper", "--out", name, "--no-report", *SHORT, *words) == 0
        (here / name / "figures").mkdir()
        (here / name / "figures" / "states.png").write_bytes(b"\x89PNG")
    capsys.readouterr()
    assert call("compare", "one, calm", "two") == 0
    printed = capsys.readouterr().out
    assert "in two: believed.air.density = 1.47\n" in printed
    both = [json.loads((here / name / "metrics.json").read_text())["observers"] for name in ("one, calm", "two")]
    score = [f"{found['force_level']['right']['Fz']['r2']:.5f}" for found in both]
    assert re.search(rf"force_level +right +Fz +{score[0]} +{score[1]} ", printed)
    folder = here / "runs" / "compare-one, calm-two"
    names = ["comparison.csv", "comparison.html", "forces.pdf", "forces.png", "replay.html"]
    assert sorted(path.name for path in folder.iterdir()) == names
    table = list(csv.reader((folder / "comparison.csv").read_text().splitlines()))
    assert (len(table), {len(row) for row in table}, table[0][3]) == (13, {7}, "R2 one, calm")
    page = (folder / "comparison.html").read_text()
    assert "momentum is off the true force by " in page
    assert page.count("data:image/png;base64,") == 3
    assert score[1] in page
    pair = compare_runs(here / "one, calm", here / "two")
    others = {("kalman", *place): score for (_, *place), score in pair.second.scores.items()}
    assert replace(pair, second=replace(pair.second, scores=others)).verdict.startswith("No observer's forces")
    total = (run.estimates.isel(point=[0]).assign_coords(point=["sum"]) for run in (pair.first, pair.second))
    first, second = (replace(pair.first, estimates=one) for one in total)
    blind = replace(first, log=FlightLog(first.log.measured))
    both = replace(pair, first=blind, second=second)
    assert [line for line in both.missing if "true force" in line][1:] == []
    assert "actual" in [text.get_text() for text in both.draw().legends[0].get_texts()]
    assert call("compare", "one, calm", "runs") == 2
    assert "runs is not the folder of a run: it has no scenario.toml" in capsys.readouterr().err
    assert call("play", str(folder)) == 2
    assert f"it has a replay: open {folder / 'replay.html'}" in capsys.readouterr().err
    (here / "circle").symlink_to("circle")
    assert call("compare", "circle", "circle") == 2
    assert "circle is not the folder of a run" in capsys.readouterr().err
    (here / "two" / "metrics.json").write_text("[]")
    assert call("compare", "one, calm", "two", "--force") == 2
    assert "the scores of a run were expected" in capsys.readouterr().err


def test_the_version_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    assert call("--version") == 0
    assert capsys.readouterr().out == f"aerobat {aerobat_pin.__version__}\n"


COMPLETED = {"run pap": "paper_open_loop", "sweep gain": "gain_noise", "urdf aerobat_l": "aerobat_light"}
COMPLETED |= {"run paper --set crank.f": "crank.frequency=", "run paper --observer kal": "kalman"}
COMPLETED |= {"describe scenario unknown_force.*.fr": "unknown_force.*.frame", "crank aerobat_g": "aerobat_guard"}
COMPLETED |= {"describe map joints.eff": "joints.effort.columns", "com": "compare"}
COMPLETING = """
import os, sys
from aerobat_pin.cli import main
for typed in sys.argv[1:]:
    sys.argv = ["aerobat"]
    os.environ |= {"COMP_WORDS": f"aerobat {typed}", "COMP_CWORD": str(len(typed.split()))}
    try:
        main()
    except SystemExit:
        print(end="\\0")
"""


def test_a_shell_completes_what_can_be_named() -> None:
    """As bash asks for it: commands, scenarios, sweeps, morphologies, observers and keys."""
    asked = os.environ | {"_AEROBAT_COMPLETE": "complete_bash"}
    command = [sys.executable, "-c", COMPLETING, *COMPLETED]
    done = subprocess.run(command, env=asked, capture_output=True, text=True, check=False)
    offered = [words.split() for words in done.stdout.split("\0")[:-1]]
    assert len(offered) == len(COMPLETED), done.stderr
    for (typed, wanted), words in zip(COMPLETED.items(), offered, strict=True):
        assert wanted in words, typed


@pytest.mark.parametrize(
    ("now", "before"), [("crank --out", "crank --output"), ("urdf -o", "urdf --output"), ("linkage --out", None)]
)
def test_out_is_called_so_everywhere_and_makes_folders(
    now: str, before: str | None, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """`--out` and `-o` take a file in folders that are not there yet; what they were called is told and still works."""
    suffix = {"crank": "html", "urdf": "urdf", "linkage": "png"}[now.split()[0]]
    assert call(*now.split(), f"new/folder/file.{suffix}") == 0
    assert Path("new", "folder", f"file.{suffix}").stat().st_size > 1000
    assert "note:" not in capsys.readouterr().err
    if before is not None:
        door, option = before.split()
        assert call(door, f"{option}=old/file.{suffix}") == 0
        assert f"note: {option} of `aerobat {door}` is called --out now" in capsys.readouterr().err
        assert Path("old", f"file.{suffix}").exists()


def test_every_command_that_writes_has_the_same_out_and_force() -> None:
    """Both spellings of `--out`; `--force` with the same words, or names that are free, as `live` finds them."""
    for name, command in get_command(app).commands.items():
        options = {option: one for one in command.params for option in one.opts}
        assert ("--force" in options) == ("--out" in options) or name == "live", name
        if "--out" in options:
            assert options["--out"] is options["-o"], name
        if "--force" in options:
            assert options["--force"].help == "Replace earlier results.", name


def test_a_port_that_is_taken_is_one_message(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from aerobat_pin.errors import OutputError
    from aerobat_pin.visualization import serve

    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(OutputError, match=rf"--port {port}: Address already in use"):
            serve("page", print, port)


@pytest.fixture(scope="module")
def short() -> Experiment:
    """Run `paper` for 50 ms."""
    return run(load_scenario("paper", ["simulation.duration=0.05", 'observers.names=["momentum"]']))


@pytest.fixture(scope="module")
def good(short: Experiment, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("short")
    write(short, folder)
    return folder


def refused(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    """Run a command that must fail with exit code 2, and return its message: one line on standard error."""
    assert call(*words) == 2
    printed = capsys.readouterr()
    assert printed.err.startswith("error: ")
    assert printed.err.count("\n") == 1
    return printed.err


def _cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:4000])


def _foreign(path: Path) -> None:
    path.write_text("notes")


def _changed(change: Callable[[xr.Dataset], xr.Dataset]) -> Callable[[Path], None]:
    def write_changed(path: Path) -> None:
        data = change(xr.load_dataset(path, engine="h5netcdf"))
        path.unlink()
        data.to_netcdf(path, engine="h5netcdf")

    return write_changed


def _linked(path: Path) -> None:
    with h5py.File(path, "r+") as file:
        del file["force_W"]
        file["force_W"] = h5py.ExternalLink("/etc/passwd", "/x")


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (_cut, "cannot be read as NetCDF-4: .*truncated"),
        (_foreign, "cannot be read as NetCDF-4"),
        (_linked, "'force_W' is a link to another place or file"),
        (_changed(lambda data: data.drop_vars("force_W")), "no channel force_W"),
        (_changed(lambda data: data.isel(interval=slice(5))), "its 5 intervals are not the 50 of the flight log"),
        (_changed(lambda data: data.assign_coords(point=["a", "b"])), "the robot has no frame a, b"),
        (_changed(lambda data: data.assign_coords(axis=["x", "x", "z"])), "axis has no labels or one label twice"),
        (_changed(lambda data: data.assign_coords(axis=["x", "y", "w"])), "axis has the labels x, y, w: x, y, z were"),
        (
            _changed(lambda data: data.where(data.interval != data.interval[3])),
            r"force_W at momentum, 0\.003, left_force",
        ),
    ],
)
def test_a_run_with_spoilt_estimates_is_not_played(
    spoil: Callable[[Path], None], message: str, good: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Cut, foreign, linked, of another flight, of another robot, with wrong labels, with a gap."""
    folder = tmp_path / "run"
    shutil.copytree(good, folder)
    spoil(folder / "estimate.nc")
    page = tmp_path / "page.html"
    told = refused(capsys, "play", str(folder), "--out", str(page))
    assert "estimate.nc" in told
    assert re.search(message, told), told
    assert not page.exists()


def test_axes_in_another_order_are_played_alike(good: Path, tmp_path: Path) -> None:
    """Labels decide in estimates too: components and dimensions in reverse."""
    log, path = FlightLog.load(good / "flight.nc"), tmp_path / "estimate.nc"
    straight = read_estimates(good / "estimate.nc", log)
    shutil.copyfile(good / "estimate.nc", path)
    _changed(lambda data: data.isel(axis=slice(None, None, -1)).transpose())(path)
    xr.testing.assert_equal(read_estimates(path, log), straight)
