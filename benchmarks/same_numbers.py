"""Do two checkouts give the same numbers? `python benchmarks/same_numbers.py BEFORE [AFTER]`, folders of checkouts.

Flies every shipped scenario, the sweep `gain_noise` and the estimate of a table of text with both, in processes of
their own, and prints the largest relative difference of all that each writes: `metrics.json` (versions aside), every
channel of `flight.nc` and `estimate.nc`, and `results.csv`. A channel's differences are relative to its largest value.
Ends with exit code 1 where one is above the limit of `--limit` (default 0: equal to the last bit).
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

HERE = Path(__file__).resolve().parents[1]
COMMAND = """
import sys
import aerobat_pin
from aerobat_pin.cli import main

checkout = sys.argv.pop(1)
assert aerobat_pin.__file__.startswith(checkout), f"{aerobat_pin.__file__} is not in {checkout}"
sys.argv[0] = "aerobat"
main()
"""
TABLE = """
import sys
from aerobat_pin.flight import FlightLog, write_csv
write_csv(FlightLog.load(sys.argv[1]), sys.argv[2])
"""


def environment(checkout: Path) -> dict[str, str]:
    """Return an environment that imports a checkout's packages, even from within another checkout's folder."""
    return {**os.environ, "PYTHONPATH": str(checkout), "PYTHONSAFEPATH": "1"}


def aerobat(checkout: Path, *words: str) -> None:
    """Run a checkout's command line."""
    done = subprocess.run(
        [sys.executable, "-c", COMMAND, str(checkout), *words],
        env=environment(checkout),
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise SystemExit(f"{checkout}: aerobat {' '.join(words)}\n{done.stderr}")


def numbers(values: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the leaves of nested lists and tables with their dotted places."""
    if isinstance(values, dict):
        for key, value in values.items():
            yield from numbers(value, f"{path}.{key}")
    elif isinstance(values, list):
        for i, value in enumerate(values):
            yield from numbers(value, f"{path}.{i}")
    else:
        yield path, values


def of_json(file: Path) -> dict[str, Any]:
    """Read `metrics.json` without versions, leaf by leaf."""
    return dict(numbers({key: value for key, value in json.loads(file.read_text()).items() if key != "versions"}))


def of_netcdf(file: Path) -> dict[str, Any]:
    """Read every channel of a NetCDF file, group `truth` included."""
    found: dict[str, Any] = {}
    for group in (None, "truth"):
        try:
            with xr.open_dataset(file, group=group, engine="h5netcdf") as data:
                found |= {f"{group or ''}/{name}": values.values for name, values in data.variables.items()}
        except OSError:
            continue
    return found


def of_csv(file: Path) -> dict[str, Any]:
    """Read a table of text, cell by cell."""
    with file.open() as text:
        rows = list(csv.DictReader(text))
    return {f"{i}.{key}": _as_number(cell) for i, row in enumerate(rows) for key, cell in row.items()}


def _as_number(cell: str) -> Any:
    try:
        return float(cell)
    except ValueError:
        return cell


READERS = {"metrics.json": of_json, "flight.nc": of_netcdf, "estimate.nc": of_netcdf, "results.csv": of_csv}


def difference(one: Any, other: Any) -> float:
    """Return the largest difference of two leaves, relative to the largest value; infinite between other things."""
    a, b = np.asarray(one), np.asarray(other)
    if a.shape != b.shape:
        return float("inf")
    if not (np.issubdtype(a.dtype, np.number) and np.issubdtype(b.dtype, np.number)):
        return 0.0 if np.array_equal(a, b) else float("inf")
    if a.size == 0 or np.array_equal(a, b, equal_nan=True):
        return 0.0
    scale = float(np.nanmax(np.abs(a))) or 1.0
    return float(np.nanmax(np.abs(a - b))) / scale


def compare(before: Path, after: Path) -> tuple[float, str]:
    """Return the largest difference of two folders of results, and where it is."""
    worst, where = 0.0, ""
    for name, read in READERS.items():
        if not (before / name).is_file():
            continue
        old, new = read(before / name), read(after / name)
        for key in old:
            found = difference(old[key], new[key]) if key in new else float("inf")
            if found > worst:
                worst, where = found, f"{name} {key}"
        if set(new) - set(old):
            print(f"    {after.name}/{name} also has {', '.join(sorted(set(new) - set(old))[:5])}")
    return worst, where


def main() -> int:
    """Run both checkouts and print a line for each result."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("before", type=Path, help="checkout")
    parser.add_argument("after", type=Path, nargs="?", default=HERE, help="checkout; this one when omitted")
    parser.add_argument("--limit", type=float, default=0.0, help="largest relative difference allowed")
    parser.add_argument("--only", nargs="*", help="scenarios; all of them and the sweep when omitted")
    given = parser.parse_args()
    checkouts = {"before": given.before.resolve(), "after": given.after.resolve()}
    shipped = sorted(path.stem for path in (HERE / "aerobat_pin" / "scenario" / "shipped").glob("*.toml"))
    works: dict[str, list[str]] = {name: ["run", name, "--no-report"] for name in given.only or shipped}
    if not given.only:
        works["gain_noise"] = ["sweep", "gain_noise", "--jobs", str(len(os.sched_getaffinity(0)))]
    works["of a table"] = []
    good = True
    with tempfile.TemporaryDirectory() as work:
        for name, words in works.items():
            folders = {side: Path(work) / side / name for side in checkouts}
            table = Path(work) / "hall.csv"
            if not words:
                flown = Path(work) / "before" / next(iter(works)) / "flight.nc"
                done = [sys.executable, "-c", TABLE, str(flown), str(table)]
                subprocess.run(done, env=environment(HERE), check=True)
                words = ["estimate", str(table), "--observer", "momentum", "--observer", "smoother"]
            for side, checkout in checkouts.items():
                aerobat(checkout, *words, "--out", str(folders[side]))
            worst, where = compare(folders["before"], folders["after"])
            good = good and worst <= given.limit
            print(f"{name:<20} {worst:.1e} {where}", flush=True)
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
