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

WORK = ".aerobat-"  # prefix of files and folders that are still being written
LONGEST_FILE_NAME = 255 - len(WORK)  # bytes


def write_text(target: Path, text: str) -> None:
    """Write a file atomically: either completely or not at all. Raises OutputError if it cannot be written."""
    write_files({target: text.encode()})


def write_files(contents: Mapping[Path, bytes | Path]) -> None:
    """Write files atomically: either all of them or none. Missing folders are created.

    Each file is first written beside its place, and locked there.

    Args:
        contents: path -> content, or the file that has it.

    Raises:
        OutputError: a file or folder cannot be written, or another process is just writing it.
    """
    parts: dict[Path, int] = {}  # file beside its place -> descriptor that locks it
    path = Path()

    def clear() -> None:
        while parts:
            part, descriptor = parts.popitem()
            with suppress(OSError):
                part.unlink(missing_ok=True)
            os.close(descriptor)

    try:
        with without_empty({folder for path in contents for folder in path.absolute().parents}), cleaned(clear):
            for path, content in contents.items():
                if os.path.isdir(path):
                    raise IsADirectoryError(errno.EISDIR, "is a folder")
                part = path.with_name(WORK + path.name)
                with undisturbed():
                    parts[part] = descriptor = locked(part)
                os.truncate(descriptor, 0)
                with open(descriptor, "wb", closefd=False) as file:
                    if isinstance(content, bytes):
                        file.write(content)
                    else:
                        with content.open("rb") as source:
                            shutil.copyfileobj(source, file)
            with undisturbed():
                for path in contents:
                    part = path.with_name(WORK + path.name)
                    os.replace(part, path)
                    os.close(parts.pop(part))
                    written(path)
    except BlockingIOError as error:
        raise OutputError(f"output {path}: another process is writing it") from error
    except OSError as error:
        raise OutputError(f"output {path}: cannot be written: {error.strerror or error}") from error


def locked(path: Path) -> int:
    """Open a file of ours for reading and writing, and lock it until it is closed; it and its folder may be missing.

    The lock ends with the process that holds it, however that ends.

    Raises:
        BlockingIOError: another process holds the lock.
        FileExistsError: what is there is not ours.
    """
    while True:
        path.parent.mkdir(parents=True, exist_ok=True)
        check_ours(path)
        descriptor = -1
        try:
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o666)
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if os.path.samestat(os.fstat(descriptor), os.lstat(path)):
                return descriptor
        except FileNotFoundError:
            pass  # the process that held it has just removed it
        except OSError:
            if descriptor >= 0:
                os.close(descriptor)
            raise
        if descriptor >= 0:
            os.close(descriptor)


def check_ours(path: Path, *, folder: bool = False) -> None:
    """Raise FileExistsError if something is at a work place that no program of this user can have left there.

    What is there will be overwritten or deleted; through a link, that would befall a file or folder elsewhere.

    Args:
        path: where a work file goes.
        folder: a work folder goes there, not a file.
    """
    try:
        found = os.lstat(path)
    except FileNotFoundError:
        return
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
    """Raise OutputError if a file cannot be written, or if it exists and `force` is False."""
    if len(os.fsencode(target.name)) > LONGEST_FILE_NAME:
        raise OutputError(f"output {target}: a name of {LONGEST_FILE_NAME} bytes at most was expected")
    if os.path.isdir(target):
        raise OutputError(f"output {target}: is a folder; a file was expected")
    if os.path.exists(target) and not force:
        raise OutputError(f"output {target} exists; --force overwrites it")
    if not os.path.isdir(target.absolute().parent):
        raise OutputError(f"output {target}: there is no folder {target.parent}")
    if not os.access(target.absolute().parent, os.W_OK):
        raise OutputError(f"output {target}: cannot be written: the folder {target.parent} takes no files")


def picture_files(out: Path, name: str, *, force: bool) -> list[Path]:
    """Return the picture files to write: `out` itself if it is a file name, else `name`.png and `name`.pdf in `out`.

    Args:
        out: file that ends in .png, .pdf or .svg, or a folder.
        name: name of the files in a folder, without ending.
        force: allow files that exist.

    Raises:
        OutputError: the ending is none of these three, or a file cannot be written or exists (without `force`).
    """
    if os.path.isdir(out) or not out.suffix:
        files = [out / f"{name}.png", out / f"{name}.pdf"]
        if os.path.exists(out) and not os.path.isdir(out):
            raise OutputError(f"output {out}: is a file; a folder, or a .png, .pdf or .svg file was expected")
        for file in files:
            if os.path.exists(file):
                check_file(file, force=force)
        return files
    if out.suffix.lower() not in (".png", ".pdf", ".svg"):
        raise OutputError(f"output {out}: {out.suffix} is none of .png, .pdf and .svg, and there is no such folder")
    check_file(out, force=force)
    return [out]
