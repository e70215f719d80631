"""Files and folders are written whole or not at all; the user's own stay; signals end a program in one line."""

import errno
import os
import re
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import nullcontext, suppress
from importlib import import_module
from pathlib import Path
from unittest.mock import Mock

import pytest
import support.broken_runs as broken
from support.bench import RUN, Bench
from support.broken_runs import Case
from support.commands import aerobat, last_words

from aerobat_pin.aerobat import FlightLog
from aerobat_pin.errors import (
    OutputError,
    OutputWarning,
    claimed,
    end_on_signals,
    output_folder,
    until_signal,
    write_files,
)
from aerobat_pin.errors.ending import SIGNALS

ending = import_module("aerobat_pin.errors.ending")
folders = import_module("aerobat_pin.errors.output_folder")  # the door has a function of this name
REPLACES = ("a.txt", "b.txt")
PROGRAM = [sys.executable, "-m", "aerobat_pin"]


def written(folder: Path) -> dict[str, str]:
    return {str(path.relative_to(folder)): path.read_text() for path in sorted(folder.rglob("*")) if path.is_file()}


def write(target: Path) -> None:
    with output_folder(target, force=True, replaces=REPLACES, sign="a.txt") as work:
        (work / "a.txt").write_text("new")


@pytest.fixture
def target(tmp_path: Path) -> Path:
    """Return a folder with an old result and a file of the user's."""
    folder = tmp_path / "target"
    folder.mkdir()
    for name, text in (("a.txt", "old"), ("b.txt", "old"), ("mine.txt", "mine")):
        (folder / name).write_text(text)
    return folder


def test_a_new_result_takes_the_place_of_the_old_one_at_once(target: Path) -> None:
    """Until the end nothing changes; then the folder is another one, with the user's file itself, not a copy."""
    inode, mine = target.stat().st_ino, (target / "mine.txt").stat().st_ino
    with output_folder(target, force=True, replaces=REPLACES, sign="a.txt") as work:
        (work / "a.txt").write_text("new")
        assert written(target) == {"a.txt": "old", "b.txt": "old", "mine.txt": "mine"}
        (target / "late.txt").write_text("made meanwhile")
    assert written(target) == {"a.txt": "new", "late.txt": "made meanwhile", "mine.txt": "mine"}
    assert target.stat().st_ino != inode
    assert (target / "mine.txt").stat().st_ino == mine
    assert os.listdir(target.parent) == ["target"]


def test_a_link_to_a_folder_is_not_followed(target: Path) -> None:
    """Nobody knows who put it there; the line says what to name to write behind it."""
    link = target.parent / "link"
    link.symlink_to(target)
    with pytest.raises(OutputError, match=f"{link} is a link; to write behind it, name the place itself: {target}"):
        write(link)
    assert written(target)["a.txt"] == "old"


