"""Check the efforts against what the motion and the weight need: units, signs, places, delays, mounting, zeros, loads.

What forces, friction and constants leave of a fixed robot's rows is explained by one change of the map or of the robot,
if any: the one that makes the rows most likely (`explanations`). Feet of a free robot carry more than its motion needs,
so that a factor of all efforts looks like other forces: there `free_efforts` compares what no force explains.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from aerobat_pin.estimation.checks.balance import Exchange, InputsBetween, limb_pairs, with_exchanged
from aerobat_pin.estimation.checks.explanations import EffortRows, Explanation, effort_rows, explained, screened
from aerobat_pin.estimation.checks.free_efforts import (
    GOOD,
    NAMED,
    left_unexplained,
    of_all,
    of_free,
    reversed_effort,
    swapped,
    wrong_effort,
)
from aerobat_pin.estimation.findings import Finding
from aerobat_pin.forces import SLIDES_AT, WEIGHED, FittedValues, Instants, expected_of, looked_at, row_scale
from aerobat_pin.numerics import Array
from aerobat_pin.observers import Expected
from aerobat_pin.records import LARGEST_DELAY, PlainRobot, Record

SURE, PRICE = 6.0, 2.0  # gain of the log-likelihood from which a change is named, and what each of its numbers costs
FACTOR = 4.0  # what factors of efforts cost more, as rows of joints that hardly carry anything look like some
AS_LIKELY = 3.0  # loss of it with which a change explains about as well as the likeliest
TRIED = 6  # changes of which the likelihood is found, after a first look at all
ANY_FORCE = 10.0  # times what is expected of a force: no change need explain a steady one
GROSS = 5.0  # a factor that no stiction looks like
CLEARLY = 4.0  # standard deviations by which a factor is told from 1, and its inverse from 0
SWAP = 0.5  # of what is left, in squares, if joints or limbs change places, or efforts come at another time
LEAST_TILT = np.radians(3.0)  # by which a robot must be mounted otherwise than believed before that is said
SAME_SIZE = 0.25  # of gravity, by which its size may seem another, as friction and masses are known badly
TURNED, SLID = (0.05, 0.5), (0.02, 0.3)  # least and largest zero of a joint that is named [rad], [m]
LEAST_MOMENT = 0.005  # [m] times the mass that moves: a load whose moment about a point is smaller is not named
UNEXPLAINED = 0.25  # share of what is needed, in squares, that is left of no good record
WHITE = 0.5  # share of instants that are independent, from which what is left is noise
HARMLESS = frozenset(  # warnings that leave the motion as it is, but for some ms
    "unit of joints.effort, held channel, interpolated channel, late channel, gap, repeated stamps, time goes back, "
    "recorder clock, duplicate file, accelerometer against gravity".split(", ")
)


@dataclass(frozen=True)
class Change:
    """A change of the map or the robot.

    Attributes:
        told: what is found, of what is likely with it and what that leaves: nothing if it is too small, None if it
            cannot be.
        columns: (m, k, p) what it does to the rows for h = 1.
        shift: (m, k) what it does to the rows, where it has no coefficient.
        doubt: what it costs beside its coefficients.
        leaves: share of what is left, in squares, that it must leave at most.
    """

    told: Callable[[Explanation, str], Sequence[Finding] | None]
    columns: Array | None = None
    shift: Array | None = None
    doubt: float = 0.0
    leaves: float = np.inf

    @property
    def price(self) -> float:
        """What its coefficients cost."""
        return self.doubt + PRICE * (1 if self.columns is None else self.columns.shape[2])

    def explained(self, rows: EffortRows, without: Explanation) -> Explanation:
        """Return what is most likely with it."""
        return explained(rows if self.shift is None else replace(rows, y=rows.y - self.shift), self.columns, without)


def effort_findings(
    record: Record,
    inputs: InputsBetween,
    before: Sequence[Finding],
    instants: Instants | None = None,
    expected: Expected | None = None,
) -> Iterator[Finding]:
    """Yield how well efforts fit the motion, and what change of the map or the robot explains what they leave.

    Args:
        record: the record.
        inputs: what an observer is given between two indices of the common times.
        before: what was found before; efforts are not compared with a motion that is misread.
        instants: of the record, if it was looked at.
        expected: what is expected of it, if that is known.
    """
    misread = [each for each in before if each.warns and each.check not in HARMLESS]
    beyond = bool(misread) and all(each.check == "joint limits" and each.verdict == "warning" for each in misread)
    if "joints.effort" not in record.channels or (misread and not beyond):
        return
    if record.robot.free:
        yield from of_free(record, inputs, beyond=beyond)
        return
    free, chosen = record.map.use.free, record.map.robot
    rows = None
    if free is not None or chosen.points or chosen.wrenches:  # else a force that is not sought may be in every row
        instants = looked_at(record, inputs, FittedValues(), between=free) if free or instants is None else instants
        rows, instants = (None, None) if instants is None else _rows_of(record, instants, expected)
    if instants is None or rows is None or rows.forces.shape[1] >= rows.y.shape[1]:
        how = "" if free else "; use.free names a stretch without contact"
        yield Finding("effort against motion", "note", f"unknown forces leave no row to check efforts by{how}")
        return
    without, scale = explained(rows), row_scale(record.robot.model)[instants.kept]
    needed = max(float(np.sum((rows.needed / scale) ** 2)), 1e-300)

    def left(explanation: Explanation) -> float:
        return float(np.sum((explanation.errors / scale) ** 2)) / needed

    share = left(without)
    text = f"forces and friction leave {100.0 * np.sqrt(share):.1f} % of what weight and motion need"
    if beyond and share < GOOD:
        text += ": they fit the angles as they are, also those of joints beyond their limits"
    yield Finding("effort against motion", "good" if share < GOOD else "note", text, float(np.sqrt(share)), "1")
    if beyond:  # whose efforts say nothing of factors or places before that is settled
        return
    changes = [*_of_efforts(record, instants, rows, without), *_of_robot(record, instants)]
    told = []
    for gain, found, change in _likely(rows, without, changes):
        after = left(found)
        findings = change.told(found, _shares(after, share))
        if findings is not None and after < change.leaves * share:
            told.append((gain, findings))
    most = max((gain for gain, _ in told), default=SURE)
    if told:
        yield from next((findings for gain, findings in told if findings and gain > most - AS_LIKELY), ())
        return
    if share < UNEXPLAINED or without.independent > WHITE:
        return
    for pair in limb_pairs(record):
        seen = looked_at(record, with_exchanged(record, inputs, pair), FittedValues(), between=free)
        after = 1.0 if seen is None else left(explained(_rows_of(record, seen, None)[0]))
        if after < SWAP * share:
            yield swapped(record.driven, "all columns", pair, _shares(after, share))
            return
    yield left_unexplained("nothing simple", 100.0 * share**0.5)


def _shares(after: float, before: float) -> str:
    return f"{100.0 * after**0.5:.1f} % of what is needed, as mapped {100.0 * before**0.5:.1f} %"


def _in_motion(instants: Instants) -> Instants:
    """Return instants without the rows of joints that never slide, which stiction holds, if others do."""
    slide = np.abs(instants.sliding).max(axis=0, initial=0.0) > SLIDES_AT
    if not slide.any():
        return instants
    kept = [row for row, each in zip(instants.kept, slide.tolist(), strict=True) if each]
    sliding, columns, rates = instants.sliding[:, slide], instants.columns[:, :, slide], instants.rates[:, slide]
    return replace(instants, kept=kept, sliding=sliding, columns=columns, rates=rates)


def _rows_of(record: Record, instants: Instants, expected: Expected | None) -> tuple[EffortRows, Instants]:
    expected = expected_of(record, instants, FittedValues()) if expected is None else expected
    instants = _in_motion(instants)
    driven = [place for _, place in _driven(record, instants)]
    return effort_rows(instants, expected, driven, forces=0.0 if record.map.use.free else ANY_FORCE), instants


def _likely(
    rows: EffortRows, without: Explanation, changes: list[Change]
) -> Iterator[tuple[float, Explanation, Change]]:
    """Yield the changes that make the rows far more likely, in their order: by how much, and what is likely then."""
    changes = sorted(changes, key=lambda each: each.shift is not None)
    columns = [each.columns for each in changes if each.columns is not None]
    gains = screened(rows, without, columns, [each.shift for each in changes if each.shift is not None])
    order = np.argsort([each.price - gain for each, gain in zip(changes, gains.tolist(), strict=True)])
    tried = [(changes[k].explained(rows, without), changes[k]) for k in sorted(order[:TRIED].tolist())]
    independent = min(tried, key=lambda pair: pair[0].loss)[0].independent
    for found, change in tried:
        gain = (without.loss - found.loss) * independent - change.price
        if gain > SURE:
            yield gain, found, change


def _driven(record: Record, instants: Instants) -> list[tuple[str, int]]:
    """Return driven joints whose rows are believed, and which of these they are."""
    rows = [(joint, record.robot.v_index(joint)) for joint in record.driven]
    return [(joint, instants.kept.index(row)) for joint, row in rows if row in instants.kept]


def _of_efforts(record: Record, instants: Instants, rows: EffortRows, without: Explanation) -> Iterator[Change]:
    """Yield factors of efforts, their delay, and exchanged ones."""
    driven = _driven(record, instants)
    names, at = [joint for joint, _ in driven], [place for _, place in driven]
    one, slides = np.eye(len(instants.kept))[:, at], np.abs(instants.sliding[:, at]).max(axis=0) > SLIDES_AT
    for true in (rows.needed, rows.needed - without.around):  # forces that wrong efforts show are wrong, too
        needed = true[:, :, None] * one
        yield Change(partial(_common, record, names, slides), needed.sum(axis=2, keepdims=True), doubt=FACTOR)
        yield Change(partial(_factors, names, slides), needed, doubt=FACTOR)
        for k, name in enumerate(names):
            yield Change(partial(_factors, [name], slides[[k]]), needed[:, :, [k]], doubt=FACTOR)
    late = (rows.rates[:, :, None] * one).sum(axis=2, keepdims=True)
    yield Change(partial(_late, record), late, leaves=SWAP)
    pairs: list[Exchange] = [((j,), (k,)) for j, k in itertools.combinations(range(len(names)), 2)]
    for pair in [*pairs, *(limb_pairs(record) if len(names) == len(record.driven) else [])]:
        shift = np.zeros_like(rows.y)
        for j, k in zip(*pair, strict=True):
            apart = rows.effort[:, at[k]] - rows.effort[:, at[j]]
            shift[:, at[j]], shift[:, at[k]] = apart, -apart
        yield Change(partial(_exchanged, names, pair), shift=shift, leaves=SWAP)


def _of_robot(record: Record, instants: Instants) -> Iterator[Change]:
    """Yield gravity of another direction, rotors, zeros of the joints, and loads beside the points."""
    model, kept = record.robot.model, instants.kept
    data, rest, pulls, pulling = model.createData(), np.zeros(model.nv), [], model.copy()
    q = instants.q[:: max(1, len(instants.rows) // WEIGHED)]
    for axis in np.eye(3):
        pulling.gravity.linear = axis
        pulls.append([pin.computeGeneralizedGravity(pulling, data, each)[kept] for each in q])
    yield Change(partial(_mounting, model), np.moveaxis(np.array(pulls), 0, -1))
    slopes = np.array([pin.computeGeneralizedGravityDerivatives(model, data, each).copy() for each in q])
    slopes = slopes.reshape(len(q), model.nv, model.nv)[:, kept]
    bends = instants.columns[2, :: max(1, len(instants.rows) // WEIGHED)]
    yield Change(_fitted, bends[:, :, None] * np.eye(len(kept)))
    slides = dict(zip(kept, np.abs(instants.sliding).max(axis=0) > SLIDES_AT, strict=True))
    for joint in (each for each in record.driven if slides.get(record.robot.v_index(each))):
        yield Change(partial(_zero, record.robot, joint), slopes[:, :, [record.robot.v_index(joint)]])
    for name in (*record.map.robot.points, *record.map.robot.wrenches):
        first = 10 * model.frames[model.getFrameId(name)].parentJoint - 10
        weighs = np.array([pin.computeJointTorqueRegressor(model, data, each, rest, rest).copy() for each in q])
        weighs = weighs.reshape(len(q), model.nv, -1)[:, kept, first : first + 4]
        yield Change(partial(_load, record.robot, name), weighs)


def _common(record: Record, names: Sequence[str], slides: Array, found: Explanation, _: str) -> Sequence[Finding]:
    factor = float(_factor_of(found.size)[0])
    if not _told_apart(np.array([factor]), np.array([slides.any()]))[0]:
        return []
    return [of_all(record, names, factor)]


def _factors(names: Sequence[str], slides: Array, found: Explanation, _: str) -> Sequence[Finding]:
    """Return the efforts that would have to be larger or smaller by a factor of their own, or reversed."""
    clearly = CLEARLY * found.deviation * found.independent**-0.5
    sure = (np.abs(found.size) > clearly) & (np.abs(1.0 - found.size) > clearly)  # neither 1 nor of any size
    factors = _factor_of(found.size)
    wrong = np.flatnonzero(sure & _told_apart(factors, slides)).tolist()
    return [(reversed_effort if factors[k] < 0.0 else wrong_effort)(names[k], float(factors[k])) for k in wrong]


def _told_apart(factors: Array, slides: Array) -> NDArray[np.bool_]:
    """Return which factors are worth naming: of a joint at rest, which stiction holds, only those that are gross."""
    gross = (factors < 0.0) | (np.abs(np.log(np.maximum(np.abs(factors), 1e-300))) > np.log(GROSS))
    return np.asarray(np.where(slides, np.abs(factors - 1.0) > NAMED, gross))


def _factor_of(size: Array) -> Array:
    """Return the factors of efforts of which rows are off by a share h of what is needed."""
    return np.asarray(1.0 / np.where(size == 1.0, 1e-9, 1.0 - size))


def _late(record: Record, found: Explanation, left: str) -> Sequence[Finding]:
    by = float(found.size[0])
    if abs(by) < max(LARGEST_DELAY, record.dt):
        return []
    early, late, parts = "the motion", "joints.effort", "effort"
    if by < 0.0:
        early, late, parts = late, early, "position and joints.velocity"
    text = (
        f"{late} comes {1e3 * abs(by):.0f} ms after {early}: shifted by that, it leaves {left}: a clock, a filter or a "
        f"slow sensor (in a map: delay = {abs(by):.3f} under joints.{parts})"
    )
    return [Finding("late efforts", "warning", text, by, "s")]


def _exchanged(names: Sequence[str], pair: Exchange, _: Explanation, left: str) -> Sequence[Finding]:
    return [swapped(names, "efforts", pair, left)]


def _fitted(_: Explanation, __: str) -> Sequence[Finding]:
    """Return nothing of rotors that the robot's file lacks: they are found beside the forces."""
    return []


