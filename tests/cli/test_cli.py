"""The command line: what it writes, and that a mistake costs one message, exit code 2 and nothing else."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from support.commands import call

from aerobat_pin.aerobat.flight_log import FlightLog
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
        assert call("run", "paper", "--out", out, "--no-report", *SHORT, *words) == 0
        printed = capsys.readouterr().out
        assert printed.count("a smaller observers.gain follows the sensors' noise less") == hints
        clean = [float(line.split()[4]) for line in printed.splitlines() if line.startswith("momentum  ")]
        assert (min(clean) < 0.0) == bool(hints)


def test_only_the_observers_asked_for_are_run(tmp_path: Path) -> None:
    """`--observer` may be repeated and replaces the scenario's choice."""
    out = tmp_path / "one"
    assert call("run", "paper", "--out", str(out), "--no-report", "--observer", "momentum", *SHORT) == 0
    assert list(json.loads((out / "metrics.json").read_text())["observers"]) == ["momentum"]


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


def test_what_a_killed_run_left_is_swept_away(tmp_path: Path) -> None:
    """A work folder of a run that was killed does not make the folder count as full."""
    (tmp_path / ".aerobat-dead").mkdir()
    assert call("run", "paper", "--out", str(tmp_path), "--no-report", *SHORT) == 0
    assert not (tmp_path / ".aerobat-dead").exists()


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
