"""Joints that a log counts from quite another zero than the robot's file, the other way, or in another order.

Such a mistake is no column (`changes`): it changes what the motion needs and what a force does. Of those that make the
rows likely, were forces as they are, the rows are formed anew, and the rest of a turn is found beside the forces.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np
import pinocchio as pin

from aerobat_pin.estimation.checks.balance import Exchange, InputsBetween, in_each_others_place, limb_pairs
from aerobat_pin.estimation.checks.changes import FACTOR, PRICE, Change, driven_rows, slopes_of_weight
from aerobat_pin.estimation.checks.free_efforts import reversed_effort, swapped
from aerobat_pin.estimation.findings import Finding
from aerobat_pin.forces import EffortRows, Explanation, Instants, KnownInputs, most_likely_with, screened
from aerobat_pin.numerics import Array
from aerobat_pin.records import Record

QUARTER = 0.5 * np.pi
TURNS_TRIED = np.pi / 6.0 * np.arange(1, 12)  # that are tried [rad]
DOWNHILL = np.pi / np.array([6.0, 6.0, 6.0, 12.0, 12.0])  # from the likeliest of them [rad]
LIKELIEST = 6  # of which the rows are formed anew
REST_AT_MOST = np.radians(20.0)  # from a turn that was tried to the one that is found: within it the weight is linear
UPRIGHT = 1e-6  # of the largest change of the weight: an axis along gravity
LEFT_BY_JOINTS = 0.1  # of what is left, in squares: the rows are exact
SMALLEST_TURN = 0.5 * TURNS_TRIED[0]  # that is said; a column says what smaller ones do
AS_QUARTERS = np.radians(5.0)  # so near to quarters a turn is one
Formed = Callable[[InputsBetween], tuple[EffortRows, Instants]]  # the rows of other inputs


@dataclass(frozen=True)
class Turned:
    """A joint that may stand otherwise: q = turn + sense times what the log says.

    Attributes:
        joint: its name.
        turn: [rad], positive in the joint's own sense.
        sense: 1, or -1 of a joint that turns the other way.
        effort: 1, or -1 if its effort's sign is the other one; a joint that turns the other way has both.
    """

    joint: str
    turn: float = 0.0
    sense: float = 1.0
    effort: float = 1.0

    def of_motion(self, record: Record, q: Array, *rates: Array, effort: Array) -> list[Array]:
        """Return positions (m, nq), rates and accelerations (m, nv), efforts (n, nv), so read [rad, m, s, N, N m]."""
        at_q, at_v = record.robot.q_index(self.joint), record.robot.v_index(self.joint)
        there = [values.copy() for values in (q, *rates, effort)]
        there[0][:, at_q] = self.turn + self.sense * q[:, at_q]
        for values in there[1:-1]:
            values[:, at_v] *= self.sense
        there[-1][:, at_v] *= self.effort
        return there

    def told(self, record: Record, found: Explanation, left: str) -> Sequence[Finding] | None:
        """Return what is found, None if the rest of the turn is too far."""
        joint, table, rest = self.joint, record.map.joints, -float(found.size[0])
        rest = 0.0 if record.robot.slides(joint) or found.deviation[0] > REST_AT_MOST else rest  # which nothing shows
        if abs(rest) > REST_AT_MOST:
            return None
        if self.effort != self.sense:
            return [reversed_effort(joint, -1.0)]
        turn = self.turn + rest
        quarters = QUARTER * round(turn / QUARTER)
        turn = quarters if abs(turn - quarters) < AS_QUARTERS else turn
        turn = float(np.pi - np.remainder(np.pi - turn, 2.0 * np.pi))  # beyond -180 deg, up to 180
        if self.sense > 0.0 and abs(turn) < SMALLEST_TURN:
            return None
        offset = turn + self.sense * table.offset.get(joint, 0.0)
        what = f"stand {np.degrees(turn):.0f} deg farther than its position says"
        keys = f"joints.offset = {{{joint} = {offset:.4g}}}"
        if self.sense < 0.0:
            zero = f", from a zero {np.degrees(turn):.0f} deg away" if turn else ""
            what = f"turn the other way than its columns say{zero}"
            keys = f"joints.factor = {{{joint} = {-table.factor.get(joint, 1.0):g}}}{f' and {keys}' if offset else ''}"
        text = f"{joint} seems to {what}, which leaves {left}: {keys}"
        return [Finding("joint zero" if self.sense > 0.0 else "joint sense", "warning", text, turn, "rad")]


@dataclass(frozen=True)
class Exchanged:
    """Joints, or limbs, that may have each other's columns: places among the driven joints."""

    pair: Exchange

    def of_motion(self, record: Record, q: Array, *rates: Array, effort: Array) -> list[Array]:
        """Return positions (m, nq), rates and accelerations (m, nv), efforts (n, nv), so read [rad, m, s, N, N m]."""
        return in_each_others_place(record, self.pair, q, *rates, effort)

    def told(self, record: Record, _: Explanation, left: str) -> Sequence[Finding]:
        """Return what is found."""
        return [swapped(record.driven, "all columns", self.pair, left)]


