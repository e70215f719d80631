"""How a log's joints may have to be read: whose columns each has, from which zero, and which way it turns."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from aerobat_pin.estimation.findings import Finding
from aerobat_pin.forces import Exchange, FreeMotion, balance_of
from aerobat_pin.numerics import Array
from aerobat_pin.records import PlainRobot, Record, torques_per_unit

QUARTER = 0.5 * np.pi
LEFT_BY_JOINTS = 0.1  # of what is left, in squares, that a right reading leaves at most: it makes the rows exact
AS_QUARTERS = np.radians(5.0)  # so near to quarters a turn is one
SLIGHTLY, SLIGHTLY_OUT = np.radians(5.0), 5e-3  # beyond its limits a joint may be that turns [rad], or slides [m]
UNLIMITED = 1e6  # [rad, m]: a wider range, as of a joint that turns on and on, is none
FEW_INSTANTS = 24  # of the record, at which readings are looked at
FIRST_LOOK, SEEN_AGAIN = 3, 40  # of so many of them one, at which all are; so many are looked at again
MOST_MISREADINGS = 4  # changes, one after the other
FAR_LESS = 0.6  # of what was left before, in squares
WELL = 0.002  # of what is needed, in squares, that a robot read right may leave
TURNS_OF_LEGS = np.radians([*range(30, 360, 30), -12, 12]).tolist()  # that are tried [rad]
DOWNHILL_OF_LEGS = np.radians([15.0, 7.5, 4.0, 2.0]).tolist()  # from the best of them [rad]
LIMBS_IN_ANY_ORDER = 4  # so many at most


@dataclass(frozen=True)
class JointReading:
    """How the n driven joints may have to be read, each: q = turn + sense times what the columns of one of them say."""

    order: tuple[int, ...]  # (n,) whose columns each has
    turn: tuple[float, ...]  # (n,) [rad], positive in the joint's own sense
    sense: tuple[float, ...]  # (n,) 1, or -1 of a joint that turns the other way
    effort: tuple[float, ...]  # (n,) 1, or -1 if its sign is the other one, as of a joint that turns the other way

    @classmethod
    def as_mapped(cls, record: Record) -> JointReading:
        """Return how they are read."""
        n = len(record.driven)
        return cls(tuple(range(n)), n * (0.0,), n * (1.0,), n * (1.0,))

    def otherwise(
        self, joints: Iterable[int], turn: float = 0.0, sense: float = 1.0, effort: float = 1.0
    ) -> JointReading:
        """Return this reading with some joints turned by an angle [rad], the other way round, or their efforts."""
        turns, senses, efforts = list(self.turn), list(self.sense), list(self.effort)
        for k in joints:
            turns[k] = _within_a_turn(turn + sense * turns[k])
            senses[k] *= sense
            efforts[k] *= effort
        return replace(self, turn=tuple(turns), sense=tuple(senses), effort=tuple(efforts))

    def exchanged(self, pair: Exchange) -> JointReading:
        """Return this reading with the columns of two joints, or limbs, in each other's place."""
        return self.moved([*pair[0], *pair[1]], [*pair[1], *pair[0]])

    def moved(self, joints: Iterable[int], others: Iterable[int]) -> JointReading:
        """Return this reading with some joints having the columns that others have."""
        order = list(self.order)
        for k, other in zip(joints, others, strict=True):
            order[k] = self.order[other]
        return replace(self, order=tuple(order))

    def of_motion(self, record: Record, q: Array, *rates: Array, effort: Array) -> list[Array]:
        """Return positions (m, nq), rates and accelerations (m, nv), efforts (n, nv), so read [rad, m, s, N, N m]."""
        robot, as_read = record.robot, [values.copy() for values in (q, *rates, effort)]
        at_q, at_v = (np.array([index(joint) for joint in record.driven]) for index in (robot.q_index, robot.v_index))
        order = list(self.order)
        as_read[0][:, at_q] = np.array(self.turn) + self.sense * q[:, at_q[order]]
        for ours, values in zip(as_read[1:-1], rates, strict=True):
            ours[:, at_v] = self.sense * values[:, at_v[order]]
        unit = torques_per_unit(record.map.joints.effort, record.driven)
        as_read[-1][:, at_v] = self.effort * unit / unit[order] * effort[:, at_v[order]]
        return as_read

    def findings(self, record: Record, leaves: str) -> list[Finding]:
        """Return what the map would have to say to be read so, in findings that tell what it `leaves`."""
        names, table = record.driven, record.map.joints
        findings, alike = list[Finding](), dict[tuple[float, float], list[str]]()
        moved = [k for k, other in enumerate(self.order) if k != other]
        if moved and all(self.order[self.order[k]] == k for k in moved):
            first = tuple(k for k in moved if k < self.order[k])
            findings.append(swapped(names, "all columns", (first, tuple(self.order[k] for k in first)), leaves))
        elif moved:
            ours, theirs = (", ".join(names[k] for k in places) for places in (moved, (self.order[k] for k in moved)))
            findings.append(Finding("swapped joints", "warning", f"{ours} with all columns of {theirs} leave {leaves}"))
        for joint, turn, sense in zip(names, self.turn, self.sense, strict=True):
            quarters = QUARTER * round(turn / QUARTER)
            near = _within_a_turn(quarters if abs(turn - quarters) < AS_QUARTERS else turn)
            if near or sense < 0.0:
                alike.setdefault((near, sense), []).append(joint)
        for (turn, sense), joints in alike.items():
            offset = {joint: turn + sense * table.offset.get(joint, 0.0) for joint in joints}
            seem, its = ("seems", "its") if len(joints) == 1 else ("seem", "their")
            says = f"position{' says' if len(joints) == 1 else 's say'}"
            what = f"stand {np.degrees(turn):.0f} deg farther than {its} {says}"
            keys = f"joints.offset = {_inline_table(offset)}"
            if sense < 0.0:
                zero = f", from a zero {np.degrees(turn):.0f} deg away" if turn else ""
                what = f"turn the other way than {its} columns say{zero}"
                factors = {joint: -table.factor.get(joint, 1.0) for joint in joints}
                keys = f"joints.factor = {_inline_table(factors)}{f' and {keys}' if any(offset.values()) else ''}"
            text = f"{', '.join(joints)} {seem} to {what}, which leaves {leaves}: {keys}"
            findings.append(Finding("joint zero" if sense > 0.0 else "joint sense", "warning", text, turn, "rad"))
        return findings


