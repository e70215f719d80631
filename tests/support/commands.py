"""The command line as tests call it: in this process, which saves the second of a start, or in one of its own."""

import contextlib
import io
import os
import signal
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from aerobat_pin.cli import app as cli
from support.watch import watched_command

STAGES = ("starting", "reading the motion", "opening the page", "taking pictures")
TEMPORARY = [Path(tempfile.gettempdir())]  # where tests have their folders, and so what commands may read


def call(*words: str) -> int:
    """Run `aerobat` with these words in this process and return its exit code; it writes only where they say."""
    before, sys.argv = sys.argv, ["aerobat", *words]
    try:
        with pytest.raises(SystemExit) as stop, watched_command(words, reads=TEMPORARY):
            cli.main()
    finally:
        sys.argv = before
    return int(stop.value.code or 0)


def aerobat(*words: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run `aerobat` with these words in a folder, in this process but with the warnings that a program shows."""
    out, errors = io.StringIO(), io.StringIO()
    with (
        contextlib.chdir(cwd),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(errors),
        warnings.catch_warnings(),
    ):
        warnings.resetwarnings()
        warnings.simplefilter("ignore", DeprecationWarning)
        code = call(*words)
    return subprocess.CompletedProcess(words, code, out.getvalue(), errors.getvalue())


def interrupted(*words: str, cwd: Path, at: str) -> subprocess.CompletedProcess[str]:
    """Run `aerobat` in a process of its own, and press Ctrl-C once a file or folder matches a pattern."""
    command = [sys.executable, "-m", "aerobat_pin", *words]
    piped = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    process = subprocess.Popen(command, cwd=cwd, start_new_session=True, **piped)
    while process.poll() is None and not any(cwd.glob(at)):
        time.sleep(0.01)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: a browser too
    output, errors = process.communicate()
    return subprocess.CompletedProcess(command, process.returncode, output, errors)


@contextmanager
def served(*words: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """Run a command that serves a page until the `with` block ends; provide the process and its page's address."""
    command = [sys.executable, "-m", "aerobat_pin", *words]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, start_new_session=True) as server:
        try:
            yield server, server.stdout.readline().split()[2]
        finally:
            server.kill()


def of_session(leader: int) -> list[str]:
    """Return the live processes of a session."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[3]) == leader and fields[0] != "Z":
            found.append(stat.parent.name)
    return found


def last_words(done: subprocess.CompletedProcess[str]) -> str:
    """Return what a program said to standard error, without the lines about what takes long, on a busy machine."""
    return "".join(line for line in done.stderr.splitlines(keepends=True) if not line.startswith(STAGES))
