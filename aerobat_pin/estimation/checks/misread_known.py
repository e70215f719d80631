"""What may be wrong with the forces that a fixed robot's map knows.

Their factor or sign; a constant that a sensor shows; its axes, or the order of its columns.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np

from aerobat_pin.estimation.checks.changes import CLEARLY, FACTOR, LEFT_BY_CHANGE, LEFT_BY_ROBOT, PRICE, Change
from aerobat_pin.estimation.checks.free_efforts import NAMED
from aerobat_pin.estimation.checks.sensor_zeros import MISREAD_FORCE, felt_of_constant, shown_of_nothing
from aerobat_pin.estimation.findings import Finding
from aerobat_pin.forces import EffortRows, Explanation, Instants, screened, seen_wrench
from aerobat_pin.numerics import Array
from aerobat_pin.records import KnownSection, Record

COLUMN_ORDERS = [  # of three columns, each with either sign, the fewest signs first; not as mapped, nor all reversed
    np.array(order) * np.array(signs)[:, None]
    for signs in sorted(itertools.product((1.0, -1.0), repeat=3), key=sum, reverse=True)
    for order in itertools.permutations(np.eye(3))
    if not np.array_equal(np.array(order) * np.array(signs)[:, None], signs[0] * np.eye(3))
]


def changes_of_known(record: Record, instants: Instants, rows: EffortRows, without: Explanation) -> Iterator[Change]:
    """Yield another factor of each known force, a constant that its sensor shows of nothing, and its other axes."""
    kept, some = instants.kept, instants.weighed
    for name, section in record.map.known.items():
        yield Change(
            partial(_known_factor, name), instants.known[name][some][:, kept, None], doubt=FACTOR, leaves=LEFT_BY_ROBOT
        )
        felt = felt_of_constant(record, section, instants.q[some])
        if felt is not None:
            yield Change(partial(_shown_of_nothing, record, name), felt[:, kept], leaves=LEFT_BY_ROBOT)
        yield from _changes_of_axes(record, instants, rows, without, name, section)


def _changes_of_axes(
    record: Record, instants: Instants, rows: EffortRows, without: Explanation, name: str, section: KnownSection
) -> Iterator[Change]:
    """Yield the other axes of a known wrench, and the likeliest order of its forces, of its moments, and of both."""
    q = instants.past[0][instants.weighed]
    other = section.model_copy(update={"axes": "world" if section.axes == "frame" else "frame"})
    felt, turned = (felt_of_constant(record, each, q) for each in (section, other))
    if felt is None or turned is None:
        return
    felt, turned = felt[:, instants.kept], turned[:, instants.kept]
    wrench = seen_wrench(record, instants, name)
    shift = np.einsum("mkp,mp->mk", turned - felt, wrench)
    yield Change(partial(_in_axes, name, other.axes), shift=shift, doubt=FACTOR, leaves=LEFT_BY_CHANGE)
    parts = [slice(first, first + 3) for first in range(0, felt.shape[2], 3)]
    each = [
        [np.einsum("mki,ij,mj->mk", felt[:, :, part], M - np.eye(3), wrench[:, part]) for M in COLUMN_ORDERS]
        for part in parts
    ]
    both = [("forces and moments", np.sum(each, axis=0))] * (len(each) - 1)
    for what, shifts in [*both, *zip(("forces", "moments"), each, strict=False)]:
        best = int(np.argmax(screened(rows, without, [], list(shifts))))
        told = partial(_in_order, name, what, COLUMN_ORDERS[best])
        yield Change(told, shift=shifts[best], doubt=FACTOR + PRICE, leaves=LEFT_BY_CHANGE)


def _in_axes(name: str, axes: str, _: Explanation, left: str) -> Sequence[Finding]:
    what = f'known.{name} in axes = "{axes}" leaves {left}: known.{name}.axes'
    return [Finding(MISREAD_FORCE, "warning", what)]


def _in_order(name: str, part: str, order: Array, _: Explanation, left: str) -> Sequence[Finding]:
    words = ", ".join("-" * int(row.min() < 0.0) + "xyz"[int(np.argmax(np.abs(row)))] for row in order)
    what = f"known.{name} with {part} ({words}) in place of (x, y, z) leaves {left}: known.{name}.columns"
    return [Finding(MISREAD_FORCE, "warning", what)]


def _known_factor(name: str, found: Explanation, left: str) -> Sequence[Finding]:
    factor, clearly = 1.0 + float(found.size[0]), CLEARLY * float(found.deviation[0]) * found.independent**-0.5
    if abs(factor - 1.0) < max(NAMED, clearly):
        return []
    what = (
        f"known.{name} would have to be {factor:.3g} times as large, which leaves {left}: its unit, sign, axes or frame"
    )
    return [Finding(MISREAD_FORCE, "warning", what, factor, "1")]


def _shown_of_nothing(record: Record, name: str, found: Explanation, left: str) -> Sequence[Finding]:
    return shown_of_nothing(record, name, -found.size, left)
