"""Read and write NetCDF-4 files, also those of strangers (`checked_netcdf.py`): every failure is one `LogError`.

Files are written with h5py alone, with a checksum of the whole at the end. A NetCDF-4 file is an HDF5 file in which a
dimension is a dataset with the attribute CLASS = DIMENSION_SCALE, and DIMENSION_LIST of each other dataset refers to
its dimensions (NetCDF Users Guide, appendix C.3).
"""

from __future__ import annotations

import io
import itertools
from collections.abc import Hashable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd
import xarray as xr

from aerobat_pin.errors import LogError
from aerobat_pin.numerics import shown
from aerobat_pin.records.checked_netcdf import NO_VARIABLE, checked_file, is_bare, seal_of

PACKING = {"scale_factor": 1.0, "add_offset": 0.0}  # attributes of packed numbers, and what they are without
INTERNAL = ("CLASS", "NAME", "REFERENCE_LIST", "DIMENSION_LIST", "_FillValue", "missing_value", "coordinates", *PACKING)


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
        yield {key: _stored_variables(part, name) for key, part in parts.items()}


class StoredVariable:
    """A variable of an open NetCDF file, by its name, its HDF5 dataset, and how messages name it."""

    def __init__(self, label: str, item: h5py.Dataset, where: str) -> None:
        self.dims, self.item, self._where = _dimensions(item, label, where), item, where
        self.shape, self.kind = tuple(item.shape), item.dtype.kind

    @property
    def unit(self) -> str:
        """What its attribute `units` says; empty if there is none."""
        return str(_plain_attribute(self.item.attrs.get("units", "")))

    @property
    def seconds(self) -> float:
        """The unit [s] of a time, also as xarray writes dates, `milliseconds since 2026-...`; 1 if none is written.

        Raises LogError if nobody knows it.
        """
        word, *_ = f"{self.unit} s".split()
        try:
            return float(pd.Timedelta(1, word.lower()) / pd.Timedelta(seconds=1))
        except ValueError as error:
            what = f"{self._where} has the unit {shown(word)}: log.time.unit of the map was expected to say it"
            raise LogError(what) from error

    def __getitem__(self, rows: Any) -> Any:
        """Return rows of its text or unpacked numbers, NaN for the fill value. Raises LogError for unsigned ones."""
        item = self.item
        if "_Unsigned" in item.attrs:
            raise LogError(f"{self._where} has the attribute _Unsigned: plain numbers were expected")
        if h5py.check_string_dtype(item.dtype) is not None:
            return np.array(np.asarray(item.asstr()[rows], object).tolist())
        values = item[rows]
        fills = [np.ravel(item.attrs[key]) for key in ("_FillValue", "missing_value") if key in item.attrs]
        if fills and np.asarray(values).dtype.kind in "fiu":
            kind = item.dtype if item.dtype.kind == "f" else float  # a double is rounded as they are
            empty = np.isin(values, np.concatenate([fill.astype(kind) for fill in fills]))
            values = np.where(empty, np.nan, values) if np.any(empty) else values
        return self._unpacked(values) if item.attrs.keys() & PACKING.keys() else values

    def _unpacked(self, values: Any) -> Any:
        """Return packed numbers times their factor, plus their offset. Raises LogError if these are no numbers."""
        given = {key: np.ravel(self.item.attrs.get(key, plain)) for key, plain in PACKING.items()}
        for key, number in given.items():
            if number.shape != (1,) or number.dtype.kind not in "fiu" or np.asarray(values).dtype.kind not in "fiu":
                raise LogError(f"{self._where} has the attribute {key}: plain numbers were expected")
        return values * float(given["scale_factor"][0]) + float(given["add_offset"][0])


def _stored_variables(group: h5py.Group, name: str) -> dict[str, StoredVariable]:
    """Return the variables of a group by name, without dimensions that have no values."""
    items = {key: item for key, item in group.items() if isinstance(item, h5py.Dataset) and not is_bare(item)}
    labels = {key.removeprefix("_nc4_non_coord_"): key for key in items}
    return {label: StoredVariable(label, items[key], f"{name}: '{key}'") for label, key in labels.items()}


def _dataset(group: h5py.Group, name: str) -> xr.Dataset:
    """Read all variables of a group whose sizes are checked."""
    variables, coords = {}, set(str(group.attrs.get("coordinates", "")).split())
    for label, stored in _stored_variables(group, name).items():
        attrs = stored.item.attrs
        attributes = {
            k: _plain_attribute(v) for k, v in attrs.items() if k not in INTERNAL and not k.startswith("_Netcdf4")
        }
        if "dtype" in attributes:
            raise LogError(f"{name}: '{label}' has the attribute dtype: plain numbers were expected")
        if stored.dims == (label,):
            coords.add(label)
        coords |= set(str(attrs.get("coordinates", "")).split())
        variables[label] = xr.Variable(stored.dims, stored[()], attributes)
    attributes = {k: _plain_attribute(v) for k, v in group.attrs.items() if k not in INTERNAL and k != "_NCProperties"}
    data = {key: values for key, values in variables.items() if key not in coords}
    return xr.Dataset(data, {key: variables[key] for key in coords & set(variables)}, attributes)


