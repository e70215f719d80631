"""Runs that are killed, interrupted, short of disk, two at once, or that diverge: random cases, and what must hold."""

# `aerobat run --force` over a good result: that or the new one is left, whole, and one line says how it ended.

import json
import os
import re
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np
import xarray as xr

from support.bench import OWN, Bench, content

FULL = r"error: (output|standard output).*(No space left on device|File too large|Disk quota exceeded)"


class Case(NamedTuple):
    """A case: what is done, and a function that plays it in a `Bench.new_folder` and returns what was wrong, if any."""

    name: str
    play: Callable[[Bench, Path], list[str]]


def said_wrong(done: subprocess.CompletedProcess[str], codes: tuple[int, ...], line: str) -> list[str]:
    """Return what is wrong with how a program ended: its code, or its last line; on a busy machine it told progress."""
    wrong = [] if done.returncode in codes else [f"exit code {done.returncode}: {done.stderr[-500:]}"]
    wrong += ["traceback: " + done.stderr[-1000:]] if "Traceback" in done.stderr else []
    if done.returncode > 0 and not re.fullmatch(line, "".join(done.stderr.splitlines()[-1:])):
        wrong.append(f"said: {done.stderr[-500:]!r}")
    return wrong


def killed(share: float, number: signal.Signals) -> Case:
    """End a run by a signal after a share of its time, then run it once more."""

    def play(bench: Bench, folder: Path) -> list[str]:
        assert bench.seconds
        running = bench.start(folder)
        time.sleep(share * bench.seconds)
        running.send(number)
        done = running.result()
        code = -9 if number == signal.SIGKILL else 128 + number
        wrong = said_wrong(done, (0, code), INTERRUPTED) + bench.wrong(folder, left=number == signal.SIGKILL)
        here = content(folder / "result")["metrics.json"] == bench.new["metrics.json"]
        if "nothing was written" in done.stderr and here:
            wrong.append("it says that nothing was written, but the new result is there")
        again = bench.start(folder).result()
        return wrong + said_wrong(again, (0,), "") + bench.wrong(folder)

    return Case(f"{number.name} after {share:.0%} of the time", play)


INTERRUPTED = r"interrupted: (nothing was written|.* had been written and (is|are) whole)"


def ignored(share: float) -> Case:
    """Send a run in the background a Ctrl-C that it was started to ignore."""

    def play(bench: Bench, folder: Path) -> list[str]:
        running = bench.start(folder, ignored=[signal.SIGINT])
        time.sleep(share * bench.seconds)
        running.send(signal.SIGINT)
        return said_wrong(running.result(), (0,), "") + bench.wrong(folder)

    return Case(f"ignored SIGINT after {share:.0%} of the time", play)


def limited(size: int) -> Case:
    """Let no file grow beyond a size [bytes]."""

    def play(bench: Bench, folder: Path) -> list[str]:
        done = bench.start(folder, largest_file=size).result()
        fits = max(map(len, bench.new.values())) <= size
        return said_wrong(done, (0,) if fits else (2,), FULL) + bench.wrong(folder)

    return Case(f"no file beyond {size} bytes", play)


def can_mount() -> bool:
    """Return whether this process may mount a file system."""
    return (
        os.geteuid() == 0
        and subprocess.run(["unshare", "-m", "true"], capture_output=True, check=False).returncode == 0
    )


