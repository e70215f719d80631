"""Timing several callables against each other, one line of the table of results, and the time of another process."""

import gc
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

REPEATS = 3  # of which a round takes the best

Call = Callable[[], object]
Part = tuple[Call, int]
Times = dict[str, NDArray[np.float64]]


@dataclass(frozen=True)
class Figure:
    """One line of the table: median, lowest and highest round, in `unit`; a target is an upper limit."""

    name: str
    value: float
    low: float
    high: float
    unit: str
    target: float | None = None


def interleaved(rounds: int, **parts: Part) -> Times:
    """Time several callables in turn.

    Args:
        rounds: number n of rounds.
        parts: name -> a callable and the number of operations that one call of it does.

    Returns:
        Name -> (n,) time of one operation [s], the best of each round.
    """
    times = {name: np.full(rounds, np.inf) for name in parts}
    for call, _ in parts.values():
        call()
    gc.disable()
    try:
        for k in range(rounds):
            for _ in range(REPEATS):
                for name, (call, operations) in parts.items():
                    start = time.perf_counter()
                    call()
                    times[name][k] = min(times[name][k], (time.perf_counter() - start) / operations)
    finally:
        gc.enable()
    return times


def figure(name: str, values: NDArray[np.float64], unit: str, target: float | None = None) -> Figure:
    """Summarise the rounds (n,) of one quantity."""
    return Figure(name, float(np.median(values)), float(values.min()), float(values.max()), unit, target)


def processor_time(process: int) -> float:
    """Return the processor time of a process so far [s], by its number."""
    parts = Path(f"/proc/{process}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(parts[11]) + int(parts[12])) / os.sysconf("SC_CLK_TCK")
