"""Build checked dataclasses from nested plain values, as read from TOML, and check names.

Errors name key, value and rule. Tools reject a robot in which the name of a link or joint occurs twice.
"""

from __future__ import annotations

import difflib
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import MISSING, fields
from typing import Annotated, Any, get_args, get_origin, get_type_hints

# Links and joints of every robot, and Pinocchio's names for the world and for the joint of the free base.
FRAMES = ("force_point", "linkage_J1", "linkage_J8")
WING = ("proximal", "distal", "shoulder", "elbow", *FRAMES, *(f"{frame}_fixed" for frame in FRAMES))
LONGEST_ROBOT_NAME = 100  # bytes: files are named after a robot, and no file system takes names above 255 bytes
BUILT_IN = {"universe", "root_joint", "base_link", *(f"{side}_{name}" for side in ("left", "right") for name in WING)}
LONGEST_LIST = 420  # characters of all known names in a message
LARGEST = 1e30  # powers of such numbers are still finite doubles, and they fit the single precision of a mesh
POSITIVE, NOT_NEGATIVE = "it must be positive", "it is not negative"
AboveZero = Annotated[float, POSITIVE]
NotNegative = Annotated[float, NOT_NEGATIVE]


class MorphologyError(ValueError):
    """A morphology cannot be read, or no robot can have its values. The message names key, value and rule."""


def require(holds: bool, key: str, value: object, rule: str) -> None:
    """Raise MorphologyError with key, value and rule if `holds` is False."""
    if not holds:
        raise MorphologyError(f"morphology: {key} = {value}: {rule}")


def did_you_mean(name: str, known: Iterable[str], every: str = "") -> str:
    """Return the known name that is closest to a wrong one as a question, or else all known names.

    With words before all of them, `every`, such as `shipped are`, they follow the question, too.
    """
    names = {each.lower(): each for each in known}
    close = difflib.get_close_matches(name.lower(), names, n=1)
    listed = textwrap.shorten(f"{every or 'known are'} {', '.join(names.values())}", LONGEST_LIST, placeholder=" ...")
    if not close:
        return listed
    question = f"did you mean '{names[close[0]]}'?"
    return f"{question} {listed[0].upper()}{listed[1:]}" if every else question


def merge(base: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return nested values with changes laid over them: tables are merged key by key, other values are replaced."""
    merged = dict(base)
    for key, value in changes.items():
        below = merged.get(key)
        merged[key] = merge(below, value) if isinstance(value, Mapping) and isinstance(below, Mapping) else value
    return merged


def build(kind: Any, values: object, where: str) -> Any:
    """Convert plain TOML values to `kind`: a dataclass, which its `check` checks, a number, a string or a vector.

    Messages name the values by their dotted key `where`.
    """
    if not hasattr(kind, "__dataclass_fields__"):
        return _leaf(kind, values, where)
    if not isinstance(values, Mapping):
        raise MorphologyError(f"morphology: {where} = {values!r}: a table was expected")
    known = {field.name: field for field in fields(kind)}
    hints = get_type_hints(kind, include_extras=True)
    for key in values:
        if key not in known:
            raise MorphologyError(f"morphology: unknown key '{dotted(where, key)}'; {did_you_mean(str(key), known)}")
    converted = {}
    for key, field in known.items():
        if key in values:
            converted[key] = _field(hints[key], values[key], dotted(where, key))
        elif field.default is MISSING:
            raise MorphologyError(f"morphology: missing key '{dotted(where, key)}'")
    section = kind(**converted)
    if hasattr(section, "check"):
        section.check(where)
    return section


def _field(kind: Any, value: object, where: str) -> Any:
    if get_origin(kind) is Annotated:
        number, rule = build(float, value, where), kind.__metadata__[0]
        require(number > 0.0 or (number == 0.0 and rule == NOT_NEGATIVE), where, number, rule)
        return number
    choices = get_args(kind)
    if type(None) in choices:
        if value is None or value is False:  # `tail = false` removes the tail
            return None
        kind = next(choice for choice in choices if choice is not type(None))
    if choices and hasattr(choices[0], "__dataclass_fields__") and Ellipsis in choices:
        require(isinstance(value, list | tuple), where, repr(value), "a list of tables was expected")
        assert isinstance(value, list | tuple)
        return tuple(build(choices[0], item, f"{where}[{i}]") for i, item in enumerate(value))
    return build(kind, value, where)


def _leaf(kind: Any, value: Any, where: str) -> Any:
    if kind is str:
        require(isinstance(value, str), where, repr(value), "a string was expected")
        return value
    numbers = value if isinstance(value, list | tuple) else [value]
    good = all(isinstance(x, int | float) and not isinstance(x, bool) and abs(x) < LARGEST for x in numbers)
    require(good, where, value, f"finite numbers were expected, below {LARGEST:g}")
    if kind is float:
        require(not isinstance(value, list | tuple), where, value, "one number was expected")
        return float(numbers[0])
    size = None if Ellipsis in get_args(kind) else len(get_args(kind))
    rule = "a list of numbers was expected" if size is None else f"a list of {size} numbers was expected"
    require(isinstance(value, list | tuple) and size in (None, len(value)), where, value, rule)
    return tuple(float(x) for x in numbers)


def dotted(where: str, key: object) -> str:
    """Return the dotted key of `key` within the section `where`."""
    return f"{where}.{key}" if where else str(key)


def check_name(name: str, key: str) -> None:
    """Raise MorphologyError, which names the dotted key, unless a name can be used for files, links and joints."""
    plain = 0 < len(name.encode()) <= LONGEST_ROBOT_NAME and all(letter.isalnum() or letter in "_-" for letter in name)
    require(plain, key, repr(name), f"letters, digits, _ and - only, {LONGEST_ROBOT_NAME} at most")


def check_thrusters(names: Sequence[str]) -> None:
    """Raise MorphologyError if frames with the names of thrusters, and their fixed joints, would repeat a name."""
    taken = set(BUILT_IN)
    for i, name in enumerate(names):
        pair = {name, f"{name}_fixed"}
        rule = "another link, joint or frame has this name or that of its joint; each needs a name of its own"
        require(not pair & taken, f"thrusters[{i}].name", repr(name), rule)
        taken |= pair
