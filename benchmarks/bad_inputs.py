"""Try thousands of bad inputs at all doors, and write the counts of what went wrong to docs/reliability.md.

PYTHONPATH=tests python benchmarks/bad_inputs.py --count 5000 --seeds 1 2 3
"""

import argparse
import datetime
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from support.bad_bytes import READERS
from support.bad_inputs import CLASSES, FAULTS, MORE_MEMORY, Doors, drawn_classes
from support.pages import fill, table

from aerobat_description import toml_text
from aerobat_pin.errors import LARGEST_TABLE
from aerobat_pin.experiments.sweep import plan
from aerobat_pin.scenario import scenario

LIMITS = (
    f"a flight may take {scenario.LARGEST_LOG / 1e9:g} GB of log and {scenario.MOST_SECONDS:g} s, a sweep "
    f"{plan.MOST_RUNS} runs and {plan.MOST_DAYS:g} days, a table {LARGEST_TABLE / 1e6:g} MB, a TOML file "
    f"{toml_text.LARGEST_TOML / 1e6:g} MB with {toml_text.MOST_LEVELS} levels"
)
SLOWEST, PATIENCE = 900.0, 60.0  # [s] until a command hangs: a good one at first, which compiles, and a bad one
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


def main() -> int:
    """Try inputs, an equal share by each seed; write the page after every hundred; return 1 if anything went wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=5000, help="number of bad inputs, or a few more")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3], help="of all choices")
    chosen = parser.parse_args()
    start, counts, faults = time.monotonic(), Counter[tuple[int, str]](), list[str]()

    def write() -> None:
        words = f"--count {chosen.count} --seeds {' '.join(map(str, chosen.seeds))}"
        minutes = (time.monotonic() - start) / 60.0
        made = f'{datetime.date.today()} by `make reliability ARGS="{words}"` in {minutes:.0f} minutes'
        fill("docs/reliability.md", page(doors, counts, faults, made, chosen.count))

    with tempfile.TemporaryDirectory() as folder, Doors(Path(folder), SLOWEST) as doors:
        # Made before anything is timed.
        _ = doors.run, doors.swept, doors.estimated, doors.results, doors.bench.seconds
        doors.longest, doors.patience = 0.0, PATIENCE
        rngs = [np.random.default_rng(seed) for seed in chosen.seeds]
        drawn = zip(*(drawn_classes(rng, -(-chosen.count // len(rngs))) for rng in rngs), strict=True)
        for k, (rng, number) in enumerate(pair for row in drawn for pair in zip(rngs, row, strict=True)):
            attempt = doors.attempt(rng, number)
            fault = next((name for name in FAULTS if attempt.fault.startswith(name)), "wrong message")
            counts[number, fault if attempt.fault else ""] += 1
            if attempt.fault:
                faults.append(f"class {number}, {attempt.name}: {attempt.fault}")
                print(f"{k}, {faults[-1]}", flush=True)
            if (k + 1) % 100 == 0:
                print(f"{k + 1} of {chosen.count}, {len(faults)} faults", flush=True)
                write()
        write()
    return int(bool(faults))


def page(doors: Doors, counts: Counter[tuple[int, str]], failed: list[str], made: str, asked: int) -> dict[str, str]:
    """Return what the page says of what was tried.

    Args:
        doors: where it was tried.
        counts: how often each (class, fault) occurred, with an empty fault for those without.
        failed: which inputs failed, and how.
        made: when, how and in what time it was tried.
        asked: number of inputs that were asked for.
    """
    rows: list[list[Any]] = []
    for number, name in CLASSES.items():
        faults = [counts[number, fault] for fault in FAULTS]
        rows.append([number, name, ITEMS[number], sum(faults) + counts[number, ""], *faults])
    count, *faults = (sum(row[i] for row in rows) for i in range(3, 4 + len(FAULTS)))
    early = "" if count >= asked else f" of {asked}, as it was ended early"
    head = f"| bad inputs | what must hold | tried | {' | '.join(FAULTS)}"
    return {
        "measured": f"{made}: {count} inputs{early}",
        "counts": table(head, [*rows, ["", "all", "", count, *faults]]),
        "patience": f"{PATIENCE:g}",
        "longest": f"{doors.longest:.0f}",
        "found": "\n".join(f"* Found: {' '.join(one.split())[:200]}" for one in failed) or "* Found: nothing.",
        "doors": table("door | inputs", sorted(doors.tried.items())),
        "memory": f"{MORE_MEMORY / 1e6:g}",
        "readers": str(len(READERS)),
        "limits": LIMITS,
    }


if __name__ == "__main__":
    sys.exit(main())
