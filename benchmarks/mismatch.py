"""The mismatch matrix: what every wrong belief costs `kalman` and `smoother` beside `force_level`, over five seeds.

Each line is one belief on one flight with exact or noisy sensors: the smallest R2 of a filter minus that of
`force_level` on any axis, wing and seed; what is made up where nothing pushes; and the verdict of the redundancy. Exits
with 1 if a filter is more than 0.1 below `force_level`, if an error of 8 mN a redundant row is not flagged, or if an
exact belief is. Run by `make evidence`; some minutes.
"""

from __future__ import annotations

import sys

import numpy as np
from support.mismatch import FLIGHTS, MISMATCHES, NOISY, estimated, flown, made_up, scores, seen

SEEDS = (1, 2, 3, 4, 5)
FILTERS = ("kalman", "smoother")
ALLOWED_LOSS, ALWAYS_FLAGGED = 0.1, 8.0e-3


def line(row: str, flight: str, sensors: tuple[str, ...]) -> tuple[str, bool]:
    """Return a line of the table, and whether everything in it is as it should be."""
    losses, invented, verdicts, sizes = [], [], set(), []
    for seed in SEEDS:
        given = seen(row, flight, seed, sensors)
        level = estimated("force_level", given)
        verdicts.add(level.redundancy.verdict)
        sizes.append(level.redundancy.belief)
        for name in FILTERS:
            found = estimated(name, given)
            if flight == "no force":
                invented.append(made_up(found).max() - made_up(level).max())
            else:
                pushed = np.isfinite(scores(found, given))
                losses.append((scores(found, given) - scores(level, given))[pushed].min())
    exact, size = row == "exact", min(sizes)
    good = verdicts == {"consistent"} if exact else size < ALWAYS_FLAGGED or verdicts == {"inconsistent"}
    good &= min(losses, default=0.0) > -ALLOWED_LOSS
    change = f"R2 {min(losses):+8.3f}" if losses else f"mN {1e3 * max(invented):+8.2f}"
    noise = "noisy" if sensors else "exact"
    words = ", ".join(sorted(verdicts))
    return (
        f"{row:<22} {flight:<9} {noise:<6} {change}  belief {1e3 * size:6.2f} mN  {words:<24}{'' if good else ' BAD'}",
        good,
    )


def main() -> int:
    """Print the matrix; return the exit code."""
    print("belief                 flight    sensors  worst filter over force_level; redundancy", flush=True)
    all_good = True
    for sensors in ((), NOISY):
        for flight in FLIGHTS:
            for row in MISMATCHES:
                text, good = line(row, flight, sensors)
                print(text, flush=True)
                all_good &= good
            flown.cache_clear()
    return 0 if all_good else 1


if __name__ == "__main__":
    sys.exit(main())
