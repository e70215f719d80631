"""Write files atomically, one or several, and check beforehand that they can be written."""

from __future__ import annotations

import errno
import fcntl
import os
import shutil
import stat
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from aerobat_pin.errors.ending import cleaned, undisturbed, written
from aerobat_pin.errors.exceptions import OutputError
from aerobat_pin.errors.given_files import NO_TRICKS

WORK = ".aerobat-"  # prefix of files and folders that are still being written
LONGEST_FILE_NAME = 255 - len(WORK)  # bytes
OPEN_FOLDER = os.O_RDONLY | os.O_DIRECTORY


def write_text(target: Path, text: str) -> None:
    """Write a file atomically: either completely or not at all. Raises OutputError if it cannot be written."""
    write_files({target: text.encode()})


def write_files(contents: Mapping[Path, bytes | Path], within: Path | None = None) -> None:
    """Write files atomically: either all of them or none. Missing folders are created.

    Each file is first written beside its place, and locked there.

    Args:
        contents: path -> content, or the file that has it.
        within: folder below which no folder may be a link.

    Raises:
        OutputError: a file or folder cannot be written, or a link leads to it, or another process is just writing it.
    """
    for path in contents:
        refuse_links(path, within)
    parts: dict[Path, tuple[int, int]] = {}  # path -> its folder, and the descriptor that locks the file beside it
    path = Path()

    def clear() -> None:
        while parts:
            path, (folder, descriptor) = parts.popitem()
            with suppress(OSError):
                os.unlink(WORK + path.name, dir_fd=folder)
            os.close(descriptor)
            os.close(folder)

    try:
        with without_empty({folder for path in contents for folder in path.absolute().parents}), cleaned(clear):
            for path, content in contents.items():
                if os.path.isdir(path):
                    raise IsADirectoryError(errno.EISDIR, "is a folder")
                with undisturbed():
                    folder = opened_folder(path.parent, within)
                    try:
                        parts[path] = folder, locked(path.with_name(WORK + path.name), folder)
                    except BaseException:
                        os.close(folder)
                        raise
                descriptor = parts[path][1]
                os.truncate(descriptor, 0)
                with open(descriptor, "wb", closefd=False) as file:
                    if isinstance(content, bytes):
                        file.write(content)
                    else:
                        with content.open("rb") as source:
                            shutil.copyfileobj(source, file)
            with undisturbed():
                for path in contents:
                    folder, descriptor = parts[path]
                    os.replace(WORK + path.name, path.name, src_dir_fd=folder, dst_dir_fd=folder)
                    del parts[path]
                    os.close(descriptor)
                    os.close(folder)
                    written(path)
    except BlockingIOError as error:
        raise OutputError(f"output {path}: another process is writing it") from error
    except OSError as error:
        raise OutputError(f"output {path}: cannot be written: {error.strerror or error}") from error


def refuse_links(target: Path, within: Path | None = None) -> None:
    """Raise OutputError if a link leads to an output.

    Whoever sent a folder can have put links into it, so of a path that begins at the current folder no part may be one;
    of an absolute path, which the user has typed, only the last part and what is below the folder `within`.
    """
    path, root = (Path(os.path.normpath(one)) for one in (target, within or target))
    below = [folder for folder in path.parents if folder != root and folder.is_relative_to(root)]
    for place in [path, *(below if path.is_absolute() else path.parents)]:
        if os.path.islink(place):
            real = os.path.realpath(path)
            raise OutputError(f"output {target}: {place} is a link; to write behind it, name the place itself: {real}")


def opened_folder(path: Path, within: Path | None = None) -> int:
    """Open a folder for the `dir_fd` of other calls; make those that are missing.

    The links that `refuse_links` refuses are not followed here either: they can be made in between.
    """
    path, root = (Path(os.path.normpath(one)) for one in (path, within or path))
    names = path.relative_to(path.anchor).parts
    typed = len(root.parts) - 1 if path.is_absolute() else 0
    descriptor = os.open(path.anchor or ".", OPEN_FOLDER)
    for i, name in enumerate(names):
        outer = descriptor
        try:
            descriptor = _entered(name, outer, OPEN_FOLDER if i < typed else OPEN_FOLDER | os.O_NOFOLLOW)
        finally:
            os.close(outer)
    return descriptor


