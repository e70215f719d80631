"""Two series that must agree: how the second follows the first, which column is off, by how much, and by which slip."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np

from aerobat_pin.estimation.findings import LOST_SAMPLES, Finding
from aerobat_pin.numerics import COMPARED_OVER, Array, CrossCorrelation, compare_rates, compare_series, lost_samples
from aerobat_pin.records import Agreement

FOLLOWS = 0.8  # correlation from which one series is taken to follow the other
CONFUSED = 0.5  # correlation below which one does not follow the other
FACTOR_OFF = 0.1  # deviation of a factor from 1 that counts, if the factor explains most of the difference
LOST_SHARE = 5e-3  # share of samples that are missing under even stamps, from which it is said
LEAST_MOTION = 5e-4  # [rad, m] in a window: a column that moves less shows no factor
SEEN_MOTION = 2e-3  # [rad, m] in a window: series that move less are not said to differ in kind
UNIT_FACTORS = {  # second per first -> the slip that makes it
    57.2958: "degrees are read as radians",
    1.0 / 57.2958: "degrees of the position or pose are read as radians",
    1000.0: "thousandths are read as units",
    1e-3: "thousandths of the position (mm) are read as units",
    100.0: "hundredths are read as units",
    0.01: "hundredths of the position (cm) are read as units",
    9.5493: "revolutions a minute are read as rad/s",
}


def slip_of(factor: float, correlation: float) -> str:
    """Return the slip of unit or sign that explains a least-squares factor, which noise dilutes; or nothing."""
    if correlation < FOLLOWS:
        return "its sign is wrong" if correlation < -FOLLOWS else ""
    low, high = 0.94 * factor, 1.06 * factor / correlation**2
    return next((slip for known, slip in UNIT_FACTORS.items() if low < known < high), "")


def agreement_findings(pair: Agreement) -> Iterator[Finding]:
    """Yield lost samples; or a delay between the two series, exchanged columns, and those off; or that they agree."""
    comparison = comparison_of(pair)
    if comparison is None:
        return
    if pair.kind == "rates" and (missing := lost_samples(pair.first, pair.second, pair.time)) > LOST_SHARE:
        moves = f"{pair.names[0]} move{'s' if pair.names[0][-1] != 's' else ''} on as if {100.0 * missing:.2g} %"
        text = f"{moves} of the samples were lost under stamps that do not show it: write when each was taken"
        yield Finding(LOST_SAMPLES, "warning", text, missing, "1")
        return
    yield from _late(pair, comparison)
    swapped = exchanged(comparison) if pair.apart else []
    for j, k in swapped:
        names = " and ".join(pair.labels[i].removeprefix("at ") for i in (j, k))
        text = f"{pair.names[1]} of {names} fit {pair.names[0]} the other way round"
        yield Finding("swapped joints", "warning", text)
    skip = {column for columns in swapped for column in columns}
    limit = np.maximum(pair.floor, pair.share * comparison.sizes[0])
    factor = np.array([comparison.follows(column)[0] for column in range(len(limit))])  # as it is told
    explained = (np.abs(factor - 1.0) > FACTOR_OFF) & (comparison.scaled < 0.5 * comparison.unlike)
    wrong = (comparison.residual > limit) | (explained & (comparison.swings.max(axis=0) > LEAST_MOTION))
    slips: dict[str, list[int]] = {}
    for column in np.flatnonzero(wrong).tolist():
        if column not in skip:
            slips.setdefault(slip_of(*comparison.follows(column)), []).append(column)
    moving = int(np.sum(comparison.swings.max(axis=0) > LEAST_MOTION))
    for slip, columns in slips.items():
        certain = bool(slip) and (pair.apart or len(columns) >= max(moving, 1))
        text = _sentence(pair, comparison, limit, columns, slip)
        yield Finding(pair.check, "refused" if certain else "warning", text, float(factor[columns[0]]), "1")
    if not slips and pair.kind == "rates":
        yield _whole_channel(pair, comparison)


def comparison_of(pair: Agreement) -> CrossCorrelation | None:
    """Return how the two series compare; None if they are too short."""
    return (compare_rates if pair.kind == "rates" else compare_series)(pair.first, pair.second, pair.time)


def exchanged(comparison: CrossCorrelation) -> list[tuple[int, int]]:
    """Return pairs of columns that fit each other's far better than their own."""
    match = comparison.match
    return [
        (j, k)
        for j, k in itertools.combinations(range(len(match)), 2)
        if min(match[j, k], match[k, j]) > FOLLOWS
        and max(match[j, j], match[k, k]) < min(match[j, k], match[k, j]) - 0.1
    ]


def _late(pair: Agreement, comparison: CrossCorrelation) -> Iterator[Finding]:
    if comparison.certain and abs(comparison.lag) > pair.latest:
        early, late = pair.names if comparison.lag > 0.0 else pair.names[::-1]
        text = (
            f"{late} come{'s' if late[-1] != 's' else ''} {1e3 * abs(comparison.lag):.1f} ms after {early}, "
            f"{1e3 * pair.latest:g} ms are allowed; shift one of them (in a map: delay = {abs(comparison.lag):.4f})"
        )
        yield Finding("late channel", "warning", text, comparison.lag, "s")


def _sentence(pair: Agreement, comparison: CrossCorrelation, limit: Array, columns: list[int], slip: str) -> str:
    """Return what is wrong with columns that have the same slip: the figures of the worst of them."""
    worst = max(columns, key=lambda column: float(comparison.residual[column] / limit[column]))
    others = [pair.labels[column] for column in columns if column != worst]
    place = pair.labels[worst] + (f" (and {', '.join(others)})" if others else "")
    residual, allowed = float(comparison.residual[worst]), float(limit[worst])
    if pair.kind == "values":
        return f"{place} is {residual:.2f} {pair.unit} (rms) off, {allowed:.2f} are allowed; {pair.expected}"
    if residual < allowed:
        allowed = FACTOR_OFF * float(comparison.sizes[0, worst])
    follows = _follows(pair, *comparison.follows(worst))
    return (
        f"in {COMPARED_OVER:g} s they differ by {residual:.3g} {pair.unit} (rms) {place}, {allowed:.2g} are allowed; "
        f"{follows}{f': {slip}' if slip else ''}; {pair.expected}"
    )


def _follows(pair: Agreement, factor: float, correlation: float) -> str:
    first, second = pair.names
    verb = "are" if second[-1] == "s" else "is"
    return f"{second} {verb} {factor:.3g} times what follows from {first}, correlation {correlation:.2f}"


def _whole_channel(pair: Agreement, comparison: CrossCorrelation) -> Finding:
    """Return what all columns together say of two series of which no column is off."""
    first, second = (float(np.linalg.norm(swing)) for swing in comparison.swings)
    if (min(first, second) if second > 0.0 else first) < SEEN_MOTION:  # a sensor that shows nothing at all is seen
        return Finding(pair.check, "note", "hardly any motion to compare")
    cross = float(np.sum(comparison.correlation * comparison.swings[0] * comparison.swings[1]))
    factor, correlation = cross / max(first**2, 1e-300), cross / max(first * second, 1e-300)
    text = _follows(pair, factor, correlation)
    if abs(correlation) < CONFUSED:
        why = "does not follow it (other axes, columns in another order, another clock)"
        return Finding(pair.check, "warning", f"{text}: {why}", factor, "1")
    good = correlation > FOLLOWS and abs(factor - 1.0) < FACTOR_OFF
    return Finding(pair.check, "good" if good else "note", text, factor, "1")
