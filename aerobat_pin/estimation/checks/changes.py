"""What may be wrong with the efforts of a fixed robot, and what each does to its rows.

Factors of efforts, exchanged columns; gravity of another direction, a joint's zero, a load beside a point.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from aerobat_pin.estimation.checks.free_efforts import NAMED, no_effort, of_all, reversed_effort, wrong_effort
from aerobat_pin.estimation.checks.readings import joint_pairs, limb_pairs, swapped
from aerobat_pin.estimation.checks.sensor_faults import LEAST_MOMENT
from aerobat_pin.estimation.findings import Finding
from aerobat_pin.forces import (
    QUARTERS,
    SLIDES_AT,
    EffortRows,
    Exchange,
    Explanation,
    InputsBetween,
    Instants,
    column_rms,
    most_likely_with,
    slopes_of_need,
    without_quarters,
)
from aerobat_pin.numerics import Array, frame_id
from aerobat_pin.observers import robot_length
from aerobat_pin.records import PlainRobot, Record, torques_per_unit

PRICE = 2.0  # in the logarithm of the likelihood: what each number of a change costs
FACTOR = 4.0  # what factors of efforts cost more, as rows of joints that hardly carry anything look like some
GROSS = 5.0  # a factor that is named of joints at rest: no stiction looks like it
OWN = 1.25  # a factor of one effort that is named, or its inverse: motors differ by less from what is known of them
MOST_WRONG = 2  # efforts, each by a factor of its own
SHOW_NOTHING = 0.05  # share of what is needed: efforts that surely show less, if anything, are not known by what factor
CLEARLY = 4.0  # standard deviations by which a factor is told from 1, and its inverse from 0
LEFT_BY_ROBOT = 0.9  # of what is left, in squares, with a robot that stands, turns or weighs otherwise: 5 % less
LEFT_BY_CHANGE = 0.5  # of what is left, in squares, if columns change places, or efforts come at another time
LEAST_TURN = np.radians(3.0)  # by which a robot must be mounted otherwise than believed before that is said
SIZE_OF_GRAVITY = 0.25  # of gravity, by which its size may seem another, as friction and masses are known badly
NO_GRAVITY = 0.1  # of gravity: what seems to pull where efforts do not bear the weight
TURNED, SLID = (0.03, 0.5), (0.02, 0.3)  # least and largest zero of a joint that is named [rad], [m]
LARGE_OFFSET = 0.3  # of an effort's rms, that its sensor may be off by unseen
LARGE_ZERO = 0.15  # [rad, m]: no encoder slips by so much unseen
Formed = Callable[[InputsBetween], tuple[EffortRows, Instants]]  # the rows of other inputs


@dataclass(frozen=True, eq=False)
class Change:
    """A change of the map or the robot."""

    # what is found, of what is likely with it and what that leaves: nothing if it is too small, None if it cannot be
    findings_of: Callable[[Explanation, str], Sequence[Finding] | None]
    columns: Array | None = None  # (m, k, p) what it does to the rows for h = 1
    shift: Array | None = None  # (m, k) what it does to the rows, where it has no coefficient
    # where neither says what it does: rows as mapped, and rows and columns as they would be at the same instants
    anew: Callable[[], tuple[EffortRows, EffortRows, Array | None]] | None = None
    doubt: float = 0.0  # what it costs beside its coefficients
    leaves: float = np.inf  # share of what is left, in squares, that it must leave at most
    large: float = np.inf  # h from which it must leave as little as columns that change places, as it leaves traces
    cases: Sequence[Change] = ()  # that it contains, a factor of all efforts first: it must be likelier than each

    @property
    def price(self) -> float:
        """What its coefficients cost."""
        return self.doubt + PRICE * (1 if self.columns is None else self.columns.shape[2])

    @property
    def parts(self) -> list[range]:
        """Quarters of a record without which it must be worth its price, too: a push lasts, and a factor imitates it.

        Any half where there is doubt, as of factors and misread joints; else any quarter, as one pose shows less of how
        a robot stands or weighs.
        """
        width = 2 if self.doubt else 1
        return [range(first, first + width) for first in range(QUARTERS + 1 - width)]

    def enough(self, explanation: Explanation) -> float:
        """Return the share of what is left, in squares, that it must leave at most."""
        return LEFT_BY_CHANGE if np.any(np.abs(explanation.size) > self.large) else self.leaves

    def likely(self, rows: EffortRows, without: Explanation, but: range | None = None) -> tuple[float, Explanation]:
        """Return by how much it makes the rows likelier, for its price, and what is most likely with it.

        Without some quarters of the record, if they are given.
        """
        mapped, changed, columns = (rows, rows, self.columns) if self.anew is None else self.anew()
        changed = changed if self.shift is None else replace(rows, y=rows.y - self.shift)
        if but is not None:
            mapped, changed = mapped.but(but), changed.but(but)
            columns = None if columns is None else without_quarters(columns, but)
        before = without if mapped is rows else most_likely_with(mapped, None, without)
        explanation = most_likely_with(changed, columns, without)
        return before.loss - explanation.loss, explanation


def sliding_rows(instants: Instants) -> NDArray[np.bool_]:
    """Return which believed rows are those of joints that slide."""
    return np.asarray(np.abs(instants.sliding).max(axis=0, initial=0.0) > SLIDES_AT)


def driven_rows(record: Record, instants: Instants) -> list[tuple[str, int]]:
    """Return driven joints whose rows are believed, and which of these they are."""
    rows = [(joint, record.robot.v_index(joint)) for joint in record.driven]
    return [(joint, instants.kept.index(row)) for joint, row in rows if row in instants.kept]


def changes_of_efforts(record: Record, instants: Instants, rows: EffortRows, without: Explanation) -> Iterator[Change]:
    """Yield factors of efforts, and exchanged ones."""
    driven = driven_rows(record, instants)
    names, at = [joint for joint, _ in driven], [place for _, place in driven]
    unit = torques_per_unit(record.map.joints.effort, names)
    identity, moving = np.eye(len(instants.kept))[:, at], bool(sliding_rows(instants).any())
    all_alike, each_own = partial(_common, record, names, moving), partial(_own_factors, names, moving)
    one_own = [partial(_own_factors, [name], moving) for name in names]
    for true in (rows.needed, rows.needed - without.around):  # forces that wrong efforts show are wrong, too
        needed = true[:, :, None] * identity
        common = Change(all_alike, needed.sum(axis=2, keepdims=True), doubt=FACTOR)
        single = [Change(findings_of, needed[:, :, [k]], doubt=FACTOR) for k, findings_of in enumerate(one_own)]
        yield common
        yield Change(each_own, needed, doubt=FACTOR, cases=(common, *single))
        yield from single
    for k, name in enumerate(names):
        rms = float(column_rms(rows.effort[:, at[k]]))
        constant = np.broadcast_to(identity[:, [k]], (*rows.y.shape, 1))
        yield Change(partial(_offset, record.robot, name, rms), constant, leaves=LEFT_BY_ROBOT)
    for pair in [*joint_pairs(record.robot, names), *(limb_pairs(record) if len(names) == len(record.driven) else [])]:
        shift = np.zeros_like(rows.y)
        for j, k in [*zip(*pair, strict=True), *zip(*pair[::-1], strict=True)]:
            shift[:, at[j]] = unit[j] / unit[k] * rows.effort[:, at[k]] - rows.effort[:, at[j]]
        yield Change(partial(_exchanged, names, pair), shift=shift, leaves=LEFT_BY_CHANGE)


def changes_of_robot(record: Record, instants: Instants) -> Iterator[Change]:
    """Yield gravity of another direction, rotors, zeros of the joints, and loads beside the points."""
    model, kept = record.robot.model, instants.kept
    data, rest, pulls, pulling = model.createData(), np.zeros(model.nv), [], model.copy()
    q = instants.past[0][instants.weighed]
    for axis in np.eye(3):
        pulling.gravity.linear = axis
        pulls.append([pin.computeGeneralizedGravity(pulling, data, each)[kept] for each in q])
    yield Change(partial(_mounting, model), np.moveaxis(np.array(pulls), 0, -1), leaves=LEFT_BY_ROBOT)
    slopes = slopes_of_need(model, instants)[:, kept]
    bends = instants.around[1, instants.weighed]
    yield Change(no_names, bends[:, :, None] * np.eye(len(kept)))  # rotors are found beside the forces
    for joint, _ in driven_rows(record, instants) if sliding_rows(instants).any() else []:
        slope = slopes[:, :, [record.robot.v_index(joint)]]
        yield Change(partial(_zero, record.robot, joint), slope, leaves=LEFT_BY_ROBOT, large=LARGE_ZERO)
    for name in (*record.map.robot.points, *record.map.robot.wrenches):
        first = 10 * model.frames[frame_id(model, name)].parentJoint - 10
        weighs = np.array([pin.computeJointTorqueRegressor(model, data, each, rest, rest).copy() for each in q])
        weighs = weighs.reshape(len(q), model.nv, -1)[:, kept, first : first + 4]
        yield Change(partial(_load, record.robot, name), weighs, leaves=LEFT_BY_ROBOT)


def no_names(*_: object) -> Sequence[Finding]:
    """Return nothing: what the map need not say."""
    return ()


def _common(record: Record, names: Sequence[str], moving: bool, explanation: Explanation, _: str) -> Sequence[Finding]:
    """Return that all efforts would have to be larger or smaller by one factor, or reversed."""
    if _show_nothing(explanation).all():
        return [no_effort("all efforts show")]
    factors = _factor_of(explanation.size)
    named = np.abs(factors - 1.0) > NAMED if moving else _beyond(factors, GROSS)
    return [of_all(record, names, float(factors[0]))] if named[0] else []


def _own_factors(names: Sequence[str], moving: bool, explanation: Explanation, _: str) -> Sequence[Finding]:
    """Return the efforts that would have to be larger or smaller by a factor of their own, or reversed.

    Not if they are many: then it is the model that is wrong, or what pushes.
    """
    silent, clearly = _show_nothing(explanation), _clearly(explanation)
    # neither 1 nor of any size
    sure = (np.abs(explanation.size) > clearly) & (np.abs(1.0 - explanation.size) > clearly) & ~silent
    factors = _factor_of(explanation.size)
    wrong = np.flatnonzero(sure & _beyond(factors, OWN if moving else GROSS)).tolist()
    if len(wrong) + np.count_nonzero(silent) > MOST_WRONG:
        return []
    return [no_effort(f"the effort of {names[k]} shows") for k in np.flatnonzero(silent).tolist()] + [
        (reversed_effort if factors[k] < 0.0 else wrong_effort)(names[k], float(factors[k])) for k in wrong
    ]


def _clearly(explanation: Explanation) -> Array:
    """Return by how much each coefficient (p,) must differ to be told from something."""
    return np.asarray(CLEARLY * explanation.deviation * explanation.independent**-0.5)


def _show_nothing(explanation: Explanation) -> NDArray[np.bool_]:
    """Return which efforts (p,) show less than `SHOW_NOTHING`, and not by what factor, within twice or half of it."""
    shown, clearly = np.abs(1.0 - explanation.size), _clearly(explanation)
    return np.asarray((shown <= 2.0 * clearly) & (np.maximum(shown, clearly) < SHOW_NOTHING))


def _beyond(factors: Array, size: float) -> NDArray[np.bool_]:
    """Return which factors are negative, or larger than this or smaller than its inverse."""
    return np.asarray((factors < 0.0) | (np.abs(np.log(np.maximum(np.abs(factors), 1e-300))) > np.log(size)))


def _factor_of(size: Array) -> Array:
    """Return the factors of efforts of which rows are off by a share h of what is needed."""
    return np.asarray(1.0 / np.where(size == 1.0, 1e-9, 1.0 - size))


def _offset(robot: PlainRobot, joint: str, rms: float, explanation: Explanation, leaves: str) -> Sequence[Finding]:
    """Return that an effort is off by a constant, if that is far more than what is always believed possible."""
    off, unit = -float(explanation.size[0]), "N" if robot.slides(joint) else "N m"
    if abs(off) < LARGE_OFFSET * rms:
        return []
    text = (
        f"the effort of {joint} seems to be {off:.3g} {unit} more than it is, which leaves {leaves}: its sensor's "
        "zero, which a calibration learns, or what pulls there all the time"
    )
    return [Finding("effort zero", "warning", text, off, unit)]


def _exchanged(names: Sequence[str], pair: Exchange, _: Explanation, leaves: str) -> Sequence[Finding]:
    return [swapped(names, "efforts", pair, leaves)]


def _mounting(model: pin.Model, explanation: Explanation, leaves: str) -> Sequence[Finding] | None:
    """Return gravity of another direction, or none: what is believed, less h [m/s2], in the axes of the root."""
    believed = model.gravity.linear
    gravity, g = believed - explanation.size, float(np.linalg.norm(believed))
    size = max(float(np.linalg.norm(gravity)), 1e-300)
    if size < NO_GRAVITY * g:
        text = (
            f"efforts that bear no weight leave {leaves}: where a controller adds the weight to what is logged "
            "(gravity compensation), write gravity = 0 in [robot]"
        )
        return [Finding("efforts without weight", "warning", text, size / g, "1")]
    if g > 0.0 and abs(size - g) > SIZE_OF_GRAVITY * g:
        return None
    if float(gravity @ believed) > np.cos(LEAST_TURN) * g * size:
        return None if abs(size - g) > NAMED * g else []
    x, y, z = gravity / size
    text = (
        f"gravity along ({x:.2f}, {y:.2f}, {z:.2f}) leaves {leaves}: is the robot mounted so (robot.down), or are its "
        "first joints off?"
    )
    return [Finding("mounting", "warning", text)]


def _zero(robot: PlainRobot, joint: str, explanation: Explanation, leaves: str) -> Sequence[Finding] | None:
    """Return another zero of a joint; its value is how much farther than its position says the joint stands."""
    off, slides = -float(explanation.size[0]), robot.slides(joint)
    low, high = SLID if slides else TURNED
    if not low < abs(off) < high:
        return [] if abs(off) < high else None
    words = f"{1e3 * off:.0f} mm" if slides else f"{np.degrees(off):.1f} deg"
    text = (
        f"{joint} seems to stand {words} farther than its position says, which leaves {leaves}: its encoder's zero "
        "(joints.offset), or a centre of mass that lies aside"
    )
    return [Finding("joint zero", "warning", text, off, "m" if slides else "rad")]


def _load(robot: PlainRobot, name: str, explanation: Explanation, leaves: str) -> Sequence[Finding] | None:
    """Return a load beside a point: its weight passes for a force there, its moment about it is left."""
    model = robot.model
    frame = model.frames[frame_id(model, name)]
    moment = float(np.linalg.norm(explanation.size[1:] - explanation.size[0] * frame.placement.translation))
    lacks = explanation.size[0] - _clearly(explanation)[0]
    if lacks > model.inertias[frame.parentJoint].mass or moment > robot.mass * robot_length(model):
        return None  # no body lacks more than its mass, and the whole robot weighs less at its end
    if moment < LEAST_MOMENT * robot.mass:
        return []
    text = (
        f"a load beside {name}, mass times distance {moment:.2g} kg m, leaves {leaves}: does the robot carry what its "
        "file lacks ([payload] in the map), or lack what it has?"
    )
    return [Finding("load", "warning", text, moment, "kg m")]
