"""Suggest what a robot that flies or walks needs: which columns are its attitude, and its rotors' forces."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Iterator, Sequence

import numpy as np
import pinocchio as pin

from aerobat_pin.records.columns import Columns
from aerobat_pin.records.joint_columns import GYRO_WORDS, MEASURED_WORDS, WANTED_WORDS, named_unit, words_of_name
from aerobat_pin.records.suggest_joints import listed, toml_text

UNIT_ERROR = 1e-3  # of a quaternion's length, as it is written
FULL_TURN = 7.0  # beyond any angle of an attitude in rad
IMU_WORDS = {  # joints have accelerations, too
    "rate": [{word} for word in GYRO_WORDS],
    "acceleration": [{"accelerometer"}, {"imu", "acc"}, {"imu", "accel"}],
}
RPY = ("roll", "pitch", "yaw")
OF_BASE = {"attitude", "att", "orientation", "euler", "rpy", "angle", "angles", "base", "body", "pose", "imu", "odom"}
OF_BASE |= {"mocap", "vicon", "vision", "optitrack", *MEASURED_WORDS}  # else a joint of that name, or its command
LAST_NUMBER = re.compile(r"^(?P<stem>.*\D)(?P<number>\d+)(?P<tail>\D*)$")
ROTOR_WORDS = {"rotor", "rotors", "rot", "prop", "propeller", "thrust", "throttle", "esc", "pwm"}
SPEED_WORDS = {"rpm", "erpm", "omega", "speed"}
DRIVE_WORDS = {"motor", "motors", "m", *SPEED_WORDS}  # those of joints, too
BESIDE_ROTORS = {"", "n", "rad", "rads", "s", "us", "link", *MEASURED_WORDS, *WANTED_WORDS}


def attitudes(columns: Columns) -> Iterator[tuple[str, ...]]:
    """Yield columns that may be the attitude, the likeliest last: roll, pitch and yaw, four that are numbered."""
    found: dict[tuple[str, ...], dict[str, str]] = {}
    for name in columns.names:
        words = [word for word in words_of_name(name) if word not in {"deg", "rad"}]
        if words and words[-1] in RPY and {*words[:-1]} <= OF_BASE:
            found.setdefault(tuple(words[:-1]), {})[words[-1]] = name
    yield from (tuple(axes[axis] for axis in RPY) for axes in found.values() if len(axes) == len(RPY))
    yield from (names for names in _numbered_alike(columns, 4) if _is_attitude(columns, names))


def line_of_attitude(columns: Columns, names: tuple[str, ...]) -> str:
    """Return the line of a map about a quaternion, or about roll, pitch and yaw."""
    if len(names) == 3:
        largest = max(float(np.nanmax(np.abs(columns.sample(name)))) for name in names)
        unit = named_unit("angle", names) or ("deg" if largest > FULL_TURN else "rad")
        asked = "about x, then y, then z? With z up pitch is nose down"
        return f'quaternion = {{columns = {listed(names)}, unit = "{unit}"}}  # {asked}; the largest is {largest:.3g}'
    means = [float(np.nanmean(np.abs(columns.sample(name)))) for name in names]
    numbered = names in [*_numbered_alike(columns, 4)]
    order = "wxyz" if numbered and means[0] > means[3] else "xyzw"
    asked = f"  # or {'xyzw' if order == 'wxyz' else 'wxyz'}?" if numbered else ""
    return f'quaternion = {{columns = {listed(names)}, order = "{order}", sense = "body_to_world"}}{asked}'


def numbered_imu(columns: Columns) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield kind -> three columns of a gyro or an accelerometer that are numbered, as gyro_rad[0] to gyro_rad[2]."""
    for kind, words in IMU_WORDS.items():
        groups = ((names, {*words_of_name(names[0])}) for names in _numbered_alike(columns, 3))
        some = (names for names, found in groups if any(each <= found for each in words))
        yield from ((kind, names) for names in itertools.islice(some, 1))


def _numbered_alike(columns: Columns, count: int) -> Iterator[tuple[str, ...]]:
    """Yield so many columns each that are numbered, as q[0] to q[3]."""
    groups: dict[str, list[str]] = {}
    for name in columns.values:
        groups.setdefault(re.sub(r"[\[_ .]?\d\]?$", "", name), []).append(name)
    yield from (tuple(names) for names in groups.values() if len(names) == count)


