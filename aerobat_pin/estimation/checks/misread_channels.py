"""What may be wrong with a fixed robot's channels: efforts at another time, joints or known forces read otherwise.

How fast efforts change is what a short delay does to the rows. Where that makes them likelier, efforts are taken so
much later. Friction, which turns with the motion, hides most of what is left of the delay; how much of it follows from
how it falls (secant method).

Joints that a log counts from quite another zero than the robot's file, the other way, or in another order, are no
column (`changes`) either: that changes what the motion needs and what a force does. Of those that make the rows likely,
were forces as they are, the rows are formed anew, and the rest of a turn is found beside the forces.

Of forces that the map knows it may be their factor or sign; a constant that a sensor shows; its axes, or the order of
its columns.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cache, partial

import numpy as np
import pinocchio as pin

from aerobat_pin.estimation.checks.changes import (
    CLEARLY,
    FACTOR,
    LEFT_BY_CHANGE,
    LEFT_BY_ROBOT,
    PRICE,
    Change,
    Formed,
    driven_rows,
)
from aerobat_pin.estimation.checks.free_efforts import NAMED, reversed_effort
from aerobat_pin.estimation.checks.readings import (
    LEFT_BY_JOINTS,
    QUARTER,
    JointReading,
    downhill,
    joint_pairs,
    limb_pairs,
    possible_readings,
)
from aerobat_pin.estimation.checks.sensor_faults import (
    MISREAD_FORCE,
    SETTLED_STEP,
    felt_of_constant,
    late_finding,
    shown_of_nothing,
)
from aerobat_pin.estimation.findings import Finding
from aerobat_pin.forces import (
    EffortRows,
    Explanation,
    InputsBetween,
    Instants,
    KnownInputs,
    later_efforts,
    most_likely_with,
    screened,
    seen_wrench,
    slopes_of_need,
)
from aerobat_pin.numerics import LATEST_SHIFT, SHIFT_STEPS, Array
from aerobat_pin.records import LARGEST_DELAY, KnownSection, Record

LEFT_BY_DELAY = 1.0 / 3.0  # of what is left, in squares: what is no delay, or another one, leaves more
LEAST_SEEN_REST = 0.05  # share of what is left of a delay that is seen at least
TURNS_TRIED = np.pi / 6.0 * np.arange(1, 12)  # that are tried [rad]
DOWNHILL = (np.pi / np.array([6.0, 6.0, 6.0, 12.0, 12.0])).tolist()  # from the likeliest of them [rad]
LIKELIEST = 6  # of which the rows are formed anew
REST_AT_MOST = np.radians(20.0)  # from a turn that was tried to the one that is found: within it the weight is linear
UPRIGHT = 1e-6  # of the largest change of what is needed: an upright first axis, whose zero nothing shows
SMALLEST_TURN = 0.5 * TURNS_TRIED[0]  # that is said; a column says what smaller ones do
COLUMN_ORDERS = [  # of three columns, each with either sign, the fewest signs first; not as mapped, nor all reversed
    np.array(order) * np.array(signs)[:, None]
    for signs in sorted(itertools.product((1.0, -1.0), repeat=3), key=sum, reverse=True)
    for order in itertools.permutations(np.eye(3))
    if not np.array_equal(np.array(order) * np.array(signs)[:, None], signs[0] * np.eye(3))
]


def change_of_time(
    record: Record,
    inputs: InputsBetween,
    rows: EffortRows,
    without: Explanation,
    as_mapped: Callable[[], EffortRows],
    formed: Formed,
) -> Change:
    """Return a delay of the efforts; the channels of a record at its own times cannot be shifted.

    `formed` returns the rows of other inputs, `as_mapped` those as mapped at the same instants.
    """
    short = Change(partial(_delay_findings, record, 0.0), _changing(rows), leaves=LEFT_BY_CHANGE)
    gain, explanation = short.likely(rows, without)
    rest = move = float(explanation.size[0])
    if record.knots is not None or abs(rest) < _least_delay(record) or gain * explanation.independent < short.price:
        return short
    at, by, shifted = [record.robot.v_index(joint) for joint in record.driven], 0.0, rows

    def between(first: int, last: int) -> KnownInputs:
        given = inputs(first, last)
        tau = given.tau.copy()
        tau[:, at] = later_efforts(record, given.time, tau[:, at], by)
        return replace(given, tau=tau)

    for _ in range(SHIFT_STEPS):
        if abs(by + move) > LATEST_SHIFT:
            break
        by, before = by + move, rest
        shifted, _ = formed(between)
        rest = float(most_likely_with(shifted, _changing(shifted), without).size[0])
        move = rest / max((before - rest) / move, LEAST_SEEN_REST)
        if abs(move) < SETTLED_STEP * max(record.dt, abs(by)):
            break
    anew = (as_mapped(), shifted, _changing(shifted))
    return Change(partial(_delay_findings, record, by), anew=lambda: anew, leaves=LEFT_BY_DELAY)


def _changing(rows: EffortRows) -> Array:
    """Return (m, k, 1) how fast the efforts of driven joints change [N/s, N m/s]."""
    return np.asarray((rows.rates[:, :, None] * np.eye(rows.y.shape[1])[:, rows.driven]).sum(axis=2, keepdims=True))


def _least_delay(record: Record) -> float:
    return max(LARGEST_DELAY, record.dt)


def _delay_findings(record: Record, shifted: float, explanation: Explanation, leaves: str) -> Sequence[Finding]:
    by = shifted + float(explanation.size[0])
    return [] if abs(by) < _least_delay(record) else [late_finding(by, leaves)]


def changes_of_reading(
    record: Record,
    inputs: InputsBetween,
    instants: Instants,
    rows: EffortRows,
    without: Explanation,
    as_mapped: Callable[[], EffortRows],
    formed: Formed,
) -> Iterator[Change]:
    """Yield how the driven joints may have to be read otherwise: the likeliest, were forces as they are.

    The rows of the instants are compared. `formed` and `as_mapped` are those of `change_of_time`.
    """
    model, kept, some = record.robot.model, instants.kept, instants.weighed
    q, v = (each[some] for each in instants.past)
    a, effort = np.zeros((2, len(q), model.nv))
    a[:, kept], effort[:, kept] = -instants.columns[2, some], instants.columns[3, some]
    mapped, residual = JointReading.as_mapped(record), _effort_residual(model, q, v, a, effort)

    def shift(read: JointReading) -> Array:
        return (residual - _effort_residual(model, *read.of_motion(record, q, v, a, effort=effort)))[:, kept]

    @cache
    def change_to(read: JointReading) -> Change:
        anew = cache(partial(_anew, record, read, inputs, as_mapped, formed))
        return Change(partial(_joint_findings, record, read), anew=anew, doubt=FACTOR + PRICE, leaves=LEFT_BY_JOINTS)

    def loss(read: JointReading) -> float:
        return -change_to(read).likely(rows, without)[0] if possible_readings(record, q, [read])[0] else np.inf

    slopes, kinds = np.abs(slopes_of_need(model, instants)).max(axis=(0, 1)), list[list[JointReading]]()
    joints = {joint for joint, _ in driven_rows(record, instants)}
    places = [k for k, joint in enumerate(record.driven) if joint in joints]  # else other rows would be compared
    for k in places:
        joint = record.driven[k]
        turns = not record.robot.slides(joint) and slopes[record.robot.v_index(joint)] > UPRIGHT * slopes.max()
        kinds.append([mapped.otherwise([k], turn) for turn in (TURNS_TRIED.tolist() if turns else ())])
        kinds.append([mapped.otherwise([k], n * QUARTER, -1.0, -1.0) for n in range(4 if turns else 1)])
        kinds.append([mapped.otherwise([k], effort=-1.0)])
    pairs = [*joint_pairs(record.robot, record.driven), *limb_pairs(record)]
    pairs = [pair for pair in pairs if {*pair[0], *pair[1]} <= set(places)]
    kinds += [[mapped.exchanged(pair)] for pair in pairs]
    kinds = [list(itertools.compress(kind, possible_readings(record, q, kind))) for kind in kinds]
    shifts = {read: shift(read) for read in itertools.chain(*kinds)}
    gain = dict(zip(shifts, screened(rows, without, [], list(shifts.values())).tolist(), strict=True))
    likeliest = [max(kind, key=gain.__getitem__) for kind in kinds if kind]
    losses = {read: most_likely_with(replace(rows, y=rows.y - shifts[read]), None, without).loss for read in likeliest}
    # What no force could make likely enough to be named is not formed anew.
    first = sorted((read for read in likeliest if losses[read] < without.loss + FACTOR + PRICE), key=losses.__getitem__)
    chosen = first[:LIKELIEST]
    best = min(chosen, key=loss, default=None)
    if best is not None and any(best.turn) and loss(best) < FACTOR + PRICE:
        best = downhill(best, np.flatnonzero(best.turn).tolist(), DOWNHILL, loss)
    yield from map(change_to, dict.fromkeys([*([] if best is None else [best]), *chosen]))


def _effort_residual(model: pin.Model, q: Array, v: Array, a: Array, effort: Array) -> Array:
    """Return what efforts leave of what motion and weight need."""
    data = model.createData()
    return np.array([pin.rnea(model, data, *each) for each in zip(q, v, a, strict=True)]) - effort


def _joint_changed(read: JointReading) -> tuple[int, float, float, float] | None:
    """Return the joint that is read otherwise, its turn, sense and effort; None if columns are exchanged."""
    each = zip(itertools.count(), read.turn, read.sense, read.effort)
    return next((joint for joint in each if joint[1:] != (0.0, 1.0, 1.0)), None)


def _joint_findings(
    record: Record, read: JointReading, explanation: Explanation, leaves: str
) -> Sequence[Finding] | None:
    """Return what is found, None if the rest of the turn is too far."""
    changed = _joint_changed(read)
    if changed is None:
        return read.findings(record, leaves)
    k, turn, sense, effort = changed
    hidden = record.robot.slides(record.driven[k]) or explanation.deviation[0] > REST_AT_MOST
    rest = 0.0 if hidden else -float(explanation.size[0])
    if abs(rest) > REST_AT_MOST:
        return None
    if effort != sense:
        return [reversed_effort(record.driven[k], -1.0)]
    return (
        read.otherwise([k], rest).findings(record, leaves) if sense < 0.0 or abs(turn + rest) >= SMALLEST_TURN else None
    )


def _anew(
    record: Record, read: JointReading, inputs: InputsBetween, as_mapped: Callable[[], EffortRows], formed: Formed
) -> tuple[EffortRows, EffortRows, Array | None]:
    """Return the rows as mapped and as they would be, and what the rest of a turn does to them."""

    def between(first: int, last: int) -> KnownInputs:
        given = inputs(first, last)
        q, v, tau = read.of_motion(record, given.q, given.v, effort=given.tau)
        return replace(given, q=q, v=v, tau=tau)

    rows, instants = formed(between)
    if (changed := _joint_changed(read)) is None:
        return as_mapped(), rows, None
    slopes = slopes_of_need(record.robot.model, instants)
    return as_mapped(), rows, slopes[:, instants.kept][:, :, [record.robot.v_index(record.driven[changed[0]])]]


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
        findings_of = partial(_in_order, name, what, COLUMN_ORDERS[best])
        yield Change(findings_of, shift=shifts[best], doubt=FACTOR + PRICE, leaves=LEFT_BY_CHANGE)


def _in_axes(name: str, axes: str, _: Explanation, leaves: str) -> Sequence[Finding]:
    what = f'known.{name} in axes = "{axes}" leaves {leaves}: known.{name}.axes'
    return [Finding(MISREAD_FORCE, "warning", what)]


def _in_order(name: str, part: str, order: Array, _: Explanation, leaves: str) -> Sequence[Finding]:
    words = ", ".join("-" * int(row.min() < 0.0) + "xyz"[int(np.argmax(np.abs(row)))] for row in order)
    what = f"known.{name} with {part} ({words}) in place of (x, y, z) leaves {leaves}: known.{name}.columns"
    return [Finding(MISREAD_FORCE, "warning", what)]


def _known_factor(name: str, explanation: Explanation, leaves: str) -> Sequence[Finding]:
    factor = 1.0 + float(explanation.size[0])
    clearly = CLEARLY * float(explanation.deviation[0]) * explanation.independent**-0.5
    if abs(factor - 1.0) < max(NAMED, clearly):
        return []
    what = (
        f"known.{name} would have to be {factor:.3g} times as large, which leaves {leaves}: its unit, sign, axes or "
        "frame"
    )
    return [Finding(MISREAD_FORCE, "warning", what, factor, "1")]


def _shown_of_nothing(record: Record, name: str, explanation: Explanation, leaves: str) -> Sequence[Finding]:
    return shown_of_nothing(record, name, -explanation.size, leaves)
