"""What a map asks of the log about joints: their columns, units, torques for each unit, and encoders."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from aerobat_pin.errors import LogError, MapError
from aerobat_pin.numerics import Array
from aerobat_pin.records.channels import (
    SI_FACTORS,
    Request,
    base_requests,
    check_count,
    factor_of,
    further_requests,
)
from aerobat_pin.records.columns import Columns
from aerobat_pin.records.joint_names import listed_joints, renamed_joints
from aerobat_pin.records.map_tables import EffortSection, JointsTable, Map
from aerobat_pin.records.resample import failed_readings
from aerobat_pin.records.robots import PlainRobot
from aerobat_pin.records.spool import series_of, typical_spacing

JOINT_KINDS = {"position": "angle", "velocity": "rate", "effort": "torque"}
CURRENTS = ("A", "mA", "1")  # units that are no torque
SI_UNITS = {"position": ("rad", "m"), "velocity": ("rad/s", "m/s"), "effort": ("N m", "N")}  # where it turns, slides
SLIDING_UNITS = {"position": ("m", "mm"), "velocity": ("m/s", "mm/s"), "effort": ("N",)}
MOST_PER_MILLI = 1.0  # [N m] for each mA or mN m: no drive gives as much


def requests_of(chosen: Map, robot: PlainRobot, joints: tuple[str, ...]) -> list[Request]:
    """Return all that a map asks of the log; see the three functions that yield it."""
    return [*base_requests(chosen), *joint_requests(chosen, robot, joints), *further_requests(chosen)]


def with_efforts_there(
    chosen: Map, asked: Sequence[Request], columns: Collection[str]
) -> tuple[Map, list[Request], list[str]]:
    """Return a map and what it asks where a topic has efforts of some joints only, and notes.

    The rows of the others are not believed. A topic without any, or of which what is there is coupled to what is not,
    stays as it is asked for.
    """
    requests, notes = list(asked), list[str]()
    for n, request in enumerate(requests):
        kept = [k for k, name in enumerate(request.names) if name in columns]
        none = [k for k in range(len(request.names)) if k not in kept]
        tied = request.mix is not None and bool(np.any(request.mix[np.ix_(kept, none)]))
        if request.key != "joints.effort" or not request.optional or not kept or not none or tied:
            continue
        names, joints = (tuple(each[k] for k in kept) for each in (request.names, request.joints))
        mix = None if request.mix is None else request.mix[np.ix_(kept, kept)]
        factor, units = np.asarray(request.factor)[kept], request.units[: len(kept)]
        requests[n] = replace(request, names=names, joints=joints, units=units, factor=factor, mix=mix)
        ignored = chosen.robot.rows.ignore
        without = tuple(request.joints[k] for k in none if request.joints[k] not in ignored)
        rows = chosen.robot.rows.model_copy(update={"ignore": (*ignored, *without)})
        chosen = chosen.model_copy(update={"robot": chosen.robot.model_copy(update={"rows": rows})})
        if without:
            notes.append(f"no effort of {', '.join(without)} is recorded: no such row is believed")
    return chosen, requests, notes


def without_failed_readings(asked: Sequence[Request], columns: Columns) -> Columns:
    """Return the columns of a log without the rows of joints where the reading of one's position failed, and a note."""
    failed, said = dict[str, NDArray[np.intp]](), ""
    for request in (each for each in asked if each.key == "joints.position"):
        for name, joint, turn in zip(request.names, request.joints, request.turns, strict=True):
            if name not in columns.values or len(columns.values[name]) < 2:
                continue
            clock, values = columns.clock_of[name], columns.values[name][:]
            time = columns.clocks[clock].time
            if len(rows := failed_readings(values, turn, typical_spacing(time))):
                said = said or f"at {time[rows[0]]:.10g} s {joint} shows {values[rows[0]]:g}"
                failed[clock] = np.union1d(failed.get(clock, rows), rows)
    series = dict(columns.values)
    for name in {name for each in asked if each.key.startswith("joints.") for name in each.names} & {*series}:
        if columns.clock_of[name] in failed:
            values = series[name][:]
            values[failed[columns.clock_of[name]]] = np.nan
            series[name] = series_of(series[name].spool, values)
    text = f"{sum(map(len, failed.values()))} readings of joints jump away and back, as where one failed: left out"
    return replace(columns, values=series, notes=(*columns.notes, *[f"{text} ({said})"] * bool(failed)))


