"""Write files atomically, one or several, and check beforehand that they can be written."""

from __future__ import annotations

import errno
import fcntl
import os
import shutil
import stat
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from aerobat_pin.errors.ending import cleaned, undisturbed, written
from aerobat_pin.errors.exceptions import OutputError
from aerobat_pin.errors.foreign_files import NO_TRICKS

WORK = ".aerobat-"  # prefix of files and folders that are still being written
LONGEST_FILE_NAME = 255 - len(WORK)  # bytes
OPEN_FOLDER = os.O_RDONLY | os.O_DIRECTORY


def write_text(target: Path, text: str) -> None:
    """Write a file atomically: either completely or not at all. Raises OutputError if it cannot be written."""
    write_files({target: text.encode()})


def write_files(contents: Mapping[Path, bytes | Path], within: Path | None = None) -> None:
    """Write files atomically: either all of them or none. Missing folders are created.

    Args:
        contents: path -> content, or the file that has it.
        within: folder below which no folder may be a link.

    Raises:
        OutputError: a file or folder cannot be written, or a link leads to it, or another process is just writing it.
    """
    for path in contents:
        refuse_links(path, within)
    beside: dict[Path, int] = {}  # path whose content still stands beside it -> its folder
    path, opened = Path(), ExitStack()

    def clear() -> None:
        for path, folder in beside.items():
            with suppress(OSError):
                os.unlink(WORK + path.name, dir_fd=folder)
        beside.clear()
        opened.close()

    try:
        with without_empty({folder for path in contents for folder in path.absolute().parents}), cleaned(clear):
            for path, content in contents.items():
                if os.path.isdir(path):
                    raise IsADirectoryError(errno.EISDIR, "is a folder")
                with undisturbed():
                    opened.callback(os.close, folder := opened_folder(path.parent, within))
                    opened.callback(os.close, descriptor := locked(path.with_name(WORK + path.name), folder))
                    beside[path] = folder
                os.truncate(descriptor, 0)
                with open(descriptor, "wb", closefd=False) as file:
                    if isinstance(content, bytes):
                        file.write(content)
                    else:
                        with content.open("rb") as source:
                            shutil.copyfileobj(source, file)
            with undisturbed():
                for path in contents:
                    folder = beside[path]
                    os.replace(WORK + path.name, path.name, src_dir_fd=folder, dst_dir_fd=folder)
                    del beside[path]
                    written(path)
    except BlockingIOError as error:
        raise OutputError(f"output {path}: another process is writing it") from error
    except OSError as error:
        raise OutputError(f"output {path}: cannot be written: {error.strerror or error}") from error


def refuse_links(target: Path, within: Path | None = None) -> None:
    """Raise OutputError if a link leads to an output.

    Of a path that begins at the current folder, which somebody may have sent, no part may be one; of an absolute path,
    which the user has typed, only the last part and what is below the folder `within`.
    """
    path, root = (Path(os.path.normpath(place)) for place in (target, within or target))
    below = [folder for folder in path.parents if folder != root and folder.is_relative_to(root)]
    for place in [path, *(below if path.is_absolute() else path.parents)]:
        if os.path.islink(place):
            real = os.path.realpath(path)
            raise OutputError(f"output {target}: {place} is a link; to write behind it, name the place itself: {real}")


def opened_folder(path: Path, within: Path | None = None) -> int:
    """Open a folder for the `dir_fd` of other calls; make those that are missing.

    The links that `refuse_links` refuses are not followed here either: they can be made in between.
    """
    path, root = (Path(os.path.normpath(place)) for place in (path, within or path))
    typed = len(root.parts) - 1 if path.is_absolute() else 0
    descriptor = os.open(path.anchor or ".", OPEN_FOLDER)
    for i, name in enumerate(path.relative_to(path.anchor).parts):
        outer, flags = descriptor, OPEN_FOLDER if i < typed else OPEN_FOLDER | os.O_NOFOLLOW
        try:
            try:
                descriptor = os.open(name, flags, dir_fd=outer)
            except FileNotFoundError:
                with suppress(FileExistsError):  # another process was faster
                    os.mkdir(name, dir_fd=outer)
                descriptor = os.open(name, flags, dir_fd=outer)
        finally:
            os.close(outer)
    return descriptor


def own_folder(path: Path, outer: int) -> int:
    """Open a work folder in a folder that is open; make it, for this user alone, if it is missing."""
    with suppress(FileExistsError):
        os.mkdir(path.name, 0o700, dir_fd=outer)
    return opened_ours(path, outer, OPEN_FOLDER)


def locked(path: Path, folder: int) -> int:
    """Open a file of ours, which may be missing, and lock it until it is closed or the process ends.

    Raises:
        BlockingIOError: another process holds the lock.
        FileExistsError: what is there is not ours.
        FileNotFoundError: the folder was removed meanwhile.
    """
    while True:
        descriptor = opened_ours(path, folder, os.O_RDWR | os.O_CREAT)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if os.path.samestat(os.fstat(descriptor), os.lstat(path.name, dir_fd=folder)):
                return descriptor
        except FileNotFoundError:
            pass  # the process that held it has just removed it
        except OSError:
            os.close(descriptor)
            raise
        os.close(descriptor)


def opened_ours(path: Path, outer: int, flags: int) -> int:
    """Open what is at a work place, in an open folder; FileExistsError if no program of this user can have left it.

    It will be overwritten or deleted; through a link, that would befall a file or folder elsewhere.
    """
    descriptor = -1
    try:
        descriptor = os.open(path.name, flags | NO_TRICKS, 0o666, dir_fd=outer)
        _check_ours(os.fstat(descriptor), path, flags)
    except OSError as error:
        if descriptor >= 0:
            os.close(descriptor)
        elif error.errno in (errno.ELOOP, errno.EISDIR, errno.ENXIO, errno.ENOTDIR):
            _check_ours(os.lstat(path.name, dir_fd=outer), path, flags)
        raise
    return descriptor


def _check_ours(status: os.stat_result, path: Path, flags: int) -> None:
    """Raise FileExistsError if what is at a work place, opened with these flags, is not ours."""
    folder = flags & os.O_DIRECTORY
    kind = "folder" if folder else "file"
    if stat.S_ISLNK(status.st_mode):
        what = "is a link"
    elif stat.S_IFMT(status.st_mode) != (stat.S_IFDIR if folder else stat.S_IFREG):
        what = f"is no {kind}"
    elif not folder and status.st_nlink > 1:
        what = "is also a file of another name"
    elif status.st_uid != os.geteuid():
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
    """Raise OutputError if a file cannot be written, a link leads to it, or it exists and `force` is False."""
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