@contextmanager
def small_disk(folder: Path, size: int) -> Iterator[None]:
    """Mount a file system of a size [bytes] at a folder."""
    options = ["-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(folder)]
    subprocess.run(["mount", *options], check=True, capture_output=True)
    try:
        yield
    finally:
        subprocess.run(["umount", "-l", str(folder)], check=True, capture_output=True)


def full_disk(free: int) -> Case:
    """Leave only so many bytes beside the old result, on a disk of its own. Needs `can_mount`."""

    def play(bench: Bench, folder: Path) -> list[str]:
        used = sum(4096 * (2 + len(part) // 4096) for part in [*bench.old.values(), *OWN.values()])
        disk = bench.new_folder()
        shutil.rmtree(disk)
        disk.mkdir()
        with small_disk(disk, used + free):
            shutil.copytree(folder, disk, dirs_exist_ok=True)
            done = bench.start(disk).result()
            fits = done.returncode == 0
            wrong = said_wrong(done, (0, 2), FULL) + bench.wrong(disk)
            here = content(disk / "result")["metrics.json"]
            return wrong + ([] if (here == bench.new["metrics.json"]) == fits else ["exit code and result disagree"])

    return Case(f"{free} bytes free", play)


def at_once(count: int) -> Case:
    """Start several runs into one folder at once: one wins, the others refuse at their start."""

    def play(bench: Bench, folder: Path) -> list[str]:
        bench.new  # noqa: B018
        running = [bench.start(folder) for _ in range(count)]
        done = [one.result() for one in running]
        refused = r"error: output folder .*/result: another process \(\d+\) writes into it"
        wrong = [text for one in done for text in said_wrong(one, (0, 2), refused)] + bench.wrong(folder)
        return wrong + (["all were refused"] if all(one.returncode for one in done) else [])

    return Case(f"{count} at once", play)


def in_the_way(name: str, is_folder: bool) -> Case:
    """Put a folder where a file goes, or a file where a folder goes."""

    def play(bench: Bench, folder: Path) -> list[str]:
        place = folder / "result" / name
        before = content(folder / "result")
        if is_folder:
            place.unlink(missing_ok=True)
            before.pop(name, None)
            place.mkdir()
        else:
            shutil.rmtree(place, ignore_errors=True)
            place.write_bytes(b"in the way")
            before = {**{path: kept for path, kept in before.items() if not path.startswith(name)}, name: b"in the way"}
        done = bench.start(folder).result()
        wrong = said_wrong(done, (2,), "error: output folder .* is a (file|folder); a (folder|file) was expected")
        wrong += [] if content(folder / "result") == before else ["something was changed"]
        return wrong + [f"left behind: {path}" for path in folder.iterdir() if path.name != "result"]

    return Case(f"{'folder' if is_folder else 'file'} {name} in the way", play)


def left_by_a_killed_run(name: str, text: bytes) -> Case:
    """Find the work folder of a run that was killed, beside the result: it is removed."""

    def play(bench: Bench, folder: Path) -> list[str]:
        work = folder / f".aerobat-{name}"
        (work / "new" / "figures").mkdir(parents=True)
        (work / "new" / "flight.nc").write_bytes(b"half")
        (work / "lock").write_bytes(text)
        return said_wrong(bench.start(folder).result(), (0,), "") + bench.wrong(folder)

    return Case(f"leftover .aerobat-{name}", play)


def from_inside(below: bool) -> Case:
    """Run into the current folder, or one above it: its files are replaced one by one, and a line says so."""

    def play(bench: Bench, folder: Path) -> list[str]:
        out, here = ("..", folder / "result" / "figures") if below else (".", folder / "result")
        done = bench.start(here, "--out", out).result()
        wrong = said_wrong(done, (0,), "") + bench.wrong(folder)
        told = "it is or holds the current folder; so its files are replaced one by one" in done.stderr
        return wrong + ([] if told else [f"it does not say how it writes: {done.stderr}"])

    return Case(f"into the current folder{' from below' * below}", play)


def diverging(start: float, height: float) -> Case:
    """Push so hard that the flight diverges: what was flown before is kept, and marked."""

    def play(bench: Bench, folder: Path) -> list[str]:
        push = f"unknown_force=[{{frame='left_force_point', signal='step', start={start}, height={height}}}]"
        done = bench.start(folder, "--set", push).result()
        line = r"error: scenario paper: the flight diverged at t = (?P<time>[\d.]+) s: .* is beyond the limit of .*"
        wrong = said_wrong(done, (2,), line)
        if (told := re.search(line, done.stderr)) is None:
            return [*wrong, "it did not diverge"]
        scores = json.loads((folder / "result" / "metrics.json").read_text())
        flight = xr.load_dataset(folder / "result" / "flight.nc", engine="h5netcdf")
        at = float(flight.attrs["diverged_at"])
        wrong += [] if abs(at - float(told["time"])) < 1e-4 else ["log and message name different times"]
        wrong += [] if scores["flight"]["diverged_at"] == at else ["log and metrics name different times"]
        wrong += [] if start < at and at - 0.0011 < flight.time.values[-1] < at else ["the log does not end there"]
        wrong += [] if all(np.isfinite(flight[name]).all() for name in ("q", "v")) else ["the log is not finite"]
        return wrong + ([] if "DIVERGED" in scores["note"] else ["the note does not tell"])

    return Case(f"push of {height:.0f} N at {start:.4f} s", play)


def _replaced(rng: np.random.Generator) -> Case:
    choice = rng.integers(5)
    if choice == 0:
        return at_once(int(rng.integers(2, 6)))
    if choice == 1:
        return in_the_way(str(rng.choice(["flight.nc", "metrics.json", "report.html", "unknown_force_7.csv"])), True)
    if choice == 2:
        return in_the_way("figures", False)
    if choice == 3:
        return left_by_a_killed_run(str(rng.choice(["result", "other"])), rng.bytes(int(rng.integers(8))))
    return from_inside(bool(rng.integers(2)))


def _disk(rng: np.random.Generator) -> Case:
    size = int(10.0 ** rng.uniform(2.0, 5.7))
    return full_disk(size) if can_mount() and rng.integers(2) else limited(size)


def _signals(rng: np.random.Generator) -> Case:
    share, number = float(rng.uniform(0.0, 1.1)), int(rng.integers(4))
    return ignored(share) if number == 3 else killed(share, (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)[number])


CASES: dict[str, Callable[[np.random.Generator], Case]] = {  # kind -> a random case of it
    "replaced": _replaced,
    "disk": _disk,
    "signals": _signals,
    "diverged": lambda rng: diverging(float(rng.uniform(0.002, 0.01)), float(10.0 ** rng.uniform(3.5, 9.0))),
}
