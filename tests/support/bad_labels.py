"""Flight logs with wrong labels or units: class 1 of `bad_logs`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import xarray as xr

from support.log_kinds import (
    Cells,
    Rng,
    cells_kind,
    dataset_kind,
    some,
)


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
