"""Bad inputs of the kinds in `CLASSES` for all doors, drawn from a seed, and what must hold for each of them."""

import contextlib
import io
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import urllib.request
import warnings
from collections import Counter
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from types import FrameType
from typing import Any, NamedTuple, NoReturn, Self

import numpy as np
import tomli_w

from aerobat_pin.aerobat import FlightLog, belief_about, read_log, write_csv
from aerobat_pin.cli import app as cli
from aerobat_pin.errors import AerobatError
from aerobat_pin.experiments import run_recorded
from aerobat_pin.flight import simulate
from aerobat_pin.scenario import load_scenario
from support import bad_recordings
from support.bad_bytes import READERS, changed_bytes, write_readable
from support.bad_folders import SWEEP, bad_comparison, bad_run, bad_sweep
from support.bad_logs import HARMLESS, KINDS, write_kind
from support.bad_maps import by_map, changes_nothing, drawn_map
from support.bad_robots import FOREIGN, ROBOT
from support.bad_strangers import STRANGERS
from support.bad_texts import SHORT, SIZES, TEXT, WITH_MAP, Kind
from support.bench import Bench
from support.broken_runs import CASES
from support.damaged_kernels import damaged_case
from support.wrong_values import api_case, environment_case

CLASSES = {  # number -> what is bad
    1: "logs whose labels or units are others",
    2: "files that are damaged, foreign or absurd",
    3: "requests that are too large, or fail at their end",
    4: "results that are in use, in the way or left over",
    5: "full disks and limits of files",
    6: "signals at any moment",
    7: "files and requests that reach for others",
    8: "damaged compiled kernels",
    9: "wrong arguments from Python",
    10: "flights that diverge",
    11: "logs that contradict themselves",
    12: "files that eat the machine, robots that cannot be",
    13: "keys of a map with values drawn from its tables",
    14: "bytes changed in a file of any kind",
}
SHARES = (8, 24, 10, 0, 0, 0, 8, 2, 10, 0, 4, 10, 12, 12)  # of the classes beyond their least number, in per cent
FAULTS = ("traceback", "hang", "half-written result", "silent acceptance", "wrong message")
RUNS = {4: "replaced", 5: "disk", 6: "signals", 10: "diverged"}
OTHER_DOORS = {**dict.fromkeys(RUNS, "run"), 8: "cache of kernels", 9: "functions of Python", 13: "estimate --map"}
OWN_FOLDERS = {"bench", "run", "swept", "walk", "good.nc", "good.csv"}  # which are made when they are first needed
LONGEST = 20.0  # [s]
MORE_MEMORY = 300_000_000  # bytes beyond those of a process that has imported everything: some 200 MB
DRAWN = 0.1  # share of the inputs that are taken whose figures and pages are drawn, which takes most of the time
IN_A_PROCESS = 0.05  # share of the command lines that run in a process of their own


class Hang(BaseException):
    """A command took longer than `Doors.patience`."""


class Attempt(NamedTuple):
    """One bad input: number of its class, its name, and the fault that it found, which begins with one of `FAULTS`."""

    number: int
    name: str
    fault: str


class Said(NamedTuple):
    """How a command ended: its exit code, or None with the error that left it; and what it printed."""

    code: int | None
    error: str
    out: str