def _entered(name: str, outer: int, flags: int, mode: int = 0o777) -> int:
    """Open a folder in another one; make it if it is missing."""
    try:
        return os.open(name, flags, dir_fd=outer)
    except FileNotFoundError:
        with suppress(FileExistsError):  # another process was faster
            os.mkdir(name, mode, dir_fd=outer)
        return os.open(name, flags, dir_fd=outer)


def own_folder(path: Path, outer: int) -> int:
    """Open a work folder in a folder that is open; make it, for this user alone, if it is missing.

    Raises:
        FileExistsError: what is there is not ours.
    """
    try:
        descriptor = _entered(path.name, outer, OPEN_FOLDER | os.O_NOFOLLOW, 0o700)
    except NotADirectoryError:
        check_ours(os.lstat(path.name, dir_fd=outer), path, folder=True)
        raise
    try:
        check_ours(os.fstat(descriptor), path, folder=True)
    except FileExistsError:
        os.close(descriptor)
        raise
    return descriptor


def locked(path: Path, folder: int) -> int:
    """Open a file of ours for reading and writing, and lock it until it is closed; it may be missing.

    The lock ends with the process that holds it, however that ends.

    Args:
        path: the file.
        folder: descriptor of its folder.

    Raises:
        BlockingIOError: another process holds the lock.
        FileExistsError: what is there is not ours.
    """
    while True:
        descriptor = -1
        try:
            descriptor = os.open(path.name, os.O_RDWR | os.O_CREAT | NO_TRICKS, 0o666, dir_fd=folder)
            check_ours(os.fstat(descriptor), path)
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if os.path.samestat(os.fstat(descriptor), os.lstat(path.name, dir_fd=folder)):
                return descriptor
        except FileNotFoundError:
            pass  # the process that held it has just removed it
        except OSError as error:
            if descriptor >= 0:
                os.close(descriptor)
            elif error.errno in (errno.ELOOP, errno.EISDIR, errno.ENXIO):
                check_ours(os.lstat(path.name, dir_fd=folder), path)
            raise
        if descriptor >= 0:
            os.close(descriptor)


def check_ours(found: os.stat_result, path: Path, *, folder: bool = False) -> None:
    """Raise FileExistsError if what is at a work place can be left there by no program of this user.

    It will be overwritten or deleted; through a link, that would befall a file or folder elsewhere.

    Args:
        found: what is there, by `fstat` of what was opened.
        path: where a work file goes.
        folder: a work folder goes there, not a file.
    """
    kind = "folder" if folder else "file"
    if stat.S_ISLNK(found.st_mode):
        what = "is a link"
    elif stat.S_IFMT(found.st_mode) != (stat.S_IFDIR if folder else stat.S_IFREG):
        what = f"is no {kind}"
    elif not folder and found.st_nlink > 1:
        what = "is also a file of another name"
    elif found.st_uid != os.geteuid():
        what = "belongs to another user"
    else:
        return
    raise FileExistsError(errno.EEXIST, f"{path} {what}; nothing, or a {kind} of your own, was expected there")


@contextmanager
def without_empty(folders: Iterable[Path]) -> Iterator[None]:
    """When the `with` block ends, remove those of the folders that did not exist before it and are empty."""
    missing = sorted((folder for folder in folders if not os.path.exists(folder)), key=lambda path: -len(path.parts))

    def remove() -> None:
        for folder in missing:
            with suppress(OSError):
                folder.rmdir()

    with cleaned(remove):
        yield


def check_file(target: Path, *, force: bool) -> None:
    """Raise OutputError if a file cannot be written, a link leads to it, or it exists and `force` is False.

    Missing folders are no obstacle: `write_files` makes them.
    """
    refuse_links(target)
    if len(os.fsencode(target.name)) > LONGEST_FILE_NAME:
        raise OutputError(f"output {target}: a name of {LONGEST_FILE_NAME} bytes at most was expected")
    if os.path.isdir(target):
        raise OutputError(f"output {target}: is a folder; a file was expected")
    if os.path.exists(target) and not force:
        raise OutputError(f"output {target} exists; --force overwrites it")
    folder = next(folder for folder in target.absolute().parents if os.path.lexists(folder))
    if not os.path.isdir(folder):
        raise OutputError(f"output {target}: {folder} is no folder")
    if not os.access(folder, os.W_OK):
        raise OutputError(f"output {target}: cannot be written: the folder {folder} takes no files")