def joint_requests(chosen: Map, robot: PlainRobot, joints: tuple[str, ...]) -> Iterator[Request]:
    """Yield what a map asks of the log about joints, those that have channels, in the order of the columns.

    Raises LogError for a number of columns or a unit that do not fit the key, and MapError for a current without a
    torque per ampere of every joint, or encoders that do not tell the joints apart.
    """
    table = chosen.joints
    joints = joints or listed_joints(table.names)  # where the robot finds the joints, they can have efforts alone
    heard = {joint: name for name, joint in renamed_joints(table.names).items()}
    sensed = tuple(name for name in joints if name not in table.passive)
    driven = tuple(name for name in sensed if name not in chosen.robot.rows.ignore)
    geared = bool(table.factor or table.offset or table.coupling)
    coupled = {*table.coupling, *(name for row in table.coupling.values() for name in row), *table.factor}
    for part, kind in JOINT_KINDS.items():
        key, section = f"joints.{part}", getattr(table, part)
        if getattr(section, "from_", None) == "position":
            continue
        part_topic = None if section is None else section.topic
        topic = part_topic or table.topic
        columns = () if section is None else section.columns
        whose, counts = joints, (len(joints), len(joints))
        if part == "effort":  # a topic need not tell what is not believed, unless others are coupled to it
            whose, counts = sensed if columns or geared else driven, (len(sensed), len(driven))
        if columns:
            names, optional = columns, False
            check_count(key, names, counts)
        elif topic is not None and whose:
            names = tuple(f"{topic}.{part}.{heard.get(joint, joint)}" for joint in whose)
            optional = part_topic is None and part != "position"
        else:
            continue
        unit, delay = (None, 0.0) if section is None else (section.unit, section.delay)
        whose = whose if len(names) == len(whose) else driven
        factor_of(key, unit, kind)  # refuses a unit, whether or not a joint has it
        given = {*coupled, *(table.effort.torque_per_unit if table.effort and part == "effort" else ())}
        slide_unit, slides = getattr(section, "slide_unit", None), [robot.slides(joint) for joint in whose]
        others = [False for _ in whose] if slide_unit else _of_other_kind(part, unit, robot, whose, given)
        stated = [None if other else (slid and slide_unit) or unit for slid, other in zip(slides, others, strict=True)]
        if part == "effort":
            if table.effort is not None:
                _check_torques(table.effort, whose, sensed)
            factor = np.where(others, 1.0, torques_per_unit(table.effort, whose))
        else:
            factor = np.array([factor_of(key, joint_unit, kind) for joint_unit in stated])
        units = [
            joint_unit or ("" if slid and {joint, "*"} & given else SI_UNITS[part][slid])
            for joint, slid, joint_unit in zip(whose, slides, stated, strict=True)
        ]
        mix, turns = None, list[float]()
        shift: float | Array = 0.0
        if geared:
            mix = effort_matrix(table, joints, whose) if part == "effort" else encoder_matrix(table, joints)
        if part == "position":
            shift = encoder_offset(table, joints) if geared else 0.0
            gear = [0.0 if slid else abs(_gear(table, joint)) for joint, slid in zip(whose, slides, strict=True)]
            turns = [2.0 * np.pi / (each * scale) if each else 0.0 for each, scale in zip(gear, factor, strict=True)]
        yield Request(
            key, names, factor, delay, optional, whose, tuple(units), mix=mix, shift=shift, turns=tuple(turns)
        )


def _of_other_kind(
    part: str, unit: str | None, robot: PlainRobot, joints: Sequence[str], given: Collection[str]
) -> list[bool]:
    """Return which joints a map's unit is not of, which are in SI: those that slide if it is of an angle, or else turn.

    Those that are `given` a factor show an encoder or a motor, of either kind. Raises LogError if none is left.
    """
    if unit is None or unit in CURRENTS:
        return [False] * len(joints)
    lengths = SLIDING_UNITS[part]
    others = [robot.slides(name) != (unit in lengths) and not {name, "*"} & {*given} for name in joints]
    if all(others) and others:
        known = [each for each in SI_FACTORS[JOINT_KINDS[part]] if each not in CURRENTS]
        expected = " or ".join(each for each in known if (each in lengths) != (unit in lengths))
        what = "turn" if unit in lengths else "slide"
        raise LogError(
            f"map: joints.{part}.unit = '{unit}', but {', '.join(joints)} {what if len(joints) > 1 else f'{what}s'}: "
            f"{expected} was expected"
        )
    return others


