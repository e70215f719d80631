"""The files that keep compiled kernels between runs: none of another user's, nor a damaged one, is ever run.

numba reads these files without a check: a cut one ends the process, and another user's runs whatever he put into it. So
they lie in a folder that only this user can write, below the one that numba chooses; and a file counts only if it is
his, nobody else can write it, and the checksum at its end is right. Others count as absent: the kernel is compiled.

Of several processes that start at once, one compiles a kernel, and the others wait and then load it: two that write one
index at the same time would let it lead to the wrong file.
"""

from __future__ import annotations

import fcntl
import os
import pickle
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from io import BytesIO
from pathlib import Path
from typing import Any
from zlib import crc32

import numba
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.core.compiler_lock import global_compiler_lock
from numba.core.runtime import rtsys

from aerobat_pin.errors import check_private, content_of

SEAL_SIZE = 4  # [bytes]
LARGEST_KERNEL = 100_000_000  # [bytes]; one has 2,000,000 at most
LONGEST_WAIT = 300.0  # [s] for a process that compiles the same kernel; it may have been stopped
_told: list[str] = []  # so that a process tells once, not for every kernel


class KernelCache(FunctionCache):  # type: ignore[misc]  # numba has no types
    """The compiled versions of one function, in sealed files; `stamp` identifies the source of all kernels."""

    def __init__(self, function: Callable[..., Any], stamp: object) -> None:
        super().__init__(function)
        self._cache_path = os.path.join(self.cache_path, f"aerobat-{os.geteuid()}")
        self._cache_file = SealedFiles(self._cache_path, self._impl.filename_base, stamp)
        self.by_one_process = self._cache_file.by_one_process

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Load a kernel without loading the compiler, which takes a third of a second; `compile` loads it anyway."""
        rtsys.initialize(target_context)  # what kernels need from numba while they run
        return self._load_overload(sig, target_context)


class SealedFiles(IndexDataCacheFile):  # type: ignore[misc]  # numba has no types
    """The files of one kernel: an index, and one file for each combination of argument types."""

    def __init__(self, folder: str, name: str, stamp: object) -> None:
        super().__init__(cache_path=folder, filename_base=name, source_stamp=stamp)
        # A new version also avoids unpickling outdated entries, whose signatures can name classes that no longer exist.
        self._version = f"{numba.__version__} {stamp}"
        self._locked = False  # by this process

    @contextmanager
    def by_one_process(self) -> Iterator[None]:
        """Compile in this `with` block: other processes wait until it ends, if anything can be locked.

        No two can wait for each other, because a kernel is locked before the kernels that it calls.
        """
        with global_compiler_lock:  # first, or two threads of this process could wait for each other
            if self._locked:
                yield
                return
            with ExitStack() as end:
                with suppress(OSError):
                    self._enter()
                    lock = os.open(f"{self._index_path}.lock", os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o600)
                    end.callback(os.close, lock)
                    last = time.monotonic() + LONGEST_WAIT
                    while time.monotonic() < last:
                        with suppress(BlockingIOError):
                            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                            break
                        time.sleep(0.02)
                self._locked = True
                end.callback(setattr, self, "_locked", False)
                yield

    def save(self, key: Any, data: Any) -> None:
        """Store a compiled kernel; if that fails, tell it once and go on."""
        try:
            self._enter()
            super().save(key, data)
        except OSError as error:
            _tell(f"compiled kernels cannot be stored in {self._cache_path}: {error.strerror or error}")

    def _enter(self) -> None:
        """Make the folder if it is missing. Raises OSError if it cannot be made, or if others can write into it."""
        with suppress(FileExistsError):
            os.mkdir(self._cache_path, 0o700)
        check_private(os.lstat(self._cache_path), Path(self._cache_path))

    def _load_index(self) -> dict[Any, str]:
        content = BytesIO(self._content(self._index_path) or pickle.dumps(""))
        if pickle.load(content) != self._version:
            return {}
        stamp, entries = pickle.load(content)
        return dict(entries) if stamp == self._source_stamp else {}

    def _load_data(self, name: str) -> Any:
        if (content := self._content(path := self._data_path(name))) is None:
            raise FileNotFoundError(path)  # which numba takes for a kernel that is not compiled yet
        return pickle.loads(content)

    @contextmanager
    def _open_for_write(self, filepath: str) -> Iterator[BytesIO]:
        content = BytesIO()
        yield content
        with super()._open_for_write(filepath) as file:
            os.fchmod(file.fileno(), 0o600)
            file.write(content.getvalue() + self._seal(filepath, content.getvalue()))

    def _seal(self, path: str, content: bytes) -> bytes:
        """Return the checksum of content and name; that of a kernel also depends on the version of the sources."""
        version = "" if path == self._index_path else self._version
        return crc32(f"{Path(path).name} {version}".encode(), crc32(content)).to_bytes(SEAL_SIZE, "big")

    def _content(self, path: str) -> bytes | None:
        """Return what a file contains before its checksum; None if that is wrong, or others can have written it."""
        with suppress(OSError):
            check_private(os.lstat(self._cache_path), Path(self._cache_path))
            data = content_of(Path(path), LARGEST_KERNEL, private=True)
            if data[-SEAL_SIZE:] == self._seal(path, data[:-SEAL_SIZE]):
                return data[:-SEAL_SIZE]
        if os.path.lexists(path):
            _tell(f"the compiled kernel {path} is damaged, another's or of another version: it is compiled again")
        return None


def _tell(text: str) -> None:
    if not _told:
        _told.append(text)
        print(text, file=sys.stderr, flush=True)
