"""What two series that must agree say about each other: which column is off, by how much, and by which slip."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np

from aerobat_pin.estimation.checks.compare import (
    COMPARED_OVER,
    FOLLOWS,
    SeriesComparison,
    compare,
    compare_rates,
    slip_of,
)
from aerobat_pin.estimation.findings import Finding
from aerobat_pin.numerics import Array
from aerobat_pin.records import Agreement

CONFUSED = 0.5  # correlation below which it does not
FACTOR_OFF = 0.1  # deviation of a factor from 1 that counts, if the factor explains most of the difference
LEAST_MOTION = 5e-4  # [rad, m] in a window: a column that moves less shows no factor
SEEN_MOTION = 2e-3  # [rad, m] in a window: series that move less are not said to differ in kind


def agreement_findings(pair: Agreement) -> Iterator[Finding]:
    """Yield a delay between the two series, exchanged columns, and columns that are off; or that they agree."""
    found = comparison_of(pair)
    if found is None:
        return
    yield from _late(pair, found)
    swapped = exchanged(found) if pair.apart else []
    for j, k in swapped:
        names = " and ".join(pair.labels[i].removeprefix("at ") for i in (j, k))
        text = f"{pair.names[1]} of {names} fit {pair.names[0]} the other way round"
        yield Finding("swapped joints", "warning", text)
    skip = {column for columns in swapped for column in columns}
    limit = _limits(pair, found)
    explained = (np.abs(found.factor - 1.0) > FACTOR_OFF) & (found.scaled < 0.5 * found.unlike)
    wrong = (found.left > limit) | (explained & (found.swings.max(axis=0) > LEAST_MOTION))
    slips: dict[str, list[int]] = {}
    for column in np.flatnonzero(wrong).tolist():
        if column not in skip:
            slip = slip_of(*found.follows(column))
            slips.setdefault(slip, []).append(column)
    moving = int(np.sum(found.swings.max(axis=0) > LEAST_MOTION))
    for slip, columns in slips.items():
        certain = bool(slip) and (pair.apart or len(columns) >= max(moving, 1))
        yield Finding(
            pair.check,
            "refused" if certain else "warning",
            _sentence(pair, found, limit, columns, slip),
            float(found.factor[columns[0]]),
            "1",
        )
    if not slips and pair.kind == "rates":
        yield _whole_channel(pair, found)


def comparison_of(pair: Agreement) -> SeriesComparison | None:
    """Return how the two series compare; None if they are too short."""
    return (compare_rates if pair.kind == "rates" else compare)(pair.first, pair.second, pair.time)


def exchanged(found: SeriesComparison) -> list[tuple[int, int]]:
    """Return pairs of columns that fit each other's far better than their own."""
    match = found.match
    return [
        (j, k)
        for j, k in itertools.combinations(range(len(match)), 2)
        if min(match[j, k], match[k, j]) > FOLLOWS
        and max(match[j, j], match[k, k]) < min(match[j, k], match[k, j]) - 0.1
    ]


def _limits(pair: Agreement, found: SeriesComparison) -> Array:
    return np.asarray(np.maximum(pair.floor, pair.share * found.sizes[0]))


def _late(pair: Agreement, found: SeriesComparison) -> Iterator[Finding]:
    if found.certain and abs(found.lag) > pair.latest:
        early, late = pair.names if found.lag > 0.0 else pair.names[::-1]
        yield Finding(
            "late channel",
            "warning",
            f"{late} come{'s' if late[-1] != 's' else ''} {1e3 * abs(found.lag):.1f} ms after {early}, "
            f"{1e3 * pair.latest:g} ms are allowed; shift one of them (in a map: delay = {abs(found.lag):.4f})",
            found.lag,
            "s",
        )


def _sentence(pair: Agreement, found: SeriesComparison, limit: Array, columns: list[int], slip: str) -> str:
    """Return what is wrong with columns that have the same slip: the figures of the worst of them."""
    worst = max(columns, key=lambda column: float(found.left[column] / limit[column]))
    others = [pair.labels[column] for column in columns if column != worst]
    place = pair.labels[worst] + (f" (and {', '.join(others)})" if others else "")
    left, allowed = float(found.left[worst]), float(limit[worst])
    if pair.kind == "values":
        return f"{place} is {left:.2f} {pair.unit} (rms) off, {allowed:.2f} are allowed; {pair.expected}"
    if left < allowed:
        allowed = FACTOR_OFF * float(found.sizes[0, worst])
    follows = _follows(pair, *found.follows(worst))
    return (
        f"in {COMPARED_OVER:g} s they differ by {left:.3g} {pair.unit} (rms) {place}, {allowed:.2g} are allowed; "
        f"{follows}{f': {slip}' if slip else ''}; {pair.expected}"
    )


def _follows(pair: Agreement, factor: float, correlation: float) -> str:
    first, second = pair.names
    verb = "are" if second[-1] == "s" else "is"
    return f"{second} {verb} {factor:.3g} times what follows from {first}, correlation {correlation:.2f}"


def _whole_channel(pair: Agreement, found: SeriesComparison) -> Finding:
    """Return what all columns together say of two series of which no column is off."""
    first, second = (float(np.linalg.norm(swing)) for swing in found.swings)
    if max(first, second) < SEEN_MOTION:
        return Finding(pair.check, "note", "hardly any motion to compare")
    cross = float(np.sum(found.correlation * found.swings[0] * found.swings[1]))
    factor, correlation = cross / max(first**2, 1e-300), cross / max(first * second, 1e-300)
    text = _follows(pair, factor, correlation)
    if abs(correlation) < CONFUSED:
        why = "does not follow it (other axes, columns in another order, another clock)"
        return Finding(pair.check, "warning", f"{text}: {why}", factor, "1")
    good = correlation > FOLLOWS and abs(factor - 1.0) < FACTOR_OFF
    return Finding(pair.check, "good" if good else "note", text, factor, "1")