def possible_readings(record: Record, q: Array, readings: Iterable[JointReading]) -> list[bool]:
    """Return by which readings no joint, at positions (m, nq) as mapped, is beyond its limits but where it is anyway.

    A whole turn is none.
    """
    robot, none = record.robot, np.empty((0, record.robot.model.nv))
    at, turns = [robot.q_index(joint) for joint in record.driven], [not robot.slides(joint) for joint in record.driven]
    limits = robot.model.lowerPositionLimit[at], robot.model.upperPositionLimit[at]
    low, high = np.clip(limits, -UNLIMITED, UNLIMITED)
    limited = (high > low) & (high - low < UNLIMITED)
    middle, half = np.where(limited, 0.5 * (low + high), 0.0), np.where(limited, 0.5 * (high - low), np.inf)

    def beyond(reading: JointReading) -> Array:
        away = np.abs(reading.of_motion(record, q, effort=none)[0][:, at] - middle)
        away = np.where(turns, np.minimum(away, np.abs(2.0 * np.pi - away)), away)
        return np.asarray(np.maximum(away - half, 0.0).max(axis=0, initial=0.0))

    allowed = beyond(JointReading.as_mapped(record)) + np.where(turns, SLIGHTLY, SLIGHTLY_OUT)
    return [bool(np.all(beyond(each) < allowed)) for each in readings]


def swapped(names: Sequence[str], columns: str, pair: Exchange, leaves: str) -> Finding:
    """Return that columns of joints or limbs are exchanged."""
    both = " and ".join(", ".join(names[k] for k in limb) for limb in pair)
    return Finding("swapped joints", "warning", f"{columns} of {both} in exchanged places leave {leaves}")


def joint_pairs(robot: PlainRobot, names: Sequence[str]) -> list[Exchange]:
    """Return pairs of joints, by their places among some, that may be mixed up: both turn, or both slide."""
    slides = [robot.slides(name) for name in names]
    return [((j,), (k,)) for j, k in itertools.combinations(range(len(names)), 2) if slides[j] == slides[k]]


def limb_pairs(record: Record) -> list[Exchange]:
    """Return pairs of limbs with equally many driven joints, two or more."""
    pairs = itertools.combinations(record.robot.limbs(record.driven), 2)
    return [pair for pair in pairs if len(pair[0]) == len(pair[1]) > 1]


def downhill(
    reading: JointReading, joints: Sequence[int], steps: Iterable[float], loss: Callable[[JointReading], float]
) -> JointReading:
    """Return a reading whose loss is least as some joints turn by these steps [rad], each taken either way or not."""
    for step in steps:
        reading = min((reading, *(reading.otherwise(joints, by) for by in (step, -step))), key=loss)
    return reading


def _within_a_turn(angle: float) -> float:
    """Return an angle [rad] beyond -180 deg, up to 180."""
    return float(np.pi - np.remainder(np.pi - angle, 2.0 * np.pi))


def _inline_table(values: dict[str, float]) -> str:
    return f"{{{', '.join(f'{joint} = {value:.4g}' for joint, value in values.items())}}}"


