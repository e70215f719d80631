"""Flight logs that cannot be read, or must not be, class 2 of `bad_logs`; and with wrong labels or units, class 1."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import xarray as xr

from aerobat_pin.aerobat.flight_log import FlightLog
from support.log_kinds import (
    Cells,
    Rng,
    bytes_kind,
    cells_kind,
    dataset_kind,
    file_kind,
    hdf5_kind,
    save,
    some,
)


@bytes_kind(2, "cut file")
def _cut(rng: Rng, data: bytes) -> bytes:
    return data[: rng.integers(len(data) - 8)]


@bytes_kind(2, "damaged start of the file")
def _damaged_start(rng: Rng, data: bytes) -> bytes:
    return bytes(rng.integers(0, 256, 64, dtype=np.uint8)) + data[64:]


@bytes_kind(2, "other kind of file")
def _other(rng: Rng, data: bytes) -> bytes:
    return [b"", b"a note\n", b"\x89PNG\r\n\x1a\n" + data[:500], b"CDF\x01" + data[4:], b"\0" * 4096][rng.integers(5)]


@file_kind(2, "damaged numbers")
def _damaged_numbers(rng: Rng, log: FlightLog, path: Path) -> None:
    save(log, path)
    with h5py.File(path) as file:
        item = file[some(rng, log.measured.data_vars)].id
        chunk = item.get_chunk_info(0) if item.get_num_chunks() else None
        start, size = (chunk.byte_offset, chunk.size) if chunk else (item.get_offset(), item.get_storage_size())
    data = bytearray(path.read_bytes())
    at = start + int(rng.integers(size - 8))
    data[at : at + 4] = bytes(byte ^ 0x55 for byte in data[at : at + 4])
    path.write_bytes(data)


@hdf5_kind(2, "foreign group")
def _foreign_group(rng: Rng, file: h5py.File, path: Path) -> None:
    file.create_group(some(rng, ("notes", "Truth", "truth/inner", "é")))["x"] = 1.0


@hdf5_kind(2, "truth that is none")
def _empty_truth(rng: Rng, file: h5py.File, path: Path) -> None:
    names = ("force_W", "force_noise_free_W", "aerodynamic", "strip_force_z", "motor_power")
    del file["truth"][some(rng, names)]


@hdf5_kind(2, "unknown channel")
def _unknown_channel(rng: Rng, file: h5py.File, path: Path) -> None:
    file.move("crank_angle", some(rng, ("crank_angel", "angle", "²")))


@hdf5_kind(2, "no clock")
def _no_clock(rng: Rng, file: h5py.File, path: Path) -> None:
    del file[some(rng, ("time", "interval"))]


@hdf5_kind(2, "link to another place")
def _link(rng: Rng, file: h5py.File, path: Path) -> None:
    del file["airspeed"]
    links = (h5py.ExternalLink("/etc/passwd", "/x"), h5py.ExternalLink(path.name, "/q"), h5py.SoftLink("/crank_angle"))
    file["airspeed"] = links[rng.integers(3)]


@hdf5_kind(2, "values in another file")
def _external(rng: Rng, file: h5py.File, path: Path) -> None:
    shape, _ = file["airspeed"].shape, file.pop("airspeed")
    if rng.random() < 0.5:
        file.create_dataset("airspeed", shape, "f8", external=[("/etc/passwd", 0, 8 * shape[0])])
    else:
        layout = h5py.VirtualLayout(shape, "f8")
        layout[:] = h5py.VirtualSource("/tmp/other.nc", "x", shape)
        file.create_virtual_dataset("airspeed", layout)


@hdf5_kind(2, "absurd size")
def _absurd(rng: Rng, file: h5py.File, path: Path) -> None:
    file.pop("airspeed")
    count = int(rng.choice([10**6, 10**10, 2**50]))
    file.create_dataset("airspeed", (count,), "f8", chunks=(1000,), compression=[None, "gzip"][rng.integers(2)])


@hdf5_kind(2, "type without numbers")
def _compound(rng: Rng, file: h5py.File, path: Path) -> None:
    count = len(file.pop("airspeed"))
    types = [np.dtype([("a", "f8")]), h5py.vlen_dtype(float), h5py.ref_dtype, np.dtype("c16"), np.dtype("V8")]
    file.create_dataset("airspeed", (count,), types[rng.integers(len(types))]).attrs["units"] = "m/s"


@hdf5_kind(2, "packed numbers")
def _packed(rng: Rng, file: h5py.File, path: Path) -> None:
    file[some(rng, ("q", "v", "airspeed"))].attrs[some(rng, ("scale_factor", "add_offset"))] = 2.0


@dataset_kind(2, "channel of another length")
def _other_length(rng: Rng, data: xr.Dataset) -> xr.Dataset:
    name = some(rng, ("airspeed", "crank_angle"))
    short = data[name].values[: rng.integers(1, data.sizes["time"])]
    return data.assign({name: (("short",), short, data[name].attrs)})


@dataset_kind(2, "text or dates for numbers")
def _text(rng: Rng, data: xr.Dataset) -> xr.Dataset:
    name, count = some(rng, ("airspeed", "crank_angle")), data.sizes["time"]
    wrong = (np.array(["3.0"] * count), np.zeros(count, bool))
    data = data.assign({name: (("time",), wrong[rng.integers(2)], data[name].attrs)})
    return data


@dataset_kind(2, "not a number")
def _nan(rng: Rng, data: xr.Dataset) -> xr.Dataset:
    values = data[some(rng, data.data_vars)].values
    values[tuple(rng.integers(n) for n in values.shape)] = rng.choice([np.nan, np.inf, -np.inf, 1e300, -1e12])
    return data


@dataset_kind(2, "fill values")
def _fill(rng: Rng, data: xr.Dataset) -> xr.Dataset:
    name = some(rng, ("airspeed", "crank_angle"))
    data[name].values[rng.integers(data.sizes["time"])] = -999.0
    data[name].encoding["_FillValue"] = -999.0
    return data


@dataset_kind(2, "time that is none")
def _time(rng: Rng, data: xr.Dataset) -> xr.Dataset:
    time = data["time"].values.copy()
    k = int(rng.integers(1, len(time)))
    time[k] = rng.choice([np.nan, np.inf, time[k - 1] - 0.01, -1.0])
    return data.assign_coords(time=("time", time, data["time"].attrs))


@dataset_kind(2, "quaternion of another length")
def _length(rng: Rng, data: xr.Dataset) -> xr.Dataset:
    data["q"].values[rng.integers(data.sizes["time"]), 3:7] *= rng.choice([0.0, 0.5, 3.0])
    return data


@dataset_kind(2, "joints in degrees")
def _degrees(rng: Rng, data: xr.Dataset) -> xr.Dataset:
    data["q"].values[:, 7:] *= 180.0 / np.pi
    return data


@dataset_kind(2, "no configuration")
def _no_q(rng: Rng, data: xr.Dataset) -> xr.Dataset:
    return data.drop_vars(["q", "q_axis"])


@dataset_kind(2, "wrong attribute")
def _attribute(rng: Rng, data: xr.Dataset) -> xr.Dataset:
    key = some(rng, ("morphology", "morphology_changes", "air", "gravity"))
    wrong: list[Any] = [np.array([1.0, 2.0]), -1.0, "[" * 9000, "²", "aerobot"]
    data.attrs[key] = wrong[rng.integers(len(wrong))]
    return data


@dataset_kind(2, "huge attribute")
def _huge_attribute(rng: Rng, data: xr.Dataset) -> xr.Dataset:
    data.attrs["notes"] = np.zeros(200_000)
    return data


@bytes_kind(2, "other kind of table", ".csv")
def _other_table(rng: Rng, text: bytes) -> bytes:
    first = text.splitlines()[0]
    others = [
        b"",
        b"\n\n",
        first + b"\n",
        bytes(range(256)) * 20,
        text.decode().encode("utf-16"),
    ]
    others += [b"time," * 100_000, b'"' + text, first + b"\n" + b"\0" * 500]
    return others[rng.integers(len(others))]


@cells_kind(2, "cell without a number")
def _cell(rng: Rng, rows: Cells) -> None:
    words = ("", "far", "nan", "inf", "²", "1,5", "0x10", "9" * 5000, "1e999", "2020-01-01", "--1", "1 2", "TRUE")
    rows[rng.integers(1, len(rows))][rng.integers(len(rows[0]))] = some(rng, words)


@cells_kind(2, "row of another length")
def _row(rng: Rng, rows: Cells) -> None:
    k = rng.integers(1, len(rows))
    rows[k] = rows[k][:-1] if rng.random() < 0.5 else [*rows[k], "0"]


@cells_kind(2, "time that does not rise")
def _time_cell(rng: Rng, rows: Cells) -> None:
    k = rng.integers(2, len(rows))
    rows[k][0] = some(rng, (rows[k - 1][0], "-1"))


@cells_kind(2, "degrees in a table")
def _degrees_cells(rng: Rng, rows: Cells) -> None:
    names = [cell.partition(" ")[0] for cell in rows[0]]
    k = names.index(some(rng, ("crank_angle", "left_elbow", "right_elbow")))
    for row in rows[1:]:
        row[k] = repr(float(row[k]) * 180.0 / np.pi)


@cells_kind(2, "quaternion of another length in a table")
def _length_cells(rng: Rng, rows: Cells) -> None:
    row = rows[rng.integers(1, len(rows))]
    row[4:8] = some(rng, ("0 0 0 0", "1 1 1 1", "0 0 0 0.5")).split()


@cells_kind(2, "milliseconds")
def _milliseconds(rng: Rng, rows: Cells) -> None:
    for row in rows[1:]:
        row[0] = repr(float(row[0]) * 1000.0)


@dataset_kind(1, "columns in another order")
def _shuffled(rng: Rng, data: xr.Dataset) -> xr.Dataset:
    return data.isel({dim: rng.permutation(data.sizes[dim]) for dim in ("q_axis", "v_axis")})


@dataset_kind(1, "dimensions in another order")
def _transposed(rng: Rng, data: xr.Dataset) -> xr.Dataset:
    return data.transpose("v_axis", "q_axis", "interval", "time")


def _relabelled(rng: Rng, data: xr.Dataset, change: Callable[[list[str], int], Any]) -> xr.Dataset:
    dim = some(rng, ("q_axis", "v_axis"))
    labels = [str(label) for label in data[dim].values]
    change(labels, int(rng.integers(len(labels))))
    return data.assign_coords({dim: labels})


@dataset_kind(1, "unknown label")
def _unknown_label(rng: Rng, data: xr.Dataset) -> xr.Dataset:
    word = some(rng, ("joint_5", "", "Ä", "LEFT_SHOULDER", "x" * 300))
    return _relabelled(rng, data, lambda labels, k: labels.__setitem__(k, word))


@dataset_kind(1, "doubled label")
def _doubled_label(rng: Rng, data: xr.Dataset) -> xr.Dataset:
    return _relabelled(rng, data, lambda labels, k: labels.__setitem__(k, labels[k - 1]))


@dataset_kind(1, "missing label")
def _missing_label(rng: Rng, data: xr.Dataset) -> xr.Dataset:
    dim = some(rng, ("q_axis", "v_axis"))
    return data.isel({dim: np.delete(np.arange(data.sizes[dim]), rng.integers(data.sizes[dim]))})


@dataset_kind(1, "no labels")
def _no_labels(rng: Rng, data: xr.Dataset) -> xr.Dataset:
    return data.drop_vars(some(rng, ("q_axis", "v_axis")))


@dataset_kind(1, "numbers for labels")
def _numbered(rng: Rng, data: xr.Dataset) -> xr.Dataset:
    dim = some(rng, ("q_axis", "v_axis"))
    return data.assign_coords({dim: np.arange(data.sizes[dim])})


@dataset_kind(1, "wrong unit")
def _wrong_unit(rng: Rng, data: xr.Dataset) -> xr.Dataset:
    data[some(rng, data.data_vars)].attrs["units"] = some(rng, ("mm", "deg", "deg/s", "mN m", "", "seconds since 2020"))
    return data


@dataset_kind(1, "no unit")
def _no_unit(rng: Rng, data: xr.Dataset) -> xr.Dataset:
    del data[some(rng, data.data_vars)].attrs["units"]
    return data


@dataset_kind(1, "unit that is no text")
def _number_unit(rng: Rng, data: xr.Dataset) -> xr.Dataset:
    data[some(rng, data.data_vars)].attrs["units"] = [1.0, np.array([1, 2]), 7][rng.integers(3)]
    return data


@dataset_kind(1, "unit of time")
def _wrong_time_unit(rng: Rng, data: xr.Dataset) -> xr.Dataset:
    data["time"].attrs["units"] = some(rng, ("ms", "minutes", "days since 2000-01-01"))
    return data


@cells_kind(1, "unknown column")
def _unknown_column(rng: Rng, rows: Cells) -> None:
    rows[0][rng.integers(len(rows[0]))] = some(rng, ("height", "²", "", "q" * 500, "x[", "X [m]"))


@cells_kind(1, "doubled column")
def _doubled_column(rng: Rng, rows: Cells) -> None:
    k = rng.integers(1, len(rows[0]))
    rows[0][k] = rows[0][k - 1]


@cells_kind(1, "missing column")
def _missing_column(rng: Rng, rows: Cells) -> None:
    k = rng.integers(8)  # time, position and quaternion are required
    for row in rows:
        del row[k]


@cells_kind(1, "wrong unit of a column")
def _wrong_column_unit(rng: Rng, rows: Cells) -> None:
    k = rng.integers(len(rows[0]))
    rows[0][k] = f"{rows[0][k].partition('[')[0].strip()} [{some(rng, ('mm', 'deg', '°', 'furlong', ''))}]"
