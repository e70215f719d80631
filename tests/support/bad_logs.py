"""Bad flight logs, one mistake each, drawn at random."""

# Of class 1 and 2 a program must refuse it with one message, but read `HARMLESS` as the good log; of 11 read it and
# warn by the name of the kind.

import io
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np
import xarray as xr

from aerobat_pin.aerobat import FlightLog, write_csv

Rng = np.random.Generator
HARMLESS = ("columns in another order", "dimensions in another order")
AXES = ("q_axis", "v_axis")
WRONG_NAMES = ("crank_angel", "angle", "²")  # of a crank angle
PARTS_OF_TRUTH = ("force_W", "force_noise_free_W", "aerodynamic", "strip_force_z", "motor_power")
GROUPS, PACK = ("notes", "Truth", "truth/inner", "é"), ("scale_factor", "_Unsigned")
PARTS = ("q", "v", "airspeed")
UNITS = ("mm", "deg", "deg/s", "mN m", "", "seconds since 2020")
TIME_UNITS = ("ms", "minutes", "days since 2000-01-01")


class Kind(NamedTuple):
    """A kind of bad log: class, name, what of a good log is changed, and a function that changes it."""

    # That is the `file`, by h5py, or its `bytes`; the `channels`, as they are or by the log's writer (`.nc`, `.csv`).

    number: int
    name: str
    part: str
    change: Callable[[Rng, Any], Any]


def write_kind(kind: Kind, rng: Rng, log: FlightLog, folder: Path) -> Path:
    """Write a bad log of a good simulated one of half a second or more, with its truth and exact sensors."""
    suffix = ".csv" if kind.part == ".csv" else ".nc"
    path = folder / f"bad_{kind.number}_{rng.integers(10**9)}{suffix}"
    if kind.part in ("channels", ".nc", ".csv"):
        data = log.measured.copy(deep=True)
        found = kind.change(rng, data)
        data = data if found is None else found
    if kind.part == "channels":
        data.to_netcdf(path, engine="h5netcdf")
    elif kind.part == ".nc":
        FlightLog(data).save(path)
    elif kind.part == ".csv":
        write_csv(FlightLog(data), path)
    elif kind.part == "file":
        save(log, path)
        with h5py.File(path, "r+") as file:
            kind.change(rng, file)
    else:
        save(log, path)
        path.write_bytes(kind.change(rng, path.read_bytes()))
    return path


_SAVED: list[tuple[FlightLog, bytes]] = []  # the last good log and its file: saving takes longest


def save(log: FlightLog, path: Path) -> None:
    if not _SAVED or _SAVED[0][0] is not log:
        log.save(path)
        _SAVED[:] = [(log, path.read_bytes())]
    path.write_bytes(_SAVED[0][1])


def some(rng: Rng, names: Any) -> str:
    return str(rng.choice(sorted(map(str, names))))


def _other_file(rng: Rng, data: bytes) -> bytes:
    return [b"", b"a note\n", b"\x89PNG\r\n\x1a\n" + data[:500], b"CDF\x01" + data[4:], b"\0" * 4096][rng.integers(5)]


def _damaged_numbers(rng: Rng, data: bytes) -> bytes:
    with h5py.File(io.BytesIO(data)) as file:
        item = file[some(rng, ("q", "v", "airspeed", "crank_angle", "motor_torque"))].id
        chunk = item.get_chunk_info(0) if item.get_num_chunks() else None
        start, size = (chunk.byte_offset, chunk.size) if chunk else (item.get_offset(), item.get_storage_size())
    at = start + int(rng.integers(size - 8))
    return data[:at] + bytes(byte ^ 0x55 for byte in data[at : at + 4]) + data[at + 4 :]


def _link(rng: Rng, file: h5py.File) -> None:
    del file["airspeed"]
    own = h5py.ExternalLink(Path(file.filename).name, "/q")
    links = (h5py.ExternalLink("/etc/passwd", "/x"), own, h5py.SoftLink("/crank_angle"))
    file["airspeed"] = links[rng.integers(3)]


def _external(rng: Rng, file: h5py.File) -> None:
    shape, _ = file["airspeed"].shape, file.pop("airspeed")
    if rng.random() < 0.5:
        file.create_dataset("airspeed", shape, "f8", external=[("/etc/passwd", 0, 8 * shape[0])])
    else:
        layout = h5py.VirtualLayout(shape, "f8")
        layout[:] = h5py.VirtualSource("/tmp/other.nc", "x", shape)
        file.create_virtual_dataset("airspeed", layout)


def _absurd(rng: Rng, file: h5py.File) -> None:
    file.pop("airspeed")
    count = int(rng.choice([10**6, 10**10, 2**50]))
    file.create_dataset("airspeed", (count,), "f8", chunks=(1000,), compression=[None, "gzip"][rng.integers(2)])


