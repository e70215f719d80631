"""The flight log keeps all through a file, which the NetCDF library reads, too; one message for what is no flight."""

import io
import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray as xr
from support.bad_logs import HARMLESS, KINDS, Kind, write_kind
from support.further import further
from support.tools import need

from aerobat_description import MORPHOLOGIES
from aerobat_pin.aerobat import (
    JOINTS,
    FlightLog,
    belief_about,
    believed_robot,
    known_inputs,
    load_aerobat,
    read_log,
    write_csv,
)
from aerobat_pin.errors import AerobatError, LogError
from aerobat_pin.experiments import Experiment, estimate_dataset
from aerobat_pin.experiments.write_results import write_netcdf
from aerobat_pin.flight import simulate
from aerobat_pin.records import checked_netcdf, netcdf_bytes, read_netcdf
from aerobat_pin.scenario import load_scenario


def test_a_log_survives_its_file(paper: Experiment, tmp_path: Path) -> None:
    """NetCDF-4 and back: every number, unit and attribute, measured and true."""
    paper.log.save(tmp_path / "flight.nc")
    again = FlightLog.load(tmp_path / "flight.nc")
    xr.testing.assert_identical(again.measured, paper.log.measured)
    assert again.truth is not None
    xr.testing.assert_equal(again.truth, paper.log.truth)


def test_a_file_is_what_xarray_writes(paper: Experiment) -> None:
    """Names, dimensions, units, types and values, as xarray reads them; for texts, truth values and scalars too."""
    odd = xr.Dataset(
        {"truth": ("k", [True, False]), "scalar": 3, "word": "so", "none": (("e", "k"), np.zeros((0, 2)))},
        {"k": ["ä", ""], "other": ("k", [1.0, np.nan]), "elsewhere": ("bare", [1, 2, 3])},
        {"number": 2.5, "text": "", "numbers": [1.0, 2.0], "words": ["a", "b"]},
    )
    for parts in ([paper.log.measured, paper.log.truth], [estimate_dataset(paper.estimates)], [odd]):
        ours, expected = io.BytesIO(netcdf_bytes(*parts)), io.BytesIO()
        for group, mode, data in zip((None, "truth"), "wa", parts, strict=False):
            data.to_netcdf(expected, mode=mode, group=group, engine="h5netcdf")
        for group in (None, "truth")[: len(parts)]:
            found, right = (xr.load_dataset(file, group=group, engine="h5netcdf") for file in (ours, expected))
            xr.testing.assert_identical(found, right)
            assert {key: found[key].dtype for key in found} == {key: right[key].dtype for key in right}


def test_an_observer_is_fed_from_the_measured_side_alone(paper: Experiment) -> None:
    """Without its truth a log gives the same inputs, each with its source."""
    whole, blind = (known_inputs(log, paper.robot) for log in (paper.log, FlightLog(paper.log.measured)))
    np.testing.assert_array_equal(whole.tau, blind.tau)
    assert set(blind.known) == {"aerodynamic", "added_mass", "thrusters"}
    assert blind.source["motor_torque"] == "measured"
    assert blind.source["aerodynamic"] == "reconstructed"


def test_a_crank_that_jumps_by_full_turns_is_the_same_crank(paper: Experiment) -> None:
    """As an encoder of one turn shows it; the air's force takes its rate and acceleration."""
    jumping = paper.log.measured.copy(deep=True)
    jumping["crank_angle"].values[:] = (jumping["crank_angle"] + np.pi) % (2.0 * np.pi) - np.pi
    smooth, jumps = (known_inputs(FlightLog(each), paper.robot).known for each in (paper.log.measured, jumping))
    for name, force in smooth.items():
        np.testing.assert_allclose(jumps[name], force, atol=1e-6)


def test_what_is_not_a_flight_is_refused(paper: Experiment, tmp_path: Path) -> None:
    """Missing channels, missing or backward time, intervals that do not fit, and files of another kind."""
    measured = paper.log.measured
    with pytest.raises(LogError, match="no channel named q or pose"):
        FlightLog(measured.drop_vars("q"))
    with pytest.raises(LogError, match="no coordinate named time"):
        FlightLog(measured.drop_vars("time"))
    with pytest.raises(LogError, match="must not decrease"):
        FlightLog(measured.assign_coords(time=measured["time"].values[::-1]))
    with pytest.raises(LogError, match="intervals between"):
        FlightLog(measured.isel(interval=slice(0, -2)))
    (tmp_path / "flight.nc").write_text("not a flight")
    with pytest.raises(LogError, match="cannot be read"):
        FlightLog.load(tmp_path / "flight.nc")
    with pytest.raises(LogError, match="cannot be read"):
        FlightLog.load(tmp_path / "missing.nc")


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


# In a process of its own, as the library brings another HDF5 than h5py. Prints of each file group -> what it holds.
READER = """
import json, sys
import netCDF4, numpy as np

def told(group):
    found = {}
    for name, item in group.variables.items():
        item.set_auto_mask(False)
        values = np.asarray(item[...])
        if values.dtype.kind == "f":
            values = [float(x) if np.isfinite(x) else str(x) for x in values.ravel().tolist()]
        else:
            values = values.ravel().tolist()
        notes = {key: np.asarray(item.getncattr(key)).tolist() for key in item.ncattrs() if key != "_FillValue"}
        found[name] = [list(item.dimensions), list(item.shape), values, notes]
    notes = {key: np.asarray(group.getncattr(key)).tolist() for key in group.ncattrs()}
    return [found, notes, {name: len(size) for name, size in group.dimensions.items()}]

for path in sys.argv[1:]:
    with netCDF4.Dataset(path) as file:
        assert file.file_format == "NETCDF4"
        found = {"": told(file)} | {name: told(group) for name, group in file.groups.items()}
    with netCDF4.Dataset(path, "a") as file:
        file.setncattr("seen", "by another library")
        file.renameVariable(next(iter(file.variables)), "renamed")
    print(json.dumps(found))
"""