def _mounting(model: pin.Model, found: Explanation, left: str) -> Sequence[Finding] | None:
    believed = model.gravity.linear
    gravity, g = believed - found.size, float(np.linalg.norm(believed))
    size = max(float(np.linalg.norm(gravity)), 1e-300)
    if g > 0.0 and abs(size - g) > SAME_SIZE * g:
        return None
    if float(gravity @ believed) > np.cos(LEAST_TILT) * g * size:
        return None if abs(size - g) > NAMED * g else []
    x, y, z = gravity / size
    text = (
        f"gravity along ({x:.2f}, {y:.2f}, {z:.2f}) leaves {left}: is the robot mounted so (robot.down), or are its "
        "first joints off?"
    )
    return [Finding("mounting", "warning", text)]


def _zero(robot: PlainRobot, joint: str, found: Explanation, left: str) -> Sequence[Finding] | None:
    """Return another zero of a joint; its value is how much farther than its position says the joint stands."""
    off, slides = -float(found.size[0]), robot.slides(joint)
    low, high = SLID if slides else TURNED
    if not low < abs(off) < high:
        return [] if abs(off) < high else None
    words = f"{1e3 * off:.0f} mm" if slides else f"{np.degrees(off):.1f} deg"
    text = (
        f"{joint} seems to stand {words} farther than its position says, which leaves {left}: its encoder's zero "
        "(joints.offset), or a centre of mass that lies aside"
    )
    return [Finding("joint zero", "warning", text, off, "m" if slides else "rad")]


def _load(robot: PlainRobot, name: str, found: Explanation, left: str) -> Sequence[Finding]:
    """Return a load beside a point: its weight passes for a force there, its moment about it is left."""
    frame = robot.model.frames[robot.model.getFrameId(name)]
    moment = float(np.linalg.norm(found.size[1:] - found.size[0] * frame.placement.translation))
    if moment < LEAST_MOMENT * robot.mass:
        return []
    text = (
        f"a load beside {name}, mass times distance {moment:.2g} kg m, leaves {left}: does the robot carry what its "
        "file lacks ([payload] in the map)?"
    )
    return [Finding("load", "warning", text, moment, "kg m")]
