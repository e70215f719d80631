"""Read NetCDF-4 files, also those of strangers (`checked_netcdf.py`): every failure is one `LogError`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import xarray as xr

from aerobat_pin.errors import LogError
from aerobat_pin.records.checked_netcdf import checked_file, is_bare

PACKING = ("scale_factor", "add_offset", "_Unsigned", "dtype")  # attributes that change the meaning of numbers
INTERNAL = ("CLASS", "NAME", "REFERENCE_LIST", "DIMENSION_LIST", "_FillValue", "missing_value", "coordinates")


def read_netcdf(path: str | Path, what: str, groups: Sequence[str] = ()) -> dict[str, xr.Dataset]:
    """Read a NetCDF-4 file.

    Args:
        path: the file.
        what: what the file is, such as `flight log`; error messages begin with it.
        groups: names of the groups that the file may contain.

    Returns:
        Name -> dataset of each group that is there; the root's name is empty. Times stay numbers.

    Raises:
        LogError: the file cannot be read, is damaged, refers to other files, or has a group of another name.
    """
    with checked_file(path, what, groups) as (parts, name):
        return {key: _dataset(part, name) for key, part in parts.items()}


@contextmanager
def netcdf_variables(
    path: str | Path, what: str, groups: Sequence[str] = ()
) -> Iterator[dict[str, dict[str, StoredVariable]]]:
    """Open a NetCDF-4 file as `read_netcdf` does, for files that are too large to be read at once.

    Yields group -> name -> variable, whose rows are read when they are asked for.
    """
    with checked_file(path, what, groups) as (parts, name):
        variables: dict[str, dict[str, StoredVariable]] = {}
        for key, part in parts.items():
            items = {entry.removeprefix("_nc4_non_coord_"): item for entry, item in part.items() if _has_values(item)}
            variables[key] = {
                label: StoredVariable(_dimensions(item, label, f"{name}: '{label}'"), item)
                for label, item in items.items()
            }
        yield variables


class StoredVariable:
    """A variable of an open NetCDF file.

    Args:
        dims: names of its dimensions.
        item: the HDF5 dataset.
    """

    def __init__(self, dims: tuple[str, ...], item: h5py.Dataset) -> None:
        self.dims, self._item = dims, item
        self.shape, self.kind = tuple(item.shape), item.dtype.kind

    def __getitem__(self, rows: Any) -> Any:
        """Return rows of its numbers or text; numbers equal to the fill value become NaN."""
        return _values(self._item, rows)


def _has_values(item: Any) -> bool:
    return isinstance(item, h5py.Dataset) and not is_bare(item)


def _dataset(group: h5py.Group, name: str) -> xr.Dataset:
    """Read all variables of a group whose sizes are checked."""
    variables, coords = {}, set(str(group.attrs.get("coordinates", "")).split())
    for key, item in group.items():
        if not _has_values(item):
            continue
        attributes = {
            k: _plain_attribute(v) for k, v in item.attrs.items() if k not in INTERNAL and not k.startswith("_Netcdf4")
        }
        packed = [k for k in PACKING if k in attributes]
        if packed:
            raise LogError(f"{name}: '{key}' has the attribute {packed[0]}: plain numbers were expected")
        label = key.removeprefix("_nc4_non_coord_")
        dims = _dimensions(item, label, f"{name}: '{key}'")
        if dims == (label,):
            coords.add(label)
        coords |= set(str(item.attrs.get("coordinates", "")).split())
        variables[label] = xr.Variable(dims, _values(item), attributes)
    attributes = {k: _plain_attribute(v) for k, v in group.attrs.items() if k not in INTERNAL and k != "_NCProperties"}
    data = {key: values for key, values in variables.items() if key not in coords}
    return xr.Dataset(data, {key: variables[key] for key in coords & set(variables)}, attributes)


def _dimensions(item: h5py.Dataset, label: str, where: str) -> tuple[str, ...]:
    """Return the names of a dataset's dimensions."""
    if item.attrs.get("CLASS") == b"DIMENSION_SCALE" and item.ndim == 1:
        return (label,)
    listed = item.attrs.get("DIMENSION_LIST", ())  # h5py's item.dims would end the process if this list is damaged
    scales = [[str(item.file[scale].name).rpartition("/")[2] for scale in dim] for dim in listed]
    if [len(names) for names in scales] != [1] * item.ndim:
        raise LogError(f"{where}: its dimensions have no names: the dimension scales of NetCDF-4 were expected")
    return tuple(names[0] for names in scales)


def _values(item: h5py.Dataset, rows: Any = ()) -> Any:
    """Read rows of numbers or text; numbers equal to the fill value become NaN."""
    if h5py.check_string_dtype(item.dtype) is not None:
        return np.array(np.asarray(item.asstr()[rows], object).tolist())
    values = item[rows]
    fill = item.attrs.get("_FillValue", item.attrs.get("missing_value"))
    if fill is not None and np.asarray(values).dtype.kind in "fiu":
        empty = np.asarray(values) == np.asarray(fill, float).ravel()[0]
        return np.where(empty, np.nan, values) if np.any(empty) else values
    return values


def _plain_attribute(value: Any) -> Any:
    """Return an attribute as text or number where it is one."""
    if isinstance(value, h5py.Empty):
        return ""
    if isinstance(value, np.ndarray) and value.size == 1:
        value = value.ravel()[0]
    if isinstance(value, str):
        value.encode("utf-8")  # fails for damaged text, which could not be printed
    return value.decode("utf-8") if isinstance(value, bytes) else value