def parts() -> tuple[xr.Dataset, xr.Dataset]:
    """Return a dataset of every kind of variable and attribute, and one for the group `truth` of other sizes."""
    time = np.array([0.0, 0.1, 0.2])
    root = xr.Dataset(
        {
            "plain": (("time", "bare"), np.arange(6.0).reshape(3, 2), {"units": "m/s²", "long_name": "größe"}),
            "square": (("time", "other_time"), np.eye(3), {"units": "1"}),
            "single": (("time",), np.array([1.0, np.nan, np.inf], np.float32)),
            "whole": (("time",), np.arange(3), {"range": np.array([1, 2])}),
            "words": (("time",), np.array(["", "ä b", "日本"])),
            "nothing": (("time", "empty"), np.zeros((3, 0))),
            "number": ((), 3.5),
            "word": ((), "Ω"),
        },
        {"time": time, "other_time": [5, 6, 7], "name": ("time", ["x", "y", "z"])},
        {"title": "größe", "several": ["a", "b"], "count": 3, "share": 0.5},
    )
    truth = xr.Dataset(
        {
            "shorter": (("time", "axis"), np.ones((2, 3)), {"units": "N"}),
            "same": (("bare", "axis"), np.full((2, 3), 2.0)),
        },
        {"axis": list("xyz")},
    )
    return root, truth


def test_the_netcdf_library_reads_the_same(tmp_path: Path, paper_folder: Path) -> None:
    """Every variable, dimension, attribute and text of all kinds, and of a flight; and it can write to the file."""
    need("netCDF4")
    (tmp_path / "kinds.nc").write_bytes(netcdf_bytes(*parts()))
    for name in ("flight.nc", "estimate.nc"):
        (tmp_path / name).write_bytes((paper_folder / name).read_bytes())
    paths = [tmp_path / name for name in ("kinds.nc", "flight.nc", "estimate.nc")]
    written = [read_netcdf(path, "log", ["truth"]) for path in paths]
    run = subprocess.run([sys.executable, "-c", READER, *map(str, paths)], capture_output=True, check=False)
    assert run.returncode == 0, run.stderr.decode()
    for expected, told in zip(written, run.stdout.splitlines(), strict=True):
        found = json.loads(told)
        assert set(found) == set(expected)
        sizes = {}
        for part, data in expected.items():
            variables, notes, dims = found[part]
            sizes |= dims
            assert set(variables) == set(map(str, data.variables))
            told = {key: np.asarray(value).tolist() for key, value in data.attrs.items()}
            assert told == {key: value for key, value in notes.items() if key != "coordinates"}
            assert all(sizes[str(dim)] == size for dim, size in data.sizes.items())
            for key, item in data.variables.items():
                there, shape, values, own = variables[str(key)]
                assert (tuple(there), tuple(shape)) == (item.dims, item.shape), key
                if item.dtype.kind == "f":
                    np.testing.assert_array_equal(np.array(values, float).reshape(shape), item.values)
                else:
                    assert values == item.values.ravel().tolist(), key
                notes_of = {label: value for label, value in own.items() if label != "coordinates"}
                assert notes_of == {label: np.asarray(value).tolist() for label, value in item.attrs.items()}, key


def test_the_seal_notices_damage_before_the_library_reads_and_goes_when_the_library_writes(tmp_path: Path) -> None:
    """Any changed byte before the seal is damage; an edit by HDF5 leaves a file without a seal, which is read."""
    path, content = tmp_path / "kinds.nc", netcdf_bytes(*parts())
    rng = np.random.default_rng(0)
    for place in rng.integers(len(content) - 12, size=30):  # before the seal
        damaged = bytearray(content)
        damaged[place] ^= int(rng.integers(1, 256))
        path.write_bytes(damaged)
        with pytest.raises(LogError, match=r"kinds\.nc: cannot be read as NetCDF-4: it is damaged"):
            read_netcdf(path, "log", ["truth"])
    for edit in (lambda file: file["number"].write_direct(np.array(7.0)), lambda file: file.attrs.create("seen", 1)):
        path.write_bytes(content)
        with h5py.File(path, "r+") as file:
            edit(file)
        xr.testing.assert_equal(read_netcdf(path, "log", ["truth"])["truth"], parts()[1])


def test_a_file_written_block_by_block_is_sealed(tmp_path: Path) -> None:
    """It holds all blocks, and a changed bit is noticed."""
    path = tmp_path / "blocks.nc"
    write_netcdf((xr.Dataset({"x": (("interval",), np.full(5, float(k)))}) for k in range(3)), 15, path)
    np.testing.assert_array_equal(read_netcdf(path, "estimates")[""]["x"], np.repeat([0.0, 1.0, 2.0], 5))
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)
    with pytest.raises(LogError, match="it is damaged"):
        read_netcdf(path, "estimates")
