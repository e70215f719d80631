"""Turn pydantic's validation errors into one-line messages that name the key, the value and what was expected."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, TypeVar, get_args, get_origin

from pydantic import ValidationError

from aerobat_description.reading import did_you_mean
from aerobat_pin.errors import AerobatError
from aerobat_pin.numerics import guarded
from aerobat_pin.scenario.tables import Section, sections_of
from aerobat_pin.scenario.toml import parsed_value, scenario_value

Validated = TypeVar("Validated", bound=Section)
LONGEST_SHOWN = 200  # characters of a wrong value in an error message


def validated(section: type[Validated], values: Mapping[str, Any], source: str, error: type[AerobatError]) -> Validated:
    """Return the table that nested plain values make. Raises `error`, which names every broken rule of `source`."""
    try:
        return section.model_validate(dict(values))
    except ValidationError as invalid:
        # A short list gives one error for each missing number, all with the same message: the keys keep one of them.
        lines = dict.fromkeys(explain(dict(item), section) for item in invalid.errors())
        raise error(f"{source}: " + "; ".join(lines)) from invalid


def explain(error: dict[str, Any], root: type[Section]) -> str:
    """Return the message for one of pydantic's errors in a scenario; `root` is the class of the outermost table."""
    parts, section = _place(error["loc"], root)
    where, kind = ".".join(parts), error["type"]
    if kind == "union_tag_invalid":
        tag, known = error["ctx"]["tag"], error["ctx"]["expected_tags"].replace("'", "").split(", ")
        return f"{where}.signal = '{tag}': {did_you_mean(tag, known, 'there are')}"
    if kind == "missing" and isinstance(error["loc"][-1], int):
        count = _fixed_length(section, parts[-2])
        return f"{'.'.join(parts[:-1])} = {list(error['input'])}: {count or 'more'} numbers were expected"
    if kind == "too_long" and (count := _fixed_length(section, parts[-1])):
        return f"{where} = {list(error['input'])}: {count} numbers were expected"
    if kind == "value_error":
        return str(error["ctx"]["error"])
    if kind in ("dict_type", "model_type"):
        keys = f"of {', '.join(field.alias or key for key, field in section.model_fields.items())}"
        if kind == "dict_type":
            keys = _as_table(error["input"], section, parts[-1])
        return f"{where} = {_shown(error['input'])}: a table {keys} was expected"
    message = explain_plainly(error, where, list(section.model_fields)).replace("tuple", "list")
    return message + (
        f", such as {_as_list(error['input'], _fixed_length(section, parts[-1]))}" if kind == "tuple_type" else ""
    )


@guarded()
def explain_plainly(error: dict[str, Any], where: str, known: Sequence[str]) -> str:
    """Return the message for one of pydantic's errors in any table, at a dotted key.

    A misspelt key is likened to the known ones, which the table accepts.
    """
    if error["type"] == "extra_forbidden":
        return f"unknown key '{where}'; {did_you_mean(where.rpartition('.')[2], known)}"
    if error["type"] == "missing":
        return f"missing key '{where}'"
    if error["type"] == "value_error":
        return f"{where}: {error['ctx']['error']}" if where else str(error["ctx"]["error"])
    message = f"{error['msg'][:1].lower()}{error['msg'][1:]}"
    if error["type"] == "string_pattern_mismatch":  # of a name
        message = "letters, digits, '.', '_' and '-' without spaces were expected, a letter or digit first"
    return f"{where} = {_shown(error['input'])}: {message}"


def _shown(value: object) -> str:
    """Return a value as an error message shows it: its Python text, or the beginning of a long one."""
    text = repr(value)
    return text if len(text) <= LONGEST_SHOWN else f"{text[:LONGEST_SHOWN]}... ({len(text)} characters)"


def _fixed_length(section: type[Section], key: str) -> int:
    """Return how many entries the list of a key must have, or 0 if any number is allowed."""
    field = section.model_fields.get(key)
    entries = () if field is None else get_args(field.annotation)
    entries = next((get_args(kind) for kind in entries if get_origin(kind) is tuple), entries)  # of a list or None
    return 0 if Ellipsis in entries else len(entries)


def _as_list(given: Any, count: int) -> str:
    """Suggest a list for a value that is not one: split text at commas, and fill up with zeros to `count` entries."""
    entries = [parsed_value(part.strip()) for part in given.split(",")] if isinstance(given, str) else [given]
    return scenario_value(entries + [0.0] * (count - len(entries)))


def _as_table(given: Any, section: type[Section], key: str) -> str:
    """Suggest a table of named values for a value that is none: by the key's description, such as `joint -> torque`."""
    field = section.model_fields.get(key)
    name, arrow, _ = ((field.description if field is not None else None) or "").partition(" -> ")
    first = given[0] if isinstance(given, list) and given else given
    value = scenario_value(first) if isinstance(first, int | float) else "..."
    return f"{{{name if arrow else 'name'} = {value}, ...}}"


def _place(loc: tuple[Any, ...], root: type[Section]) -> tuple[list[str], type[Section]]:
    """Return the parts of the dotted key for a location in pydantic's notation, and the innermost section there."""
    section = root
    parts: list[str] = []
    kinds: dict[str, type[Section]] = {}
    for part in loc:
        if part in kinds and len(kinds) > 1:  # not a key but pydantic's tag: it selects one of several section classes
            section, kinds = kinds[part], {}
            continue
        parts.append(str(part))
        if not isinstance(part, int):
            field = section.model_fields.get(part)
            kinds = {} if field is None else sections_of(field.annotation)
        if len(kinds) == 1:
            section = next(iter(kinds.values()))
    return parts, section
