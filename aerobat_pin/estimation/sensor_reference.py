"""The force sensor that a map names, `[check] wrench`, as a reference."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from aerobat_pin.errors import MapError
from aerobat_pin.estimation.compared import FORGOTTEN, low_passed
from aerobat_pin.estimation.inverse_dynamics import frame_axes, sensor_force, sensor_point
from aerobat_pin.estimation.run_observers import blocks_of, settled
from aerobat_pin.numerics import Array
from aerobat_pin.records import Record, Reference, Series, Spool

WRENCH_AXES = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")


def sensor_references(record: Record) -> tuple[Reference, ...]:
    """Return the sensor of a map as the only reference; empty if the map names none.

    Raises:
        MapError: the sensor is at no point of the map, or less than three intervals are left to compare.
    """
    section = record.map.check.wrench
    if section is None or "check.wrench" not in record.channels:
        return ()
    point, spool = sensor_point(record), Spool()
    known = 6 if point in record.map.robot.wrenches else 3
    count = min(known, record.channels["check.wrench"].values.shape[1])
    values, stretches, left = Series(spool, count), [], 0
    friction = record.map.joints.friction

    def scored(start: Array) -> NDArray[np.bool_]:
        when, counts = start - record.start, settled(record, start)
        if section.part is not None:
            counts &= (when >= section.part[0]) & (when <= section.part[1])
        return counts

    def used(start: Array) -> NDArray[np.bool_]:
        if friction is None or friction.to != "check.wrench" or friction.fit is None:
            return np.zeros(len(start), bool)
        when = start - record.start
        return np.asarray((when >= friction.fit[0]) & (when < friction.fit[1]))

    margin = 0 if section.filter is None else int(np.ceil(FORGOTTEN / section.filter * record.rate))
    for first, last in record.parts:
        stretches.append((len(values), len(values) + last - first))
        for begin, end in blocks_of(first, last):
            low, high = max(first, begin - margin), min(last, end + margin)
            time, inside = record.times(low, high), slice(begin - low, end - low)
            axes = frame_axes(record, record.block(low, high), point) if section.axes == "frame" else None
            values.append(low_passed(sensor_force(record, time, axes), section.filter, record.dt)[inside, :count])
            left += int(scored(time[:-1][inside]).sum())
    if left < 3:
        raise MapError("map: check.wrench.part: less than three intervals are left to compare")
    labels = WRENCH_AXES[:count]
    return (Reference(point, "sensor", labels, values, None, section.filter, tuple(stretches), scored, used),)
