"""The channels of a map in SI units, each on its own clock, read from the columns that the map names."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from aerobat_pin.errors import LogError
from aerobat_pin.numerics import Array
from aerobat_pin.records.columns import Columns, in_step
from aerobat_pin.records.map_tables import ChannelSection, KnownSection, Map
from aerobat_pin.records.spool import EXTENT, Series

G = 9.80665  # [m/s2] of the unit g
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
VECTOR, TURN_AXES = tuple("xyz"), tuple("xyzw")
COLUMN_PARTS = {
    "base.position": ("position", VECTOR),
    "base.quaternion": ("orientation", TURN_AXES),
    "base.velocity": ("linear", VECTOR),
    "base.rate": ("angular_velocity", VECTOR),
    "check.specific_force": ("linear_acceleration", VECTOR),
    "check.wrench": ("force", VECTOR),
}
SHARED = {"base.rate": "angular"}  # part of a message that also has the pose, where it is not that of an Imu


@dataclass(frozen=True)
class LogChannel:
    """Samples of one channel, on disk if they are many.

    Attributes:
        key: key of the map, such as `base.rate`.
        names: its columns in the log.
        time: (n,) stamps [s], the delay that the map states taken off.
        values: (n, k) samples in SI units.
    """

    key: str
    names: tuple[str, ...]
    time: Series
    values: Series

    def between(self, first: float, last: float, extra: int = 0) -> tuple[Array, Array]:
        """Return stamps and samples from a time to another [s], and `extra` more on either side."""
        rows = slice(max(0, self.time.index(first) - extra), self.time.index(last, "right") + extra)
        return self.time[rows], self.values[rows]

    def changed(self, change: Callable[[Array, Array], Array]) -> LogChannel:
        """Return the channel with other samples: a function of stamps (m,) and samples (m, k), piece by piece."""
        values = Series(self.values.spool, self.values.shape[1])
        for time, rows in in_step(self.time, self.values):
            values.append(change(time, rows))
        return LogChannel(self.key, self.names, self.time, values)


@dataclass(frozen=True)
class Request:
    """What a key of the map asks of the log: names of columns, factor to SI, and a delay to take off [s]."""

    key: str
    names: tuple[str, ...]
    factor: float
    delay: float
    optional: bool = False


def requests(chosen: Map, joints: tuple[str, ...]) -> Iterator[Request]:
    """Yield what a map asks of the log; `joints` are those that have channels, in the order of the columns.

    Raises LogError for a number of columns or a unit that do not fit the key.
    """
    base, check = chosen.base, chosen.check
    if not base.held:
        yield from _asked("base.position", base.position, "length", 3, base.topic)
        yield from _asked("base.quaternion", base.quaternion, "none", 4, base.topic)
        if base.velocity is None or base.velocity.from_ is None:
            yield from _asked("base.velocity", base.velocity, "speed", 3, base.topic)
        if base.rate is None or base.rate.from_ is None:
            yield from _asked("base.rate", base.rate, "rate", 3, base.topic)
    table, count = chosen.joints, len(joints)
    for part, section, kind in (
        ("position", table.position, "angle"),
        ("velocity", table.velocity, "rate"),
        ("effort", table.effort, "torque"),
    ):
        key, topic = f"joints.{part}", table.topic
        if part == "velocity" and table.velocity is not None and table.velocity.from_ == "position":
            continue
        if section is not None and section.columns:
            driven = len(driven_joints(chosen, joints, len(section.columns)))
            yield from _asked(key, section, kind, (count, driven) if part == "effort" else count, None)
        elif topic is not None and count:
            names = tuple(f"{topic}.{part}.{joint}" for joint in joints)
            factor = 1.0 if section is None else factor_of(key, section.unit, kind)
            yield Request(key, names, factor, 0.0 if section is None else section.delay, optional=part != "position")
    yield from _asked("check.specific_force", check.specific_force, "acceleration", 3, None)
    if check.wrench is not None:
        yield from _asked("check.wrench", check.wrench, "force", (3, 6), None)
    for name, known in chosen.known.items():
        yield from _known(f"known.{name}", known)


def driven_joints(chosen: Map, joints: tuple[str, ...], count: int) -> tuple[str, ...]:
    """Return the joints of `count` columns of efforts: all joints, or only those whose rows are believed."""
    return joints if count == len(joints) else tuple(name for name in joints if name not in chosen.robot.rows.ignore)


def used_columns(chosen: Map, joints: tuple[str, ...] | None) -> set[str]:
    """Return the names to read; where the joints are not known yet, the joints' topic itself."""
    names = {name for request in requests(chosen, joints or ()) for name in request.names}
    if chosen.joints.topic is not None:
        names.add(chosen.joints.topic)
    if chosen.base.topic is not None:
        names.add(chosen.base.topic)
    if chosen.use.when is not None and chosen.use.when.column is not None:
        names.add(chosen.use.when.column)
    return names


