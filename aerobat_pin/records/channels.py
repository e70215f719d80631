"""The channels of a map in SI units, each on its own clock, read from the columns that the map names."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from aerobat_pin.errors import LogError
from aerobat_pin.numerics import Array
from aerobat_pin.records.block import Channel
from aerobat_pin.records.columns import Columns, in_step, same_unit
from aerobat_pin.records.map_tables import ChannelSection, KnownSection, Map
from aerobat_pin.records.resample import holes, without_turns
from aerobat_pin.records.spool import EXTENT, Series
from aerobat_pin.records.table_cells import line_of

EXTRA = "extra."  # prefix of the keys of channels that only the robot itself reads
G = 9.80665  # [m/s2] of the unit g
LARGEST_VALUE = 1e9  # no quantity of a robot is larger; a larger number is a damaged one
SI_FACTORS: dict[str, dict[str, float]] = {
    "length": {"m": 1.0, "cm": 1e-2, "mm": 1e-3},
    "angle": {"rad": 1.0, "deg": math.pi / 180.0, "rev": 2.0 * math.pi, "m": 1.0, "mm": 1e-3},
    "speed": {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3, "km/h": 1.0 / 3.6},
    "rate": {"rad/s": 1.0, "deg/s": math.pi / 180.0, "rpm": math.pi / 30.0, "m/s": 1.0, "mm/s": 1e-3},
    "acceleration": {"m/s2": 1.0, "g": G, "mg": 1e-3 * G},
    "force": {"N": 1.0, "mN": 1e-3, "kN": 1e3, "gf": 1e-3 * G, "kgf": G},
    "torque": {"N m": 1.0, "mN m": 1e-3, "N": 1.0, "A": 1.0, "mA": 1e-3, "1": 1.0},
    "none": {},
}
IN_ONE_ARRAY = {  # kinds of its unit and of some columns: a pose's quaternion, moments, slides beside hinges
    *(("length", ""), ("angle", "length"), ("length", "angle")),
    *(("speed", "rate"), ("rate", "speed"), ("force", "torque")),
}
ASKED = {  # key -> kind of quantity, numbers of columns, and part of a message with its axes
    "base.position": ("length", (3,), "position", "xyz"),
    "base.quaternion": ("none", (4, 3), "orientation", "xyzw"),
    "base.velocity": ("speed", (3,), "linear", "xyz"),
    "base.rate": ("rate", (3,), "angular_velocity", "xyz"),
    "base.acceleration": ("acceleration", (3,), "linear_acceleration", "xyz"),
    "check.specific_force": ("acceleration", (3,), "linear_acceleration", "xyz"),
    "check.wrench": ("force", (3, 6), "force", "xyz"),
}
BASE_PARTS = {  # what the base's motion is found from -> what is read
    "measured": ("position", "quaternion", "velocity", "rate"),
    "imu": ("quaternion", "rate", "acceleration"),
    "joints": ("quaternion", "rate"),
}
LEFT_ZERO = ("base.velocity", "base.rate", "joints.velocity")
TWIST = {"base.velocity": "linear", "base.rate": "angular"}  # parts that a message with the pose may have


@dataclass(frozen=True)
class Request:
    """What a key of the map asks of the log.

    Attributes:
        key: the key.
        names: of the columns.
        factor: to SI; one number, or (k,) one for each column.
        delay: to take off the stamps [s].
        optional: whether the log may lack it.
        joints: whose columns these are, for a channel of joints.
        units: of the columns, which a header may state; none, or an empty one, where the map does not say.
        wraps: whether full turns are taken out.
        mix: (k, k) from the columns in SI to the channel; None if they are the channel.
        shift: (k,) that is added then.
        turns: (k,) a full turn as the columns show it, of those of joints that turn, else 0; none where it is empty.
    """

    key: str
    names: tuple[str, ...]
    factor: float | Array = 1.0
    delay: float = 0.0
    optional: bool = False
    joints: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    wraps: bool = False
    mix: Array | None = None
    shift: float | Array = 0.0
    turns: tuple[float, ...] = ()

    @property
    def of_angles(self) -> bool:
        """Whether the columns are roll, pitch and yaw: turns about x, then y, then z, of which quaternions are made."""
        return self.key == "base.quaternion" and len(self.names) == 3

    def converted(self, values: Array) -> Array:
        """Return the channel (..., k) in SI units of what the columns hold."""
        values = self.factor * values
        if self.of_angles:
            from scipy.spatial.transform import Rotation  # slow to import

            return np.asarray(Rotation.from_euler("xyz", values).as_quat())
        return values if self.mix is None else values @ self.mix.T + self.shift


def base_requests(chosen: Map) -> Iterator[Request]:
    """Yield what a map asks of the log about a free base. Raises LogError for a number of columns or a unit."""
    base = chosen.base
    for part in () if base.held else BASE_PARTS[base.from_]:
        section = getattr(base, part)
        if getattr(section, "from_", None) is None:
            yield from _asked(f"base.{part}", section, base.topic, twist=base.from_ == "measured")


def further_requests(chosen: Map) -> Iterator[Request]:
    """Yield what a map asks of the log to compare with, of known forces, and of what only the robot itself reads."""
    yield from _asked("check.specific_force", chosen.check.specific_force)
    yield from _asked("check.wrench", chosen.check.wrench)
    for name, known in chosen.known.items():
        yield from _known(f"known.{name}", known)
    for name, section in chosen.extra.items():
        key, names = f"{EXTRA}{name}", section.columns or ((section.topic,) if section.topic is not None else ())
        if not names or (section.unit is not None and section.kind is None):
            raise LogError(f"map: {key}: columns in the robot's own unit were expected, or a key kind beside unit")
        factor = factor_of(key, section.unit, section.kind or "none")
        units = () if section.kind is None else units_of(section.unit, section.kind, len(names))
        yield Request(key, names, factor, section.delay, units=units, wraps=section.wraps)


def named_columns(chosen: Map) -> set[str]:
    """Return the names that a map's joints, topics and conditions have, whoever of the joints has a channel."""
    table, when = chosen.joints, chosen.use.when
    sections = [part for part in (table.position, table.velocity, table.effort) if part is not None]
    names = {name for section in sections for name in section.columns}
    topics = (table.topic, chosen.base.topic, *(section.topic for section in sections))
    names |= {topic for topic in topics if topic is not None}
    return names | ({when.column} if when is not None else set())