def _compound(rng: Rng, file: h5py.File) -> None:
    count = len(file.pop("airspeed"))
    types = [np.dtype([("a", "f8")]), h5py.vlen_dtype(float), h5py.ref_dtype, np.dtype("c16"), np.dtype("V8")]
    file.create_dataset("airspeed", (count,), types[rng.integers(len(types))]).attrs["units"] = "m/s"


def _other_length(rng: Rng, data: xr.Dataset) -> xr.Dataset:
    name = some(rng, ("airspeed", "crank_angle"))
    short = data[name].values[: rng.integers(1, data.sizes["time"])]
    return data.assign({name: (("short",), short, data[name].attrs)})


def _text(rng: Rng, data: xr.Dataset) -> xr.Dataset:
    name, count = some(rng, ("airspeed", "crank_angle")), data.sizes["time"]
    wrong = (np.array(["3.0"] * count), np.zeros(count, bool))
    return data.assign({name: (("time",), wrong[rng.integers(2)], data[name].attrs)})


def _nan(rng: Rng, data: xr.Dataset) -> None:
    values = data[some(rng, data.data_vars)].values
    values[tuple(rng.integers(n) for n in values.shape)] = rng.choice([np.nan, np.inf, -np.inf, 1e300, -1e12])


def _fill(rng: Rng, data: xr.Dataset) -> None:
    name = some(rng, ("airspeed", "crank_angle"))
    data[name].values[rng.integers(data.sizes["time"])] = -999.0
    data[name].encoding["_FillValue"] = -999.0


def _time(rng: Rng, data: xr.Dataset) -> xr.Dataset:
    time = data["time"].values.copy()
    k = int(rng.integers(1, len(time)))
    time[k] = rng.choice([np.nan, np.inf, time[k - 1] - 0.01, -1.0])
    return data.assign_coords(time=("time", time, data["time"].attrs))


def _length(rng: Rng, data: xr.Dataset) -> None:
    data["q"].values[rng.integers(data.sizes["time"]), 3:7] *= rng.choice([0.0, 0.5, 3.0])


def _degrees(rng: Rng, data: xr.Dataset) -> None:
    data["q"].values[:, 7:] *= 180.0 / np.pi


def _attribute(rng: Rng, data: xr.Dataset) -> xr.Dataset:
    key = some(rng, ("morphology", "morphology_changes", "air", "gravity"))
    wrong: list[Any] = [np.array([1.0, 2.0]), -1.0, "[" * 9000, "²", "aerobot"]
    return data.assign_attrs({key: wrong[rng.integers(len(wrong))]})


def _unknown_label(rng: Rng, data: xr.Dataset) -> xr.Dataset:
    word, dim = some(rng, ("joint_5", "", "Ä", "LEFT_SHOULDER", "x" * 300)), some(rng, AXES)
    labels = [*map(str, data[dim].values)]
    labels[rng.integers(len(labels))] = word
    return data.assign_coords({dim: labels})


def _doubled_label(rng: Rng, data: xr.Dataset) -> xr.Dataset:
    dim = some(rng, AXES)
    labels = [*map(str, data[dim].values)]
    k = rng.integers(len(labels))
    labels[k] = labels[k - 1]
    return data.assign_coords({dim: labels})


def _missing_label(rng: Rng, data: xr.Dataset) -> xr.Dataset:
    dim = some(rng, AXES)
    return data.isel({dim: np.delete(np.arange(data.sizes[dim]), rng.integers(data.sizes[dim]))})


def _numbered(rng: Rng, data: xr.Dataset) -> xr.Dataset:
    dim = some(rng, AXES)
    return data.assign_coords({dim: np.arange(data.sizes[dim])})


def _unit(rng: Rng, data: xr.Dataset, *units: Any) -> None:
    data[some(rng, data.data_vars)].attrs["units"] = units[rng.integers(len(units))]


def off_the_linkage(rng: Rng, data: xr.Dataset) -> None:
    """One joint angle with an offset of 2 to 10 deg, or both joints of a wing swapped."""
    q = data["q"].values
    if rng.random() < 0.3:
        q[:, 7:9] = q[:, [8, 7]]
    else:
        q[:, rng.integers(7, 11)] += rng.choice([-1.0, 1.0]) * rng.uniform(0.035, 0.17)


def gyro_in_degrees(rng: Rng, data: xr.Dataset) -> None:
    """A gyro in deg/s."""
    data["v"].values[:, 3:6] *= 180.0 / np.pi


def height_in_millimetres(rng: Rng, data: xr.Dataset) -> None:
    """The height z in mm."""
    data["q"].values[:, 2] *= 1000.0


