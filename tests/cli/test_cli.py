"""The command line: what it writes, and that a mistake costs one message, exit code 2 and nothing else."""

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from support.commands import call

from aerobat_pin.aerobat import FlightLog, write_csv
from aerobat_pin.estimation import read_calibration
from aerobat_pin.experiments.experiment import run
from aerobat_pin.experiments.write_results import write_metrics
from aerobat_pin.scenario.scenario import load_scenario

SHORT = ["--set", "simulation.duration=0.02", "--set", "air.warm_up_cycles=1"]


def test_a_run_writes_what_it_promises(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Log, estimates, metrics and scenario; what was changed is said, and the last line says what to open."""
    out = tmp_path / "result"
    assert call("run", "paper", "--out", str(out), "--no-report", "--seed", "5", *SHORT) == 0
    assert sorted(path.name for path in out.iterdir()) == ["estimate.nc", "flight.nc", "metrics.json", "scenario.toml"]
    printed = capsys.readouterr().out
    assert "attitude held, 79 % thruster-borne" in printed
    assert "force_level" in printed
    assert f"results in {out}/: estimate.nc, flight.nc, metrics.json, scenario.toml\n" in printed
    assert printed.endswith(f"open {out / 'metrics.json'}\n")
    assert "\nchanged from paper: air.warm_up_cycles = 1, simulation.duration = 0.02, simulation.seed = 5\n" in printed
    metrics = json.loads((out / "metrics.json").read_text())
    assert metrics["changed"] == {"air.warm_up_cycles": 1, "simulation.duration": 0.02, "simulation.seed": 5}
    assert metrics["scenario"] == "paper"
    assert metrics["seed"] == 5
    assert set(metrics["observers"]) == {"momentum", "force_level"}
    one = metrics["observers"]["momentum"]
    assert set(one["left"]["Fx"]) == {"r2", "r2_noise_free", "rmse", "lag_s"}
    assert {"rank", "condition", "null_direction"} <= set(one)
    keys = {"position_end", "z_range", "roll_range", "pitch_range", "yaw_range"}
    assert keys <= set(metrics["flight"])
    log = FlightLog.load(out / "flight.nc")
    assert log.truth is not None
    assert log.measured["q"].attrs["units"]
    assert log.measured["q"].shape == (21, 11)
    estimate = xr.load_dataset(out / "estimate.nc", engine="h5netcdf")
    assert estimate["force_W"].dims == ("observer", "interval", "point", "axis")
    assert bool(np.isfinite(estimate["force_W"]).all())


def test_the_same_seed_gives_the_same_metrics_in_any_process(tmp_path: Path) -> None:
    """To the last bit, with noisy forces and sensors: a fresh process, and this one, twice."""
    command = [sys.executable, "-m", "aerobat_pin", "run", "noisy_sensors", "--no-report", *SHORT]
    subprocess.run([*command, "--out", str(tmp_path / "fresh")], check=True, capture_output=True)
    written = [(tmp_path / "fresh" / "metrics.json").read_bytes()]
    for _ in range(2):
        write_metrics(run(load_scenario("noisy_sensors", SHORT[1::2])).metrics, tmp_path)
        written.append((tmp_path / "metrics.json").read_bytes())
    assert len(set(written)) == 1


def test_an_estimate_that_drowns_in_noise_says_what_helps(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One line, only where sensors err and an R2 is below 0."""
    for name, settings, hints in (("noisy", ["sensors.gyro.noise=1.0"], 1), ("fine", ["sensors.gyro.noise=1e-9"], 0)):
        words = [word for one in settings for word in ("--set", one)]
        out = str(tmp_path / name)
        assert call("run", "paper", "--out", out, "--no-report", "--observer", "momentum", *SHORT, *words) == 0
        printed = capsys.readouterr().out
        assert printed.count("a smaller observers.gain follows the sensors' noise less") == hints
        clean = [float(line.split()[4]) for line in re.findall("^momentum +(?:left|right) .*", printed, re.MULTILINE)]
        assert (min(clean) < 0.0) == bool(hints)
        assert "force_level " not in printed


def test_only_force_replaces_a_run_and_other_files_stay(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Without --force the folder is refused untouched; with it only our own files change."""
    out = tmp_path / "run"
    out.mkdir()
    (out / "notes.txt").write_text("mine")
    (out / "report.html").write_text("old")
    assert call("run", "paper", "--out", str(out), "--no-report", *SHORT) == 2
    assert "not empty; --force" in capsys.readouterr().err
    assert sorted(path.name for path in out.iterdir()) == ["notes.txt", "report.html"]
    assert call("run", "paper", "--out", str(out), "--no-report", "--force", *SHORT) == 2
    assert "holds no earlier result (estimate.nc) that --force could replace" in capsys.readouterr().err
    assert (out / "report.html").read_text() == "old", "a file of that name alone is no result"
    (out / "estimate.nc").write_text("old")
    assert call("run", "paper", "--out", str(out), "--no-report", "--force", *SHORT) == 0
    assert (out / "notes.txt").read_text() == "mine"
    assert not (out / "report.html").exists(), "an old report would not belong to the new numbers"
    assert (out / "metrics.json").exists()


def test_a_way_through_a_missing_folder_is_followed_first(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`missing/../mine` is `mine`: not empty, so refused, and nothing is made on the way."""
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "metrics.json").write_text("mine")
    assert call("run", "paper", "--out", str(tmp_path / "missing" / ".." / "mine"), *SHORT) == 2
    assert "not empty" in capsys.readouterr().err
    assert (tmp_path / "mine" / "metrics.json").read_text() == "mine"
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]


