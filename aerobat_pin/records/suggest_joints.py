"""Suggest the joints of a map: which columns are whose positions, velocities and efforts."""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Iterable, Iterator

import numpy as np

from aerobat_pin.records.columns import Columns
from aerobat_pin.records.joint_channels import SI_UNITS
from aerobat_pin.records.joint_columns import (
    PART_WORDS,
    columns_by_name,
    joint_columns,
    named_unit,
    numbered_columns,
    rivals,
    said_unit,
    words_of_name,
)
from aerobat_pin.records.joint_names import as_names, nearest_joints
from aerobat_pin.records.robots import Mimic, PlainRobot

KIND_OF_SLIDE = {"position": "length", "velocity": "speed", "effort": "force"}
LARGEST_RADIANS = 7.0  # of an angle that has an end; beyond, degrees are suggested
ENDLESS = 100.0  # [rad]: a joint that goes so far turns on


def suggest_joints(columns: Columns, robot: PlainRobot | None, step: float | None = None) -> list[str]:
    """Return the lines of the table `joints`; `step` is the time between samples [s], if it is known."""
    if robot is not None and not robot.joints:
        return []
    topic, following = joint_topic(columns), {} if robot is None else followers(columns, robot)
    if topic and not following:
        lines = [*_joints_of_topic(columns, robot, topic)]
    elif robot is not None and (topic or not columns.kinds):
        lines = [*_joints_of_columns(columns, robot, following, step)]
    elif robot is not None:
        lines = ["# MISSING: [joints]. No topic is a sensor_msgs/JointState with positions: their columns, or held"]
    else:
        lines = [] if columns.kinds else [*_without_robot(columns)]
    return [*lines, ""] if lines else []


def _joints_of_topic(columns: Columns, robot: PlainRobot | None, topic: str) -> Iterator[str]:
    """Yield the lines about joints whose names, positions and efforts a topic tells."""
    yield "[joints]"
    yield (
        f'topic = "{topic}"  # is its effort a torque in N m? Else effort = {{unit = "A", torque_per_unit = {{...}}}}'
    )
    if more := joint_topics(columns)[1:]:
        yield f"# or {', '.join(more)}? One is read: it has most of the positions and efforts"
    start = f"{topic}.position."
    heard = [name.removeprefix(start) for name in columns.names if name.startswith(start)]
    if heard and not any(name.startswith(f"{topic}.effort.") for name in columns.names):
        yield "# MISSING: what drives the joints? Without efforts in the topic no row of a joint is believed"
    joints = () if robot is None else robot.joints
    alike = nearest_joints((name for name in heard if name not in joints), (j for j in joints if j not in heard))
    if alike:
        yield f"{as_names(alike)}  # the robot calls them otherwise: are these the same?"
    silent = [joint for joint in joints if joint not in {*heard, *alike.values()}]
    if 0 < len(silent) < len(joints):
        places = ", ".join(f"{toml_key(joint)} = 0.0" for joint in silent)
        yield f"held = {{{places}}}  # do they stand still? The topic says nothing of them"