def held(rng: Rng, data: xr.Dataset) -> None:
    """A channel of 60 to 500 Hz that repeats its last sample at the log's rate."""
    rate = 1.0 / float(np.median(np.diff(data["time"].values)))
    every = max(2, round(rate / rng.choice([60.0, 100.0, 200.0, 500.0])))
    parts = (("q", slice(0, 3)), ("q", slice(3, 7)), ("v", slice(3, 6)), ("v", slice(0, 3)))
    _repeat(data, *parts[rng.integers(4)], np.arange(data.sizes["time"]) // every * every)


def w_first(rng: Rng, data: xr.Dataset) -> None:
    """Quaternions written as w, x, y, z."""
    data["q"].values[:, 3:7] = data["q"].values[:, [6, 3, 4, 5]]


def late(rng: Rng, data: xr.Dataset) -> None:
    """Gyro, velocity, pose or joints that are 4 to 15 ms late."""
    step = float(np.median(np.diff(data["time"].values)))
    behind = np.arange(data.sizes["time"]) - round(rng.uniform(0.004, 0.015) / step)
    parts = (("q", slice(0, 7)), ("v", slice(0, 6)), ("q", slice(7, 11)))
    _repeat(data, *parts[rng.integers(3)], np.maximum(behind, 0))


def _repeat(data: xr.Dataset, name: str, columns: slice, index: np.ndarray) -> None:
    """Put earlier samples in the place of some columns of a channel."""
    values = data[name].values
    values[:, columns] = values[index, columns]


# Logs that contradict themselves, by the name of the warning that they must cause.
CONTRADICTIONS: dict[str, Callable[[Rng, xr.Dataset], None]] = {
    "joints off the linkage": off_the_linkage,
    "gyro against attitude": gyro_in_degrees,
    "position against velocity": height_in_millimetres,
    "held channel": held,
    "quaternion order": w_first,
    "late channel": late,
}
KINDS = [
    Kind(2, "cut file", "bytes", lambda rng, data: data[: rng.integers(len(data) - 8)]),
    Kind(2, "damaged start of the file", "bytes", lambda rng, data: rng.bytes(64) + data[64:]),
    Kind(2, "other kind of file", "bytes", _other_file),
    Kind(2, "damaged numbers", "bytes", _damaged_numbers),
    Kind(2, "foreign group", "file", lambda rng, file: file.create_dataset(f"{some(rng, GROUPS)}/x", data=1.0)),
    Kind(2, "truth that is none", "file", lambda rng, file: file["truth"].pop(some(rng, PARTS_OF_TRUTH))),
    Kind(2, "unknown channel", "file", lambda rng, file: file.move("crank_angle", some(rng, WRONG_NAMES))),
    Kind(2, "no clock", "file", lambda rng, file: file.pop(some(rng, ("time", "interval")))),
    Kind(2, "link to another place", "file", _link),
    Kind(2, "values in another file", "file", _external),
    Kind(2, "absurd size", "file", _absurd),
    Kind(2, "type without numbers", "file", _compound),
    Kind(2, "packed numbers", "file", lambda rng, file: file[some(rng, PARTS)].attrs.update({some(rng, PACK): "true"})),
    Kind(2, "channel of another length", "channels", _other_length),
    Kind(2, "text or dates for numbers", "channels", _text),
    Kind(2, "not a number", "channels", _nan),
    Kind(2, "fill values", "channels", _fill),
    Kind(2, "time that is none", "channels", _time),
    Kind(2, "quaternion of another length", "channels", _length),
    Kind(2, "joints in degrees", "channels", _degrees),
    Kind(2, "no configuration", "channels", lambda rng, data: data.drop_vars(["q", "q_axis"])),
    Kind(2, "wrong attribute", "channels", _attribute),
    Kind(2, "huge attribute", "channels", lambda rng, data: data.assign_attrs(notes=np.zeros(200_000))),
    Kind(1, HARMLESS[0], "channels", lambda rng, data: data[{dim: rng.permutation(data.sizes[dim]) for dim in AXES}]),
    Kind(1, HARMLESS[1], "channels", lambda rng, data: data.transpose("v_axis", "q_axis", "interval", "time")),
    Kind(1, "unknown label", "channels", _unknown_label),
    Kind(1, "doubled label", "channels", _doubled_label),
    Kind(1, "missing label", "channels", _missing_label),
    Kind(1, "no labels", "channels", lambda rng, data: data.drop_vars(some(rng, AXES))),
    Kind(1, "numbers for labels", "channels", _numbered),
    Kind(1, "wrong unit", "channels", lambda rng, data: _unit(rng, data, *UNITS)),
    Kind(1, "no unit", "channels", lambda rng, data: data[some(rng, data.data_vars)].attrs.clear()),
    Kind(1, "unit that is no text", "channels", lambda rng, data: _unit(rng, data, 1.0, np.array([1, 2]), 7)),
    Kind(1, "unit of time", "channels", lambda rng, data: data["time"].attrs.update(units=some(rng, TIME_UNITS))),
    *(Kind(11, name, suffix, change) for name, change in CONTRADICTIONS.items() for suffix in (".nc", ".csv")),
]