class Doors:
    """Where bad inputs are tried, in a `with` statement: an empty folder, and how long a command may take [s]."""

    def __init__(self, folder: Path, patience: float = LONGEST) -> None:
        self.folder, self.patience, self.longest = folder, patience, 0.0  # the last: of all command lines [s]
        self.tried = Counter[str]()  # door -> number of inputs

    def __enter__(self) -> Self:
        self._stack = contextlib.ExitStack()
        return self

    def __exit__(self, *error: object) -> None:
        self._stack.close()

    @cached_property
    def bench(self) -> Bench:
        """Where runs are killed and disks are filled."""
        (self.folder / "bench").mkdir()
        return self._stack.enter_context(Bench(self.folder / "bench"))

    @cached_property
    def log(self) -> FlightLog:
        """A good flight."""
        return simulate(load_scenario("paper", ["simulation.duration=0.5"]))

    @cached_property
    def run(self) -> Path:
        """The folder of a good run."""
        assert self.called(["run", "paper", "--out", "run", *SHORT], self.folder).code == 0
        return self.folder / "run"

    @cached_property
    def swept(self) -> Path:
        """The folder of a good sweep, with its file."""
        place = self.folder / "swept"
        place.mkdir()
        (place / "s.toml").write_text(SWEEP)
        assert self.called(["sweep", "s.toml", "--out", "out", "--jobs", "1"], place).code == 0
        return place

    @cached_property
    def address(self) -> str:
        """Where a page is served, by a program of its own: a command that ends in this one would end it, too."""
        code = "from aerobat_pin.visualization import serve; serve('the page', lambda at: print(at, flush=True))"
        server = self._stack.enter_context(subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE))
        self._stack.callback(server.kill)
        assert server.stdout is not None
        return server.stdout.readline().decode().strip()

    def attempt(self, rng: np.random.Generator, number: int) -> Attempt:
        """Draw one bad input of a class and try it."""
        self._door = OTHER_DOORS.get(number, "estimate")
        before = sorted(os.listdir(self.folder))
        made = self._attempt(rng, number)
        self.tried[self._door] += 1
        if not made.fault and number not in RUNS and set(os.listdir(self.folder)) - set(before) - OWN_FOLDERS:
            return Attempt(number, made.name, "half-written result: something beside the folder was written")
        return made

    def _attempt(self, rng: np.random.Generator, number: int) -> Attempt:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            if number in RUNS:
                return self._broken(rng, number)
            if number == 9:
                in_environment = rng.random() < 0.2
                self._door = "environment" if in_environment else self._door
                name, wrong = environment_case(rng) if in_environment else api_case(rng)
                signs = {"is accepted": "silent acceptance", "raises": "traceback"}
                kind = next((fault for sign, fault in signs.items() if sign in wrong), FAULTS[-1])
                return Attempt(number, name, wrong and f"{kind}: {wrong}")
            with tempfile.TemporaryDirectory(dir=self.folder) as folder:
                place = Path(folder)
                if number == 8:
                    wrong = damaged_case(rng, place)
                    return Attempt(number, "kernel", wrong and f"wrong message: {wrong}")
                if number in (1, 11) or (number == 2 and rng.random() < 0.4):
                    return self._bad_log(rng, number, place)
                if number == 7 and rng.random() < 0.3:
                    return self._asked(rng)
                if number == 13:
                    return self._drawn_map(rng, place)
                if number == 14:
                    return self._changed_bytes(rng, place)
                kinds = {2: TEXT | ROBOT | self.results, 3: SIZES, 7: FOREIGN, 12: STRANGERS}[number]
                name = str(rng.choice(list(kinds)))
                return Attempt(number, name, self._refused(rng, kinds[name](rng, place), place, limited=number == 12))

    @cached_property
    def walk(self) -> Path:
        """The folder of good recordings, robots and maps, and of a free flight with its calibration."""
        good = self.folder / "walk"
        good.mkdir()
        bad_recordings.write_good(good)
        free = ["--set", "unknown_force=[]", "--set", "simulation.duration=1", "--no-report"]
        assert self.called(["run", "paper", *free, "--out", "free"], good).code == 0
        learn = ["calibrate", "free", "--out", "c.nc", "--identify", "none"]
        assert self.called(learn, good).code == 0
        write_readable(good, self.run, self.swept)
        for name, words, others in READERS:
            with tempfile.TemporaryDirectory(dir=good) as place:
                bad_recordings.copied(good, Path(place), *others, name)
                code = self.bench.forks.warm(words, Path(place))
                assert code == 0 or name == "robot.mjcf", (words, code)  # no table of that robot is there
        return good

    @cached_property
    def results(self) -> dict[str, Kind]:
        """The kinds of bad recordings and of bad folders of results, with good ones behind them."""
        recordings = bad_recordings.recordings(self.walk, self.walk / "free" / "flight.nc", self.walk / "c.nc")
        return recordings | {
            "folder of a run": lambda rng, place: bad_run(rng, place, self.run),
            "folder of a sweep": lambda rng, place: bad_sweep(rng, place, self.swept),
            "run to compare": lambda rng, place: bad_comparison(rng, place, self.run),
        }

    @contextlib.contextmanager
    def _in_time(self) -> Iterator[None]:
        """Raise Hang if a `with` block takes longer than `patience`."""
        before = signal.signal(signal.SIGALRM, _hang)
        signal.setitimer(signal.ITIMER_REAL, self.patience)
        try:
            yield
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            signal.signal(signal.SIGALRM, before)

    def _fault_of(self, error: BaseException) -> str:
        hang = isinstance(error, Hang)
        return f"hang: more than {self.patience:g} s" if hang else f"traceback: {type(error).__name__}: {error}"[:300]

    def called(self, words: list[str], place: Path) -> Said:
        """Run `aerobat` with these words in this process, in a folder."""
        out, error = io.StringIO(), io.StringIO()
        before, sys.argv, start = sys.argv, ["aerobat", *words], time.monotonic()
        code: int | None = 0
        try:
            with (
                self._in_time(),
                contextlib.chdir(place),
                contextlib.redirect_stdout(out),
                contextlib.redirect_stderr(error),
            ):
                cli.main()
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else 0
        except (Exception, Hang) as caught:
            return Said(None, self._fault_of(caught), out.getvalue())
        finally:
            sys.argv = before
            self.longest = max(self.longest, time.monotonic() - start)
        return Said(code, error.getvalue(), out.getvalue())

    def _answer(self, rng: np.random.Generator, words: list[str], place: Path, *, limited: bool = False) -> Said:
        kinds = (" --map", " --suggest", " --calibration")
        self._door = words[0] + "".join(kind for kind in kinds if kind.strip() in words)
        if not limited and rng.random() >= IN_A_PROCESS:
            return self.called(words, place)
        start = time.monotonic()
        limits: Any = {}
        if limited:
            limits = {"more_memory": MORE_MEMORY, "patience": int(self.patience), "pages": rng.random() < DRAWN}
        done = self.bench.forks.start(words, place, **limits).result()
        late = time.monotonic() - start > self.patience
        bad = done.returncode < 0 or "Traceback" in done.stderr
        ended = f"traceback: code {done.returncode}, {done.stderr[-300:]}"
        text = "hang: in a process" if late or done.returncode == -signal.SIGALRM else ended if bad else done.stderr
        return Said(None if late or bad else done.returncode, text, done.stdout)

    def _refused(
        self, rng: np.random.Generator, words: list[str], place: Path, *, limited: bool = False, taken: bool = False
    ) -> str:
        """Return the fault of a command that must be refused with one message, `place` unchanged; or be `taken`."""
        # `limited`: always in a process of its own, whose memory and time are limited.
        before = _state(place)
        said = self._answer(rng, words, place, limited=limited)
        what = f"{' '.join(words)[:300]}: "
        if said.code is None:
            return re.sub("^([a-z]+)", rf"\1: {re.escape(what)}", said.error, count=1)
        if said.code == 0 and taken:
            return ""
        if said.code == 0:
            return f"silent acceptance: {what}{said.out[-200:]}"
        if _state(place) != before:
            return f"half-written result: {what}{sorted(set(_state(place)) ^ set(before))[:5]}"
        last = said.error.strip().splitlines()[-1:] or [""]
        told = len(re.findall("^error: ", said.error, re.MULTILINE)) == 1 or "Usage:" in said.error
        return "" if said.code == 2 and told else f"wrong message: {what}code {said.code}, {last[0][:300]}"

    def _bad_log(self, rng: np.random.Generator, number: int, place: Path) -> Attempt:
        kinds = [kind for kind in KINDS if kind.number == number]
        kind = kinds[rng.integers(len(kinds))]
        path, name = write_kind(kind, rng, self.log, place), kind.name
        if number != 11 and name not in HARMLESS:
            out = {"estimate": ["--out", "out"], "play": ["--out", "out.html"], "calibrate": ["--out", "out.nc"]}
            door = str(rng.choice(list(out)))
            return Attempt(number, name, self._refused(rng, [door, path.name, *out[door]], place))
        try:
            read = _estimated(path)
        except AerobatError as error:
            return Attempt(number, name, f"wrong message: refused: {error}")
        except Exception as error:
            return Attempt(number, name, self._fault_of(error))
        if number == 11:
            warned = read.get("warnings", [])
            told = any(text.startswith(name) for text in warned)
            return Attempt(number, name, "" if told else f"silent acceptance: {name}: warnings {warned}")
        same = read["observers"] == self.estimated[path.suffix]["observers"]
        return Attempt(number, name, "" if same else f"silent acceptance: {name}: read as another flight")

    def _drawn_map(self, rng: np.random.Generator, place: Path) -> Attempt:
        """Estimate by a map with one drawn value: it is refused, or it changes nothing, or a finding says what."""
        name, values, bad = drawn_map(rng)
        bad_recordings.copied(self.walk, place, "robot.urdf", "log.csv")
        (place / "map.toml").write_text(tomli_w.dumps(values))
        if bad:
            return Attempt(13, name, self._refused(rng, ["estimate", "log.csv", *WITH_MAP], place))
        try:
            with self._in_time():
                found = by_map(place)
        except AerobatError:
            return Attempt(13, name, "")
        except (Exception, Hang) as error:
            return Attempt(13, name, self._fault_of(error))
        more = {str(one) for one in found.findings} - {str(one) for one in self.by_map.findings}
        fine = name.startswith("choice") or more or changes_nothing(self.by_map, found)
        return Attempt(13, name, "" if fine else "silent acceptance: other forces without a finding")

    @cached_property
    def by_map(self) -> Any:
        """What is estimated from the good recording by the good map."""
        return by_map(self.walk)

    def _changed_bytes(self, rng: np.random.Generator, place: Path) -> Attempt:
        """Change bytes of a good file: it is taken or refused, within memory and time."""
        name, words = changed_bytes(rng, self.walk, place)
        return Attempt(14, name, self._refused(rng, words, place, limited=True, taken=True))

    @cached_property
    def estimated(self) -> dict[str, dict[str, Any]]:
        """What is estimated from the good flight as a NetCDF file and as a table."""
        FlightLog(self.log.measured).save(self.folder / "good.nc")
        write_csv(self.log, self.folder / "good.csv")
        return {suffix: _estimated(self.folder / f"good{suffix}") for suffix in (".nc", ".csv")}

    def _asked(self, rng: np.random.Generator) -> Attempt:
        """Ask for the page with the name of another host."""
        self._door = "the page that play serves"
        hosts = ["", *"evil.example 127.0.0.1 localhost 127.0.0.1:1 [::1] evil.example:80 127.0.0.1.nip.io".split()]
        host = hosts[rng.integers(len(hosts))]
        asked = urllib.request.Request(self.address, headers={"Host": host})
        answer = urllib.request.build_opener(AllAnswers).open(asked, timeout=self.patience)
        fine = answer.status == 403 and b"the page" not in answer.read()
        return Attempt(7, "host of another", "" if fine else f"silent acceptance: host {host!r}")

    def _broken(self, rng: np.random.Generator, number: int) -> Attempt:
        case = CASES[RUNS[number]](rng)
        place = self.bench.new_folder()
        wrong = "; ".join(case.play(self.bench, place))
        shutil.rmtree(place, ignore_errors=True)
        kind = next((fault for fault in ("traceback", "half-written result") if fault.split()[0] in wrong), FAULTS[-1])
        return Attempt(number, case.name, wrong and f"{kind}: {case.name}: {wrong}")


class AllAnswers(urllib.request.HTTPErrorProcessor):
    """Returns every answer, whatever its status."""

    def http_response(self, request: object, response: Any) -> Any:
        """Return the answer."""
        return response


def drawn_classes(rng: np.random.Generator, count: int, least: int = 20) -> list[int]:
    """Draw the classes of a run: each at least so often, the rest by their shares, in a random order."""
    numbers = [number for number in CLASSES for _ in range(least)]
    numbers += rng.choice(list(CLASSES), max(0, count - len(numbers)), p=np.array(SHARES) / sum(SHARES)).tolist()
    return list(map(int, rng.permutation(numbers)))


def _state(place: Path) -> dict[str, int]:
    """Return every path below a folder with the size of what is there."""
    return {str(path): path.lstat().st_size if not path.is_dir() else 0 for path in place.rglob("*")}


def _estimated(path: Path) -> dict[str, Any]:
    """Return what `metrics.json` would hold of the flight in a file."""
    log = read_log(path)
    return run_recorded(log, belief_about(log, "flight", None, [], [])).metrics


def _hang(number: int, frame: FrameType | None) -> NoReturn:
    raise Hang
