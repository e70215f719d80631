"""How the joints of a free robot may have to be read, if what its efforts leave shows that it is misread.

Of a walking robot a wrong order of legs, or another convention of zeros and senses, is the same mistake at several
joints: of one place in all limbs, or in two of them. One such change at a time is taken, the one that leaves least of
what weight and motion need, as long as each leaves far less than the one before.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from aerobat_pin.estimation.checks.readings import QUARTER, JointReading, downhill, possible_readings
from aerobat_pin.forces import FreeMotion, balance_of
from aerobat_pin.records import Record

FEW_INSTANTS = 24  # of the record, at which readings are looked at
FIRST_LOOK, SEEN_AGAIN = 3, 40  # of so many of them one, at which all are; so many are looked at again
MOST_MISREADINGS = 4  # changes, one after the other
FAR_LESS = 0.6  # of what was left before, in squares
WELL = 0.002  # of what is needed, in squares, that a robot read right may leave
TURNS_OF_LEGS = np.radians([*range(30, 360, 30), -12, 12]).tolist()  # that are tried [rad]
DOWNHILL_OF_LEGS = np.radians([15.0, 7.5, 4.0, 2.0]).tolist()  # from the best of them [rad]
LIMBS_IN_ANY_ORDER = 4  # so many at most


def reading_of(record: Record, motion: FreeMotion, needed: float) -> JointReading:
    """Return the reading of a free robot that leaves least beside friction, over the mean square `needed` as mapped."""
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

    (left,) = left_by([reading])
    for _ in range(MOST_MISREADINGS):
        tried = list(changes(reading))
        first = left_by([each for _, each in tried], few.every(FIRST_LOOK))
        tried = [tried[k] for k in np.argsort(first)[:SEEN_AGAIN]]
        group, best = tried[np.argmin(left_by([each for _, each in tried]))]
        if any(best.turn[k] for k in group):
            best = downhill(best, group, DOWNHILL_OF_LEGS, lambda each: left_by([each])[0])
        (least,) = left_by([best])
        if least > FAR_LESS * left:
            break
        reading, left = best, least
        if left < WELL:
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
    left = (part.beside_friction(part.residual) * max(1.0, part.size / (count * needed)) for part in parts)
    return [next(left) if each else np.inf for each in possible]


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
        moved += [([one, other], [other, one]) for one, other in zip(ours, theirs, strict=True)]
    return [*moved, (whole, by_place), (by_place, whole)]
