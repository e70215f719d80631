"""Contacts in an estimate: which foot stands when, and what pushed where a calibration says what is normal.

A foot stands while the vertical force at its point is above `END_SHARE` of the robot's weight W, and reaches
`ONSET_SHARE` of it. So a contact is known a moment after it began, but its onset is not later for that. Its probability
follows from the force's deviation: Phi((Fz - LIKELY_SHARE W) / sigma).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from aerobat_pin.forces.calibration_use import SURE_OF_CONTACT, CalibrationUse, Contact
from aerobat_pin.forces.deviations import without_lag
from aerobat_pin.forces.scores import point_label
from aerobat_pin.forces.stored_estimate import StoredEstimate
from aerobat_pin.numerics import Array
from aerobat_pin.observers import Estimate, Event, LevelDetector, typical_step
from aerobat_pin.records import Map, PlainRobot, Record

TINY = 1e-12  # [N, N m]
NEARLY_AS_SURE = 0.5  # of the most deviations that a force ever is during a contact
ONSET_SHARE, END_SHARE, LIKELY_SHARE = 0.08, 0.04, 0.03  # of the weight
ROW_CONTACT_ENDS = 0.5  # of a row's threshold, or a force's, where its contact begins and ends


@dataclass(frozen=True)
class Stance:
    """The contacts of one point with the ground.

    Attributes:
        point: the frame.
        onset: (n,) start of each contact [s]; the first one may have begun before the record.
        end: (n,) its end [s]; NaN for one that lasts beyond the last estimate.
        share: of the time in contact [-].
        sure: share of the time at which contact or its absence is at least 95 % likely [-]; NaN without deviations.
    """

    point: str
    onset: Array
    end: Array
    share: float
    sure: float

    def numbers(self) -> dict[str, object]:
        """Return the contacts as `metrics.json` holds them."""
        last = [None if np.isnan(end) else float(end) for end in self.end]
        return {
            "contacts": [list(pair) for pair in zip(self.onset.tolist(), last, strict=True)],
            "share": self.share,
            "sure": None if np.isnan(self.sure) else self.sure,
        }


def touching(force: Array, weight: float) -> Array:
    """Return whether a point is in contact, by hysteresis of vertical forces (m,) in shares of the weight [N]."""
    above = force > END_SHARE * weight
    stretch = np.cumsum(np.diff(above, prepend=False))  # its number is odd where the force is above
    return np.asarray(above & np.isin(stretch, stretch[force > ONSET_SHARE * weight]))


def contact_probability(force: Array, deviation: Array, weight: float) -> Array:
    """Return how likely a contact is, for vertical forces of any shape and their deviations [N]."""
    from scipy.special import ndtr  # takes a while to import

    return np.asarray(ndtr((force - LIKELY_SHARE * weight) / np.maximum(deviation, 1e-12)))


class ContactWatch:
    """Which of some points are in contact, as `touching` says it of a record, decided while forces arrive.

    Args:
        weight: of the robot [N].
    """

    def __init__(self, weight: float) -> None:
        self.weight = weight
        self._least = np.array(ONSET_SHARE * weight)

    def take(self, force: Array) -> NDArray[np.bool_]:
        """Return whether points with vertical forces (k,) [N] are in contact now."""
        on = np.asarray(force > self._least)
        self._least = np.where(on, END_SHARE, ONSET_SHARE) * self.weight
        return on


def stances_of(blocks: Iterable[Estimate], weight: float) -> tuple[Stance, ...]:
    """Return the contacts of every point, in blocks of an estimate in order; none where these are no world forces.

    A contact ends where a hole begins before the next block.
    """
    times, count, ended, stances = list[Array](), 0, np.inf, list[Stance]()
    vertical, sure = defaultdict[str, list[Array]](list), defaultdict[str, float](float)
    for block in blocks:
        if not block.are_world_forces:
            return ()
        if block.time[0] > ended:
            times.append(np.array([ended]))
            for parts in vertical.values():
                parts.append(np.zeros(1))
        times.append(block.time[:-1])
        count, ended = count + len(block.components), float(block.time[-1])
        for k, point in enumerate(block.frames):
            up, deviation = block.force[:, k, 2], block.standard_deviation
            vertical[point].append(up)
            if deviation is None:
                sure[point] = np.nan
            else:
                likely = contact_probability(up, deviation[:, 3 * k + 2], weight)
                sure[point] += float(np.sum(np.abs(likely - 0.5) >= 0.45))
    for point, parts in vertical.items():
        on, time = touching(np.concatenate(parts), weight), np.concatenate(times)
        change = np.diff(on.astype(int), prepend=0)
        onset, end = time[change > 0], time[change < 0]
        end = np.pad(end, (0, len(onset) - len(end)), constant_values=np.nan)
        whole = max(count, 1)
        stances.append(Stance(point, onset, end, float(on.sum()) / whole, sure[point] / whole))
    return tuple(stances)


def walks_on(robot: PlainRobot, chosen: Map) -> bool:
    """Return whether a robot has feet to stand on, by its model and its map; a sole with moments is none."""
    points = bool(chosen.robot.points) and not chosen.robot.wrenches and not robot.weightless
    return points and robot.free and bool(robot.joints) and robot.limits_forces and not chosen.base.held


def stances_on_ground(record: Record, stored: Mapping[str, StoredEstimate]) -> dict[str, tuple[Stance, ...]]:
    """Return observer -> stances at each point; empty unless the record is of a robot with joints that walks."""
    robot = record.robot
    if not walks_on(robot, record.map):
        return {}
    by_observer = {name: stances_of(estimate.stretches(), robot.weight) for name, estimate in stored.items()}
    return {name: stances for name, stances in by_observer.items() if stances}


def found_contacts(estimate: StoredEstimate, use: CalibrationUse | None) -> list[Contact] | None:
    """Return the contacts of a calibration with the largest force that is seen during each, or those of rows.

    None without a calibration, which says what is normal. A contact of which nothing is seen is none. Where the size of
    errors of the belief is known, nor is one that they can make up (friction, as a joint begins to move), and it lasts
    as long as the force stands out from them: a faint push passes the thresholds of single samples only here and there.
    """
    head = estimate.head
    if use is None or not head.frames:
        return None if use is None else row_contacts(estimate)
    if use.contacts is None or not head.are_world_forces:  # a moment that is sought has no contact
        return None
    contacts = []
    for contact in _lasting(estimate, use.contacts):
        if contact.point in head.frames:
            during = during_contact(estimate, contact)
            rows, at = during.time[1:] > contact.onset, head.frames.index(contact.point)
            shown = during.shown.reshape(len(rows), -1, 3)[rows, at]
            force = np.where(shown, during.force[rows, at], 0.0)
            deviation, sure = during.standard_deviation, np.inf
            deviation = None if deviation is None else deviation.reshape(len(rows), -1, 3)[rows, at]
            if during.expected_force is not None and deviation is not None:
                sure = float(np.max(np.linalg.norm(force / deviation, axis=1), initial=0.0))
            if (shown.any() or not len(shown)) and sure > SURE_OF_CONTACT:
                size = float(np.linalg.norm(force[largest_of(force, deviation)])) if len(force) else 0.0
                contacts.append(replace(contact, point=point_label(contact.point), size=size))
    return contacts


def largest_of(force: Array, deviation: Array | None) -> int:
    """Return at which of some instants a force (m, n) is largest, of those at which it is nearly as sure as ever.

    At an instant of large deviations (m, n) the largest may be the largest error.
    """
    size = np.linalg.norm(force, axis=1)
    if deviation is None:
        return int(np.argmax(size))
    sure = size / np.maximum(along_itself(force, deviation), TINY)
    return int(np.argmax(np.where(sure >= NEARLY_AS_SURE * sure.max(), size, -1.0)))


def along_itself(force: Array, deviation: Array) -> Array:
    """Return the deviation (...) of forces (..., n) along themselves, with deviations (..., n) of their components."""
    known = np.where(force == 0.0, 0.0, deviation)  # what is not shown is 0 +- inf
    squares = np.sum((force * known) ** 2, axis=-1) / np.maximum(np.sum(force**2, axis=-1), TINY**2)
    return np.asarray(np.sqrt(squares))


def _lasting(estimate: StoredEstimate, contacts: Iterable[Contact]) -> list[Contact]:
    """Return contacts, those together during which the force at their point stands out from its errors, and as long."""
    from scipy.ndimage import grey_closing  # takes a while to import

    head, whole = estimate.head, dict[tuple[str, float], Contact]()
    if head.expected_force is None or head.standard_deviation is None:
        return list(contacts)
    time, _, over = _over_bars(estimate)
    resolved = max(1, round(estimate.time_constant / typical_step(time)))
    over = grey_closing(over, (resolved, 1))  # a filter does not see shorter pauses
    lasts = LevelDetector(np.zeros(()), ROW_CONTACT_ENDS, ROW_CONTACT_ENDS, 0.0)
    each = zip(head.frames, np.split(over, len(head.frames), axis=1), strict=True)
    stretches = {frame: _events(estimate, lasts, part.max(axis=1)) for frame, part in each}
    for contact in contacts:
        end = np.inf if contact.end is None else contact.end
        after = (event for event in stretches.get(contact.point, ()) if event.end is None or event.end > contact.onset)
        stretch = next((event for event in after if event.onset < end), contact)
        before = whole.setdefault((contact.point, stretch.onset), contact)
        onsets, ends = zip(*((span.onset, span.end) for span in (before, contact, stretch)), strict=True)
        whole[contact.point, stretch.onset] = replace(
            before, onset=min(onsets), end=None if None in ends else max(end for end in ends if end is not None)
        )
    return joined_contacts(whole.values())


def joined_contacts(contacts: Iterable[Contact]) -> list[Contact]:
    """Return contacts in the order of their onsets, those at one point that overlap as one."""
    joined: list[Contact] = []
    for contact in sorted(contacts, key=lambda contact: (contact.point, contact.onset)):
        before = joined[-1] if joined else None
        if before is None or before.point != contact.point or (before.end is not None and before.end < contact.onset):
            joined.append(contact)
            continue
        end = None if before.end is None or contact.end is None else max(before.end, contact.end)
        joined[-1] = replace(before, end=end)
    return sorted(joined, key=lambda contact: contact.onset)


def _over_bars(estimate: StoredEstimate) -> tuple[Array, Array, Array]:
    """Return times (m + 1,) [s], the components (m, c), 0 where not shown, and their sizes over what is a contact.

    Of rows a filter's lag counts for nothing, which hides when something pushes, not that it does.
    """
    rows = not estimate.head.frames
    parts = []
    for block in estimate.blocks():
        deviation = np.asarray(block.standard_deviation)
        bars = SURE_OF_CONTACT * (without_lag(block, deviation) if rows else deviation)
        parts.append((np.where(block.shown, block.components, 0.0), bars))
    values, bars = (np.concatenate(part) for part in zip(*parts, strict=True))
    return np.concatenate([estimate.start[:], [estimate.end]]), values, np.abs(values) / bars


def _events(estimate: StoredEstimate, detector: LevelDetector, series: Array) -> list[Event]:
    """Return what a detector finds in a series (m,) of an estimate; it ends where a hole begins."""
    events = list[Event]()
    for first, last in pairwise(estimate.borders):
        edges = np.append(estimate.start[first:last], estimate.ends[last - 1])
        detected = detector.detect(edges, series[first:last])
        cut = float(edges[-1]) if last < len(estimate) else None
        events += [replace(event, end=cut if event.end is None else event.end) for event in detected]
    return events


def during_contact(estimate: StoredEstimate, contact: Contact) -> Estimate:
    """Return the intervals of an estimate from that in which a contact begins."""
    last = len(estimate) if contact.end is None else estimate.start.index(contact.end)
    return estimate.between(max(estimate.start.index(contact.onset, "right") - 1, 0), last)


def row_contacts(estimate: StoredEstimate) -> list[Contact] | None:
    """Return when a row is beyond its threshold, in the order of time; None for an estimate of forces at points."""
    head = estimate.head
    if head.frames or head.standard_deviation is None:
        return None
    time, values, over = _over_bars(estimate)
    contacts, detector = [], LevelDetector(np.zeros(()), ROW_CONTACT_ENDS, 1.0, 0.0)
    for k, label in enumerate(head.identifiability.components):
        for event in _events(estimate, detector, over[:, k]):
            during = (time[1:] > event.onset) & (time[:-1] < (np.inf if event.end is None else event.end))
            size = float(np.max(np.abs(values[during, k])))
            contacts.append(Contact(label, event.onset, event.alarm, event.end, size))
    return sorted(contacts, key=lambda event: event.onset)
