"""Try thousands of bad inputs at all doors, and write the counts of what went wrong to docs/reliability.md.

PYTHONPATH=tests python benchmarks/bad_inputs.py --count 5000 --seeds 1 2 3
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from support.bad_bytes import READERS
from support.bad_inputs import CLASSES, FAULTS, MORE_MEMORY, Doors, drawn_classes

from aerobat_description import toml_text
from aerobat_pin.errors import LARGEST_TABLE
from aerobat_pin.experiments.sweep import plan
from aerobat_pin.scenario import scenario

LIMITS = (
    scenario.LARGEST_LOG / 1e9,
    scenario.MOST_SECONDS,
    plan.MOST_RUNS,
    plan.MOST_DAYS,
    LARGEST_TABLE / 1e6,
    toml_text.LARGEST_TOML / 1e6,
    toml_text.MOST_LEVELS,
)
SLOWEST, PATIENCE = 900.0, 60.0  # [s] until a command hangs: a good one at first, which compiles, and a bad one
PAGE = Path(__file__).parents[1] / "docs" / "reliability.md"
ITEMS = {  # number -> what must hold
    1: "refused by name; other orders of columns read alike",
    2: "refused",
    3: "refused before any work",
    4: "one whole result, old or new",
    5: "one message; the old result whole",
    6: "one line; old or new result whole",
    7: "refused",
    8: "compiled again, with one line",
    9: "refused by the argument's name",
    10: "kept until it diverged, marked",
    11: "read, with a warning that names it",
    12: "refused, with 300 MB at most",
    13: "refused, or nothing changes, or a finding says what",
    14: "refused or taken, with 300 MB at most",
}


class Tried(NamedTuple):
    """What came of the inputs so far.

    Attributes:
        counts: how often each (class, fault) occurred, with an empty fault for those without.
        doors: door -> number of inputs.
        longest: time that a command line took at most [s].
        faults: which inputs failed, and how.
    """

    counts: Counter[tuple[int, str]]
    doors: Counter[str]
    longest: float
    faults: list[str]


def tried(count: int, seeds: Sequence[int]) -> Iterator[Tried]:
    """Try `count` bad inputs, or a few more: an equal share by each of the seeds; yield every hundred, and the end."""
    counts, faults = Counter[tuple[int, str]](), list[str]()
    with tempfile.TemporaryDirectory() as folder, Doors(Path(folder), SLOWEST) as doors:
        _ = (
            doors.run,
            doors.swept,
            doors.estimated,
            doors.recordings,
            doors.bench.seconds,
        )  # made before anything is timed
        doors.longest, doors.patience = 0.0, PATIENCE
        rngs = [np.random.default_rng(seed) for seed in seeds]
        drawn = zip(*(drawn_classes(rng, -(-count // len(seeds))) for rng in rngs), strict=True)
        for k, (rng, number) in enumerate(pair for row in drawn for pair in zip(rngs, row, strict=True)):
            attempt = doors.attempt(rng, number)
            fault = next((name for name in FAULTS if attempt.fault.startswith(name)), "wrong message")
            counts[number, fault if attempt.fault else ""] += 1
            if attempt.fault:
                faults.append(f"class {number}, {attempt.name}: {attempt.fault}")
                print(f"{k}, {faults[-1]}", flush=True)
            if (k + 1) % 100 == 0:
                print(f"{k + 1} of {count}, {len(faults)} faults", flush=True)
                yield Tried(counts, doors.tried, doors.longest, faults)
        yield Tried(counts, doors.tried, doors.longest, faults)


def main() -> int:
    """Write the page, again after every hundred inputs, and return 1 if anything went wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=5000, help="number of bad inputs")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3], help="of all choices")
    chosen = parser.parse_args()
    start, wrong = time.monotonic(), 0
    words = f"--count {chosen.count} --seeds {' '.join(map(str, chosen.seeds))}"
    for found in tried(chosen.count, chosen.seeds):
        PAGE.write_text(page(found, words, chosen.count, (time.monotonic() - start) / 60.0))
        wrong = len(found.faults)
    return int(wrong > 0)


def page(found: Tried, words: str, asked: int, minutes: float) -> str:
    """Return the page of what was tried, of so many inputs that were asked for."""
    rows = []
    for number, name in CLASSES.items():
        faults = [found.counts[number, fault] for fault in FAULTS]
        rows.append((number, name, ITEMS[number], sum(faults) + found.counts[number, ""], *faults))
    rows.append(("", "all", "", *(sum(row[i] for row in rows) for i in range(3, 4 + len(FAULTS)))))
    return TEXT.format(
        date=time.strftime("%Y-%m-%d"),
        count=rows[-1][3],
        words=words,
        early="" if rows[-1][3] >= asked else f" of {asked}, as it was ended early",
        minutes=minutes,
        longest=found.longest,
        doors="\n".join(f"| {door} | {number} |" for door, number in sorted(found.doors.items())),
        memory=MORE_MEMORY / 1e6,
        patience=PATIENCE,
        heads=" | ".join(f"{fault}" for fault in FAULTS),
        rule="|---" * (4 + len(FAULTS)) + "|",
        faults="".join(f"* Found: {' '.join(fault.split())[:200]}\n" for fault in found.faults),
        table="\n".join(f"| {' | '.join(map(str, row))} |" for row in rows),
        limits=LIMITS,
        readers=len(READERS),
    )


TEXT = """# Reliability

What strangers, full disks and impatient fingers do to the program, counted. Written on {date} by
`make reliability ARGS="{words}"` (`benchmarks/bad_inputs.py`) in {minutes:.0f} minutes: {count} inputs{early},
drawn from these seeds. The same generator makes the 400 bad inputs of every test run (`tests/support/bad_inputs.py`).

| | bad inputs | what must hold | tried | {heads} |
{rule}
{table}

* A *traceback* is any error that is none of this package's, or a program that is ended by a signal of its own making.
* A *hang* takes more than {patience:g} s; the limit only ends it. The longest command line took {longest:.0f} s.
* A *half-written result* is any file that a refused command adds, changes or removes, or a folder of results that is
  neither the old one nor the new one.
* A *silent acceptance* is exit code 0 for an input that must be refused, another estimate from columns in another
  order, or a contradiction without its warning.
* A *wrong message* is any other exit code than 2, or not exactly one message.
{faults}
| door | inputs |
|---|---|
{doors}

Most inputs go through the command line in one process; those of rows 12 and 14 go through processes of their own, which
are forked from one that has imported everything and read a good file of each kind, and end when they take {memory:g} MB
more than that one. Of their results that are taken, one in ten is drawn as a page. Nothing is written beside the folder
in which a command runs. No door reads SRDF: it is only written. Maps (row 13) are drawn from the tables of
`records/map_tables.py` themselves, robots (row 12) from the numbers that their files have, bytes (row 14) from a good
file of each of {readers} readers. Sizes are estimated before any work: a flight may take {limits[0]:g} GB of log and
{limits[1]:g} s, a sweep {limits[2]} runs and {limits[3]:g} days, a table {limits[4]:g} MB, a TOML file {limits[5]:g} MB
with {limits[6]} levels; what the files of strangers may be stands in `errors/foreign_files.py`.
[broken_runs.md](broken_runs.md) has the counts of `make evidence` for interruptions and full disks.
"""

if __name__ == "__main__":
    sys.exit(main())