def changes_of_reading(
    record: Record,
    inputs: InputsBetween,
    instants: Instants,
    rows: EffortRows,
    without: Explanation,
    formed: Formed,
) -> Iterator[Change]:
    """Yield how the driven joints may have to be read otherwise: the likeliest, were forces as they are.

    Args:
        record: the record.
        inputs: what an observer is given between two indices of the common times.
        instants: of the record, their rows being those that are compared.
        rows: at these instants.
        without: what is likely as the joints are mapped.
        formed: returns the rows of other inputs.
    """
    model, kept, some = record.robot.model, instants.kept, instants.weighed
    q, v = instants.q[some], instants.v[some]
    a, effort = np.zeros((2, len(q), model.nv))
    a[:, kept], effort[:, kept] = -instants.columns[2, some], instants.columns[3, some]
    left = _left(model, q, v, a, effort)

    def shift(read: Turned | Exchanged) -> Array:
        return (left - _left(model, *read.of_motion(record, q, v, a, effort=effort)))[:, kept]

    @cache
    def change_to(read: Turned | Exchanged) -> Change:
        anew = cache(partial(_anew, record, read, inputs, formed))
        return Change(partial(read.told, record), anew=anew, doubt=FACTOR + PRICE, leaves=LEFT_BY_JOINTS)

    def loss(read: Turned | Exchanged) -> float:
        return change_to(read).explained(rows, without).loss

    slopes, kinds = np.abs(slopes_of_weight(model, q)).max(axis=(0, 1)), list[list[Turned | Exchanged]]()
    joints = [joint for joint, _ in driven_rows(record, instants)]
    for joint in joints:
        turns = not record.robot.slides(joint) and slopes[record.robot.v_index(joint)] > UPRIGHT * slopes.max()
        kinds.append([Turned(joint, turn) for turn in (TURNS_TRIED.tolist() if turns else ())])
        kinds.append([Turned(joint, k * QUARTER, -1.0, -1.0) for k in range(4 if turns else 1)])
        kinds.append([Turned(joint, effort=-1.0)])
    places = [k for k, joint in enumerate(record.driven) if joint in joints]  # else other rows would be compared
    pairs: list[Exchange] = [((j,), (k,)) for j, k in itertools.combinations(places, 2)]
    pairs += [pair for pair in limb_pairs(record) if {*pair[0], *pair[1]} <= set(places)]
    kinds += [[Exchanged(pair)] for pair in pairs]
    shifts = {read: shift(read) for read in itertools.chain(*kinds)}
    gain = dict(zip(shifts, screened(rows, without, [], list(shifts.values())).tolist(), strict=True))
    likeliest = [max(kind, key=gain.__getitem__) for kind in kinds if kind]
    losses = {read: most_likely_with(replace(rows, y=rows.y - shifts[read]), None, without).loss for read in likeliest}
    # What no force could make likely enough to be named is not formed anew.
    first = sorted((read for read in likeliest if losses[read] < without.loss + FACTOR + PRICE), key=losses.__getitem__)
    chosen = first[:LIKELIEST]
    best = min(chosen, key=loss, default=None)
    if isinstance(best, Turned) and best.turn:  # downhill
        for step in DOWNHILL:
            best = min((best, *(replace(best, turn=best.turn + sign * step) for sign in (1.0, -1.0))), key=loss)
    yield from map(change_to, dict.fromkeys([*([] if best is None else [best]), *chosen]))


def _left(model: pin.Model, q: Array, v: Array, a: Array, effort: Array) -> Array:
    """Return what efforts leave of what motion and weight need."""
    data = model.createData()
    return np.array([pin.rnea(model, data, *each) for each in zip(q, v, a, strict=True)]) - effort


def _anew(
    record: Record, read: Turned | Exchanged, inputs: InputsBetween, formed: Formed
) -> tuple[EffortRows, Array | None]:
    """Return the rows as they would be, and what the rest of a turn does to them."""

    def between(first: int, last: int) -> KnownInputs:
        given = inputs(first, last)
        q, v, tau = read.of_motion(record, given.q, given.v, effort=given.tau)
        return replace(given, q=q, v=v, tau=tau)

    rows, instants = formed(between)
    if isinstance(read, Exchanged):
        return rows, None
    slopes = slopes_of_weight(record.robot.model, instants.q[instants.weighed])
    return rows, slopes[:, instants.kept][:, :, [record.robot.v_index(read.joint)]]
