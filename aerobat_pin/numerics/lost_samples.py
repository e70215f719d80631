"""Samples that are missing between even stamps: values move on by whole numbers of steps of their rates.

Of values x with rates v, a step is r times as long as its stamps say where all columns moved on by r v dt at once. A
logger that loses samples and stamps those that it has evenly leaves whole numbers r: mostly 1, and some 2, 3, ...
"""

from __future__ import annotations

import numpy as np

from aerobat_pin.numerics.arrays import Array

QUARTILE = 0.3186  # of the magnitude of noise of deviation 1, below which a quarter is
CLEAR_STEP = 15.0  # deviations of a step's noise by which its values move on, of the steps that count
OF_OTHER_LENGTH = 0.9  # share of the squares of a step that its rates explain, if it is of another length only
WHOLE_STEPS = 0.1  # median distance from whole numbers, of longer steps; those of any length are 0.25 away
FEWEST_LONGER = 4  # steps that tell whether they are whole
RIGHT_STEPS = 0.4  # share of the steps that are right, at least: else it is a unit that is wrong


def lost_samples(values: Array, rates: Array, time: Array) -> float:
    """Return the share of the samples that are missing between values (m, c) with rates (m, c), at times (m,) [s].

    It is 0 where nothing is missing, and where noise hides it. A step with fewer than none counts against the longer
    ones, as values that wait for a slower sensor catch up.
    """
    expected = 0.5 * (rates[1:] + rates[:-1]) * np.diff(time)[:, None]
    actual = np.diff(values, axis=0)
    noise = np.quantile(np.abs(actual - expected), 0.25, axis=0) / QUARTILE
    noise = np.maximum(noise, 1e-6 * np.abs(expected).max(axis=0, initial=0.0))
    moved = noise > 0.0
    expected, actual = expected[:, moved] / noise[moved], actual[:, moved] / noise[moved]
    power = np.sum(expected**2, axis=1)
    clear = power > CLEAR_STEP**2
    expected, actual, power = expected[clear], actual[clear], power[clear]
    if not len(power):
        return 0.0
    length = np.sum(actual * expected, axis=1) / power
    explained = length**2 * power > OF_OTHER_LENGTH * np.sum(actual**2, axis=1)
    steps = np.round(length)
    longer, right = explained & (steps > 1.0), steps == 1.0
    if longer.sum() < FEWEST_LONGER or right.mean() < RIGHT_STEPS:
        return 0.0
    if np.median(np.abs(length - steps)[longer]) > WHOLE_STEPS:
        return 0.0
    missing = float(np.sum(steps[longer] - 1.0) - np.sum(steps < 1.0))
    return max(missing / (missing + len(steps)), 0.0)
