"""Try thousands of bad inputs at all doors, and write the counts of what went wrong to docs/reliability.md.

PYTHONPATH=tests python benchmarks/bad_inputs.py --seeds 2000
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np
from support.bad_inputs import CLASSES, FAULTS, Doors, drawn_classes

from aerobat_description import toml_text
from aerobat_pin.experiments.sweep import plan
from aerobat_pin.scenario import csv_rows, scenario

LIMITS = (
    scenario.LARGEST_LOG / 1e9,
    scenario.MOST_SECONDS,
    plan.MOST_RUNS,
    plan.MOST_DAYS,
    csv_rows.LARGEST_TABLE / 1e6,
    toml_text.LARGEST_TOML / 1e6,
    toml_text.MOST_LEVELS,
)
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


def counted(count: int, seed: int) -> tuple[Counter[tuple[int, str]], list[str], float]:
    """Try bad inputs.

    Args:
        count: number of inputs.
        seed: of all choices.

    Returns:
        How often each (class, fault) occurred, with an empty fault for those without; the faults in words; the longest
        time that a command line took [s].
    """
    rng = np.random.default_rng(seed)
    counts, said = Counter[tuple[int, str]](), list[str]()
    with tempfile.TemporaryDirectory() as folder, Doors(Path(folder)) as doors:
        _ = (
            doors.run,
            doors.swept,
            doors.estimated,
            doors.recordings,
            doors.bench.seconds,
        )  # made before anything is timed
        doors.longest = 0.0
        for k, number in enumerate(drawn_classes(rng, count)):
            attempt = doors.attempt(rng, number)
            fault = next((name for name in FAULTS if attempt.fault.startswith(name)), "wrong message")
            counts[number, fault if attempt.fault else ""] += 1
            if attempt.fault:
                said.append(f"{k}, class {number}, {attempt.name}: {attempt.fault}")
                print(said[-1], flush=True)
            if (k + 1) % 100 == 0:
                print(f"{k + 1} of {count}, {len(said)} faults", flush=True)
        return counts, said, doors.longest


def main() -> int:
    """Write the page, and return 1 if anything went wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=2000, help="number of bad inputs")
    parser.add_argument("--seed", type=int, default=1, help="of all choices")
    chosen = parser.parse_args()
    start = time.monotonic()
    counts, said, longest = counted(chosen.seeds, chosen.seed)
    rows = []
    for number, name in CLASSES.items():
        faults = [counts[number, fault] for fault in FAULTS]
        rows.append((number, name, ITEMS[number], sum(faults) + counts[number, ""], *faults))
    rows.append(("", "all", "", *(sum(row[i] for row in rows) for i in range(3, 4 + len(FAULTS)))))
    table = "\n".join(f"| {' | '.join(map(str, row))} |" for row in rows)
    minutes = (time.monotonic() - start) / 60.0
    PAGE.write_text(
        TEXT.format(
            date=time.strftime("%Y-%m-%d"),
            count=chosen.seeds,
            seed=chosen.seed,
            minutes=minutes,
            longest=longest,
            heads=" | ".join(f"{fault}" for fault in FAULTS),
            rule="|---" * (4 + len(FAULTS)) + "|",
            table=table,
            limits=LIMITS,
        )
    )
    return int(bool(said))


TEXT = """# Reliability

What strangers, full disks and impatient fingers do to the program, counted. Written on {date} by
`make reliability ARGS="--seeds {count} --seed {seed}"` (`benchmarks/bad_inputs.py`) in {minutes:.0f} minutes; the same
generator makes the 300 bad inputs of every test run (`tests/support/bad_inputs.py`).

| | bad inputs | what must hold | tried | {heads} |
{rule}
{table}

* A *traceback* is any error that is none of this package's, or a program that is ended by a signal of its own making.
* A *hang* takes more than 20 s. The longest command line took {longest:.0f} s.
* A *half-written result* is any file that a refused command adds, changes or removes, or a folder of results that is
  neither the old one nor the new one.
* A *silent acceptance* is exit code 0 for an input that must be refused, another estimate from columns in another
  order, or a contradiction without its warning.
* A *wrong message* is any other exit code than 2, or not exactly one message.

Most inputs go through the command line in one process, some through processes of their own. The doors are `run`,
`estimate` (also with a map, of tables and bags), `calibrate`, `sweep`, `trim`, `play`, `compare`, `convert`, `urdf`,
`linkage`, `crank`, the page that `play` serves, and the functions that Python offers. Sizes are estimated before any
work: a flight may take {limits[0]:g} GB of log and {limits[1]:g} s, a sweep {limits[2]} runs and {limits[3]:g} days, a
table {limits[4]:g} MB, a TOML file {limits[5]:g} MB with {limits[6]} levels.
[broken_runs.md](broken_runs.md) has the counts of `make evidence` for interruptions and full disks.
"""

if __name__ == "__main__":
    sys.exit(main())
