"""Suggest the known forces of rotors: which columns are their thrusts, speeds or commands, and their frames."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence

import numpy as np
import pinocchio as pin

from aerobat_pin.records.columns import Columns
from aerobat_pin.records.joint_columns import MEASURED_WORDS, WANTED_WORDS
from aerobat_pin.records.suggest_joints import listed, toml_text

LAST_NUMBER = re.compile(r"^(?P<stem>.*\D)(?P<number>\d+)(?P<tail>\D*)$")
ROTOR_WORDS = {"rotor", "rotors", "rot", "prop", "propeller", "thrust", "throttle", "esc", "pwm"}
SPEED_WORDS = {"rpm", "erpm", "omega", "speed"}
DRIVE_WORDS = {"motor", "motors", "m", *SPEED_WORDS}  # those of joints, too
BESIDE_ROTORS = {"", "n", "rad", "rads", "s", "us", "link", *MEASURED_WORDS, *WANTED_WORDS}


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
