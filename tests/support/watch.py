"""Watch by an audit hook (PEP 578) what a command opens, makes, renames, deletes: `with watched(writes, reads)`."""

# It does not see what a library opens without Python, as HDF5 and Pinocchio do.

import itertools
import os
import site
import sys
import sysconfig
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
HOME = Path.home()
WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC
# Event -> positions of its paths and, where it has any, of the descriptors of the folders in which they are.
OF_ONE = {"chmod": 2, "chown": 3, "mkdir": 2, "remove": 1, "rmdir": 1, "truncate": None, "utime": 3}
CHANGES = {f"os.{name}": ((0, folder),) for name, folder in OF_ONE.items()}
CHANGES |= {"os.link": ((1, 3),), "os.rename": ((0, 2), (1, 3)), "os.symlink": ((1, 2),)}
OUTPUTS = ("--out", "-o", "--frames", "--out-mcap")
CACHES = (HOME / ".cache", HOME / ".config", HOME / ".numba")
SYSTEM = (*map(Path, ("/usr", "/lib", "/lib64", "/etc", "/proc", "/sys", "/opt", "/var/cache")), *CACHES)
PYTHON = {Path(path) for path in (*sysconfig.get_paths().values(), *site.getsitepackages(), *sys.path) if path}
PYTHON |= {Path(sys.prefix), Path(sys.base_prefix)}
TEMPORARY, SHARED = ("tmp", "matplotlib-", "joblib", "loky"), ("sem.", "joblib", "psm_")  # names begin so
_seen: list[list[tuple[bool, str]]] = []  # of each block `watched`: whether a file is changed, and which


def _hook(event: str, arguments: tuple[Any, ...]) -> None:
    if not _seen or (event != "open" and event not in CHANGES):
        return
    with suppress(Exception):  # an error here would become one of the program's
        if event == "open":
            path, _, flags = arguments
            # A bare name may be in a folder of which only the descriptor is known; a folder itself is not read.
            if isinstance(path, str | bytes | os.PathLike) and b"/" in os.fsencode(path) and not flags & os.O_DIRECTORY:
                opened = _place(path, None) if flags & os.O_NOFOLLOW else os.path.realpath(os.fsdecode(path))
                _seen[-1].append((bool(flags & WRITING), opened))
        for at, folder in CHANGES.get(event, ()):
            _seen[-1].append((True, _place(arguments[at], -1 if folder is None else arguments[folder])))


def _place(path: Any, folder: int | None) -> str:
    """Return the absolute path of what is changed, which may itself be a link."""
    if isinstance(path, int):
        return os.readlink(f"/proc/self/fd/{path}")
    path = os.fsdecode(path)
    if folder is not None and folder >= 0:
        path = os.path.join(os.readlink(f"/proc/self/fd/{folder}"), path)
    above, name = os.path.split(os.path.abspath(path))
    return os.path.join(os.path.realpath(above), name)


sys.addaudithook(_hook)


@contextmanager
def watched(writes: Iterable[Path], reads: Iterable[Path]) -> Iterator[None]:
    """Fail if a file is changed or read in the block not below these folders; Python's, temporary ones may be."""
    writable = [Path(os.path.realpath(path)) for path in writes]
    readable = [*writable, *(Path(os.path.realpath(path)) for path in reads), ROOT, *PYTHON, *SYSTEM]
    _seen.append([])
    try:
        yield
    finally:
        wrong = sorted(
            f"{'changed' if changed else 'read'}: {path}"
            for changed, path in set(_seen.pop())
            if not _usual(Path(path))
            and not _below(Path(path), writable if changed else readable)
            and not (changed and any(root.is_relative_to(path) for root in writable))
        )
        assert not wrong, wrong


def watched_command(words: Sequence[str], reads: Iterable[Path]) -> Any:
    """Watch a command line: it may write where its words say, beside which its work folder is, else where it stands."""
    named = [Path(value).parent for option, value in itertools.pairwise(words) if option in OUTPUTS]
    return watched(named or [Path()], reads)


def _usual(path: Path) -> bool:
    """Return whether a file is temporary, compiled by Python or numba, or of a library's settings."""
    if "__pycache__" in path.parts or path.suffix == ".pyc":
        return True
    for place, names in ((Path(os.path.realpath(tempfile.gettempdir())), TEMPORARY), (Path("/dev/shm"), SHARED)):
        if path.is_relative_to(place) and path != place:
            return path.relative_to(place).parts[0].startswith(names)
    return _below(path, [*CACHES, Path("/dev"), Path("/proc")])


def _below(path: Path, folders: Iterable[Path]) -> bool:
    return any(path.is_relative_to(folder) for folder in folders)
