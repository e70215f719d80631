"""Kinds of bad flight logs, and decorators that register a function as one of them."""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import xarray as xr

from aerobat_pin.aerobat.flight_log import FlightLog
from aerobat_pin.aerobat.tables import write_csv

Rng = np.random.Generator
Cells = list[list[str]]


@dataclass(frozen=True)
class Kind:
    """One kind of bad log: its class in the list of item numbers, its name, and how to write it."""

    number: int
    name: str
    suffix: str
    write: Callable[[Rng, FlightLog, Path], None]


KINDS: list[Kind] = []


def file_kind(
    number: int, name: str, suffix: str = ".nc", by: Callable[..., None] | None = None
) -> Callable[[Any], Any]:
    """Register a function (rng, log, path) that writes the file; or a change, made by `by` (change, rng, log, path)."""

    def register(change: Callable[..., Any]) -> Callable[..., Any]:
        KINDS.append(Kind(number, name, suffix, change if by is None else partial(by, change)))
        return change

    return register


def dataset_kind(number: int, name: str) -> Callable[[Any], Any]:
    """Register a function (rng, dataset) -> dataset that changes the measured channels before they are written."""

    def write(change: Callable[[Rng, xr.Dataset], xr.Dataset], rng: Rng, log: FlightLog, path: Path) -> None:
        change(rng, log.measured.copy(deep=True)).to_netcdf(path, engine="h5netcdf")

    return file_kind(number, name, by=write)


def hdf5_kind(number: int, name: str) -> Callable[[Any], Any]:
    """Register a function (rng, file, path) that changes a saved log through h5py."""

    def write(change: Callable[[Rng, h5py.File, Path], None], rng: Rng, log: FlightLog, path: Path) -> None:
        save(log, path)
        with h5py.File(path, "r+") as file:
            change(rng, file, path)

    return file_kind(number, name, by=write)


def bytes_kind(number: int, name: str, suffix: str = ".nc") -> Callable[[Any], Any]:
    """Register a function (rng, bytes) -> bytes that changes the file of a saved log, or of its table `.csv`."""

    def write(change: Callable[[Rng, bytes], bytes], rng: Rng, log: FlightLog, path: Path) -> None:
        if suffix == ".csv":
            table(log, path)
        else:
            save(log, path)
        path.write_bytes(change(rng, path.read_bytes()))

    return file_kind(number, name, suffix, write)


def cells_kind(number: int, name: str) -> Callable[[Any], Any]:
    """Register a function (rng, rows) -> None that changes the cells of a table; row 0 is the header."""

    def write(change: Callable[[Rng, Cells], None], rng: Rng, log: FlightLog, path: Path) -> None:
        rows = table(log, path)
        change(rng, rows)
        with path.open("w", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows(rows)

    return file_kind(number, name, ".csv", write)


_SAVED: list[tuple[FlightLog, bytes]] = []  # the last good log and its file: saving takes longest


def save(log: FlightLog, path: Path) -> None:
    if not _SAVED or _SAVED[0][0] is not log:
        log.save(path)
        _SAVED[:] = [(log, path.read_bytes())]
    path.write_bytes(_SAVED[0][1])


def table(log: FlightLog, path: Path) -> Cells:
    write_csv(replace(log, truth=None), path)
    with path.open(newline="") as file:
        return list(csv.reader(file))


def some(rng: Rng, names: Any) -> str:
    return str(rng.choice(sorted(map(str, names))))
