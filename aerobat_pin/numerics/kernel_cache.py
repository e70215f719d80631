"""The files that keep compiled kernels between runs, sealed so that a damaged one is compiled again instead of run.

numba reads these files without a check: a cut or foreign file ends the process inside the compiler's library. Here
every file ends with a checksum. A file whose checksum is wrong counts as absent, so numba compiles the kernel and
replaces the file. A folder that is full or cannot be written costs only the time to compile at the next start.

Of several processes that start at once, one compiles a kernel, and the others wait and then load it. This also keeps
them from writing one index at the same time, which numba would let lead to the wrong file.
"""

from __future__ import annotations

import fcntl
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from io import BytesIO
from pathlib import Path
from typing import Any
from zlib import crc32

import numba
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.core.compiler_lock import global_compiler_lock
from numba.core.runtime import rtsys

SEAL_SIZE = 4  # [bytes]
LONGEST_WAIT = 300.0  # [s] for a process that compiles the same kernel; it may have been stopped
_files: list[SealedFiles] = []  # those of every kernel that is imported
_told: list[str] = []  # so that a process tells once, not for every kernel


class KernelCache(FunctionCache):  # type: ignore[misc]  # numba has no types
    """The compiled versions of one kernel, in sealed files.

    Args:
        function: the function that is compiled.
        stamp: what identifies the source of all kernels.
    """

    def __init__(self, function: Callable[..., Any], stamp: object) -> None:
        super().__init__(function)
        self._cache_file = SealedFiles(self.cache_path, self._impl.filename_base, stamp)
        self.by_one_process = self._cache_file.by_one_process

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Load a kernel without loading the compiler, which takes a third of a second; `compile` loads it anyway."""
        rtsys.initialize(target_context)  # what kernels need from numba while they run
        return self._load_overload(sig, target_context)


class SealedFiles(IndexDataCacheFile):  # type: ignore[misc]  # numba has no types
    """The files of one kernel: an index, and one file for each combination of argument types.

    Args:
        folder: folder of the files.
        name: start of their names.
        stamp: what identifies the source of all kernels.
    """

    def __init__(self, folder: str, name: str, stamp: object) -> None:
        super().__init__(cache_path=folder, filename_base=name, source_stamp=stamp)
        # A new version also avoids unpickling outdated entries, whose signatures can name classes that no longer exist.
        self._version = f"{numba.__version__} {stamp}"
        self._held = False  # by this process
        _files.append(self)

    @contextmanager
    def by_one_process(self) -> Iterator[None]:
        """Compile in this `with` block: other processes wait until it ends.

        No two processes can wait for each other, because a kernel is locked before the kernels that it calls. Where
        nothing can be locked, every process compiles for itself.
        """
        with global_compiler_lock:  # first, or two threads of this process could wait for each other
            if self._held:
                yield
                return
            lock = None
            with suppress(OSError):
                lock = os.open(f"{self._index_path}.lock", os.O_RDWR | os.O_CREAT, 0o666)
                _lock(lock)
            self._held = True
            try:
                yield
            finally:
                self._held = False
                if lock is not None:
                    os.close(lock)

    def damaged(self) -> list[Path]:
        """Return the files that an up-to-date index leads to, or the index itself, if their checksum is wrong."""
        paths = [self._index_path]
        if self._is_whole(self._index_path):
            paths = [self._data_path(name) for name in self._load_index().values()]
        return [Path(path) for path in paths if Path(path).exists() and not self._is_whole(path)]

    def save(self, key: Any, data: Any) -> None:
        """Store a compiled kernel; if that fails, tell it once and go on."""
        try:
            super().save(key, data)
        except OSError as error:
            _tell(f"compiled kernels cannot be stored in {self._cache_path}: {error.strerror or error}")

    def _load_index(self) -> dict[Any, str]:
        if Path(self._index_path).exists() and self._checked(self._index_path):
            return dict(super()._load_index())
        return {}

    def _load_data(self, name: str) -> Any:
        path = self._data_path(name)
        if not self._checked(path):
            raise FileNotFoundError(path)  # which numba takes for a kernel that is not compiled yet
        return super()._load_data(name)

    @contextmanager
    def _open_for_write(self, filepath: str) -> Iterator[BytesIO]:
        content = BytesIO()
        yield content
        with super()._open_for_write(filepath) as file:
            file.write(content.getvalue() + self._seal(filepath, content.getvalue()))

    def _seal(self, path: str, content: bytes) -> bytes:
        """Return the checksum of content and name; that of a kernel also depends on the version of the sources."""
        version = "" if path == self._index_path else self._version
        return crc32(f"{Path(path).name} {version}".encode(), crc32(content)).to_bytes(SEAL_SIZE, "big")

    def _is_whole(self, path: str) -> bool:
        try:
            data = Path(path).read_bytes() if Path(path).is_file() else b""  # a named pipe would wait for ever
        except OSError:
            return False
        return data[-SEAL_SIZE:] == self._seal(path, data[:-SEAL_SIZE])

    def _checked(self, path: str) -> bool:
        whole = self._is_whole(path)
        if not whole and Path(path).exists():
            _tell(f"the compiled kernel {path} is damaged or of another version: it is compiled again")
        return whole


def _lock(file: int) -> None:
    end = time.monotonic() + LONGEST_WAIT
    while time.monotonic() < end:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            time.sleep(0.02)
        else:
            return


def _tell(text: str) -> None:
    if not _told:
        _told.append(text)
        print(text, file=sys.stderr, flush=True)


def remove_damaged_kernels() -> tuple[list[Path], list[Path]]:
    """Remove damaged files of the kernels that are imported; return those removed, and those that cannot be."""
    found = [path for files in _files for path in files.damaged()]
    for path in found:
        with suppress(OSError):
            path.unlink()
    return [path for path in found if not path.exists()], [path for path in found if path.exists()]