def _dimensions(item: h5py.Dataset, label: str, where: str) -> tuple[str, ...]:
    if item.attrs.get("CLASS") == b"DIMENSION_SCALE" and item.ndim == 1:
        return (label,)
    listed = item.attrs.get("DIMENSION_LIST", ())  # h5py's item.dims would end the process if this list is damaged
    scales = [[str(item.file[scale].name).rpartition("/")[2] for scale in dim] for dim in listed]
    if [len(names) for names in scales] != [1] * item.ndim:
        raise LogError(f"{where}: its dimensions have no names: the dimension scales of NetCDF-4 were expected")
    return tuple(names[0] for names in scales)


def _plain_attribute(value: Any) -> Any:
    """Return an attribute as text or number where it is one."""
    if isinstance(value, h5py.Empty):
        return ""
    if isinstance(value, np.ndarray) and value.size == 1:
        value = value.ravel()[0]
    if isinstance(value, str):
        value.encode("utf-8")  # fails for damaged text, which could not be printed
    return value.decode("utf-8") if isinstance(value, bytes) else value


def netcdf_bytes(root: xr.Dataset, truth: xr.Dataset | None = None) -> bytes:
    """Return the content of a NetCDF-4 file: a dataset, and perhaps another in the group `truth`; sealed.

    It is what xarray's `to_netcdf` writes, five times as fast, as small files are mostly names and labels. The order in
    which things were made is kept, without which the NetCDF library does not write to a file again. The file is
    made in memory, because the HDF5 library ends the process with a segmentation fault when the disk is full. Python
    writes the bytes, and a full disk is an OSError.
    """
    content = io.BytesIO()
    with h5py.File(content, "w", track_order=True) as file:
        libraries = f"version=2,hdf5={h5py.version.hdf5_version},h5py={h5py.__version__}"
        file.attrs["_NCProperties"] = np.bytes_(libraries)  # by which the NetCDF library knows its files
        scales: dict[Hashable, h5py.Dataset] = {}
        numbers = itertools.count()
        _write_group(file, root, scales, numbers)
        if truth is not None:
            _write_group(file.create_group("truth", track_order=True), truth, scales, numbers)
    content.seek(0)
    content.write(seal_of(content, content.getbuffer().nbytes))
    return content.getvalue()


def _write_group(
    group: h5py.Group, data: xr.Dataset, scales: dict[Hashable, h5py.Dataset], numbers: Iterator[int]
) -> None:
    """Write a dataset into a group.

    `scales` are the dimensions so far, and get those that the group adds, or has with another size. `numbers` yields
    their numbers, each once in a file: by them the NetCDF library tells dimensions apart.
    """
    variables, attributes = xr.conventions.encode_dataset_coordinates(data)
    _write_attributes(group, attributes)
    items = {key: _write_values(group, str(key), variable) for key, variable in variables.items()}
    for dim, size in data.sizes.items():
        if dim not in scales or scales[dim].shape != (size,):
            bare = dim not in items
            scale = group.create_dataset(str(dim), (size,), ">f4", track_order=True) if bare else items[dim]
            scale.make_scale(f"{NO_VARIABLE.decode()}.{size:10d}" if bare else str(dim))
            scale.attrs["_Netcdf4Dimid"] = np.int32(next(numbers))
            scales[dim] = scale
    for key, item in items.items():
        for i, dim in enumerate(variables[key].dims):
            if scales[dim] != item:
                item.dims[i].attach_scale(scales[dim])


def _write_values(group: h5py.Group, name: str, variable: xr.Variable) -> h5py.Dataset:
    """Write the values and attributes of a variable: texts as UTF-8, truth values as 0 and 1."""
    values, attributes = np.asarray(variable.values), dict(variable.attrs)
    if values.dtype.kind in "OU":
        item = group.create_dataset(name, data=values.astype(object), dtype=h5py.string_dtype(), track_order=True)
    else:
        if values.dtype.kind == "b":
            values, attributes["dtype"] = values.astype(np.int8), "bool"
        empty = np.nan if values.dtype.kind == "f" else None
        summed = bool(values.size and values.ndim) or None  # a checksum of its own, should the seal itself be damaged
        item = group.create_dataset(name, data=values, fillvalue=empty, fletcher32=summed, track_order=True)
        if empty is not None:
            attributes["_FillValue"] = empty
    _write_attributes(item, attributes)
    return item


def _write_attributes(item: h5py.Group | h5py.Dataset, attributes: Mapping[Any, Any]) -> None:
    for key, value in attributes.items():
        item.attrs[key] = value if isinstance(value, str | list) else np.atleast_1d(value)
