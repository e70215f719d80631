"""A folder of results: at every instant its path shows a whole result, the old one or the new one.

The new result is written into a work folder beside the old one. Then the two folders exchange their names, in one step
of the file system, and the old one is deleted. For the folder `runs/paper`:

    runs/.aerobat-paper/lock    locked while a process writes; the file holds its number
    runs/.aerobat-paper/new     what it has written so far; after the exchange, the old result

A process that is killed leaves this folder behind, but not its lock: the next one that writes beside it removes it.
"""

from __future__ import annotations

import ctypes
import errno
import os
import shutil
import warnings
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from aerobat_pin.errors.ending import cleaned, undisturbed, written
from aerobat_pin.errors.exceptions import OutputError, OutputWarning
from aerobat_pin.errors.foreign_files import content_of
from aerobat_pin.errors.whole_files import (
    OPEN_FOLDER,
    WORK,
    locked,
    opened_folder,
    opened_ours,
    own_folder,
    refuse_links,
    without_empty,
    write_files,
)

LOCK, NEW = "lock", "new"
AT_FDCWD, RENAME_EXCHANGE = -100, 2  # of the system call renameat2, see its page in section 2 of the Linux manual


@contextmanager
def output_folder(target: Path, *, force: bool, replaces: Sequence[str], sign: str) -> Iterator[Path]:
    """Provide an empty work folder; if the `with` block ends without an error, its content is the result in `target`.

    Args:
        target: folder for the results. Missing folders are created, and removed again if the block fails.
        force: replace an earlier result; other files in the folder are kept.
        replaces: glob patterns of the results of an earlier run.
        sign: the one of them by which an earlier result is known.

    Raises:
        OutputError: the target is another process's, a link, no folder, not empty, no result, or cannot be written.
    """
    _check_folder(target, force, replaces, sign)
    with claimed(target) as work:
        _check_folder(target, force, replaces, sign)  # another process may have ended in between
        yield work
        replace_results(work, target, replaces)


@contextmanager
def claimed(target: Path) -> Iterator[Path]:
    """Lock a folder, which may be missing, and provide an empty work folder. Raises OutputError as `output_folder`."""
    refuse_links(target)
    asked, target = Path(os.path.normpath(target)), _real(target)
    place = _work_place(target)
    opened, lock = ExitStack(), None

    def clear() -> None:  # also while it runs already: a signal can come at any moment
        nonlocal lock
        if lock is not None:
            _remove(place, holder, work)
            lock = None
        opened.close()

    try:
        with without_empty((place, *place.parents, target)), cleaned(clear):
            beside = asked if place.parent == target else asked.parent
            with undisturbed():
                opened.callback(os.close, holder := opened_folder(place.parent if asked.name in ("", "..") else beside))
                while lock is None:
                    opened.callback(os.close, work := own_folder(place, holder))
                    with suppress(FileNotFoundError):  # another process, at its end, has just removed the folder
                        opened.callback(os.close, lock := locked(place / LOCK, work))
            os.truncate(lock, 0)
            os.write(lock, b"%d\n" % os.getpid())
            for path in (place.with_name(name) for name in os.listdir(holder) if name.startswith(WORK)):
                if path != place:
                    with suppress(OSError), ExitStack() as leftover:  # by a process that was killed, and is this user's
                        leftover.callback(os.close, killed := opened_ours(path, holder, OPEN_FOLDER))
                        os.lstat(LOCK, dir_fd=killed)  # what has none is no work folder
                        leftover.callback(os.close, locked(path / LOCK, killed))
                        _remove(path, holder, killed)
            os.close(own_folder(place / NEW, work))
            shutil.rmtree(NEW, ignore_errors=True, dir_fd=work)  # of a process that was killed
            os.mkdir(NEW, dir_fd=work)
            yield place / NEW
    except BlockingIOError as error:
        number = ""
        with suppress(OSError):
            number = content_of(place / LOCK, 20).decode(errors="replace").strip()
        who = f"another process ({number})" if number else "another process"
        raise OutputError(f"output folder {target}: {who} writes into it") from error
    except OSError as error:
        if isinstance(error, OutputError) or error.errno is None:
            raise
        what = f"{error.strerror or error}{f' ({error.filename})' if error.filename else ''}"
        raise OutputError(f"output folder {target}: cannot be written: {what}") from error