@pytest.mark.parametrize("number", [errno.EINVAL, errno.ENOSYS, errno.EXDEV, errno.EPERM])
def test_file_systems_that_cannot_exchange_are_told(number: int, target: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(folders, "_put", Mock(side_effect=OSError(number, os.strerror(number))))
    with pytest.warns(OutputWarning, match=r"cannot exchange it as a whole \(.*its files are replaced one by one"):
        write(target)
    assert written(target) == {"a.txt": "new", "mine.txt": "mine"}
    assert os.listdir(target.parent) == ["target"]


def test_a_disk_that_is_full_at_the_last_moment_costs_nothing(target: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The old result stays, and the message gives the reason."""
    monkeypatch.setattr(folders, "_put", Mock(side_effect=OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))))
    with pytest.raises(OutputError, match=f"output folder {target}: cannot be written: No space left on device"):
        write(target)
    assert written(target) == {"a.txt": "old", "b.txt": "old", "mine.txt": "mine"}
    assert os.listdir(target.parent) == ["target"]


def test_a_second_writer_is_refused_by_the_number_of_the_first(target: Path) -> None:
    """At once, and without harm to the first."""
    with claimed(target):
        with pytest.raises(OutputError, match=rf"another process \({os.getpid()}\) writes into it"):
            write(target)
        assert written(target)["a.txt"] == "old"
    write(target)


def test_a_work_folder_that_was_just_removed_is_made_again(target: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Between the moment in which it is opened and that in which its lock is: as of four that write at once."""
    opened, removed = folders.own_folder, list[str]()

    def removed_once(path: Path, outer: int) -> int:
        descriptor: int = opened(path, outer)
        if not removed:
            removed.append(path.name)
            os.rmdir(path)
        return descriptor

    monkeypatch.setattr(folders, "own_folder", removed_once)
    write(target)
    assert removed == [".aerobat-target"]
    assert written(target) == {"a.txt": "new", "mine.txt": "mine"}
    assert os.listdir(target.parent) == ["target"]


def test_files_are_written_together_or_not_at_all(tmp_path: Path) -> None:
    """A folder in the place of the second file: the first is not written either, and no folder stays."""
    (tmp_path / "two").mkdir()
    with pytest.raises(OutputError, match="two: cannot be written: is a folder"):
        write_files({tmp_path / "new" / "one": b"1", tmp_path / "two": b"2"})
    assert os.listdir(tmp_path) == ["two"]
    (tmp_path / ".aerobat-three").write_text("left by a process that was killed, and longer than what comes")
    write_files({tmp_path / "three": b"3"})
    assert written(tmp_path) == {"three": "3"}


def test_standard_output_on_a_full_disk_is_told(tmp_path: Path) -> None:
    """One line and exit code 2; without it Python would end with code 120."""
    with open("/dev/full", "w") as full:
        done = subprocess.run([*PROGRAM, "urdf"], stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    said = "error: standard output: cannot be written: No space left on device\n"
    assert (done.returncode, last_words(done)) == (2, said)


PAPER = ["run", "paper"]


def limited_memory() -> None:
    """As `ulimit -v 300000` does."""
    resource.setrlimit(resource.RLIMIT_AS, (300_000 << 10, 300_000 << 10))


@pytest.mark.parametrize(
    ("words", "what", "said"),
    [
        (["--version"], lambda: os.close(1), "standard output is closed; a file or a terminal was expected, such as"),
        (PAPER, lambda: os.rmdir(os.getcwd()), "the current folder: No such file or directory; a folder that"),
        (PAPER, limited_memory, "307 MB of memory (ulimit -v); 1000 MB at least were expected"),
    ],
    ids=["standard output closed", "current folder removed", "ulimit -v 300000"],
)
def test_hopeless_surroundings_are_told(words: list[str], what: Callable[[], None], said: str, tmp_path: Path) -> None:
    """Before anything is loaded or written; exit code 2."""
    done = subprocess.run([*PROGRAM, *words], cwd=tmp_path, capture_output=True, text=True, preexec_fn=what)
    assert (done.returncode, done.stdout) == (2, "")
    assert last_words(done).startswith(f"error: {said}")
    assert last_words(done).count("\n") == 1
    assert not tmp_path.exists() or os.listdir(tmp_path) == []


def test_other_surroundings_do_not_matter(tmp_path: Path) -> None:
    """A backend of matplotlib that is none, no folder for its settings, and neither input nor messages."""

    def close() -> None:
        os.close(0)
        os.close(2)

    environment = {**os.environ, "MPLBACKEND": "nonsense", "MPLCONFIGDIR": "/proc/nowhere"}
    command = [*PROGRAM, "linkage", "--out", "a.png"]
    done = subprocess.run(command, env=environment, cwd=tmp_path, stdout=subprocess.PIPE, check=False, preexec_fn=close)
    assert done.returncode == 0
    assert done.stdout.endswith(b"drawn to a.png\n")
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")


MULTIPLYING = """
import os, sys
from aerobat_pin.cli.surroundings import prepare_surroundings
prepare_surroundings()
import numpy as np
np.ones((1000, 1000)) @ np.ones((1000, 1000))
print(len(os.listdir("/proc/self/task")))
"""


@pytest.mark.parametrize(
    ("chosen", "expected"), [({}, 1), ({"OPENBLAS_NUM_THREADS": "2"}, min(2, os.cpu_count() or 1))]
)
def test_matrices_are_multiplied_by_one_thread_unless_more_is_asked(chosen: dict[str, str], expected: int) -> None:
    """The threads of BLAS wait for each other busily: beside another program an estimate took four times as long."""
    environment = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")} | chosen
    done = subprocess.run([sys.executable, "-c", MULTIPLYING], env=environment, capture_output=True, check=True)
    assert int(done.stdout) == expected


def test_programs_without_docstrings_work(tmp_path: Path) -> None:
    """`PYTHONOPTIMIZE=2`, and no HOME; `list` shows docstrings where there are any."""
    environment = {name: value for name, value in os.environ.items() if name != "HOME"} | {"PYTHONOPTIMIZE": "2"}
    done = subprocess.run([*PROGRAM, "list"], env=environment, capture_output=True, text=True, check=False)
    assert (done.returncode, last_words(done)) == (0, "")
    assert "force_level" in done.stdout


LOADING = """
import os, signal, sys
import importlib.abc

wanted = sys.argv[1]

class Interrupt(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name == wanted:
            sys.meta_path.remove(self)
            os.kill(os.getpid(), signal.SIGINT)

sys.meta_path.insert(0, Interrupt())
from aerobat_pin.cli import main
sys.argv = ["aerobat", "run", "paper", "--out", "result"]
main()
"""


@pytest.mark.parametrize("module", ["aerobat_pin.errors", "numpy", "xarray"])
def test_ctrl_c_while_the_program_loads_is_one_line(module: str, tmp_path: Path) -> None:
    """From the first import of ours on, before the handlers are there and after."""
    command = [sys.executable, "-c", LOADING, module]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, last_words(done)) == (130, "interrupted: nothing was written\n")
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize(("count", "words"), [(1, "a0 had been written and is whole"), (3, "and 2 more .* are whole")])
def test_what_was_written_before_ctrl_c_is_counted(
    count: int, words: str, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """One folder, or several seeds'."""
    monkeypatch.setattr(ending._now, "written", [Path(f"a{k}") for k in range(count)])
    ending._say_what_was_written()
    assert re.search(words, capfd.readouterr().err)


def test_a_program_in_the_background_ignores_ctrl_c(tmp_path: Path) -> None:
    """Started with SIGINT ignored, as `&` in a script and `nohup` do."""
    process = subprocess.Popen(
        [*PROGRAM, "list"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_IGN),
    )
    while process.poll() is None:
        process.send_signal(signal.SIGINT)
        time.sleep(0.02)
    _, errors = process.communicate()
    assert process.returncode == 0
    assert re.fullmatch(rb"(starting[^\n]*\n)*", errors), errors  # which is said on a machine that loads slowly


SIZES = (1_000, 120_000)  # [bytes]: a short run writes files of up to 0.2 MB
CASES = [  # `make evidence` ends runs at 400 random moments
    broken.at_once(3),
    broken.in_the_way("metrics.json", is_folder=True),
    broken.in_the_way("figures", is_folder=False),
    broken.left_by_a_killed_run("result", b"123"),
    broken.left_by_a_killed_run("other", b""),
    broken.from_inside(below=False),
    broken.from_inside(below=True),
    *(broken.limited(size) for size in SIZES),
    *(broken.killed(share, signal.SIGKILL) for share in (0.7, 0.95)),
    broken.killed(0.6, signal.SIGTERM),
    broken.killed(0.8, signal.SIGINT),
    broken.ignored(0.5),
    broken.diverging(0.0055, 1e4),
]


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    with Bench(tmp_path_factory.mktemp("bench")) as made:
        yield made


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_a_broken_run_leaves_the_old_result_or_the_new_one(case: Case, bench: Bench) -> None:
    """A good result and files of the user's are there before; `Bench.wrong` says what must hold."""
    assert case.play(bench, bench.new_folder()) == []


@pytest.mark.skipif(not broken.can_mount(), reason="only root can mount a small disk")
@pytest.mark.parametrize("free", SIZES)
def test_a_full_disk_costs_a_message(free: int, bench: Bench) -> None:
    """A tmpfs with so many bytes left; HDF5 alone would end the process with a segmentation fault."""
    assert broken.full_disk(free).play(bench, bench.new_folder()) == []


@pytest.mark.usefixtures("unrendered")
def test_a_diverged_flight_can_be_replayed_and_estimated(tmp_path: Path) -> None:
    """Report, replay and `aerobat estimate` mark it; none of them goes beyond `diverged_at`."""
    push = "unknown_force=[{frame='left_force_point', signal='step', start=0.005, height=1e5}]"
    words = [word for word in RUN if word != "--no-report"]
    done = aerobat(*words, "--set", push, cwd=tmp_path)
    assert done.returncode == 2
    assert "the flight diverged at t = 0.00" in done.stderr
    log = FlightLog.load(tmp_path / "result" / "flight.nc")
    assert log.time[-1] < log.measured.attrs["diverged_at"] < 0.02
    for page in ("report.html", "replay.html"):
        assert f"DIVERGED at {log.measured.attrs['diverged_at']:.4g} s" in (tmp_path / "result" / page).read_text()
    assert "diverged at" in (tmp_path / "result" / "report.html").read_text()
    for words in (["play", "result", "--out", "page.html"], ["estimate", "result/flight.nc", "--out", "again"]):
        assert aerobat(*words, cwd=tmp_path).returncode == 0
    assert "DIVERGED at" in (tmp_path / "page.html").read_text()
    assert "DIVERGED at" in (tmp_path / "again" / "metrics.json").read_text()


POOL = """
import os, time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import active_children, get_context
from aerobat_pin.errors import cleaned, end_on_signals

end_on_signals()
read, write = os.pipe()
os.close(read)
with cleaned(lambda: os.write(write, b"gone")), ProcessPoolExecutor(2, mp_context=get_context("fork")) as pool:
    waiting = [pool.submit(time.sleep, 60.0) for _ in range(2)]
    print(*(child.pid for child in active_children()), flush=True)
    waiting[0].result()
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_the_helpers_of_a_program_end_with_it(number: signal.Signals) -> None:
    """After `kill PID`, which the helpers do not get, they stayed for good; writing to a dead one ends nothing."""
    with subprocess.Popen([sys.executable, "-c", POOL], stdout=subprocess.PIPE, start_new_session=True) as program:
        assert program.stdout is not None
        helpers = [int(word) for word in program.stdout.readline().split()]
        time.sleep(0.5)  # a signal just before a thread waits for a lock is seen after that
        program.send_signal(number)
        try:
            program.communicate(timeout=30.0)  # which ends when the last of them is gone
        finally:
            with suppress(ProcessLookupError):
                os.killpg(program.pid, signal.SIGKILL)
    assert len(helpers) == 2
    assert program.returncode == 128 + number


@pytest.mark.parametrize("lost", [False, True], ids=["raised", "lost in a callback"])
def test_a_loop_ends_by_the_first_signal(lost: bool) -> None:
    """Also where a library has swallowed the exception, as asyncio and ctypes do in their callbacks."""
    handlers = {number: signal.getsignal(number) for number in (*SIGNALS, signal.SIGPIPE)}
    turns: list[int] = []

    def turn() -> None:
        turns.append(len(turns))
        assert len(turns) < 4
        if len(turns) == 3:
            with suppress(KeyboardInterrupt) if lost else nullcontext():
                signal.raise_signal(signal.SIGINT)

    try:
        end_on_signals()
        until_signal(turn)
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
    assert turns == [0, 1, 2]
