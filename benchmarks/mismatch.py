"""Write the tables of docs/mismatch.md: the cost of wrong beliefs to `kalman` and `smoother`, beside `force_level`.

    PYTHONPATH=tests python benchmarks/mismatch.py

Exits with 1 if a filter is more than 0.1 of R2 below `force_level` on any flight, axis, wing and seed; if the
redundancy does not flag an error of 8 mN a redundant row; or if it flags an exact belief. Run by `make evidence`; some
ten minutes.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from support.mismatch import FLIGHTS, MISMATCHES, NOISY, estimated, flown, made_up, scores, seen
from support.pages import fill, measured
from support.pages import table as laid_out

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
    lines = []
    for row, shown in rows.items():
        bad = list(shown.failures(row))
        failed += [f"{row}, {'noisy' if sensors else 'exact'} sensors: {what}" for what in bad]
        *cells, last = shown.cells()
        lines.append([row, *cells, f"{last} **missed**" if bad else last])
    return laid_out(HEAD, lines)


def main() -> int:
    """Write the tables; return the exit code."""
    failed: list[str] = []
    tables = {words: table(sensors, failed) for words, sensors in SENSORS.items()}
    missed = "\n".join(f"* {what}" for what in failed) or "Every row is as it should be."
    fill("docs/mismatch.md", {"date": measured(), "missed": missed, **tables})
    print(missed)
    return 1 if failed else 0


HEAD = (
    "belief wrong by | `kalman`, signal | `smoother`, signal | `kalman`, contacts | `smoother`, contacts | "
    "made up [mN]: `force_level` / `kalman` / `smoother` | error of the belief [mN a row] | called inconsistent"
)

if __name__ == "__main__":
    sys.exit(main())