def channel_of(request: Request, columns: Columns, longest_gap: float) -> Channel | None:
    """Read a channel, at the stamps of its fastest column, with the holes longer than `longest_gap` [s] of any column.

    None if it is optional and missing, as are rates that a topic's messages all leave 0. Raises LogError if the log has
    no such columns, if they are in another unit or share no time, or if quaternions do not have length one.
    """
    if request.optional and not all(name in columns.values for name in request.names):
        return None
    for name, unit in zip(request.names, request.units, strict=False):
        stated = columns.units.get(name, "")
        if unit and stated and not same_unit(stated, unit):
            if name in columns.of_arrays and (_kind_of(stated), _kind_of(unit)) in IN_ONE_ARRAY:
                continue
            raise LogError(f"log {columns.path}: column '{name} [{stated}]': {unit} was expected")
    parts = [columns.series(name, request.key) for name in request.names]
    if request.optional and request.key in LEFT_ZERO and not any(x.any() for _, part in parts for x in part.pieces()):
        return None
    turned: dict[str, int] = {}
    for k, turn in enumerate(request.turns):
        if turn:
            angles, count = without_turns(*parts[k], turn, longest_gap)
            parts[k] = parts[k][0], angles
            if count and request.joints:
                turned[request.joints[k]] = count
    clock = max((stamps for stamps, _ in parts), key=len)
    low = clock.index(max(float(stamps[0]) for stamps, _ in parts))
    high = clock.index(min(float(stamps[-1]) for stamps, _ in parts), "right")
    if high - low < 2:
        raise LogError(f"log {columns.path}: {', '.join(request.names)} ({request.key}) share less than two samples")
    whole = request.delay == 0.0 and high - low == len(clock)
    time, values = clock if whole else Series(clock.spool), Series(clock.spool, len(parts) + request.of_angles)
    for rows in (slice(first, min(first + EXTENT, high)) for first in range(low, high, EXTENT)):
        stamps = clock[rows]
        table = np.stack([_column_at(stamps, rows, clock, *part) for part in parts], axis=1)
        _check_sizes(columns, request, stamps, table)
        table = request.converted(table)
        if request.key == "base.quaternion":
            table = _unit_length(columns, request, stamps, table)
        if request.wraps:
            table = _unwrapped(columns, request, table, values)
        values.append(table)
        if time is not clock:
            time.append(stamps - request.delay)
    gaps = _holes(request, [stamps for stamps, _ in parts], longest_gap)
    return Channel(request.key, request.names, time, values, holes=gaps, turns=turned)


