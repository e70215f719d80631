"""What a NetCDF-4 file must be before its values are read: sealed or tried, of plain structure, and not too large.

A seal is the checksum of the whole file, behind the end that the HDF5 library knows: the library does not see it, and
cuts it off when it changes the file. A file without one is first read in a process of its own (`hdf5_trial.py`).
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO
from zlib import crc32

import h5py
import numpy as np

from aerobat_pin.errors import LogError, foreign_file
from aerobat_pin.records.hdf5_trial import fails_in_a_trial

SEAL, CRC_SIZE = b"CRC-32:\n", 4  # the file ends with this word and the checksum of all before it, in bytes
BYTES_SUMMED = 1 << 20  # at once
LARGEST_FILE = 2e9  # [bytes] of all values of a file; 2 kB a sample, so 1e6 samples
LIMIT = f"at most {LARGEST_FILE / 1e9:g} GB are read"
LARGEST_ATTRIBUTE = 1e6  # [bytes]
MOST_ENTRIES = 1000  # in a group
DEFLATE_LIMIT = 1100.0  # zlib cannot make data smaller than by this factor
NO_VARIABLE = b"This is a netCDF dimension but not a netCDF variable"  # begins NAME of a dimension without values


def seal_of(file: BinaryIO, size: int) -> bytes:
    """Read so many bytes, and return their seal."""
    crc = 0
    while size:
        piece = file.read(min(size, BYTES_SUMMED))
        crc, size = crc32(piece, crc), size - len(piece)
    return SEAL + crc.to_bytes(CRC_SIZE, "big")


def seal_netcdf(path: Path) -> None:
    """Put a seal to the end of a file. Raises OSError if it cannot be written."""
    with path.open("r+b") as file:
        file.write(seal_of(file, path.stat().st_size))


def _seal_holds(path: str | Path) -> bool | None:
    """Return whether a file ends with a seal that fits what is before it; None if it has no seal."""
    size = max(0, os.path.getsize(path) - len(SEAL) - CRC_SIZE)
    with open(path, "rb") as file:
        file.seek(size)
        end = file.read()
        file.seek(0)
        return end == seal_of(file, size) if end.startswith(SEAL) else None


@contextmanager
def checked_file(path: str | Path, what: str, groups: Sequence[str]) -> Iterator[tuple[dict[str, h5py.Group], str]]:
    """Open a file whose structure and sizes are checked; every failure, also in the `with` block, is a LogError.

    Yields its groups by name, the root's name is empty, and how messages name the file.
    """
    name = f"{what} {path}"
    try:
        foreign_file(path, f"{name}: cannot be read as NetCDF-4")
        if (sealed := _seal_holds(path)) is False:  # the HDF5 library can end the process on a damaged file
            raise OSError("it is damaged, as its checksum tells")
        if sealed is None and (reason := fails_in_a_trial(Path(path))) is not None:
            raise OSError(reason)
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
    """Return the groups of a file by name. Raises LogError for a link, or a group that is not known."""
    subgroups = {}
    for key in _entries(file, name):
        if isinstance(file[key], h5py.Group):
            if key not in groups:
                allowed = f"at most the group {', '.join(groups)}" if groups else "no group"
                raise LogError(f"{name}: has the group '{key}': {allowed} was expected")
            subgroups[key] = file[key]
            for inner in _entries(file[key], name):
                if isinstance(file[key][inner], h5py.Group):
                    raise LogError(f"{name}: has the group '{key}/{inner}': {key} contains channels only")
    return subgroups


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
    for key, item in ((key, item) for key, item in group.items() if isinstance(item, h5py.Dataset)):
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
        if stored < size and not is_bare(item):
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
    """Raise LogError for a text of absurd length: in the file each is its length (4 bytes) and its place (12 bytes)."""
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


def is_bare(item: h5py.Dataset) -> bool:
    """Return whether a dataset is only a dimension without values."""
    return bytes(item.attrs.get("NAME", b"")).startswith(NO_VARIABLE)
