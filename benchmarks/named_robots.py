"""A push at the last link of every robot that has a name: the tables of docs/named_robots.md."""

import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import NamedTuple

import numpy as np
from support.pages import Values, measured, run
from support.pages import table as laid_out
from support.pushed_robots import EDGES, GAIN, Pushed, pushed_robot

from aerobat_pin import estimate
from aerobat_pin.errors import AerobatError
from aerobat_pin.estimation import Result
from aerobat_pin.numerics import Array
from aerobat_pin.records.robot_files import FIXED, FREE

SEEDS = range(11, 16)
OBSERVERS = ("force_level", "kalman", "smoother")
SETTLED, TURNS = 0.15, 6.0  # [s], [1/K] after which a force that turned round is judged


class Judged(NamedTuple):
    """How well one observer found the push on one robot.

    Attributes:
        error: (m, 3) over the weight of what moves.
        within: (m, 3) whether it is within two stated deviations.
        shown: (m, 3) whether the component is shown.
    """

    error: Array
    within: Array
    shown: Array


def judged(log: Pushed, result: Result, name: str) -> Judged:
    """Return how well an observer did."""
    found = result.estimates[name]
    middle = 0.5 * (found.time[1:] + found.time[:-1])
    good = (middle > SETTLED) & (np.abs(middle[:, None] - EDGES).min(axis=1) > TURNS / GAIN)
    error = found.components - log.true(middle)
    within = np.abs(error) < 2.0 * found.standard_deviation
    return Judged(error[good] / log.weight, within[good], found.shown[good])


def tried(name: str, seed: int) -> tuple[list[str], list[Judged]] | str:
    """Return the first cells of a robot's row and how well each observer did; why not, if it was refused."""
    log = pushed_robot(name, seed)
    log.chosen["observer"]["names"] = list(OBSERVERS)
    with tempfile.TemporaryDirectory() as folder:
        try:
            start = time.perf_counter()
            result = estimate(log.record(Path(folder)))
        except AerobatError as error:
            return str(error)
    cells = [str(len(log.robot.joints)), "falls" if log.robot.free else "stands", log.point]
    return [*cells, f"{time.perf_counter() - start:.1f}"], [judged(log, result, observer) for observer in OBSERVERS]


def row(name: str, tries: list[tuple[list[str], list[Judged]]]) -> list[str]:
    """Return the row of a robot, of all its seeds."""
    first = tries[0][0]
    shares = [np.concatenate([found[k].within for _, found in tries]) for k in range(len(OBSERVERS))]
    error, shown = (np.concatenate([getattr(found[0], part) for _, found in tries]) for part in ("error", "shown"))
    rms = f"{100.0 * np.sqrt(np.mean(error[shown] ** 2)):.1f}" if shown.any() else "-"
    cover = [f"{100.0 * share[shown].mean():.0f}" if shown.any() else "-" for share in shares]
    return [name, *first[:3], f"{100.0 * shown.mean():.0f}", rms, *cover, first[3]]


def find() -> Values:
    """Return the tables of the page."""
    names = sorted(FREE | FIXED)
    jobs = [(name, seed) for name in names for seed in SEEDS]
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        found = dict(zip(jobs, pool.map(tried, *zip(*jobs, strict=True)), strict=True))
    rows, refused, shares = [], [], []
    for name in names:
        tries = [found[name, seed] for seed in SEEDS]
        good = [one for one in tries if not isinstance(one, str)]
        if good:
            rows.append(row(name, good))
            shares.append(
                [[one.within[one.shown].mean() if one.shown.any() else np.nan for one in judged] for _, judged in good]
            )
        else:
            refused.append(f"* `{name}`: {tries[0]}")
    head = "robot | joints | it | pushed at | shown [%] | rms error [% of the weight] | within two deviations [%]"
    means = np.nanmean([one for robot in shares for one in robot], axis=0)
    values = {
        "robots": laid_out(f"{head} | `kalman` [%] | `smoother` [%] | s", rows),
        "refused": "\n".join(refused) or "None is refused.",
        "all": ", ".join(f"{100.0 * share:.1f} % by `{name}`" for name, share in zip(OBSERVERS, means, strict=True)),
        "measured": measured(),
    }
    return {"docs/named_robots.md": values}


if __name__ == "__main__":
    run(find)
