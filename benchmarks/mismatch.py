"""Write docs/mismatch.md: what every wrong belief costs `kalman` and `smoother` beside `force_level`, over five seeds.

    PYTHONPATH=tests python benchmarks/mismatch.py

Exits with 1 if a filter is more than 0.1 of R2 below `force_level` on any flight, axis, wing and seed; if the
redundancy does not flag an error of 8 mN a redundant row; or if it flags an exact belief. Run by `make evidence`; some
ten minutes.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from support.mismatch import FLIGHTS, MISMATCHES, NOISY, estimated, flown, made_up, scores, seen

PAGE = Path(__file__).resolve().parents[1] / "docs" / "mismatch.md"
SEEDS = (1, 2, 3, 4, 5)
SENSORS = {"exact": (), "noisy": NOISY}
FILTERS = ("kalman", "smoother")
ALLOWED_LOSS, ALWAYS_FLAGGED = 0.1, 8.0e-3


@dataclass
class Row:
    """What the flights with one wrong belief and one kind of sensors showed.

    Attributes:
        changes: (flight, filter) -> R2 minus that of `force_level`, the smallest over axes, wings and seeds.
        invented: observer -> the largest rms [N] that was found where nothing pushes.
        sizes: error of the belief [N] a redundant row, on every flight and seed.
        flagged: whether the verdict was `inconsistent` there.
    """

    changes: dict[tuple[str, str], float] = field(default_factory=dict)
    invented: dict[str, float] = field(default_factory=dict)
    sizes: list[float] = field(default_factory=list)
    flagged: list[bool] = field(default_factory=list)

    def take(self, row: str, flight: str, seed: int, sensors: tuple[str, ...]) -> None:
        """Add a flight."""
        given = seen(row, flight, seed, sensors)
        found = {name: estimated(name, given) for name in ("force_level", *FILTERS)}
        check = found["force_level"].redundancy
        self.sizes.append(check.belief)
        self.flagged.append(check.verdict == "inconsistent")
        level = scores(found["force_level"], given)
        for name, estimate in found.items():
            if flight == "no force":
                self.invented[name] = max(self.invented.get(name, 0.0), float(made_up(estimate).max()))
            elif name in FILTERS:
                pushed = np.isfinite(level)
                change = float((scores(estimate, given) - level)[pushed].min())
                self.changes[flight, name] = min(self.changes.get((flight, name), np.inf), change)

    def failures(self, row: str) -> Iterator[str]:
        """Yield what should not be."""
        for (flight, name), change in self.changes.items():
            if change < -ALLOWED_LOSS:
                yield f"{name} is {-change:.2f} of R2 below force_level on {flight}"
        if row == "exact" and any(self.flagged):
            yield f"an exact belief was flagged {sum(self.flagged)} times"
        missed = [size for size, flagged in zip(self.sizes, self.flagged, strict=True) if not flagged]
        if row != "exact" and max(missed, default=0.0) >= ALWAYS_FLAGGED:
            yield f"an error of {1e3 * max(missed):.1f} mN a row was not flagged"

    def cells(self) -> list[str]:
        """Return a row of the page's table."""
        changes = [f"{self.changes[flight, name]:+.3f}" for flight in ("signal", "pushes") for name in FILTERS]
        invented = " / ".join(f"{1e3 * self.invented[name]:.1f}" for name in ("force_level", *FILTERS))
        sizes = f"{1e3 * min(self.sizes):.1f} to {1e3 * max(self.sizes):.1f}"
        return [*changes, invented, sizes, f"{sum(self.flagged)} of {len(self.flagged)}"]


def table(sensors: tuple[str, ...], failed: list[str]) -> str:
    """Return the table of one kind of sensors, and add what should not be to `failed`."""
    rows = {row: Row() for row in MISMATCHES}
    for flight in FLIGHTS:
        for row, seen_so_far in rows.items():
            for seed in SEEDS:
                seen_so_far.take(row, flight, seed, sensors)
            print(f"{'noisy' if sensors else 'exact'} sensors, {flight}, {row}", flush=True)
        flown.cache_clear()
    lines = [HEAD, "|---" * HEAD.count(" | ") + "|---|"]
    for row, shown in rows.items():
        bad = list(shown.failures(row))
        failed += [f"{row}, {'noisy' if sensors else 'exact'} sensors: {what}" for what in bad]
        lines.append(f"| {' | '.join([row, *shown.cells()])}{' **missed**' if bad else ''} |")
    return "\n".join(lines)


def main() -> int:
    """Write the page; return the exit code."""
    failed: list[str] = []
    tables = {words: table(sensors, failed) for words, sensors in SENSORS.items()}
    missed = "\n".join(f"* {what}" for what in failed) or "Every row is as it should be."
    PAGE.write_text(TEXT.format(date=time.strftime("%Y-%m-%d"), missed=missed, **tables), encoding="utf-8")
    print(missed)
    return 1 if failed else 0


HEAD = (
    "| belief wrong by | `kalman`, signal | `smoother`, signal | `kalman`, contacts | `smoother`, contacts | "
    "made up [mN]: `force_level` / `kalman` / `smoother` | error of the belief [mN a row] | called inconsistent |"
)
TEXT = """# Every wrong belief, over five seeds

Written on {date} by `make evidence` (`benchmarks/mismatch.py`), which ends with an error if a row is not as it should
be. What it is about is on the page [structural_error.md](structural_error.md); flights and beliefs are those of that
page, without calibration, with seeds 1 to 5. All observers are as they come, `force_level` with K = 2000 1/s.

The first four columns are R2 minus that of `force_level` on the same flight: the worst over axes, wings and seeds, with
the signal of `paper` and with contacts (an impulse, a push and a step on the left wing). They should not be below -0.1:
a filter must not make more of a wrong belief than plain least squares does. What is made up is the largest rms over
axes, wings and seeds where nothing pushes. The error of the belief is what no force explains, less what sensors
explain, from the smallest to the largest of the fifteen flights; the last column says on how many of them the
[verdict](observers.md#is-the-model-right) was "inconsistent". It must be so wherever the error is 8 mN a row or more,
and never with an exact belief.

## Exact sensors

{exact}

## Noisy sensors

{noisy}

With noisy sensors `force_level` makes 0.4 N of noise at this gain, so the filters are far better on every axis here.

## What is missed

{missed}
"""

if __name__ == "__main__":
    sys.exit(main())