def channel_of(request: Request, columns: Columns) -> LogChannel | None:
    """Read a channel; None if it is optional and missing. Raises LogError if the log has no such columns."""
    if request.optional and not all(name in columns.values for name in request.names):
        return None
    parts = [columns.series(name, request.key) for name in request.names]
    own = parts[0][0]
    time, values = own if request.delay == 0.0 else Series(own.spool), Series(own.spool, len(parts))
    for rows in (slice(first, first + EXTENT) for first in range(0, len(own), EXTENT)):
        stamps = own[rows]
        values.append(request.factor * np.stack([_column_at(stamps, rows, own, *part) for part in parts], axis=1))
        if time is not own:
            time.append(stamps - request.delay)
    return LogChannel(request.key, request.names, time, values)


def _column_at(stamps: Array, rows: slice, own: Series, time: Series, values: Series) -> Array:
    """Return a column (m,) at stamps, which are the rows of a clock: its own rows, or interpolated linearly."""
    if time is own or (len(time) == len(own) and np.array_equal(time[rows], stamps)):
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


def _asked(
    key: str, section: ChannelSection | None, kind: str, count: int | tuple[int, ...], topic: str | None
) -> Iterator[Request]:
    """Yield the request of a section with columns or a topic, or of a topic that several sections share."""
    optional, (part, axes) = False, COLUMN_PARTS.get(key, ("", ()))
    if section is not None and section.columns:
        names = section.columns
    elif section is not None and section.topic:
        names = tuple(f"{section.topic}.{part}.{axis}" for axis in axes)
    elif topic is not None:
        optional, part = key in ("base.velocity", "base.rate"), SHARED.get(key, part)
        names = tuple(f"{topic}.{part}.{axis}" for axis in axes)
    else:
        return
    allowed = (count,) if isinstance(count, int) else count
    if len(names) not in allowed:
        expected = " or ".join(map(str, dict.fromkeys(allowed)))
        raise LogError(f"map: {key} has {len(names)} columns ({', '.join(names)}): {expected} were expected")
    unit, delay = (None, 0.0) if section is None else (section.unit, section.delay)
    yield Request(key, tuple(names), factor_of(key, unit, kind), delay, optional)


def _known(key: str, known: KnownSection) -> Iterator[Request]:
    names = known.columns
    if known.topic is not None and not names:
        names = tuple(f"{known.topic}.{part}.{axis}" for part in ("force", "torque") for axis in VECTOR)
    if not names:
        raise LogError(f"map: {key} has neither columns nor topic")
    if not known.powers and len(names) not in (3, 6):
        raise LogError(f"map: {key} has {len(names)} columns: 3 of force, or 6 with the moment, were expected")
    factor = 1.0 if known.powers else factor_of(key, known.unit, "force")
    yield Request(key, names, factor, -known.delay if known.powers else known.delay)
    supply = known.supply
    if supply is not None:
        column = supply.columns or ((supply.column,) if supply.column else ())
        if len(column) != 1:
            raise LogError(f"map: {key}.supply: one column was expected")
        yield Request(f"{key}.supply", column, 1.0, supply.delay)
