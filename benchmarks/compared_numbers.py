"""Read the numbers that two folders of results have in common, and compare them leaf by leaf."""

import json
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from aerobat_pin.errors import CalibrationError
from aerobat_pin.estimation import read_calibration

WORDS = {"belief", "records", "warnings", "notes"}  # of a calibration: prose
CLOCKED = ("loop_p50_s", "loop_p99_s", "loop_worst_s")  # keys of `metrics.json` that measure the machine
DIGITS = {"estimate.csv": 1e-8}  # differences that the digits of a table allow
NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?", re.IGNORECASE)


def of_nested(values: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the leaves of nested lists and tables: a list of numbers is one, entries are named by `check` or `name`."""
    if isinstance(values, dict):
        for key, value in values.items():
            yield from of_nested(value, f"{path}.{key}")
    elif isinstance(values, list) and not (values and all(isinstance(value, int | float) for value in values)):
        named = [str(value.get("check", value.get("name", ""))) if isinstance(value, dict) else "" for value in values]
        for name, value in zip(_numbered(named), values, strict=True):
            yield from of_nested(value, f"{path}.{name}")
    else:
        yield path, values


def _numbered(names: Iterable[str]) -> Iterator[str]:
    """Yield names with a number where they repeat."""
    seen: Counter[str] = Counter()
    for name in names:
        yield f"{name}#{seen[name]}" if seen[name] else name
        seen[name] += 1


def of_json(file: Path) -> dict[str, Any]:
    """Read `metrics.json` leaf by leaf, without versions and without times that the machine took."""
    values = {key: value for key, value in json.loads(file.read_text()).items() if key != "versions"}
    return {key: value for key, value in of_nested(values) if not key.endswith(CLOCKED)}


def of_netcdf(file: Path) -> dict[str, Any]:
    """Read every channel of all groups of a NetCDF file."""
    groups = xr.open_groups(file, engine="h5netcdf", decode_times=False)
    found = {
        f"{group.rstrip('/')}/{name}": values.values
        for group, data in groups.items()
        for name, values in data.load().variables.items()
    }
    for data in groups.values():
        data.close()
    return found


def of_calibration(file: Path) -> dict[str, Any]:
    """Read the numbers that a calibration learnt. Raises CalibrationError for a file of a form that is read no more."""
    learnt = asdict(read_calibration(file))
    found = dict(of_nested({key: value for key, value in learnt.items() if key not in WORDS}))
    return {key: value for key, value in found.items() if ".parameters." not in key and ".states." not in key}  # units


def of_csv(file: Path) -> dict[str, Any]:
    """Read a table of text, column by column: numbers, or words."""
    columns = pd.read_csv(file).items()
    return {str(name): column if column.dtype.kind in "iuf" else column.map(str) for name, column in columns}


def of_print(file: Path) -> dict[str, Any]:
    """Read the numbers of printed lines, by the words of the line."""
    lines = file.read_text().splitlines()
    return dict(zip(_numbered(NUMBER.sub("#", line) for line in lines), map(numbers_in, lines), strict=True))


def numbers_in(text: str) -> list[float]:
    """Return the numbers of a text."""
    return [float(number) for number in NUMBER.findall(text)]


READERS = {
    "metrics.json": of_json,
    "flight.nc": of_netcdf,
    "estimate.nc": of_netcdf,
    "estimate.csv": of_csv,
    "results.nc": of_netcdf,
    "results.csv": of_csv,
    "calibration.nc": of_calibration,
    "printed.txt": of_print,
}


def difference(one: Any, other: Any) -> float:
    """Return the largest difference of two leaves, relative to the largest value; infinite between other things."""
    a, b = np.asarray(one), np.asarray(other)
    if a.shape != b.shape:
        return np.inf
    if not (np.issubdtype(a.dtype, np.number) and np.issubdtype(b.dtype, np.number)):
        return 0.0 if np.array_equal(a, b) else np.inf
    here = np.isfinite(a)
    if not np.array_equal(here, np.isfinite(b)) or not np.array_equal(a[~here], b[~here], equal_nan=True):
        return np.inf
    if np.array_equal(a[here], b[here]):
        return 0.0
    rises = a.ndim == 1 and a.size > 1 and bool(np.all(np.diff(a) > 0))
    scale = float(a[-1] - a[0]) if rises else float(np.max(np.abs(a[here])))
    return float(np.max(np.abs(a[here] - b[here]))) / (scale or 1.0)


@dataclass
class FolderDifferences:
    """What differs between two folders of results.

    Args:
        moved: patterns of `file key` and what it is called now, as of `re.sub`; None where it is no longer written.
        count: number of leaves that were compared.
        places: differences and where they are.
        told: what is new or worded anew.
    """

    moved: Mapping[str, str | None]
    count: int = 0
    places: list[tuple[float, str]] = field(default_factory=list)
    told: list[str] = field(default_factory=list)

    def of_file(self, name: str, old: dict[str, Any], new: dict[str, Any]) -> None:
        """Compare the leaves of a file."""
        places = ((self.place(f"{name} {key}"), value) for key, value in old.items())
        known = {place.removeprefix(f"{name} "): value for place, value in places if place is not None}
        for key, value in known.items():
            if key in new:
                self._of_leaf(name, key, value, new[key])
            else:
                self.places.append((np.inf, f"{name} {key} is missing"))
        self.count += len(known)
        self.told += [f"new: {name} {key}" for key in new if key not in known]

    def place(self, old: str) -> str | None:
        """Return what `file key` of the first folder is called in the second one."""
        for pattern, now in self.moved.items():
            if re.search(pattern, old):
                return None if now is None else re.sub(pattern, now, old)
        return old

    def _of_leaf(self, name: str, key: str, old: Any, new: Any) -> None:
        if isinstance(old, str) and isinstance(new, str) and " " in old:
            if NUMBER.sub("#", old) != NUMBER.sub("#", new):
                self.told.append(f"reworded: {name} {key}: {old} -> {new}")
                return
            old, new = numbers_in(old), numbers_in(new)
        found = difference(old, new)
        if found > DIGITS.get(name, 0.0):
            self.places.append((found, f"{name} {key}"))


def compare(before: Path, after: Path, moved: Mapping[str, str | None]) -> FolderDifferences:
    """Compare two folders of results; of a calibration whose file has another form than today's it is told."""
    found = FolderDifferences(moved)
    for name, read in READERS.items():
        if (before / name).is_file():
            try:
                sides = read(before / name), read(after / name) if (after / name).is_file() else {}
            except CalibrationError as error:
                found.told.append(f"not compared: {name}: {error}")
            else:
                found.of_file(name, *sides)
    found.places.sort(key=lambda place: -place[0])
    return found
