"""The door for bags of strangers: regular files, plain SQLite tables, and a budget for what they unpack to."""

from __future__ import annotations

import bz2
import os
import sqlite3
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import IO, Any

from aerobat_pin.errors import MOST_TIMES_LARGER, MOST_UNPACKED, LogError, foreign_file

LARGEST_DESCRIPTION = 1_000_000  # bytes of metadata.yaml
BYTES_UNPACKED = 1_000_000  # bytes that are unpacked at once where a file is compressed as a whole


def check_bag(path: Path) -> None:
    """Raise LogError unless a bag is made of regular files, and of tables without formulas where it is SQLite."""
    files = sorted(path.iterdir()) if os.path.isdir(path) else [path]
    for file in files:
        if not os.path.isdir(file):
            foreign_file(file, f"log {file}", LARGEST_DESCRIPTION if file.name == "metadata.yaml" else float("inf"))
        if file.suffix.lower() == ".db3":
            _check_tables(file)


def _check_tables(path: Path) -> None:
    """Raise LogError if a database has views, triggers or computed columns, which can yield rows without an end."""
    try:
        with sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro&immutable=1", uri=True) as file:
            sql = [str(row[0]).upper() for row in file.execute("SELECT sql FROM sqlite_master WHERE sql IS NOT NULL")]
        file.close()
    except (sqlite3.Error, ValueError) as error:
        raise LogError(f"log {path}: cannot be read as a bag: {error}") from error
    plain = ("CREATE TABLE", "CREATE INDEX", "CREATE UNIQUE INDEX")
    if any(not text.startswith(plain) or {"AS", "GENERATED", "AS("} & set(text.split()) for text in sql):
        raise LogError(f"log {path}: has views or computed columns: the plain tables of a bag were expected")


def check_chunks(path: Path, reader: Any) -> None:
    """Raise LogError if the chunks that a bag's index names at one time unpack to more than `MOST_UNPACKED` bytes."""
    storages = [getattr(opened, "storage", None) for opened in reader.readers]
    parts = [part for storage in storages for part in getattr(storage, "storages", [storage])]
    chunks = [chunk for part in parts for chunk in getattr(part, "chunks", ())]
    begun: list[tuple[int, int]] = []
    for chunk in sorted(chunks, key=lambda chunk: chunk.message_start_time):
        begun = [span for span in begun if span[0] >= chunk.message_start_time]
        begun.append((chunk.message_end_time, chunk.uncompressed_size))
        if (size := sum(size for _, size in begun)) > MOST_UNPACKED:
            many = f"{len(begun)} chunks of one time" if len(begun) > 1 else "one chunk"
            raise LogError(f"log {path}: {many} unpack to {size} bytes: at most {MOST_UNPACKED} were expected")


class Unpacking:
    """Unpacks what a bag has compressed, within the budget of its size; each failure is a LogError."""

    def __init__(self, path: Path) -> None:
        files = path.iterdir() if os.path.isdir(path) else [path]
        self._path, self._budget = path, MOST_TIMES_LARGER * sum(file.stat().st_size for file in files) + MOST_UNPACKED

    @property
    def of_mcap(self) -> Mapping[str, Callable[[bytes, int], bytes]]:
        """Functions of a chunk's bytes and its stated size, by the compression's name in MCAP files."""
        return {"": lambda data, _: data, "lz4": self._lz4, "zstd": self.zstd}

    @property
    def of_rosbag1(self) -> Mapping[str, Callable[[bytes], bytes]]:
        """Functions of a chunk's bytes, by the compression's name in ROS 1 bags."""
        return {"none": bytes, "bz2": lambda data: self._unpacked(bz2.BZ2Decompressor(), data), "lz4": self._lz4}

    def zstd(self, data: bytes, size: int = MOST_UNPACKED) -> bytes:
        """Unpack a frame of Zstandard of a stated size."""
        from rosbags.rosbag2.storage_mcap import zstd

        return self._unpacked(zstd.ZstdDecompressor(), data, size)

    def copy(self, packed: IO[bytes], whole: IO[bytes]) -> None:
        """Copy a file that is unpacked on the way."""
        while piece := packed.read(BYTES_UNPACKED):
            self._take(len(piece))
            whole.write(piece)

    def _lz4(self, data: bytes, size: int = MOST_UNPACKED) -> bytes:
        from lz4.frame import LZ4FrameDecompressor

        return self._unpacked(LZ4FrameDecompressor(), data, size)

    def _unpacked(self, decompressor: Any, data: bytes, size: int = MOST_UNPACKED) -> bytes:
        most = min(size, MOST_UNPACKED)
        unpacked: bytes = decompressor.decompress(data, most + 1)
        if len(unpacked) > most:
            raise LogError(f"log {self._path}: a chunk unpacks to more than the {most} bytes expected of it")
        self._take(len(unpacked))
        return unpacked

    def _take(self, size: int) -> None:
        self._budget -= size
        if self._budget < 0:
            most = f"{MOST_TIMES_LARGER} times its size"
            raise LogError(f"log {self._path}: unpacks to more than {most}: a recording was expected")
