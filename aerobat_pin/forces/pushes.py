"""What pushed at each place of an estimate, and when: where a force stands out most from its errors, and blows.

A blow is shorter than the filter: that it was is certain, not how large. Beside contacts of the same place it is sought
outside of them.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aerobat_pin.forces.calibration_use import SURE_OF_CONTACT, Contact
from aerobat_pin.forces.contacts import TINY, along_itself, during_contact, largest_of
from aerobat_pin.forces.deviations import ComponentSize, burst_noise, without_lag
from aerobat_pin.forces.scores import point_label, quantity
from aerobat_pin.forces.stored_estimate import TIME_CONSTANTS_TO_SETTLE, StoredEstimate
from aerobat_pin.numerics import Array

LASTING = 1.5  # or its rms: noise alone has one error
SHORT_BLOW = 3.5  # times what size over errors without lag usually is: a blow, however sure its size is
USUALLY = 0.99  # share of the time
MOSTLY = 0.8  # share of a force that is along an axis before the axis is named
WAYS = {f"F{axis}": (f"along {axis}", f"against {axis}") for axis in "xyz"}
WAYS_OF_LEVEL = WAYS | {"Fz": ("upward", "downward")}  # in axes whose z is up


@dataclass(frozen=True)
class Push:
    """Force or moment at one place."""

    place: str  # where
    unit: str  # N or N m
    peak: float  # its largest size that errors at its time cannot make up; without one, where it is largest beside them
    at: float  # when that was, after the start [s]
    way: str  # its direction then, in words
    deviation: float | None  # its standard deviation then, along it; None if none is stated
    sure: float  # the peak over what errors make up at its time
    rms: float = 0.0  # of the size
    lasting: float = 0.0  # root mean square of the size over its error at each time
    error: float = 0.0  # typical error
    short: bool = False  # whether it is a blow, of which the filter shows that it was, not how large
    ends: tuple[float, float | None] | None = None  # from and to [s] of a contact, None if it lasts; None: not sought

    def stands_out(self, least: float) -> bool:
        """Whether errors, or an error of the belief that looks like `least`, cannot make it up."""
        lasts = not self.short and self.lasting > LASTING and self.rms > least
        return lasts or (self.sure > 1.0 and self.peak > least)

    def __str__(self) -> str:
        size = quantity(self.peak, self.unit)
        if self.deviation is not None:  # in the unit of the size
            number, _, unit = size.partition(" ")
            factor = {"m": 1e3, "k": 1e-3}.get(unit.removesuffix(self.unit), 1.0)
            size = f"{number} +-{float(f'{factor * self.deviation:.2g}'):g} {unit}"
        when = f"at {self.at:.2f} s"
        if self.ends is not None:
            begin, end = self.ends
            when = f"from {begin:.2f} s to {'the end' if end is None else f'{end:.2f} s'}"
        return f"{self.place} ({'short, ' * self.short}up to {size}{self.way}, {when})"


@dataclass
class _Largest:
    """Where a force is largest of those that errors cannot make up, or else over its error."""

    time: float
    force: Array
    deviation: Array
    rank: tuple[bool, float] = (False, -1.0)
    sure: float = 0.0

    def take(self, time: Array, force: Array, errors: Array, deviations: Array) -> Array:
        """Take forces (m, n) with their errors and stated deviations; return their sizes over the errors (m,)."""
        size = np.linalg.norm(force, axis=1)
        error = np.maximum(along_itself(force, errors) * force.shape[1] ** 0.5, TINY)
        beyond = size > SURE_OF_CONTACT * error
        weight = np.where(beyond, size, 0.0) if beyond.any() else size / error
        at = int(np.argmax(weight))
        if (rank := (bool(beyond[at]), float(weight[at]))) > self.rank:
            self.rank, self.time, self.sure = rank, float(time[at]), float(size[at] / error[at])
            self.force, self.deviation = force[at], deviations[at]
        return np.asarray(size / error)


class _Group:
    """The components at one place that have one unit: where they are largest, and sums over all intervals."""

    def __init__(self, place: str, unit: str, columns: list[int], axes: list[str], start: float, level: bool) -> None:
        self.place, self.unit, self.columns, self.axes, self.level = place, unit, columns, axes, level
        self.contacts: list[tuple[float, float]] = []  # from and to [s], beside which a blow is sought
        none = np.zeros(len(columns))
        self.largest, self.blow = (_Largest(start, none, none + 1.0) for _ in range(2))
        self.squares = self.shares = self.usual = 0.0

    def take(self, time: Array, components: Array, deviations: Array, errors: Array) -> None:
        """Take the components (m, c) of a block, 0 where they are not seen, their deviations, and these without lag."""
        force, deviation, without = (table[:, self.columns] for table in (components, deviations, errors))
        square = np.sum(force**2, axis=1)
        self.squares += float(np.sum(square))
        self.shares += float(np.sum(square / np.maximum(np.sum(deviation**2, axis=1), TINY**2)))
        self.largest.take(time, force, deviation, deviation)
        apart = self._apart(time)
        over = self.blow.take(time, np.where(apart[:, None], force, 0.0), without, deviation)
        if len(seen := over[apart & (square > 0.0)]):
            self.usual = max(self.usual, float(np.quantile(seen, USUALLY)))

    def _apart(self, time: Array) -> NDArray[np.bool_]:
        """Return which intervals of times (m + 1,) are in no contact."""
        apart = np.ones(len(time) - 1, bool)
        for begin, end in self.contacts:
            apart &= (time[1:] < begin) | (time[:-1] > end)
        return apart

    def push(self, start: float, count: int, sizes: Sequence[ComponentSize], noise: Array) -> Push:
        """Return what pushed here, of `count` intervals."""
        stands_out = self.largest.rank[0] and not self.contacts
        short = not stands_out and self.blow.rank[0] and self.blow.sure > SHORT_BLOW * self.usual
        largest = self.blow if short else self.largest
        stated = [sizes[k].deviation for k in self.columns]
        along, peak = float(along_itself(largest.force, largest.deviation)), float(np.linalg.norm(largest.force))
        typical = [noise[k] if size is None else size for k, size in zip(self.columns, stated, strict=True)]
        return Push(
            place=point_label(self.place),
            unit=self.unit,
            peak=peak,
            at=largest.time - start,
            way=_way(largest.force, self.axes, level=self.level),
            deviation=None if stated == [None] * len(stated) or (short and along > peak) else along,
            sure=largest.sure / SURE_OF_CONTACT,
            rms=(self.squares / count) ** 0.5,
            lasting=(self.shares / count) ** 0.5,
            error=float(np.linalg.norm(typical)),
            short=short,
        )


def pushes_of(
    estimate: StoredEstimate, start: float, contacts: Iterable[Contact] = (), *, level: bool = True
) -> list[Push]:
    """Return the force, and the moment, at each place once the estimate has risen, at times after the start [s].

    `level` says that z is up in the axes of forces. Outside of contacts that a calibration found, a blow at the same
    place is sought.
    """
    places = dict[tuple[str, str], dict[int, str]]()
    for k, label in enumerate(estimate.head.identifiability.components):
        place, _, axis = label.rpartition(".")
        places.setdefault((place or axis, estimate.head.units[k]), {})[k] = axis
    groups = [_Group(*place, list(axes), list(axes.values()), start, level) for place, axes in places.items()]
    settles = TIME_CONSTANTS_TO_SETTLE * estimate.time_constant
    for contact in contacts:
        end = np.inf if contact.end is None else contact.end
        for group in groups:
            if (point_label(group.place), group.unit) == (place_of(contact, estimate), contact.unit):
                group.contacts.append((contact.onset - settles, end + settles))
    noise, count = burst_noise(next(estimate.blocks()).components), 0
    for block in estimate.blocks():
        shown = block.shown & (block.time[:-1, None] > estimate.risen - 1e-9)
        components, deviations = np.where(shown, block.components, 0.0), np.broadcast_to(noise, shown.shape)
        if block.standard_deviation is not None:
            deviations = np.where(np.isfinite(block.standard_deviation), block.standard_deviation, noise)
        count += int(np.sum(shown.any(axis=1)))
        for group in groups:
            group.take(block.time, components, deviations, without_lag(block, deviations))
    sizes = estimate.component_sizes()
    return [group.push(start, max(count, 1), sizes, noise) for group in groups]


def _way(force: Array, axes: Sequence[str], *, level: bool) -> str:
    """Return the direction of a force (n,) along axes such as `Fx`, in words; nothing of a moment, or of one axis."""
    size, at = float(np.linalg.norm(force)), int(np.argmax(np.abs(force)))
    if len(force) == 1 or size == 0.0 or axes[at] not in WAYS:
        return ""
    if abs(force[at]) > MOSTLY * size:
        return f" {(WAYS_OF_LEVEL if level else WAYS)[axes[at]][int(force[at] < 0.0)]}"
    return f" along ({', '.join(f'{part:.2f}' for part in (force / size).round(2) + 0.0)})"


def place_of(event: Contact, estimate: StoredEstimate) -> str:
    """Return the place of a contact."""
    return event.point if estimate.head.frames else point_label(event.point.rpartition(".")[0])


def contact_push(estimate: StoredEstimate, event: Contact, start: float, *, level: bool = True) -> Push:
    """Return a contact that a calibration found, at its largest; `level` as of `pushes_of`."""
    head, components = estimate.head, estimate.head.identifiability.components
    frames = [point_label(frame) for frame in head.frames]
    columns = [3 * frames.index(event.point) + k for k in range(3)] if frames else [components.index(event.point)]
    place = place_of(event, estimate)
    ends = event.onset - start, None if event.end is None else event.end - start
    during = during_contact(estimate, event)
    force = np.where(during.shown, during.components, 0.0)[:, columns]
    if not len(force):
        return Push(place, event.unit, event.size, ends[0], "", None, np.inf, ends=ends)
    sure = during.standard_deviation
    at = largest_of(force, None if sure is None else sure[:, columns])
    way = _way(force[at], [components[k].rpartition(".")[2] for k in columns], level=level)
    along = None if sure is None else float(along_itself(force[at], sure[at, columns]))
    along = along if along is not None and np.isfinite(along) else None
    return Push(place, event.unit, event.size, float(during.time[at]) - start, way, along, np.inf, ends=ends)
