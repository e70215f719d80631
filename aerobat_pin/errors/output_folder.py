"""A folder of results: at every instant its path shows a whole result, the old one or the new one.

The new result is written into a work folder beside the old one. Then the two folders exchange their names, in one step
of the file system, and the old one is deleted. For the folder `runs/paper`:

    runs/.aerobat-paper/lock    locked while a process writes; the file holds its number
    runs/.aerobat-paper/new     what it has written so far; after the exchange, the old result

A process that is killed leaves this folder behind, but not its lock: the next one that writes beside it removes it. A
link at one of these places, or what belongs to another user, is left alone, and the result refused: each is opened
without following a link, and looked at when it is open, so that nobody can put a link there in between.
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
from aerobat_pin.errors.given_files import content_of
from aerobat_pin.errors.whole_files import (
    OPEN_FOLDER,
    WORK,
    check_ours,
    locked,
    opened_folder,
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

    Nothing appears at the target unless everything was written. With `force`, the results of an earlier run are
    replaced; other files in the folder are kept.

    Args:
        target: folder for the results. Missing folders are created, and removed again if the block fails.
        force: allow a target that is not empty, if it holds an earlier result.
        replaces: glob patterns of the results of an earlier run.
        sign: the one of them by which an earlier result is known.

    Raises:
        OutputError: another process writes into the target, or a link leads to it, or it is a file, is not empty
            (without `force`), holds no earlier result (with it), has a folder where a file has to go, or cannot be
            written, now or later.
    """
    _check_folder(target, force, replaces, sign)
    with claimed(target) as work:
        _check_folder(target, force, replaces, sign)  # another process may have ended in between
        yield work
        replace_results(work, target, replaces)


@contextmanager
def claimed(target: Path) -> Iterator[Path]:
    """Lock a folder against other processes, and provide an empty work folder. Raises OutputError as `output_folder`.

    Args:
        target: the folder; it may be missing.
    """
    refuse_links(target)
    asked, target = Path(os.path.normpath(target)), _real(target)
    place = _work_place(target)
    opened: list[int] = []  # the folder that holds the work folder, the work folder, its lock

    def clear() -> None:
        if len(opened) > 2:
            _remove(place, *opened[:2])
        while opened:
            os.close(opened.pop())

    try:
        with without_empty((place, *place.parents, target)), cleaned(clear):
            holder = asked if place.parent == target else asked.parent
            with undisturbed():
                opened.append(opened_folder(place.parent if asked.name in ("", "..") else holder))
                opened.append(own_folder(place, opened[0]))
                opened.append(locked(place / LOCK, opened[1]))
            os.truncate(opened[2], 0)
            os.write(opened[2], b"%d\n" % os.getpid())
            for name in os.listdir(opened[0]):
                if name.startswith(WORK) and name != place.name:
                    _remove_unless_alive(place.with_name(name), opened[0])
            os.close(own_folder(place / NEW, opened[1]))
            shutil.rmtree(NEW, ignore_errors=True, dir_fd=opened[1])  # of a process that was killed
            os.mkdir(NEW, dir_fd=opened[1])
            yield place / NEW
    except BlockingIOError as error:
        number = ""
        with suppress(OSError):
            number = content_of(place / LOCK, 20).decode(errors="replace").strip()
        raise OutputError(
            f"output folder {target}: another process{f' ({number})' * bool(number)} writes into it"
        ) from error
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

    Raises:
        OSError: the results cannot be written.
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
        write_files({target / path: (work / path).read_bytes() for path in new}, target)
        for path in old - {target / path for path in new}:
            path.unlink()


def _check_folder(target: Path, force: bool, replaces: Sequence[str], sign: str) -> None:
    """Raise OutputError unless results can go into a folder."""
    refuse_links(target)
    target = _real(target)
    try:
        if target.exists() and not target.is_dir():
            raise OutputError(f"output {target}: is a file; a folder was expected")
        if target.is_dir() and any(not path.name.startswith(WORK) for path in target.iterdir()):
            if not force:
                raise OutputError(
                    f"output folder {target} is not empty; --force replaces an earlier run's results in it"
                )
            if not any(target.glob(sign)):
                raise OutputError(
                    f"output folder {target} holds no earlier result ({sign}) that --force could replace; an empty or "
                    "missing folder was expected"
                )
        for pattern in replaces:
            folder = (target / pattern).parent
            if os.path.islink(folder):
                raise OutputError(f"output folder {target}: {folder.name} is a link; a folder was expected")
            if folder.exists() and not folder.is_dir():
                raise OutputError(f"output folder {target}: {folder.name} is a file; a folder was expected")
            for path in target.glob(pattern):
                if path.is_dir():
                    raise OutputError(f"output folder {target}: {path.name} is a folder; a file was expected")
    except OSError as error:
        if isinstance(error, OutputError):
            raise
        raise OutputError(f"output folder {target}: cannot be read: {error.strerror}") from error


def _real(target: Path) -> Path:
    """Return the path without links; `a/../b` is `b` even if there is no `a`."""
    return Path(os.path.realpath(os.path.abspath(target)))


def _work_place(target: Path) -> Path:
    """Return where the work folder of a target goes: beside it, or in it if there is no place beside it."""
    inside = target.is_dir() and (os.path.ismount(target) or not os.access(target.parent, os.W_OK))
    return (target if inside else target.parent) / f"{WORK}{target.name}"


def _obstacle(target: Path) -> str | None:
    """Return why a folder cannot exchange its name with another, or None."""
    if not target.is_dir():
        return None
    here = Path.cwd()
    if target in (here, *here.parents):
        return "it is or holds the current folder"
    if os.path.ismount(target):
        return "it is a mount point"
    return None if _work_place(target).parent != target else "the folder that holds it takes no new files"


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
        there = new / Path(folder).relative_to(old)
        links = [name for name in folders if os.path.islink(os.path.join(folder, name))]
        for name in [*files, *links]:
            if Path(folder, name) not in results and not os.path.lexists(there / name):
                there.mkdir(parents=True, exist_ok=True)
                os.link(Path(folder, name), there / name, follow_symlinks=False)
        if not (folders or files) and not there.exists():
            there.mkdir(parents=True)


def _remove(place: Path, holder: int, folder: int) -> None:
    """Remove a work folder, open as `folder` in `holder`, its lock last: until then no other process works in it."""
    shutil.rmtree(NEW, ignore_errors=True, dir_fd=folder)
    with suppress(OSError):
        os.unlink(LOCK, dir_fd=folder)
        os.rmdir(place.name, dir_fd=holder)


def _remove_unless_alive(place: Path, holder: int) -> None:
    """Remove the work folder of a process that was killed; of one that lives, and of another user's, do nothing."""
    with suppress(OSError), ExitStack() as opened:
        folder = os.open(place.name, OPEN_FOLDER | os.O_NOFOLLOW, dir_fd=holder)
        opened.callback(os.close, folder)
        check_ours(os.fstat(folder), place, folder=True)
        os.lstat(LOCK, dir_fd=folder)  # what has none is no work folder
        opened.callback(os.close, locked(place / LOCK, folder))
        _remove(place, holder, folder)