def test_a_robot_of_ones_own_is_found_beside_its_scenario_and_travels_with_the_results(here: Path) -> None:
    """A relative morphology means: relative to the scenario file; the results hold a copy and run again anywhere."""
    mine = here / "mine"
    mine.mkdir()
    (mine / "bird.toml").write_text('extends = "aerobat_guard"\nname = "bird"\n[body]\nmass = 0.09\n')
    scenario = '[robot]\nmorphology = "bird.toml"\n[simulation]\nduration = 0.01\n[air]\nwarm_up_cycles = 0\n'
    (mine / "flight.toml").write_text(f'name = "flight"\n{scenario}')
    assert call("run", "mine/flight.toml", "--no-report") == 0
    first = here / "runs" / "flight"
    (mine / "bird.toml").unlink()
    moved = here / "moved"
    first.rename(moved)
    assert call("run", "moved/scenario.toml", "--out", "again", "--no-report") == 0
    assert (moved / "metrics.json").read_bytes() == (here / "again" / "metrics.json").read_bytes()


def test_trim_writes_a_scenario_that_flies(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Standard output alone is the scenario; with --out it is a file, here of a second search from there, quick."""
    coarse = ["--set", "simulation.dt=2e-3", "--set", "air.strips=4"]
    assert call("trim", "paper_open_loop", "--set", "crank.frequency=6.8", *coarse) == 0
    printed = capsys.readouterr()
    assert printed.err.startswith("from a first guess of 6.8 Hz: 6.958 Hz, wing offset -87.28 mm")
    assert "doubles in" in printed.err
    (tmp_path / "found.toml").write_text(printed.out)
    assert call("trim", str(tmp_path / "found.toml"), "--force", "--out", str(tmp_path / "found.toml")) == 0
    assert "6.958 Hz, wing offset -87.28 mm" in capsys.readouterr().out
    out = str(tmp_path / "run")
    short = ["--set", "simulation.duration=0.02"]
    assert call("run", str(tmp_path / "found.toml"), "--out", out, "--no-report", *short) == 0
    assert call("trim", "paper", "--set", "crank.frequency=0") == 2
    before = sorted(path.name for path in tmp_path.iterdir())
    for target, message in (("found.toml", "exists; --force"), ("run", "is a folder")):
        capsys.readouterr()
        assert call("trim", "paper_open_loop", "--out", str(tmp_path / target)) == 2
        assert message in capsys.readouterr().err
    assert sorted(path.name for path in tmp_path.iterdir()) == before


def test_a_trim_that_cannot_be_written_is_refused_before_it_is_sought(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A folder that takes no files, as one of somebody else's; the search takes a minute, the answer does not."""
    from importlib import import_module

    output = import_module("aerobat_pin.errors.whole_files")
    from aerobat_pin import flight

    monkeypatch.setattr(flight, "trim", lambda *_: pytest.fail("it was sought"))
    monkeypatch.setattr(output.os, "access", lambda path, mode: Path(path) != tmp_path)
    assert call("trim", "paper_open_loop", "--out", str(tmp_path / "found.toml")) == 2
    assert f"the folder {tmp_path} takes no files" in capsys.readouterr().err


QUICK = ["--set", "simulation.dt=2e-3", "--set", "air.strips=4", "--set", "air.warm_up_cycles=1"]
BELIEF = ["--set", "believed.air.density=1.47"]


def fly(out: str, *words: str) -> int:
    """Fly `paper` quickly and coarsely, with too dense an air believed."""
    return call("run", "paper", "--out", out, "--no-report", *QUICK, *BELIEF, *words)


@pytest.mark.usefixtures("unrendered")
def test_a_free_run_calibrates_another_run_and_its_log(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`metrics.json` names the calibration and what changed since, the folder has a copy, and `check` asks it alone."""
    free = ["--set", "unknown_force=[]", "--set", "simulation.duration=1"]
    assert fly("free", *free) == 0
    assert call("calibrate", "free", "--out", "c.nc", "--identify", "density") == 0
    printed = capsys.readouterr().out
    assert "density" in printed
    assert "of the known force aerodynamic; 12 harmonics of the crank" in printed
    assert read_calibration(here / "c.nc").changes["density"] == pytest.approx(-1.0 / 6.0, abs=0.02)
    assert fly("used", "--set", "simulation.duration=0.5", "--calibration", "c.nc") == 0
    metrics = json.loads((here / "used" / "metrics.json").read_text())
    assert metrics["calibration"].startswith("calibration: learnt from")
    assert metrics["model"]["verdict"] == "unchanged"
    assert set(metrics["observers"]["force_level"]["events"][0]) == {"point", "onset", "alarm", "end", "size"}
    assert metrics["observers"]["force_level"]["redundancy"]["verdict"] == "consistent"
    assert (here / "used" / "calibration.nc").is_file()
    assert "model: unchanged since the calibration" in capsys.readouterr().out
    short = ["--set", "simulation.duration=0.1"]
    assert call("check", "used", "--calibration", "c.nc", "--out", "same.png") == 0
    assert "model: unchanged since the calibration" in capsys.readouterr().out
    thin = ["--set", "air.density=1.1025", "--set", "simulation.duration=0.5"]
    assert fly("thin", "--calibration", "c.nc", "--correct", *thin) == 0
    model = json.loads((here / "thin" / "metrics.json").read_text())["model"]
    assert (model["verdict"], model["cause"]["name"], model["corrected"]) == ("changed", "air_density", True)
    assert model["cause"]["estimate"][0] == pytest.approx(-10.0, abs=3.0)
    assert call("check", "thin", "--calibration", "c.nc", "--out", "other.PNG") == 3
    assert "density of the air: change -" in capsys.readouterr().out
    assert (here / "other.PNG").stat().st_size > 1000
    log = FlightLog.load(here / "free" / "flight.nc")
    write_csv(log, here / "free.csv")
    robot = ["--morphology", "aerobat_guard", "--set", "robot.changes.wing.offset_x=-0.06", "--set", "air.strips=4"]
    assert call("calibrate", "free.csv", "--out", "hall.nc", "--identify", "none", *robot) == 0
    assert call("estimate", "free.csv", "--calibration", "hall.nc", "--out", "hall", *robot) == 0
    assert json.loads((here / "hall" / "metrics.json").read_text())["model"]["verdict"] == "unchanged"
    assert call("check", "free.csv", "--calibration", "hall.nc", *robot) == 0
    assert (here / "runs" / "free-check.png").is_file()
    assert json.loads((here / "free" / "metrics.json").read_text())["calibration"] is None
    capsys.readouterr()
    run = ["run", "paper", "--out", "new", *short, "--calibration"]
    for words, message in (
        (["calibrate", "used", "--out", "new.nc"], "an unknown force of"),
        (["calibrate", "free", "--out", "c.nc"], "--force overwrites it"),
        (["calibrate", "hall", "--out", "new.nc"], "is not the folder of a run"),
        (["calibrate", "nowhere.nc", "--out", "new.nc"], "there is no such file"),
        (["calibrate", "free", "--out", "new.nc", "--identify", "luck"], "parameters has 'luck'"),
        (["calibrate", "free", "--out", "new.nc", "--morphology", "aerobat"], "a log was expected"),
        ([*run, "c.nc"], "air.density = 1.47, but 1.225 is believed"),
        ([*run, "nowhere.nc"], "calibration nowhere.nc: cannot be"),
    ):
        assert call(*words) == 2, words
        assert message in capsys.readouterr().err
    assert not (here / "new").exists()
    assert not (here / "new.nc").exists()
