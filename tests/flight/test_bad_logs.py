"""Log files from strangers: labels decide what a column is, and every mistake costs one message that names it."""

import os
import sys
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray as xr
from support.bad_logs import HARMLESS, KINDS, Kind, write_kind
from support.further import further

from aerobat_description import MORPHOLOGIES
from aerobat_pin.aerobat import JOINTS, FlightLog, belief_about, believed_robot, load_aerobat, read_log, write_csv
from aerobat_pin.errors import AerobatError, LogError
from aerobat_pin.flight import simulate
from aerobat_pin.records import checked_netcdf
from aerobat_pin.scenario import load_scenario


@pytest.fixture(scope="module")
def log() -> FlightLog:
    """Fly `paper` for 50 ms."""
    return simulate(load_scenario("paper", ["simulation.duration=0.05"]))


@pytest.mark.parametrize("seeds", [range(1), *further(range(1, 5))])
@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind.number in (1, 2)], ids=lambda kind: kind.name)
def test_a_bad_log_is_right_or_refused_in_a_message(kind: Kind, seeds: range, log: FlightLog, tmp_path: Path) -> None:
    """Each kind: an error of one line that names the file; a wrong attribute perhaps when the belief is loaded."""
    for seed in seeds:
        path = write_kind(kind, np.random.default_rng(seed), log, tmp_path)
        if kind.name in HARMLESS:
            xr.testing.assert_equal(read_log(path).measured, log.measured)
            continue
        with pytest.raises(AerobatError) as told:
            believed_robot(belief_about(read_log(path), "x", None, [], []))
        message = str(told.value)
        assert "\n" not in message
        assert len(message) < 600
        assert str(path) in message or kind.name == "wrong attribute"


def test_joints_in_another_order_give_the_same_forces(log: FlightLog, tmp_path: Path) -> None:
    """Joints in reverse, by file and memory: numbers go where their names say; the left Fx was off by 45 mN."""
    backwards = log.measured.isel(q_axis=slice(None, None, -1), v_axis=slice(None, None, -1))
    backwards.to_netcdf(tmp_path / "log.nc", engine="h5netcdf")
    for again in (FlightLog.load(tmp_path / "log.nc"), FlightLog(backwards)):
        xr.testing.assert_identical(again.measured, log.measured)


def test_every_robot_has_its_joints_in_the_order_of_a_log() -> None:
    """`LABELS` is the order of Pinocchio's configuration and velocity."""
    for name in MORPHOLOGIES:
        robot = load_aerobat(name)
        assert robot.idx_q == tuple(range(7, 11)), name
        assert robot.idx_v == tuple(range(6, 10)), name
        assert tuple(robot.model.names)[2:] == JOINTS, name


def test_a_log_made_in_python_may_leave_out_labels_and_units(log: FlightLog, tmp_path: Path) -> None:
    """They are those of the table; a file that is saved has them."""
    bare = log.measured.copy(deep=True).drop_vars(["q_axis", "v_axis"])
    for name in bare.data_vars:
        bare[name].attrs = {}
    FlightLog(bare).save(tmp_path / "log.nc")
    found = FlightLog.load(tmp_path / "log.nc").measured
    xr.testing.assert_equal(found, log.measured)
    assert found["v"].attrs["units"] == "m/s, rad/s"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda m: m["q"].values.__setitem__((12, 9), np.nan), r"'q', sample 12 \(0\.012 s\), right_shoulder = nan: a"),
        (lambda m: m["motor_torque"].values.__setitem__((3, 6), 1e300), r"interval 3 \(0\.003 s\), left_shoulder = 1e"),
        (lambda m: m["v"].attrs.update(units="mm/s"), r"channel 'v' has units = 'mm/s': 'm/s, rad/s' was expected"),
        (lambda m: m.attrs.update(gravity="heavy"), "attribute gravity = 'heavy': a number in m/s2 was expected"),
        (lambda m: m.attrs.update(air='{"density": -1}'), "attribute air: .*density"),
    ],
)
def test_a_message_names_channel_sample_and_limit(change: object, message: str, log: FlightLog, tmp_path: Path) -> None:
    measured = log.measured.copy(deep=True)
    change(measured)  # type: ignore[operator]
    measured.to_netcdf(tmp_path / "log.nc", engine="h5netcdf")
    with pytest.raises(LogError, match=rf"^flight log \S*log\.nc: .*{message}"):
        FlightLog.load(tmp_path / "log.nc")


def test_no_other_file_is_opened(log: FlightLog, tmp_path: Path) -> None:
    """A link to a FIFO would wait for ever, and one to another log would read it."""
    log.save(tmp_path / "log.nc")
    os.mkfifo(tmp_path / "pipe")
    with h5py.File(tmp_path / "log.nc", "r+") as file:
        del file["airspeed"]
        file["airspeed"] = h5py.ExternalLink("pipe", "/airspeed")
    with pytest.raises(LogError, match="'airspeed' is a link to another place or file"):
        FlightLog.load(tmp_path / "log.nc")


def test_sizes_are_checked_before_all_is_read(log: FlightLog, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a NetCDF file all channels together; of a table the bytes."""
    log.save(tmp_path / "log.nc")
    monkeypatch.setattr(checked_netcdf, "LARGEST_FILE", 50e3)
    with pytest.raises(LogError, match=r"its values take .* GB: at most 2 GB are read"):
        FlightLog.load(tmp_path / "log.nc")
    write_csv(replace(log, truth=None), tmp_path / "log.csv")
    monkeypatch.setattr(sys.modules["aerobat_pin.aerobat.kind_of_log"], "LARGEST_TABLE", 10e3)
    with pytest.raises(LogError, match=r"log\.csv: \d+ bytes: at most 10000\.0 were expected"):
        read_log(tmp_path / "log.csv")
    monkeypatch.undo()
    with pytest.raises(LogError, match="there is no such file"):
        read_log(tmp_path / ("x" * 300 + ".csv"))
    with pytest.raises(LogError, match="there is no such file"):
        read_log(tmp_path / ("x" * 300 + ".nc"))
