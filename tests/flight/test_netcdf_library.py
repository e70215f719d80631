"""The files that this package writes, as the NetCDF C library (and so MATLAB, nco and ncdump) sees them."""

import json
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray as xr
from support.tools import need

from aerobat_pin.errors import LogError
from aerobat_pin.experiments.write_results import write_netcdf
from aerobat_pin.records import netcdf_bytes, read_netcdf

SEAL_SIZE = 12  # bytes at the end of a file

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
    for place in rng.integers(len(content) - SEAL_SIZE, size=30):
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