def _check_torques(section: EffortSection, joints: tuple[str, ...], sensed: tuple[str, ...]) -> None:
    """Raise MapError for a torque of no joint, for a current without one, and for one that counts for another unit."""
    key, unit, given = "map: joints.effort.torque_per_unit", section.unit, section.torque_per_unit
    wrong = [name for name in given if name not in (*sensed, "*")]
    if wrong:
        raise MapError(f"{key}: no joint '{wrong[0]}' with a channel: {', '.join(sensed)}")
    missing = [name for name in joints if name not in given and "*" not in given]
    if unit in CURRENTS and missing:
        raise MapError(
            f"map: joints.effort.unit = '{unit}': torque_per_unit = {{{missing[0]} = ...}} was expected, in N m for "
            f'each {"unit" if unit == "1" else unit}, for {", ".join(missing)}; "*" stands for all'
        )
    factor = factor_of("joints.effort", unit, "torque")
    for name, torque in given.items():
        if factor != 1.0 and abs(torque) >= MOST_PER_MILLI:
            raise MapError(
                f"{key}: {name} = {torque:g} N m for each {unit}, the unit that the map states, is more than any drive "
                f"gives: {factor * torque:g} was expected, if it is {torque:g} N m for each {(unit or '')[1:]}"
            )


def torque_per_unit(section: EffortSection | None, joint: str) -> float:
    """Return the torque [N m, N] for each unit of a joint's column: what the map says, else what the unit is."""
    if section is None:
        return 1.0
    given = section.torque_per_unit
    return float(given.get(joint, given.get("*", factor_of("joints.effort", section.unit, "torque"))))


def torques_per_unit(section: EffortSection | None, joints: Sequence[str]) -> Array:
    """Return the torques (n,) of several joints; columns that change places keep their numbers."""
    return np.array([torque_per_unit(section, joint) for joint in joints])


def encoder_matrix(table: JointsTable, joints: Sequence[str]) -> Array:
    """Return A (n, n), from readings to joints [1, m/rad].

    Raises MapError if a joint has no channel, or if the readings do not tell the joints apart.
    """
    inner = {name for row in table.coupling.values() for name in row}
    named = {"factor": {*table.factor} - {"*"}, "offset": {*table.offset}, "coupling": {*table.coupling} | inner}
    for key, names in named.items():
        if strangers := sorted(names - set(joints)):
            raise MapError(f"map: joints.{key}: no joint '{strangers[0]}' with a channel: {', '.join(joints)}")
    factor = [_gear(table, name) for name in joints]
    shares = np.array([[table.coupling.get(j, {j: 1.0}).get(k, 0.0) for k in joints] for j in joints])
    if 0.0 in factor:
        raise MapError(f"map: joints.factor of {joints[factor.index(0.0)]} = 0: another number was expected")
    if np.linalg.matrix_rank(shares) < len(joints):
        rows = ", ".join(table.coupling)
        raise MapError(f"map: joints.coupling: its encoders do not tell {rows} apart: independent rows were expected")
    return shares.reshape(len(joints), len(joints)) * factor


def _gear(table: JointsTable, joint: str) -> float:
    """Return a joint's motion over that of its encoder [1, m/rad]."""
    return float(table.factor.get(joint, table.factor.get("*", 1.0)))


def encoder_offset(table: JointsTable, joints: Sequence[str]) -> Array:
    """Return q0 (n,): where the joints are when all encoders show 0 [rad, m]."""
    return np.array([table.offset.get(name, 0.0) for name in joints])


def effort_matrix(table: JointsTable, joints: Sequence[str], driven: Sequence[str]) -> Array:
    """Return A^-T (m, m), from torques at encoders to those of the joints that have efforts.

    Raises MapError as `encoder_matrix`, or if one of them is coupled to a joint without effort.
    """
    A, has_effort = encoder_matrix(table, joints), [name in driven for name in joints]
    other = np.logical_not(has_effort)
    tied = (A != 0.0) & (np.outer(has_effort, other) | np.outer(other, has_effort))
    if tied.any():
        first, second = (joints[int(k)] for k in np.argwhere(tied)[0])
        raise MapError(f"map: joints.effort: {first} and {second} are coupled: efforts of both were expected")
    return np.asarray(np.linalg.inv(A[np.ix_(has_effort, has_effort)]).T)


def encoder_words(table: JointsTable, joints: Sequence[str]) -> dict[str, str]:
    """Return joint -> what is made of its reading, in words."""
    A, words = encoder_matrix(table, joints), {}
    for name, row, zero in zip(joints, A, encoder_offset(table, joints), strict=True):
        terms = [f"{share:.9g} {other}" for share, other in zip(row, joints, strict=True) if share]
        words[name] = " + ".join([*terms, f"{zero:.9g}"] if zero else terms)
    return words
