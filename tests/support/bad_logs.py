"""Bad flight logs, one mistake each, drawn at random: files from strangers, damaged files, and contradictions.

`bad_log` writes one file. What a program must do with it follows from its class:

| class | a program must |
|---|---|
| 1 | refuse it with one message; kinds in `HARMLESS` must be read as the good log |
| 2 | refuse it with one message |
| 11 | read it, and warn; the name of the warning is the name of the kind |
"""

import csv
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import xarray as xr

from aerobat_pin.aerobat.flight_log import FlightLog
from aerobat_pin.aerobat.tables import write_csv
from support.contradictory_logs import CONTRADICTIONS

Rng = np.random.Generator
Cells = list[list[str]]
Write = Callable[[Rng, FlightLog, Path], None]
HARMLESS = ("columns in another order", "dimensions in another order")
AXES = ("q_axis", "v_axis")
PARTS_OF_TRUTH = ("force_W", "force_noise_free_W", "aerodynamic", "strip_force_z", "motor_power")
TIME_UNITS = ("ms", "minutes", "days since 2000-01-01")


@dataclass(frozen=True)
class Kind:
    """One kind of bad log: its class, its name, and how to write it."""

    number: int
    name: str
    suffix: str
    write: Write


def bad_log(rng: Rng, log: FlightLog, folder: Path, numbers: tuple[int, ...] = (1, 2, 11)) -> tuple[Path, int, str]:
    """Write a bad log of a random kind.

    Args:
        rng: source of all random choices.
        log: a good simulated log of half a second or more, with its truth and exact sensors.
        folder: existing folder for the file, and for a second file where the mistake needs one.
        numbers: classes to choose from.

    Returns:
        The file, the number of its class, and what is wrong in a few words.
    """
    chosen = [kind for kind in KINDS if kind.number in numbers]
    kind = chosen[rng.integers(len(chosen))]
    return write_kind(kind, rng, log, folder)


def write_kind(kind: Kind, rng: Rng, log: FlightLog, folder: Path) -> tuple[Path, int, str]:
    """Write a bad log of one kind; arguments and result are those of `bad_log`."""
    path = folder / f"bad_{kind.number}_{rng.integers(10**9)}{kind.suffix}"
    kind.write(rng, log, path)
    return path, kind.number, kind.name


def of_bytes(number: int, name: str, change: Callable[[Rng, bytes], bytes]) -> Kind:
    """Return a kind that changes the file of a saved log."""

    def write(rng: Rng, log: FlightLog, path: Path) -> None:
        save(log, path)
        path.write_bytes(change(rng, path.read_bytes()))

    return Kind(number, name, ".nc", write)


def of_hdf5(number: int, name: str, change: Callable[[Rng, h5py.File], object]) -> Kind:
    """Return a kind that changes a saved log through h5py."""

    def write(rng: Rng, log: FlightLog, path: Path) -> None:
        save(log, path)
        with h5py.File(path, "r+") as file:
            change(rng, file)

    return Kind(number, name, ".nc", write)


def of_channels(number: int, name: str, change: Callable[[Rng, xr.Dataset], xr.Dataset | None]) -> Kind:
    """Return a kind that changes the measured channels in place, or returns others, before they are written."""

    def write(rng: Rng, log: FlightLog, path: Path) -> None:
        data = log.measured.copy(deep=True)
        found = change(rng, data)
        (data if found is None else found).to_netcdf(path, engine="h5netcdf")

    return Kind(number, name, ".nc", write)


def of_text(number: int, name: str, change: Callable[[Rng, bytes], bytes]) -> Kind:
    """Return a kind that changes the text of a table."""

    def write(rng: Rng, log: FlightLog, path: Path) -> None:
        table(log, path)
        path.write_bytes(change(rng, path.read_bytes()))

    return Kind(number, name, ".csv", write)


