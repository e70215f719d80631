"""Long series on disk: a temporary file that holds rows of numbers, appended in pieces and read by slices.

A recording of an hour has gigabytes of samples, of which each step needs a stretch. All series of a recording share one
file, which stays in memory while it is small, and which the operating system deletes when the process ends, however it
ends. It lies in the folder that Python's `tempfile` chooses (`TMPDIR`).
"""

from __future__ import annotations

import io
import os
import tempfile
import weakref
from bisect import bisect_left, bisect_right
from collections.abc import Iterator
from typing import IO, Any

import numpy as np

from aerobat_pin.errors import LogError
from aerobat_pin.numerics import Array

IN_MEMORY = 1 << 23  # [bytes] of a spool before it moves to disk
EXTENT = 1 << 16  # rows that are read or written at once, at most
SPREAD = 16  # stretches of a sample that is spread over a series
MOST_SAMPLED = 200_000  # rows of such a sample; a median of more hardly differs
LAST_BITS = 4.0  # of a stamp, by which its rounding changes a step at most: one is 2.4e-7 s of Unix time


class Spool:
    """A temporary file of numbers, which threads and forked processes may read at once."""

    def __init__(self) -> None:
        self._file: IO[bytes] = io.BytesIO()
        self._size = 0

    def write(self, rows: Array) -> int:
        """Append numbers and return their place. Raises LogError if the temporary folder is full."""
        place, size = self._size, self._size + rows.nbytes
        try:
            if isinstance(self._file, io.BytesIO) and size > IN_MEMORY:
                file = tempfile.TemporaryFile()
                weakref.finalize(self, file.close)
                file.write(self._file.getbuffer())
                self._file = file
            self._file.seek(place)
            self._file.write(np.ascontiguousarray(rows, float).data)
            self._file.flush()
        except OSError as error:
            raise LogError(
                f"temporary folder {tempfile.gettempdir()}: {error.strerror or error}, {size / 1e9:.2g} GB are needed "
                "so far; TMPDIR names another one"
            ) from error
        self._size = size
        return place

    def read(self, place: int, numbers: Array) -> None:
        """Read numbers from a place on, whoever else reads: none may move the file's own place, which all share."""
        view = numbers.data.cast("B") if numbers.size else memoryview(bytearray())
        if isinstance(self._file, io.BytesIO):
            view[:] = self._file.getbuffer()[place : place + len(view)]
        else:
            os.preadv(self._file.fileno(), [view], place)


class Series:
    """Rows (n,) or (n, width) of doubles in a spool; (n,) without a width."""

    def __init__(self, spool: Spool, width: int | None = None) -> None:
        self.spool, self._row = spool, () if width is None else (width,)
        self._starts = [0]  # index of the first row of each extent, and of the next one
        self._firsts: list[float] = []  # first number of each
        self._places: list[int] = []
        self.finite = True  # whether all numbers are

    def append(self, rows: Array) -> None:
        """Append rows."""
        for begin in range(0, len(rows), EXTENT):
            piece = np.asarray(rows[begin : begin + EXTENT], float)
            self._places.append(self.spool.write(piece))
            self._starts.append(len(self) + len(piece))
            self._firsts.append(float(piece.flat[0]) if piece.size else np.nan)
            self.finite = self.finite and bool(np.isfinite(piece).all())

    def __len__(self) -> int:
        return self._starts[-1]

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of all rows together."""
        return (len(self), *self._row)

    def __getitem__(self, rows: Any) -> Any:
        """Return a slice of rows without a step as an array, or one row."""
        if not isinstance(rows, slice):
            index = range(len(self))[rows]
            return self[index : index + 1][0]
        first, last, step = rows.indices(len(self))
        assert step == 1
        table, at = np.empty((max(last - first, 0), *self._row)), first
        width = self._row[0] if self._row else 1
        while at < last:
            extent = bisect_right(self._starts, at) - 1
            end, skipped = min(self._starts[extent + 1], last), at - self._starts[extent]
            self.spool.read(self._places[extent] + 8 * width * skipped, table[at - first : end - first])
            at = end
        return table

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Array:
        return np.asarray(self[:], dtype)

    def pieces(self, beyond: int = 0) -> Iterator[Array]:
        """Yield all rows, at most `EXTENT` at once, and with each so many beyond them, which come again."""
        for first in range(0, len(self), EXTENT):
            yield self[first : first + EXTENT + beyond]

    def index(self, value: float, side: str = "left") -> int:
        """Return where a value belongs in an increasing series (n,), as `numpy.searchsorted` does."""
        extent = (bisect_left if side == "left" else bisect_right)(self._firsts, value) - 1
        if extent < 0:
            return 0
        start, end = self._starts[extent : extent + 2]
        return start + int(np.searchsorted(self[start:end], value, side=side))  # type: ignore[call-overload]

    def spread(self, most: int = MOST_SAMPLED) -> list[Array]:
        """Return all rows, or of a longer series `SPREAD` stretches at even distances, `most` rows together."""
        return [self[first:last] for first, last in spread_stretches(len(self), most)]


def spread_stretches(count: int, most: int, least: int = 0) -> list[tuple[int, int]]:
    """Return (first, last), exclusive, of stretches of a series: all of it, or `SPREAD` with `most` rows together.

    Each has `least` rows at least.
    """
    size = max(most // SPREAD, least)
    if count <= max(most, SPREAD * least):
        return [(0, count)]
    return [(first, first + size) for first in np.linspace(0, count - size, SPREAD).astype(int).tolist()]


def series_of(spool: Spool, rows: Array) -> Series:
    """Return rows (n,) or (n, k) as a series."""
    series = Series(spool, None if rows.ndim == 1 else rows.shape[1])
    series.append(rows)
    return series


def typical_spacing(time: Series) -> float:
    """Return the median step [s] of stamps (n,), but for their rounding; of a long series that of a sample of it."""
    steps = np.concatenate([np.diff(piece) for piece in time.spread()])
    usual = float(np.median(steps))
    near = steps[np.abs(steps - usual) <= LAST_BITS * np.spacing(time[-1])]
    return float(np.mean(near)) if len(near) else usual
