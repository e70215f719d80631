"""`aerobat calibrate` and `--calibration`: from a free run to a run that uses it, and what mistakes cost."""

import json
from pathlib import Path

import pytest
from support.commands import call

from aerobat_pin.aerobat import FlightLog, write_csv
from aerobat_pin.estimation import read_calibration

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
