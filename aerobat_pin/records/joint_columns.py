"""Which columns of a table are whose position, velocity and effort, and in which unit, as far as their names say."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace

import numpy as np

from aerobat_pin.records.columns import Columns
from aerobat_pin.records.joint_channels import JOINT_KINDS

NUMBERED = re.compile(r"^(?P<stem>[a-z].*?)[._ \[]?[jJ]?(?P<number>\d+)(?P<tail>(?:\D.*)?)$", re.IGNORECASE)
CURRENT_WORDS = {"current", "currents", "cur", "i"}
PART_WORDS = {  # what a joint's column may be -> words beside the joint's name, tried in this order
    "velocity": {"v", "vel", "velocity", "velocities", "qd", "dq", "qdot", "rate", "rates", "speed", "speeds"},
    "effort": CURRENT_WORDS | {"tau", "torque", "torques", "trq", "effort", "efforts", "eff", "moment", "moments"},
    "position": {"pos", "position", "positions", "angle", "angles", "enc", "encoder", "theta", "q", ""},
}
FORCE_WORDS = {"", "f", "force", "n"}  # beside a joint's name: its effort, if no other column is
WANTED_WORDS = {"target", "desired", "des", "cmd", "command", "commanded", "setpoint", "goal", "ref", "reference"}
MEASURED_WORDS = {"actual", "act", "measured", "meas"}
OTHER_WORDS = {"voltage", "volt", "temp", "temperature", "acc", "accel", "acceleration", "ext", "external", "error"}
GYRO_WORDS = {"gyro", "gyr"}
OTHER_WORDS |= GYRO_WORDS
UNITS_IN_NAMES = {  # kind of quantity -> word in a column's name -> unit
    "time": {"s": "s", "sec": "s", "ms": "ms", "us": "us", "ns": "ns"},
    "length": {"mm": "mm", "cm": "cm", "m": "m"},
    "speed": {"mms": "mm/s", "ms": "m/s", "mps": "m/s"},
    "force": {"n": "N"},
    "load": {"n": "N", "mn": "mN", "kn": "kN", "gf": "gf", "kgf": "kgf"},
    "angle": {"deg": "deg", "degrees": "deg", "rad": "rad", "rev": "rev"},
    "rate": {"dps": "deg/s", "degs": "deg/s", "deg": "deg/s", "rads": "rad/s", "rad": "rad/s", "rpm": "rpm"},
    "torque": {"a": "A", "ma": "mA", "nm": "N m", "mnm": "mN m", "nmm": "mN m"},
    "acceleration": {"g": "g", "mg": "mg", "ms2": "m/s2"},
}
BEHIND_NUMBERS = {  # words that a numbered joint's column may end in
    *("", "j", "joint", "motor", *MEASURED_WORDS, *WANTED_WORDS),
    *("per", "s", "sec", "n", "m", "mn", "mm"),
    *(word for words in PART_WORDS.values() for word in words),
    *(word for kind in JOINT_KINDS.values() for word in UNITS_IN_NAMES[kind]),
}


def _is_current(name: str) -> bool:
    """Return whether a column's name says that it is a current."""
    words = set(re.split(r"[^a-z]+", name.lower()))
    return bool(words & CURRENT_WORDS) and not words & (PART_WORDS["effort"] - CURRENT_WORDS)


def joint_columns(columns: Columns, names: list[str]) -> dict[str, dict[str, str]]:
    """Return joint -> position, velocity, effort -> column, by names or, where that finds less, in their order."""
    named, numbered, ordered = (find(columns, names) for find in (columns_by_name, numbered_columns, _ordered_columns))
    other = max(numbered, ordered, key=len)
    return other if not named or len(other) == len(names) > len(named) else named


def measured_first(names: Iterable[str], without: Collection[str] = ()) -> list[str]:
    """Return names, what is said to be measured first, what was wanted last, without those that have some words."""
    words = {name: set(re.findall("[a-z]+", humps_apart(name).lower())) for name in names}
    likely = [name for name in words if words[name].isdisjoint(without)]
    return sorted(likely, key=lambda name: (bool(words[name] & WANTED_WORDS), not words[name] & MEASURED_WORDS))


def words_of_name(name: str) -> list[str]:
    """Return letters and numbers of a name, in small letters, between what is neither."""
    return re.split(r"[^a-z0-9]+", name.lower())