def _is_attitude(columns: Columns, names: tuple[str, ...]) -> bool:
    """Return whether four columns are unit quaternions that turn."""
    values = np.column_stack([columns.sample(name) for name in names])
    values = values[np.isfinite(values).all(axis=1)]  # where the attitude has rows of its own
    unit = bool(len(values)) and np.allclose(np.linalg.norm(values, axis=1), 1.0, atol=UNIT_ERROR)
    return unit and bool(np.ptp(values, axis=0).any())


def suggest_rotors(columns: Columns, model: pin.Model | None, forces: Sequence[str], used: str) -> Iterator[str]:
    """Yield the lines of the table `known` of a robot that flies, whose model may be unknown.

    The rotors' `forces` are columns where they are recorded; what the map so far, `used`, names is no rotor's.
    """
    if forces:
        moments = [re.sub("f(?=[^f]*$)|force", "m", name) for name in forces]
        whole = [*forces, *(moments if {*moments} <= {*columns.names} else ())]
        yield "[known]"
        yield "# all rotors' force at the base's origin, in the base's axes? Else frame = ..., axes = \"world\""
        yield f"rotors = {{columns = {listed(whole)}}}"
        yield ""
        return
    moving = (name for name in columns.names if toml_text(name) not in used and np.nanstd(columns.sample(name)) > 0.0)
    series = _by_last_number(moving)
    joints = 0 if model is None else model.njoints - 2
    rotors = [
        words
        for words, names in series.items()
        if words <= ROTOR_WORDS | DRIVE_WORDS | BESIDE_ROTORS
        and (words & ROTOR_WORDS or (words & DRIVE_WORDS and len(names) != joints))
    ]
    if not rotors:
        return
    words = min(rotors, key=lambda some: (not some & {"thrust"}, not some & SPEED_WORDS))
    names = series[words]
    bodies = [] if model is None else [f.name for f in model.frames.tolist()[1:] if f.type == pin.FrameType.BODY]
    near = [some for said, some in _by_last_number(bodies).items() if said & (ROTOR_WORDS | DRIVE_WORDS)]
    frames = next((some for some in near if len(some) == len(names)), [])
    fit = 'fit = {to = "check.specific_force"}' if "specific_force" in used else "coefficients = [...]"
    law = 'law = "polynomial 2", ' + fit
    if "thrust" in words:
        law = 'law = "polynomial 1", coefficients = [1.0]'
    elif not words & SPEED_WORDS:
        largest = max(float(np.nanmax(np.abs(columns.sample(name)))) for name in names)
        law = f'law = "polynomial 1 2", full_scale = {largest:.4g}, {fit}'
    yield "# Rotors? Each pushes along z of its frame, by the power 1 of its column if it is a thrust, 2 of a speed."
    yield "# A fit takes what is not known from the accelerometer: does nothing else push in the first half of the log?"
    yield '# Reaction torques are not in it: rows = {ignore = ["base.Mz"]} in [robot] if rotors turn about z.'
    if not frames:
        yield '# MISSING: where are they? frame = "..." for each; without it they push at the base\'s origin'
    yield "[known]"
    dark = "# " if "..." in law else ""
    for k, name in enumerate(names):
        frame = f'frame = "{frames[k]}", ' if frames else ""
        yield f"{dark}rotor_{k} = {{columns = {listed([name])}, {frame}direction = [0, 0, 1], {law}}}"
    yield ""


def _by_last_number(names: Iterable[str]) -> dict[frozenset[str], list[str]]:
    """Return words -> names that have them, two or more that differ by their last number, in its order."""
    series: dict[frozenset[str], dict[int, str]] = {}
    for name in names:
        if match := LAST_NUMBER.match(name):
            words = frozenset(re.split(r"[^a-z]+", f"{match['stem']} {match['tail']}".lower()))
            series.setdefault(words, {})[int(match["number"])] = name
    return {words: [some[k] for k in sorted(some)] for words, some in series.items() if len(some) > 1}