def _check_sizes(columns: Columns, request: Request, time: Array, values: Array) -> None:
    """Raise LogError for a number of a log (m, k), in its own units, that no quantity has."""
    if not (np.abs(values) <= LARGEST_VALUE).all():
        row, k = np.argwhere(~(np.abs(values) <= LARGEST_VALUE))[0]
        where = f"log {columns.path}: {request.names[k]} ({request.key}) = {values[row, k]:g} at {time[row]:.10g} s"
        raise LogError(f"{where}: a number between -{LARGEST_VALUE:g} and {LARGEST_VALUE:g} was expected")


def check_same_rows(request: Request, columns: Columns) -> None:
    """Raise LogError if a row has samples in some columns of a channel and none in others."""
    series = [columns.values[name] for name in request.names if name in columns.values]
    if all(values.finite for values in series) or len({columns.clock_of[name] for name in request.names}) > 1:
        return
    before = 0
    for pieces in in_step(*series):
        empty = ~np.isfinite(np.stack(pieces, axis=1))
        part = np.any(empty, axis=1) & ~np.all(empty, axis=1)
        if np.any(part):
            row = int(np.argmax(part))
            name, every = request.names[int(np.argmax(empty[row]))], ", ".join(request.names)
            where = f"log {columns.path}, line {line_of(columns.path, before + row)}"
            raise LogError(f"{where}: {name} is empty: all of {every} or none")
        before += len(empty)


def _holes(request: Request, clocks: list[Series], longest: float) -> tuple[tuple[float, float, str], ...]:
    """Return the holes of the columns of a channel, whose stamps are given, the request's delay taken off."""
    gaps = {id(stamps): holes(stamps, longest) for stamps in clocks}
    labels: dict[tuple[float, float], list[str]] = {}
    for label, stamps in zip(request.joints or request.names, clocks, strict=True):
        for hole in gaps[id(stamps)]:
            labels.setdefault(hole, []).append(label)

    def name_of(whose: list[str]) -> str:
        return request.key if len(whose) == len(clocks) else f"{request.key} of {', '.join(whose)}"

    return tuple((begin - request.delay, end - request.delay, name_of(whose)) for (begin, end), whose in labels.items())


def _unwrapped(columns: Columns, request: Request, table: Array, before: Series) -> Array:
    """Return angles (m, k) without jumps by full turns, from `before` on. Raises LogError if all steps are jumps."""
    step = float(np.median(np.abs(np.diff(table, axis=0)))) if len(table) > 1 else 0.0
    if step > np.pi:
        where = f"log {columns.path}: {', '.join(request.names)} ({request.key})"
        raise LogError(f"{where} turns by {step:.3g} rad from row to row: half a turn at most was expected; degrees?")
    return np.unwrap(np.concatenate([before[len(before) - 1 :] if len(before) else table[:1], table]), axis=0)[1:]


def _unit_length(columns: Columns, request: Request, time: Array, values: Array) -> Array:
    """Return quaternions (m, 4) with length one. Raises LogError if they are none."""
    length = np.linalg.norm(values, axis=1)
    if np.any(np.abs(length - 1.0) > 0.05):
        row = int(np.argmax(np.abs(length - 1.0)))
        lost = bool(length[row] == 0.0)
        raise LogError(
            f"log {columns.path}: base.quaternion ({', '.join(request.names)}) has length {length[row]:.3g} at "
            f"{time[row] - request.delay:g} s: 1 was expected" + "; where it was lost, leave its cells empty" * lost
        )
    return np.asarray(values / length[:, None])