def replace_results(work: Path, target: Path, replaces: Sequence[str]) -> None:
    """Make the content of a work folder the results in `target`; afterwards the work folder holds the old ones.

    Args:
        work: folder that `claimed` provided for this target.
        target: folder for the results; it may be missing.
        replaces: glob patterns of the old results, which disappear. All other files stay.
    """
    target = _real(target)
    new = [path.relative_to(work) for path in sorted(work.rglob("*")) if path.is_file()]
    old = {path for pattern in replaces for path in target.glob(pattern)}
    obstacle = _obstacle(target)
    if obstacle is None:
        try:
            if target.is_dir():
                shutil.copymode(target, work)
                _link_others(target, work, old)
            with undisturbed():
                _put(work, target)
                written(target)
        except OSError as error:
            if error.errno in (errno.ENOSPC, errno.EDQUOT):
                raise
            obstacle = f"the file system cannot exchange it as a whole ({error.strerror})"
        else:
            if work.is_dir():  # what others have put into the folder in the meantime
                _link_others(work, target, {work / path.relative_to(target) for path in old})
            return
    message = f"output folder {target}: {obstacle}; so its files are replaced one by one, not all in one step"
    warnings.warn(OutputWarning(message), stacklevel=2)
    with undisturbed():
        write_files({target / path: work / path for path in new}, target)
        for path in old - {target / path for path in new}:
            path.unlink()


def _check_folder(target: Path, force: bool, replaces: Sequence[str], sign: str) -> None:
    """Raise OutputError unless results can go into a folder."""
    refuse_links(target)
    target = _real(target)
    name = f"output folder {target}"
    try:
        if target.exists() and not target.is_dir():
            raise OutputError(f"output {target}: is a file; a folder was expected")
        if target.is_dir() and any(not path.name.startswith(WORK) for path in target.iterdir()):
            if not force:
                raise OutputError(f"{name} is not empty; --force replaces an earlier run's results in it")
            if not any(target.glob(sign)):
                without = f"holds no earlier result ({sign}) that --force could replace"
                raise OutputError(f"{name} {without}; an empty or missing folder was expected")
        for folder in {(target / pattern).parent for pattern in replaces}:
            if os.path.islink(folder) or (folder.exists() and not folder.is_dir()):
                what = "link" if os.path.islink(folder) else "file"
                raise OutputError(f"{name}: {folder.name} is a {what}; a folder was expected")
        for path in (path for pattern in replaces for path in target.glob(pattern) if path.is_dir()):
            raise OutputError(f"{name}: {path.name} is a folder; a file was expected")
    except OSError as error:
        if isinstance(error, OutputError):
            raise
        raise OutputError(f"{name}: cannot be read: {error.strerror}") from error


def _real(target: Path) -> Path:
    """Return the path without links; `a/../b` is `b` even if there is no `a`."""
    return Path(os.path.realpath(os.path.abspath(target)))


def _work_place(target: Path) -> Path:
    """Return where the work folder of a target goes: beside it, or in it if there is no place beside it."""
    inside = target.is_dir() and (os.path.ismount(target) or not os.access(target.parent, os.W_OK))
    return (target if inside else target.parent) / f"{WORK}{target.name}"


def _obstacle(target: Path) -> str | None:
    """Return why a folder cannot exchange its name with another, or None."""
    if target.is_dir() and Path.cwd().is_relative_to(target):
        return "it is or holds the current folder"
    if target.is_dir() and os.path.ismount(target):
        return "it is a mount point"
    return "the folder that holds it takes no new files" if _work_place(target).parent == target else None


def _put(work: Path, target: Path) -> None:
    """Give a work folder the name of the target, and the target, if it exists, that of the work folder."""
    if not target.exists():
        os.rename(work, target)
        return
    try:
        renameat2 = ctypes.CDLL(None, use_errno=True).renameat2
    except AttributeError as error:  # a C library before 2018
        raise OSError(errno.ENOSYS, os.strerror(errno.ENOSYS)) from error
    if renameat2(AT_FDCWD, os.fsencode(work), AT_FDCWD, os.fsencode(target), RENAME_EXCHANGE) != 0:
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))


def _link_others(old: Path, new: Path, results: set[Path]) -> None:
    """Give all files in `old` but its results a second name in `new`, where they have none yet."""

    def stop(error: OSError) -> None:
        raise error

    for folder, folders, files in os.walk(old, onerror=stop):
        folders[:], files = ([name for name in names if not name.startswith(WORK)] for names in (folders, files))
        copy = new / Path(folder).relative_to(old)
        links = [name for name in folders if os.path.islink(os.path.join(folder, name))]
        for name in [*files, *links]:
            if Path(folder, name) not in results and not os.path.lexists(copy / name):
                copy.mkdir(parents=True, exist_ok=True)
                os.link(Path(folder, name), copy / name, follow_symlinks=False)
        if not (folders or files) and not copy.exists():
            copy.mkdir(parents=True)


def _remove(place: Path, holder: int, work: int) -> None:
    """Remove an open work folder, its lock last: until then no other process works in it."""
    shutil.rmtree(NEW, ignore_errors=True, dir_fd=work)
    with suppress(OSError):
        os.unlink(LOCK, dir_fd=work)
        os.rmdir(place.name, dir_fd=holder)