def _joints_of_columns(
    columns: Columns, robot: PlainRobot, following: dict[str, Mimic], step: float | None
) -> Iterator[str]:
    """Yield the lines about joints each of which has columns, or follows another one that has."""
    names, parts_of = list(robot.joints), _columns_of(columns, robot)
    topic = joint_topic(columns)
    as_named = topic is not None or parts_of == columns_by_name(columns, names)
    for name, mimic in following.items():
        parts_of[name] = {part: column for part, column in parts_of[mimic.leader].items() if part != "effort"}
    placed = [name for name in names if "position" in parts_of.get(name, {})]
    yield "[joints]"
    if not placed:
        yield f"# names = {listed(names)}"
        yield '# position = {columns = [...], unit = "rad"}  # which columns are the angles of these joints?'
        yield '# effort = {columns = [...], unit = "N m"}  # and which their torques?'
        yield "# held = {joint = 0.0}  # which stand still?"
        return
    columns_of = {part: [parts_of[name][part] for name in placed if part in parts_of[name]] for part in PART_WORDS}
    if not topic and (beside := rivals(columns, parts_of)):
        yield f"# or {', '.join(beside)}? Of a spring or a gear take all columns on the side of the link"
    if not as_named:
        yield "# the columns are not called like the joints: are they in this order?"
    yield f"names = {listed(placed)}"
    slides, limit = [name for name in placed if robot.slides(name)], robot.model.upperPositionLimit
    turning = [name for name in placed if name not in slides]
    endless = [name for name in turning if not limit[robot.q_index(name)] < ENDLESS]
    units = dict(_units(columns, parts_of, turning, slides, endless, step))
    places = columns_of["position"]
    size = max(float(np.nanmax(np.abs(columns.sample(name)))) for name in places)
    unsure = endless or (turning if size < ENDLESS and not said_unit("position", places) else [])
    question = f"; {', '.join(unsure)}: radians, or degrees?" if unsure and size > LARGEST_RADIANS else ""
    yield f"position = {{columns = {listed(places)}{units['position']}  # the largest is {size:.3g}{question}"
    if len(columns_of["velocity"]) == len(placed):
        yield f"velocity = {{columns = {listed(columns_of['velocity'])}{units['velocity']}"
    else:
        yield 'velocity = {from = "position", window = 0.02}'
    driven = {name: parts_of[name].get("effort") for name in placed if name not in following}
    yield from _effort_lines(driven, columns_of["effort"], units["effort"])
    for key, plain in (("factor", 1.0), ("offset", 0.0)):
        others = {name: value for name, mimic in following.items() if (value := getattr(mimic, key)) != plain}
        if others:
            yield f"{key} = {{{', '.join(f'{toml_key(name)} = {value!r}' for name, value in others.items())}}}"
    if len(placed) < len(names):
        unplaced = ", ".join(name for name in names if name not in placed)
        yield f'held = {{"*" = 0.0}}  # do they stand still? {unplaced}'
    if len(columns_of["effort"]) == len(driven):
        yield ""
        yield "# When does nothing touch the robot [s]? There friction can be fitted, and the error bar is seen; or,"
        yield "# without fit, by `aerobat calibrate` of a recording that nobody touched, as all of it:"
        yield '# friction = {law = "coulomb+viscous", fit = [0, 2]}'
        yield ""
        yield "[use]"
        yield "# free = [0, 3]"


def _effort_lines(driven: dict[str, str | None], efforts: list[str], unit: str) -> Iterator[str]:
    """Yield what drives joints: their columns of efforts, as far as there are some, which end with a `unit`."""
    if len(efforts) == len(driven):
        current = said_unit("effort", efforts)
        if current not in ("A", "mA"):
            yield f'effort = {{columns = {listed(efforts)}{unit}  # or a current, "A"?'
            return
        yield f"effort.columns = {listed(efforts)}"
        yield f'effort.unit = "{current}"'
        yield f"# How many N m at the joint for each {current} (torque constant times gear, with its sign)? Fill in:"
        yield f"# effort.torque_per_unit = {{{', '.join(f'{toml_key(name)} = ...' for name in driven)}}}"
        return
    lacking = [name for name, column in driven.items() if column is None]
    joints = ", ".join(lacking)
    yield f"# MISSING: what drives {joints}? No column with numbers is called so; without, no row is believed:"
    yield f"# passive = {listed(lacking)}  # or nothing at all?"
    yield f"# effort = {{columns = [{', '.join(map(toml_text, driven.values()))}]{unit}"
    yield f"# Or nobody measures it: robot.rows = {{ignore = {listed(lacking)}}}, and the columns of the others"


def followers(columns: Columns, robot: PlainRobot) -> dict[str, Mimic]:
    """Return the joints without columns that follow one with columns, and how."""
    placed = {name for name, parts in _columns_of(columns, robot).items() if "position" in parts}
    mimics = robot.mimics.items()
    return {name: mimic for name, mimic in mimics if name not in placed and mimic.leader in placed and mimic.factor}


def _columns_of(columns: Columns, robot: PlainRobot) -> dict[str, dict[str, str]]:
    """Return joint -> position, velocity, effort -> column, of a topic by the joints' own names."""
    if topic := joint_topic(columns):
        named = {joint: {part: f"{topic}.{part}.{joint}" for part in PART_WORDS} for joint in robot.joints}
        known = {
            joint: {part: name for part, name in parts.items() if name in columns.names}
            for joint, parts in named.items()
        }
        return {joint: parts for joint, parts in known.items() if parts}
    leading = [name for name in robot.joints if name not in robot.mimics]
    return max((joint_columns(columns, names) for names in (leading, list(robot.joints))), key=len)


def _without_robot(columns: Columns) -> Iterator[str]:
    """Yield a comment about columns that look like those of joints, which a map without a robot cannot use."""
    parts_of = numbered_columns(columns, [str(k) for k in range(len(columns.values))])
    if parts_of:
        whole = {part: [parts[part] for parts in parts_of.values() if part in parts] for part in PART_WORDS}
        some = "; ".join(f"{part} {', '.join(names)}" for part, names in whole.items() if names)
        yield f"# {len(parts_of)} joints? They need a robot, --urdf FILE: {some}"


