"""Two checkouts measured in turn, each by its own `bench.py`: what one asks for that says no ratio got worse."""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from typing import Any

RUNS = 5
WORSE = 3.0  # [%], of a ratio
GAIN = "faster"  # in the name of a ratio that should be large; all others should be small
HERE = Path(__file__).resolve().parents[1]

Figures = dict[str, dict[str, Any]]


def measured(checkout: Path, words: list[str]) -> Figures:
    """Run the benchmarks of a checkout on its own packages, and return its figures by name."""
    with tempfile.TemporaryDirectory() as work:
        saved = Path(work) / "figures.json"
        command = [sys.executable, str(checkout / "benchmarks" / "bench.py"), "--save", str(saved), *words]
        environment = {**os.environ, "PYTHONPATH": str(checkout)}
        done = subprocess.run(command, cwd=work, env=environment, capture_output=True, text=True, check=False)
        if done.returncode:
            raise SystemExit(f"{checkout}: the benchmarks failed\n{done.stderr}")
        return {found["name"]: found for found in json.loads(saved.read_text(encoding="utf-8"))["figures"]}


@contextmanager
def checkout_of(other: str) -> Iterator[Path]:
    """Yield a folder with another commit of this repository, removed afterwards; or the folder of that name."""
    if Path(other).is_dir():
        yield Path(other).resolve()
        return
    git = ["git", "-C", str(HERE), "worktree"]
    with tempfile.TemporaryDirectory() as work:
        folder = Path(work) / "other"
        if subprocess.run([*git, "add", "--quiet", "--detach", str(folder), other], check=False).returncode:
            raise SystemExit(f"--against {other}: a commit of {HERE}, or the folder of a checkout, was expected")
        try:
            yield folder
        finally:
            subprocess.run([*git, "remove", "--force", str(folder)], check=True)


def against(other: str, words: list[str]) -> Iterator[str]:
    """Measure another checkout and this one in turn, and yield the lines of the comparison.

    Args:
        other: commit, or folder of the checkout, that this one is compared with.
        words: further words of both command lines.
    """
    sides: tuple[list[Figures], list[Figures]] = ([], [])
    with checkout_of(other) as folder:
        for run in range(RUNS):
            pair = [(folder, sides[0]), (HERE, sides[1])]
            for checkout, runs in pair if run % 2 == 0 else reversed(pair):  # a machine that slows down slows both
                runs.append(measured(checkout, words))
            print(f"run {run + 1} of {RUNS}", file=sys.stderr, flush=True)
    yield from lines(*sides)


def lines(before: list[Figures], now: list[Figures]) -> Iterator[str]:
    """Yield the medians of both sides' runs, their change and a mark at ratios that got worse by more than `WORSE`."""
    yield f"{'median of ' + str(len(now)) + ' runs':<58} {'there':>9} {'here':>9}    {'change':>8}"
    for name, found in (before[0] | now[0]).items():
        there, here = (
            median(run[name]["value"] for run in runs) if name in runs[0] else None for runs in (before, now)
        )
        if there is None or here is None:
            cells = " ".join(f"{'-' if value is None else format(value, '.2f'):>9}" for value in (there, here))
            yield f"{name:<58} {cells} {found['unit']}"
            continue
        change = 100.0 * (here / there - 1.0)
        worse = -change if GAIN in name else change
        mark = "  WORSE" if found["unit"] == "x" and worse > WORSE else ""
        yield f"{name:<58} {there:9.2f} {here:9.2f} {found['unit']:<2} {change:+7.1f} %{mark}"
