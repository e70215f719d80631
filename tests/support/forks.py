"""Programs that start at once: `aerobat` forked from a process that has imported everything already."""

# As a program, this module is that process: it reads what to start as JSON, and answers with numbers and exit codes.

import contextlib
import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Self

ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
TESTS = Path(__file__).resolve().parents[1]


class Running:
    """A program that runs."""

    def __init__(self, forks: "Forks", pid: int, said: Path) -> None:
        """Keep its number, and the folder of what it says."""
        self.pid, self._forks, self._said = pid, forks, said

    def send(self, number: int) -> None:
        """Send it a signal, unless it has ended."""
        if self.pid not in self._forks.ended:
            os.kill(self.pid, number)  # it stays a zombie, so the number is still its own, until `result` is called

    def result(self) -> subprocess.CompletedProcess[str]:
        """Wait for its end, and return exit code, standard output and standard error."""
        code = self._forks.ask({"wait": self.pid})
        texts = [(self._said / f"{self.pid}.{name}").read_text(errors="replace") for name in ("out", "err")]
        return subprocess.CompletedProcess([], code, *texts)


class Forks:
    """The process from which programs are forked. Use it in a `with` statement."""

    def __enter__(self) -> Self:
        self.ended: set[int] = set()
        self._said = tempfile.TemporaryDirectory()
        paths = os.pathsep.join([str(TESTS), str(TESTS.parent)])
        command, there = [sys.executable, "-m", "support.forks", self._said.name], {**os.environ, "PYTHONPATH": paths}
        piped = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
        self._process = subprocess.Popen(command, env=there, **piped)
        return self

    def __exit__(self, *error: object) -> None:
        self._process.stdin.close()
        self._process.wait()
        self._said.cleanup()

    def start(self, words: Sequence[str], cwd: Path, **limits: Any) -> Running:
        """Start `aerobat` with words in a folder, with limits of a file [bytes] and of further addresses [bytes]."""
        # `ignored`: signals ignored from the start, as by `nohup`; `patience` [s]: SIGALRM; `pages`: draw figures, too.
        usual = {"largest_file": None, "ignored": [], "more_memory": None, "patience": None, "pages": True}
        wanted = usual | limits | {"words": list(words), "cwd": str(cwd)}
        assert len(wanted) == len(usual) + 2, limits
        return Running(self, self.ask(wanted), Path(self._said.name))

    def warm(self, words: Sequence[str], cwd: Path) -> int:
        """Run `aerobat` once in the process itself and return its exit code; later ones have what it loaded."""
        return self.ask({"warm": list(words), "cwd": str(cwd)})

    def ask(self, wanted: Any) -> int:
        """Send a line to the process, and return its answer."""
        self._process.stdin.write(json.dumps(wanted) + "\n")
        self._process.stdin.flush()
        answer = int(self._process.stdout.readline())
        if "wait" in wanted:
            self.ended.add(wanted["wait"])
        return answer


def fork(said: Path, wanted: dict[str, Any]) -> int:
    """Fork a process as fresh, return its number; there, run `aerobat`. `wanted` has the arguments of `Forks.start`."""
    from aerobat_pin import visualization
    from aerobat_pin.cli import main
    from aerobat_pin.errors import end_on_signals

    signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)  # until the program handles them
    pid = os.fork()
    if pid:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, ENDING)
        return pid
    try:
        os.setsid()
        for stream, name in ((1, "out"), (2, "err")):
            os.dup2(os.open(said / f"{os.getpid()}.{name}", os.O_WRONLY | os.O_CREAT), stream)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        for number in ENDING:
            signal.signal(number, signal.SIG_IGN if number in wanted["ignored"] else signal.SIG_DFL)
        end_on_signals()
        signal.pthread_sigmask(signal.SIG_UNBLOCK, ENDING)
        if (largest := wanted["largest_file"]) is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (largest, largest))
        if (more := wanted["more_memory"]) is not None:
            taken = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
            resource.setrlimit(resource.RLIMIT_AS, (taken + more,) * 2)
        signal.alarm(wanted["patience"] or 0)
        if not wanted["pages"]:
            visualization.write_figures_and_pages = lambda *_: None
        os.chdir(wanted["cwd"])
        sys.argv = ["aerobat", *wanted["words"]]
        main()
    except SystemExit as end:
        sys.stdout.flush()
        os._exit(end.code if isinstance(end.code, int) else 0 if end.code is None else 1)
    except BaseException:
        import traceback

        traceback.print_exc()
        sys.stderr.flush()
        os._exit(1)
    os._exit(0)


def warmed(words: list[str], cwd: str) -> int:
    """Run `aerobat` in this process, in silence and without pages, and return its exit code."""
    from aerobat_pin import visualization
    from aerobat_pin.cli import app

    sys.argv, draw = ["aerobat", *words], visualization.write_figures_and_pages
    visualization.write_figures_and_pages = lambda *_: None
    with contextlib.chdir(cwd), open(os.devnull, "w") as nowhere:
        with contextlib.redirect_stdout(nowhere), contextlib.redirect_stderr(nowhere):
            try:
                app.main()
            except SystemExit as end:
                return end.code if isinstance(end.code, int) else 0
            finally:
                visualization.write_figures_and_pages = draw
    return 0


def serve(said: Path) -> None:
    """Fork and wait as the lines on standard input say."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # of the terminal: not for this process
    from aerobat_pin import experiments, load_scenario
    from aerobat_pin.cli import app
    from aerobat_pin.visualization import write_figures_and_pages

    assert app is not None
    assert write_figures_and_pages is not None
    experiments.run(load_scenario("paper", ["simulation.duration=0.01", "air.warm_up_cycles=0"]))
    for line in sys.stdin:
        wanted = json.loads(line)
        if "wait" in wanted:
            _, status = os.waitpid(wanted["wait"], 0)
            answer = os.waitstatus_to_exitcode(status)
        elif "warm" in wanted:
            answer = warmed(wanted["warm"], wanted["cwd"])
        else:
            answer = fork(said, wanted)
        print(answer, flush=True)


if __name__ == "__main__":
    serve(Path(sys.argv[1]))