def _column_at(stamps: Array, rows: slice, clock: Series, time: Series, values: Series) -> Array:
    """Return a column (m,) at stamps, which are the rows of a clock: its own rows, or interpolated linearly."""
    if time is clock or (len(time) == len(clock) and np.array_equal(time[rows], stamps)):
        return np.asarray(values[rows])
    around = slice(max(0, time.index(stamps[0]) - 1), time.index(stamps[-1]) + 1)
    return np.asarray(np.interp(stamps, time[around], values[around]))


def factor_of(key: str, unit: str | None, kind: str) -> float:
    """Return the factor from a unit to SI. Raises LogError for a unit that the kind of quantity does not have."""
    known = SI_FACTORS[kind]
    if unit is None or not known:
        return 1.0
    if unit not in known:
        raise LogError(f"map: {key}.unit = '{unit}': one of {', '.join(known)} was expected")
    return known[unit]


def _kind_of(unit: str) -> str:
    """Return what has a unit: m is a length, though a joint's angle may be one; empty if nobody knows."""
    return next((kind for kind, units in SI_FACTORS.items() if unit in units), "")


def units_of(unit: str | None, kind: str, count: int) -> tuple[str, ...]:
    """Return the units of columns that a header may state; six columns of a force have moments behind it."""
    unit = unit or next(iter(SI_FACTORS[kind]), "-")
    return (unit,) * 3 + (f"{unit} m",) * 3 if kind == "force" and count == 6 else (unit,) * count


def _asked(
    key: str, section: ChannelSection | None, shared: str | None = None, *, twist: bool = False
) -> Iterator[Request]:
    """Yield the request of a section with columns or a topic, or of a topic that several sections share.

    Such a topic may have a pose, and then perhaps a twist.
    """
    kind, counts, part, axes = ASKED[key]
    section = section or ChannelSection()
    stated = bool(section.columns or section.topic)
    optional = twist and key in TWIST and not stated
    part, topic = TWIST[key] if optional else part, section.topic if stated else shared
    names = section.columns or tuple(f"{topic}.{part}.{axis}" for axis in axes if topic)
    if names:
        check_count(key, names, counts)
        kind = "angle" if key == "base.quaternion" and len(names) == 3 else kind
        units, factor = units_of(section.unit, kind, len(names)), factor_of(key, section.unit, kind)
        turns = 3 * (2.0 * np.pi / factor,) if kind == "angle" else ()
        yield Request(key, names, factor, section.delay, optional, units=units, turns=turns)


def check_count(key: str, names: tuple[str, ...], allowed: tuple[int, ...]) -> None:
    """Raise LogError unless there are as many columns as a key takes."""
    if len(names) not in allowed:
        expected = " or ".join(map(str, dict.fromkeys(allowed)))
        hint = "; joints.passive names those without a motor" if key == "joints.effort" else ""
        raise LogError(f"map: {key} has {len(names)} columns ({', '.join(names)}): {expected} were expected{hint}")


def _known(key: str, known: KnownSection) -> Iterator[Request]:
    names = known.columns
    if known.topic is not None and not names:
        names = tuple(f"{known.topic}.{part}.{axis}" for part in ("force", "torque") for axis in "xyz")
    if not names:
        raise LogError(f"map: {key} has neither columns nor topic")
    if not known.powers and len(names) not in (3, 6):
        raise LogError(f"map: {key} has {len(names)} columns: 3 of force, or 6 with the moment, were expected")
    factor = 1.0 if known.powers else factor_of(key, known.unit, "force")
    units = () if known.powers else units_of(known.unit, "force", len(names))
    yield Request(key, names, factor, -known.delay if known.powers else known.delay, units=units)
    supply = known.supply
    if supply is not None:
        column = supply.columns or ((supply.column,) if supply.column else ())
        if len(column) != 1:
            raise LogError(f"map: {key}.supply: one column was expected")
        yield Request(f"{key}.supply", column, 1.0, supply.delay)