def reading_of(record: Record, motion: FreeMotion, needed: float) -> JointReading:
    """Return the reading of a free robot that leaves least beside friction, over the mean square `needed` as mapped.

    Of a walking robot a wrong order of legs, or another convention of zeros and senses, is the same mistake at several
    joints: of one place in all limbs, or in two of them. One such change at a time is taken, the one that leaves least
    of what weight and motion need, as long as each leaves far less than the one before.
    """
    few, reading = motion.every(max(1, len(motion.q) // FEW_INSTANTS)), JointReading.as_mapped(record)
    limbs = [limb for limb in record.robot.limbs(record.driven) if len(limb) > 1]
    limbs = [limb for limb in limbs if len(limb) == len(limbs[0])]
    alone = [(k,) for k in range(len(record.driven)) if not record.robot.slides(record.driven[k])]
    turning: list[Sequence[int]] = [*alone, *zip(*limbs, strict=True)]
    either, orders = [*((k,) for k in range(len(record.driven))), *_sharing_a_sense(limbs)], _orders(limbs)

    def changes(reading: JointReading) -> Iterator[tuple[Sequence[int], JointReading]]:
        for group in turning:
            yield from ((group, reading.otherwise(group, turn)) for turn in TURNS_OF_LEGS)
            yield from ((group, reading.otherwise(group, k * QUARTER, -1.0, -1.0)) for k in range(1, 4))
        for group in either:
            yield group, reading.otherwise(group, 0.0, -1.0, -1.0)
        yield from (((), reading.moved(*order)) for order in orders)

    def left_by(readings: Sequence[JointReading], motion: FreeMotion = few) -> list[float]:
        return left_by_readings(record, motion, readings, needed)

    (share,) = left_by([reading])
    for _ in range(MOST_MISREADINGS):
        tried = list(changes(reading))
        first = left_by([each for _, each in tried], few.every(FIRST_LOOK))
        tried = [tried[k] for k in np.argsort(first)[:SEEN_AGAIN]]
        group, best = tried[np.argmin(left_by([each for _, each in tried]))]
        if any(best.turn[k] for k in group):
            best = downhill(best, group, DOWNHILL_OF_LEGS, lambda each: left_by([each])[0])
        (least,) = left_by([best])
        if least > FAR_LESS * share:
            break
        reading, share = best, least
        if share < WELL:
            break
    return reading


def left_by_readings(
    record: Record, motion: FreeMotion, readings: Sequence[JointReading], needed: float
) -> list[float]:
    """Return what each reading leaves beside friction, over what is needed, in squares.

    But not over more than is `needed` as mapped, in the mean: a reading may need much and leave as much. One by which a
    joint is beyond its limits, and not as mapped, leaves all.
    """
    read, count, possible = list[FreeMotion](), len(motion.q), possible_readings(record, motion.q, readings)
    for reading in itertools.compress(readings, possible):
        q, v, a, tau = reading.of_motion(record, motion.q, motion.v, motion.a, effort=motion.tau)
        middle, _ = reading.of_motion(record, motion.halfway, effort=motion.tau)
        read.append(replace(motion, q=q, halfway=middle, v=v, a=a, tau=tau))
    balance = balance_of(record, motion.joined(read)) if read else None
    if balance is None:
        return len(readings) * [np.inf]
    parts = (balance.between(k * count, (k + 1) * count) for k in range(len(read)))
    shares = (part.beside_friction(part.residual) * max(1.0, part.size / (count * needed)) for part in parts)
    return [next(shares) if each else np.inf for each in possible]


def _sharing_a_sense(limbs: list[tuple[int, ...]]) -> list[list[int]]:
    """Return joints that may turn the other way together: of some places in two limbs, or in all."""
    of = range(len(limbs[0]) if limbs else 0)
    places = [chosen for n in (1, 2, len(of)) for chosen in itertools.combinations(of, n)]
    return [
        [limb[k] for limb in some for k in chosen]
        for some in (*itertools.combinations(limbs, 2), limbs)
        for chosen in places
    ]


def _orders(limbs: list[tuple[int, ...]]) -> list[tuple[list[int], list[int]]]:
    """Return joints, and others whose columns they may have: of limbs, of places within them, or place by place."""
    if len(limbs) < 2:
        return []
    whole, by_place = list(itertools.chain(*limbs)), list(itertools.chain(*zip(*limbs, strict=True)))
    orders = itertools.permutations(limbs) if len(limbs) <= LIMBS_IN_ANY_ORDER else ()
    moved = [(whole, list(itertools.chain(*order))) for order in orders]
    for j, k in itertools.combinations(range(len(limbs[0])), 2):
        ours, theirs = [limb[j] for limb in limbs], [limb[k] for limb in limbs]
        moved += [([*ours, *theirs], [*theirs, *ours])]
        moved += [([joint, other], [other, joint]) for joint, other in zip(ours, theirs, strict=True)]
    return [*moved, (whole, by_place), (by_place, whole)]
