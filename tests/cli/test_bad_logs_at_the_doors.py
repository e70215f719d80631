"""Bad estimates at the door that plays them: one message, exit code 2, and nothing written."""

import re
import shutil
from collections.abc import Callable
from pathlib import Path

import h5py
import pytest
import xarray as xr
from support.commands import call

from aerobat_pin.aerobat.flight_log import FlightLog
from aerobat_pin.experiments import Experiment, run, write
from aerobat_pin.experiments.write_results import read_estimates
from aerobat_pin.scenario.scenario import load_scenario


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