def humps_apart(name: str) -> str:
    """Return a name with _ before each hump: JointPosFR_hip becomes Joint_Pos_FR_hip."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name)


def _part_in(text: str) -> str | None:
    """Return whether a column's name, without its joint's, says position, velocity or effort, by a word or its unit."""
    words = set(words_of_name(text))
    part = next((part for part, known in PART_WORDS.items() if words & (known - {""})), None)
    return part or next((part for part, kind in JOINT_KINDS.items() if named_unit(kind, [text])), None)


def columns_by_name(columns: Columns, names: list[str]) -> dict[str, dict[str, str]]:
    """Return joint -> position, velocity, effort -> column, as far as the columns' names say.

    A column is that of the longest name in it: wrist_roll_pos is none of wrist.
    """
    patterns = dict[str, re.Pattern[str]]()
    for each in sorted(names, key=len, reverse=True):
        shorts = (re.escape(form.lower().removesuffix("_joint")) for form in (each, humps_apart(each)))
        patterns[each] = re.compile(rf"(?<![a-z0-9])({'|'.join(shorts)})(_joint)?(?![a-z0-9])")
    parts_of, forces = dict[str, dict[str, str]](), dict[str, str]()
    for name in measured_first(columns.values, OTHER_WORDS):
        forms = (name.lower(), humps_apart(name).lower())
        matches = ((joint, text) for text in forms for joint, pattern in patterns.items() if pattern.search(text))
        joint, text = next(matches, (None, ""))
        if joint is not None:
            others = patterns[joint].sub(" ", text)
            part = _part_in(others) or ("position" if {*words_of_name(others)} <= {""} else None)
            if part is not None:
                parts_of.setdefault(joint, {}).setdefault(part, name)
            elif FORCE_WORDS.issuperset(words_of_name(others)):
                forces.setdefault(joint, name)
    for joint, name in forces.items():
        parts_of.setdefault(joint, {}).setdefault("effort", name)
    return parts_of


def rivals(columns: Columns, parts_of: dict[str, dict[str, str]]) -> list[str]:
    """Return columns that say the same part of the same joint as one that was taken, and are no commands."""
    taken = {column for parts in parts_of.values() for column in parts.values()}
    free = replace(columns, values={name: each for name, each in columns.values.items() if name not in taken})
    again = columns_by_name(free, list(parts_of)).items()
    names = (column for joint, parts in again for part, column in parts.items() if part in parts_of[joint])
    return [name for name in names if not set(words_of_name(humps_apart(name))) & WANTED_WORDS]


def _ordered_columns(columns: Columns, names: list[str]) -> dict[str, dict[str, str]]:
    """Return joint -> part -> column of names such as base_pos_deg, base_speed, if they are as many as the joints."""
    beside = {word for words in UNITS_IN_NAMES.values() for word in words} | {"", "joint", "per"}
    beside |= WANTED_WORDS | MEASURED_WORDS
    parts_of: dict[str, dict[str, str]] = {}
    for name in measured_first(columns.values, OTHER_WORDS):
        part = _part_in(name)
        if part is not None:
            stem = "_".join(word for word in words_of_name(name) if word not in PART_WORDS[part] | beside)
            parts_of.setdefault(stem, {}).setdefault(part, name)
    whole = [
        parts
        for stem, parts in parts_of.items()
        if (stem or len(names) == 1) and "position" in parts and len(parts) > 1
    ]
    return dict(zip(names, whole, strict=True)) if len(whole) == len(names) else {}


def numbered_columns(columns: Columns, names: list[str]) -> dict[str, dict[str, str]]:
    """Return joint -> part -> column of names as q1, q2 and A1_vel_deg_s, A2_vel_deg_s: first joints in their order.

    Or in that of their numbers, if nothing else differs in their names: Pinocchio sorts limbs by name, 12 before 4.
    """
    apart = [re.split(r"(\d+)", name) for name in names]
    differing = [places for places in zip(*apart, strict=False) if len(set(places)) > 1]
    if len({*map(len, apart)}) == len(differing) == 1 and all(map(str.isdigit, differing[0])):
        names = [name for _, name in sorted(zip(map(int, differing[0]), names, strict=True))]
    series: dict[tuple[str, str], dict[int, str]] = {}
    for name in measured_first(columns.values, OTHER_WORDS):
        match = NUMBERED.match(name)
        if match is not None and BEHIND_NUMBERS.issuperset(words_of_name(match["tail"])):
            series.setdefault((match["stem"].lower(), match["tail"].lower()), {})[int(match["number"])] = name
    parts_of: dict[str, dict[str, str]] = {}
    for (stem, tail), listed in sorted(series.items(), key=lambda each: -len(each[1])):
        part = _part_in(f"{stem} {tail}")
        first, count = min(listed), len(listed)
        if count == 4 and _are_turns(columns, list(listed.values())):
            continue
        if part is not None and first in (0, 1) and count == max(listed) - first + 1 and 1 < count <= len(names):
            for joint, number in zip(names, sorted(listed), strict=False):
                parts_of.setdefault(joint, {}).setdefault(part, listed[number])
    return parts_of if any("position" in parts for parts in parts_of.values()) else {}


def _are_turns(columns: Columns, names: list[str]) -> bool:
    """Return whether columns are quaternions: their squares add up to one."""
    squares = sum(columns.sample(name) ** 2 for name in names)
    return bool(np.nanmax(np.abs(squares - 1.0)) < 0.01)


def named_unit(kind: str, names: Sequence[str]) -> str | None:
    """Return the unit that the last words of columns' names say, if they all say the same: A1_vel_deg_s is in deg/s."""
    units, known = set(), UNITS_IN_NAMES[kind]
    for name in names:
        words = [word for word in words_of_name(name.rstrip(")] ")) if word != "per"]
        units.add(known.get("".join(words[-2:])) or known.get(words[-1] if words else ""))
    return units.pop() if len(units) == 1 else None


def said_unit(part: str, names: Sequence[str]) -> str | None:
    """Return the unit that columns' names say, as current or A1_deg, of position, velocity or effort of joints.

    None unless they all say the same.
    """
    currents = part == "effort" and bool(names) and all(map(_is_current, names))
    return named_unit(JOINT_KINDS[part], names) or ("A" if currents else None)