def of_cells(number: int, name: str, change: Callable[[Rng, Cells], None]) -> Kind:
    """Return a kind that changes the cells of a table; row 0 is the header."""

    def write(rng: Rng, log: FlightLog, path: Path) -> None:
        rows = table(log, path)
        change(rng, rows)
        with path.open("w", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows(rows)

    return Kind(number, name, ".csv", write)


def contradiction(name: str, suffix: str) -> Kind:
    """Return a kind that contradicts itself, as a NetCDF file or as a table."""

    def write(rng: Rng, log: FlightLog, path: Path) -> None:
        wrong = FlightLog(CONTRADICTIONS[name](rng, log.measured.copy(deep=True)))
        wrong.save(path) if suffix == ".nc" else write_csv(wrong, path)

    return Kind(11, name, suffix, write)


_SAVED: list[tuple[FlightLog, bytes]] = []  # the last good log and its file: saving takes longest


def save(log: FlightLog, path: Path) -> None:
    """Save a good log."""
    if not _SAVED or _SAVED[0][0] is not log:
        log.save(path)
        _SAVED[:] = [(log, path.read_bytes())]
    path.write_bytes(_SAVED[0][1])


def table(log: FlightLog, path: Path) -> Cells:
    """Write a good log as a table, and return its cells."""
    write_csv(replace(log, truth=None), path)
    with path.open(newline="") as file:
        return list(csv.reader(file))


def some(rng: Rng, names: Any) -> str:
    """Draw a name."""
    return str(rng.choice(sorted(map(str, names))))


def _damaged_start(rng: Rng, data: bytes) -> bytes:
    return bytes(rng.integers(0, 256, 64, dtype=np.uint8)) + data[64:]


def _other_file(rng: Rng, data: bytes) -> bytes:
    return [b"", b"a note\n", b"\x89PNG\r\n\x1a\n" + data[:500], b"CDF\x01" + data[4:], b"\0" * 4096][rng.integers(5)]


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


def _foreign_group(rng: Rng, file: h5py.File) -> None:
    file.create_group(some(rng, ("notes", "Truth", "truth/inner", "é")))["x"] = 1.0


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


def _packed(rng: Rng, file: h5py.File) -> None:
    file[some(rng, ("q", "v", "airspeed"))].attrs[some(rng, ("scale_factor", "add_offset"))] = 2.0


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


def _other_table(rng: Rng, text: bytes) -> bytes:
    first = text.splitlines()[0]
    others = [b"", b"\n\n", first + b"\n", bytes(range(256)) * 20, text.decode().encode("utf-16")]
    others += [b"time," * 100_000, b'"' + text, first + b"\n" + b"\0" * 500]
    return others[rng.integers(len(others))]


def _cell(rng: Rng, rows: Cells) -> None:
    words = ("", "far", "nan", "inf", "²", "1,5", "0x10", "9" * 5000, "1e999", "2020-01-01", "--1", "1 2", "TRUE")
    rows[rng.integers(1, len(rows))][rng.integers(len(rows[0]))] = some(rng, words)


def _row(rng: Rng, rows: Cells) -> None:
    k = rng.integers(1, len(rows))
    rows[k] = rows[k][:-1] if rng.random() < 0.5 else [*rows[k], "0"]


def _time_cell(rng: Rng, rows: Cells) -> None:
    k = rng.integers(2, len(rows))
    rows[k][0] = some(rng, (rows[k - 1][0], "-1"))


def _degrees_cells(rng: Rng, rows: Cells) -> None:
    names = [cell.partition(" ")[0] for cell in rows[0]]
    k = names.index(some(rng, ("crank_angle", "left_elbow", "right_elbow")))
    for row in rows[1:]:
        row[k] = repr(float(row[k]) * 180.0 / np.pi)


def _length_cells(rng: Rng, rows: Cells) -> None:
    row = rows[rng.integers(1, len(rows))]
    row[4:8] = some(rng, ("0 0 0 0", "1 1 1 1", "0 0 0 0.5")).split()


def _milliseconds(rng: Rng, rows: Cells) -> None:
    for row in rows[1:]:
        row[0] = repr(float(row[0]) * 1000.0)


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


def _wrong_unit(rng: Rng, data: xr.Dataset) -> None:
    data[some(rng, data.data_vars)].attrs["units"] = some(rng, ("mm", "deg", "deg/s", "mN m", "", "seconds since 2020"))


def _no_unit(rng: Rng, data: xr.Dataset) -> None:
    del data[some(rng, data.data_vars)].attrs["units"]


def _number_unit(rng: Rng, data: xr.Dataset) -> None:
    data[some(rng, data.data_vars)].attrs["units"] = [1.0, np.array([1, 2]), 7][rng.integers(3)]


def _unknown_column(rng: Rng, rows: Cells) -> None:
    rows[0][rng.integers(len(rows[0]))] = some(rng, ("height", "²", "", "q" * 500, "x[", "X [m]"))


def _doubled_column(rng: Rng, rows: Cells) -> None:
    k = rng.integers(1, len(rows[0]))
    rows[0][k] = rows[0][k - 1]


def _missing_column(rng: Rng, rows: Cells) -> None:
    k = rng.integers(8)  # time, position and quaternion are required
    for row in rows:
        del row[k]


def _wrong_column_unit(rng: Rng, rows: Cells) -> None:
    k = rng.integers(len(rows[0]))
    rows[0][k] = f"{rows[0][k].partition('[')[0].strip()} [{some(rng, ('mm', 'deg', '°', 'furlong', ''))}]"


KINDS = [
    of_bytes(2, "cut file", lambda rng, data: data[: rng.integers(len(data) - 8)]),
    of_bytes(2, "damaged start of the file", _damaged_start),
    of_bytes(2, "other kind of file", _other_file),
    Kind(2, "damaged numbers", ".nc", _damaged_numbers),
    of_hdf5(2, "foreign group", _foreign_group),
    of_hdf5(2, "truth that is none", lambda rng, file: file["truth"].pop(some(rng, PARTS_OF_TRUTH))),
    of_hdf5(2, "unknown channel", lambda rng, file: file.move("crank_angle", some(rng, ("crank_angel", "angle", "²")))),
    of_hdf5(2, "no clock", lambda rng, file: file.pop(some(rng, ("time", "interval")))),
    of_hdf5(2, "link to another place", _link),
    of_hdf5(2, "values in another file", _external),
    of_hdf5(2, "absurd size", _absurd),
    of_hdf5(2, "type without numbers", _compound),
    of_hdf5(2, "packed numbers", _packed),
    of_channels(2, "channel of another length", _other_length),
    of_channels(2, "text or dates for numbers", _text),
    of_channels(2, "not a number", _nan),
    of_channels(2, "fill values", _fill),
    of_channels(2, "time that is none", _time),
    of_channels(2, "quaternion of another length", _length),
    of_channels(2, "joints in degrees", _degrees),
    of_channels(2, "no configuration", lambda rng, data: data.drop_vars(["q", "q_axis"])),
    of_channels(2, "wrong attribute", _attribute),
    of_channels(2, "huge attribute", lambda rng, data: data.assign_attrs(notes=np.zeros(200_000))),
    of_text(2, "other kind of table", _other_table),
    of_cells(2, "cell without a number", _cell),
    of_cells(2, "row of another length", _row),
    of_cells(2, "time that does not rise", _time_cell),
    of_cells(2, "degrees in a table", _degrees_cells),
    of_cells(2, "quaternion of another length in a table", _length_cells),
    of_cells(2, "milliseconds", _milliseconds),
    of_channels(1, HARMLESS[0], lambda rng, data: data.isel({dim: rng.permutation(data.sizes[dim]) for dim in AXES})),
    of_channels(1, HARMLESS[1], lambda rng, data: data.transpose("v_axis", "q_axis", "interval", "time")),
    of_channels(1, "unknown label", _unknown_label),
    of_channels(1, "doubled label", _doubled_label),
    of_channels(1, "missing label", _missing_label),
    of_channels(1, "no labels", lambda rng, data: data.drop_vars(some(rng, AXES))),
    of_channels(1, "numbers for labels", _numbered),
    of_channels(1, "wrong unit", _wrong_unit),
    of_channels(1, "no unit", _no_unit),
    of_channels(1, "unit that is no text", _number_unit),
    of_channels(1, "unit of time", lambda rng, data: data["time"].attrs.update(units=some(rng, TIME_UNITS))),
    of_cells(1, "unknown column", _unknown_column),
    of_cells(1, "doubled column", _doubled_column),
    of_cells(1, "missing column", _missing_column),
    of_cells(1, "wrong unit of a column", _wrong_column_unit),
    *(contradiction(name, suffix) for name in CONTRADICTIONS for suffix in (".nc", ".csv")),
]
