"""Kinds of bad flight logs, and decorators that register a function as one of them."""

from __future__ import annotations

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


def file_kind(number: int, name: str, suffix: str = ".nc") -> Callable[[Any], Any]:
    """Register a function (rng, log, path) that writes the file."""

    def register(write: Callable[[Rng, FlightLog, Path], None]) -> Callable[[Rng, FlightLog, Path], None]:
        KINDS.append(Kind(number, name, suffix, write))
        return write

    return register


def dataset_kind(number: int, name: str) -> Callable[[Any], Any]:
    """Register a function (rng, dataset) -> dataset that changes the measured channels before they are written."""

    def register(change: Callable[[Rng, xr.Dataset], xr.Dataset]) -> Callable[[Rng, xr.Dataset], xr.Dataset]:
        def write(rng: Rng, log: FlightLog, path: Path) -> None:
            change(rng, log.measured.copy(deep=True)).to_netcdf(path, engine="h5netcdf")

        KINDS.append(Kind(number, name, ".nc", write))
        return change

    return register


def hdf5_kind(number: int, name: str) -> Callable[[Any], Any]:
    """Register a function (rng, file, path) that changes a saved log through h5py."""

    def register(change: Callable[[Rng, h5py.File, Path], None]) -> Callable[[Rng, h5py.File, Path], None]:
        def write(rng: Rng, log: FlightLog, path: Path) -> None:
            save(log, path)
            with h5py.File(path, "r+") as file:
                change(rng, file, path)

        KINDS.append(Kind(number, name, ".nc", write))
        return change

    return register


def bytes_kind(number: int, name: str) -> Callable[[Any], Any]:
    """Register a function (rng, bytes) -> bytes that changes the file of a saved log."""

    def register(change: Callable[[Rng, bytes], bytes]) -> Callable[[Rng, bytes], bytes]:
        def write(rng: Rng, log: FlightLog, path: Path) -> None:
            save(log, path)
            path.write_bytes(change(rng, path.read_bytes()))

        KINDS.append(Kind(number, name, ".nc", write))
        return change

    return register


def cells_kind(number: int, name: str) -> Callable[[Any], Any]:
    """Register a function (rng, rows) -> None that changes the cells of a table; row 0 is the header."""

    def register(change: Callable[[Rng, Cells], None]) -> Callable[[Rng, Cells], None]:
        def write(rng: Rng, log: FlightLog, path: Path) -> None:
            rows = table(log, path)
            change(rng, rows)
            with path.open("w", newline="") as file:
                csv.writer(file, lineterminator="\n").writerows(rows)

        KINDS.append(Kind(number, name, ".csv", write))
        return change

    return register


def text_kind(number: int, name: str) -> Callable[[Any], Any]:
    """Register a function (rng, bytes) -> bytes that changes the text of a table."""

    def register(change: Callable[[Rng, bytes], bytes]) -> Callable[[Rng, bytes], bytes]:
        def write(rng: Rng, log: FlightLog, path: Path) -> None:
            table(log, path)
            path.write_bytes(change(rng, path.read_bytes()))

        KINDS.append(Kind(number, name, ".csv", write))
        return change

    return register


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
