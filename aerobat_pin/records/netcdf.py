"""Read NetCDF-4 files, also those of strangers: every failure is one `LogError`, and no other file is opened.

Before a file is read, its seal (`write_netcdf.py`) and its structure are checked: links, virtual and external data, and
sizes. A file without a seal is first read in a process of its own (`hdf5_trial.py`).
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import xarray as xr

from aerobat_pin.errors import LogError
from aerobat_pin.records.hdf5_trial import fails_in_a_trial
from aerobat_pin.records.write_netcdf import NO_VARIABLE, seal_holds

LARGEST_FILE = 2e9  # [bytes] of all values of a file; 2 kB a sample, so 1e6 samples
LIMIT = f"at most {LARGEST_FILE / 1e9:g} GB are read"
LARGEST_ATTRIBUTE = 1e6  # [bytes]
MOST_ENTRIES = 1000  # in a group
DEFLATE_LIMIT = 1100.0  # zlib cannot make data smaller than by this factor
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
    with _checked_file(path, what, groups) as (parts, name):
        return {key: _dataset(part, name) for key, part in parts.items()}


@contextmanager
def netcdf_variables(
    path: str | Path, what: str, groups: Sequence[str] = ()
) -> Iterator[dict[str, dict[str, StoredVariable]]]:
    """Open a NetCDF-4 file as `read_netcdf` does, for files that are too large to be read at once.

    Yields group -> name -> variable, whose rows are read when they are asked for.
    """
    with _checked_file(path, what, groups) as (parts, name):
        found: dict[str, dict[str, StoredVariable]] = {}
        for key, part in parts.items():
            items = {entry.removeprefix("_nc4_non_coord_"): item for entry, item in part.items() if _has_values(item)}
            found[key] = {
                label: StoredVariable(_dimensions(item, label, f"{name}: '{label}'"), item)
                for label, item in items.items()
            }
        yield found


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


@contextmanager
def _checked_file(path: str | Path, what: str, groups: Sequence[str]) -> Iterator[tuple[dict[str, h5py.Group], str]]:
    """Open a file whose structure and sizes are checked; every failure is a LogError."""
    name = f"{what} {path}"
    if not os.path.isfile(path):
        raise LogError(f"{name}: cannot be read as NetCDF-4: there is no such file")
    try:
        sealed = seal_holds(path)
        if sealed is False:  # the HDF5 library can end the process on a damaged file
            raise LogError(f"{name}: cannot be read as NetCDF-4: it is damaged, as its checksum tells")
        if sealed is None and (reason := fails_in_a_trial(Path(path))) is not None:
            raise LogError(f"{name}: cannot be read as NetCDF-4: {reason}")
        with h5py.File(path, "r") as file:
            parts = {"": file} | _groups(file, groups, name)
            size = sum(_checked_size(part, name) for part in parts.values())
            if size > LARGEST_FILE:
                raise LogError(f"{name}: its values take {size / 1e9:.3g} GB: {LIMIT}")
            yield parts, name
    except LogError:
        raise
    except Exception as error:  # h5py raises errors of a dozen kinds for a damaged file
        reason = " ".join(str(error).split())[:200]
        raise LogError(f"{name}: cannot be read as NetCDF-4: {reason or type(error).__name__}") from error


def _groups(file: h5py.File, groups: Sequence[str], name: str) -> dict[str, h5py.Group]:
    """Return the groups of a file by name, after a look at all links. Raises LogError for a link or group not known."""
    found = {}
    for key in _entries(file, name):
        if isinstance(file[key], h5py.Group):
            if key not in groups:
                allowed = f"at most the group {', '.join(groups)}" if groups else "no group"
                raise LogError(f"{name}: has the group '{key}': {allowed} was expected")
            found[key] = file[key]
            for inner in _entries(file[key], name):
                if isinstance(file[key][inner], h5py.Group):
                    raise LogError(f"{name}: has the group '{key}/{inner}': {key} contains channels only")
    return found


def _entries(group: h5py.Group, name: str) -> list[str]:
    """Return the names in a group. Raises LogError if one of them leads elsewhere, or if there are too many."""
    if len(group) > MOST_ENTRIES:
        raise LogError(f"{name}: {len(group)} entries in {group.name}: at most {MOST_ENTRIES} were expected")
    for key in group:
        if not isinstance(group.get(key, getlink=True), h5py.HardLink):
            raise LogError(f"{name}: '{key}' is a link to another place or file: values in the file were expected")
    return list(group)


def _checked_size(group: h5py.Group, name: str) -> float:
    """Return the size of all values in a group [bytes]. Raises LogError for values that the file does not contain."""
    total = 0.0
    _check_attribute_sizes(group, f"{name}: {group.name}")
    for key, item in group.items():
        if not isinstance(item, h5py.Dataset):
            continue
        where = f"{name}: '{key}'"
        _check_attribute_sizes(item, where)
        if item.dtype.kind not in "fiuS" and h5py.check_string_dtype(item.dtype) is None:
            raise LogError(f"{where} has the type {str(item.dtype)[:40]}: real numbers or text were expected")
        size = float(np.prod([float(n) for n in item.shape or ()])) * item.dtype.itemsize
        total += size
        if size > LARGEST_FILE or (item.chunks and np.prod([float(n) for n in item.chunks]) * 8 > LARGEST_FILE):
            raise LogError(f"{where} of {item.shape} takes {size / 1e9:.3g} GB: {LIMIT}")
        if item.is_virtual or item.external:
            raise LogError(f"{where} has its values in another file: values in the file itself were expected")
        filters = item.id.get_create_plist().get_nfilters()
        stored = item.id.get_storage_size() * (DEFLATE_LIMIT if filters else 1.0)
        if stored < size and not _is_bare(item):
            raise LogError(f"{where} of {item.shape}: the file contains only a part of its values")
        _check_texts(item, where)
    return total


def _check_attribute_sizes(item: Any, where: str) -> None:
    """Raise LogError if an object has too many attributes or one that is too large."""
    if len(item.attrs) > MOST_ENTRIES:
        raise LogError(f"{where} has {len(item.attrs)} attributes: at most {MOST_ENTRIES} were expected")
    for key in item.attrs:
        if item.attrs.get_id(key).get_storage_size() > LARGEST_ATTRIBUTE:
            raise LogError(f"{where}: attribute {key} takes more than {LARGEST_ATTRIBUTE / 1e6:g} MB")


def _check_texts(item: h5py.Dataset, where: str) -> None:
    """Raise LogError for a text of absurd length, for which the HDF5 library would take minutes and gigabytes.

    In the file each text is its length (4 bytes) and its place (12 bytes).
    """
    text = h5py.check_string_dtype(item.dtype)
    if text is None or text.length is not None or item.id.get_create_plist().get_nfilters():
        return
    chunks = [item.id.get_chunk_info(i).byte_offset for i in range(item.id.get_num_chunks())] if item.chunks else [0]
    count = int(np.prod(item.chunks or item.shape or (1,)))
    with open(item.file.filename, "rb") as file:
        for start in chunks:
            file.seek(start if item.chunks else item.id.get_offset() or 0)
            places = np.frombuffer(file.read(16 * count)[: 16 * count], np.uint32)
            if item.id.get_storage_size() and np.max(places[::4], initial=0) > LARGEST_ATTRIBUTE:
                raise LogError(f"{where} has a text of more than {LARGEST_ATTRIBUTE / 1e6:g} MB: labels were expected")


def _has_values(item: Any) -> bool:
    return isinstance(item, h5py.Dataset) and not _is_bare(item)


def _is_bare(item: h5py.Dataset) -> bool:
    """Return whether a dataset is only a dimension without values."""
    return bytes(item.attrs.get("NAME", b"")).startswith(NO_VARIABLE)


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