def _units(
    columns: Columns,
    parts_of: dict[str, dict[str, str]],
    turning: list[str],
    slides: list[str],
    endless: list[str],
    step: float | None,
) -> Iterator[tuple[str, str]]:
    """Yield each part of joints, and the end of its table: of joints of both kinds, the unit that is not SI.

    Joints that turn on without an end may have any angle in radians.
    """

    def named(joints: list[str], part: str) -> list[str]:
        return [parts_of[name][part] for name in joints if part in parts_of[name]]

    places = named(turning, "position")
    limited = named([name for name in turning if name not in endless], "position")
    size = max((float(np.nanmax(np.abs(columns.sample(name)))) for name in limited), default=0.0)
    angle = said_unit("position", places) or ("deg" if size > LARGEST_RADIANS else "rad")
    rate = _rate_unit(columns, places, named(turning, "velocity"), angle, step)
    for part, guess in (("position", angle), ("velocity", rate), ("effort", "N m")):
        of_turn = said_unit(part, named(turning, part)) or guess
        of_slide = named_unit(KIND_OF_SLIDE[part], named(slides, part)) or SI_UNITS[part][1]
        stated = of_turn if turning else of_slide
        if turning and slides and of_turn == SI_UNITS[part][0]:
            stated = of_slide if of_slide != SI_UNITS[part][1] else ""
        unit = f', unit = "{stated}"' if stated else ""
        if turning and stated == of_turn and part != "effort" and of_slide in ("mm", "mm/s"):
            unit += f', slide_unit = "{of_slide}"'
        unit += "}"
        if turning and slides:
            unit += (
                f"  # {of_turn} of {', '.join(turning)}; {of_slide} of {', '.join(slides)} (a unit leaves others in SI)"
            )
        yield part, unit


def _rate_unit(columns: Columns, places: list[str], rates: list[str], angle: str, step: float | None) -> str:
    """Return the unit in which velocities fit best to the changes of the positions; that of these without a time."""
    if not places or len(places) != len(rates):
        return f"{angle}/s"
    place, rate = (np.stack([columns.sample(name) for name in names]) for names in (places, rates))
    changes, turn = np.diff(place), 360.0 if angle == "deg" else 2.0 * np.pi
    changes -= turn * np.round(changes / turn)  # where an angle begins anew
    if not (np.any(np.isfinite(changes)) and np.any(np.isfinite(rate))):
        return f"{angle}/s"
    moved, said = np.nanstd(changes), np.nanstd(rate) * (step or 0.0)
    if not min(moved, said) > 0.0:
        return f"{angle}/s"
    moved = np.radians(moved) if angle == "deg" else moved
    return min(("rad/s", 1.0), ("deg/s", np.pi / 180.0), key=lambda unit: abs(np.log(moved / (said * unit[1]))))[0]


def joint_topic(columns: Columns) -> str | None:
    """Return the topic of joints that has most positions and efforts, the first of equals."""
    return next(iter(joint_topics(columns)), None)


def joint_topics(columns: Columns) -> list[str]:
    """Return the topics of joints that have numbers, those with most positions and efforts first."""
    topics = (f"{topic}." for topic, kind in columns.kinds.items() if "JointState" in kind)
    entries = {topic: [name[len(topic) :] for name in columns.names if name.startswith(topic)] for topic in topics}
    count = {
        topic[:-1]: sum(not name.startswith("velocity.") for name in names) for topic, names in entries.items() if names
    }
    return sorted(count, key=lambda topic: -count[topic])


def topics_of(columns: Columns, *kinds: str, without: Collection[str] = ()) -> list[str]:
    """Return the topics of one of these types, without these words in their names."""
    filled = {name.partition(".")[0] for name in columns.values}  # a topic can be silent, or hold no numbers
    named = (topic for topic, kind in columns.kinds.items() if any(word in kind for word in kinds))
    return [topic for topic in named if topic in filled and not {*words_of_name(topic)} & {*without}]


def listed(names: Iterable[str]) -> str:
    """Return names as an array of TOML."""
    return "[" + ", ".join(map(toml_text, names)) + "]"


def toml_text(name: str | None) -> str:
    """Return a name as a text of TOML, or dots for one that is unknown."""
    return "..." if name is None else json.dumps(name, ensure_ascii=False)


def toml_key(name: str) -> str:
    """Return a name as a key of TOML."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else toml_text(name)
