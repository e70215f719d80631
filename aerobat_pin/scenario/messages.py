"""What a person reads when a table of text breaks a rule: the key, the value, and what was expected."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from typing import Any, get_args

from aerobat_pin.scenario.dotted_keys import parsed_value
from aerobat_pin.scenario.tables import (
    Section,
    sections_of,
)
from aerobat_pin.scenario.toml import scenario_value


def nothing_there(kind: str, source: str, shipped: Iterable[str]) -> str:
    """Say that neither a file nor something shipped is there; a name that can only be a file's is called one.

    Args:
        kind: of what was looked for.
        source: what it was looked for by.
        shipped: names of what is shipped.
    """
    if source.endswith(".toml") or "/" in source:
        return f"{kind} file {source}: there is no such file"
    return f"no {kind} '{source}': shipped are {', '.join(shipped)}; or give a TOML file"


def explain(error: dict[str, Any], root: type[Section]) -> str:
    """Return what one of pydantic's errors means, in a line; the scenario's tables begin at `root`."""
    parts, section = _place(error["loc"], root)
    where = ".".join(parts)
    if error["type"] == "extra_forbidden":
        known = list(section.model_fields)
        close = difflib.get_close_matches(parts[-1], known, n=1)
        return f"unknown key '{where}'" + (f"; did you mean '{close[0]}'?" if close else f"; known: {', '.join(known)}")
    if error["type"] == "union_tag_invalid":
        tag, known = error["ctx"]["tag"], error["ctx"]["expected_tags"].replace("'", "").split(", ")
        close = difflib.get_close_matches(tag, known, n=1)
        guess = f"did you mean '{close[0]}'? There are" if close else "there are"
        return f"{where}.signal = '{tag}': {guess} {', '.join(known)}"
    if error["type"] == "missing" and isinstance(error["loc"][-1], int):
        count = _length(section, parts[-2])
        return f"{'.'.join(parts[:-1])} = {list(error['input'])}: {count or 'more'} numbers were expected"
    if error["type"] == "missing":
        return f"missing key '{where}'"
    if error["type"] == "value_error":
        return str(error["ctx"]["error"])
    rule = error["msg"].replace("tuple", "list")
    if error["type"] == "tuple_type":
        rule += f", such as {_as_list(error['input'], _length(section, parts[-1]))}"
    return f"{where} = {error['input']!r}: {rule[:1].lower()}{rule[1:]}"


def _length(section: type[Section], key: str) -> int:
    """Return how many entries a list has, or 0 where that is not fixed."""
    field = section.model_fields.get(key)
    entries = () if field is None else get_args(field.annotation)
    return 0 if Ellipsis in entries else len(entries)


def _as_list(given: Any, count: int) -> str:
    """Write as a list what was not given as one: words and numbers between commas, zeros for what is missing."""
    entries = [parsed_value(part.strip()) for part in given.split(",")] if isinstance(given, str) else [given]
    return scenario_value(entries + [0.0] * (count - len(entries)))


def _place(loc: tuple[Any, ...], root: type[Section]) -> tuple[list[str], type[Section]]:
    """Return the dotted key that pydantic's location means, and the last section on the way to it."""
    section = root
    parts: list[str] = []
    kinds: dict[str, type[Section]] = {}
    for part in loc:
        if part in kinds and len(kinds) > 1:  # not a key: which of several kinds of section it is
            section, kinds = kinds[part], {}
            continue
        parts.append(str(part))
        if not isinstance(part, int):
            field = section.model_fields.get(part)
            kinds = {} if field is None else sections_of(field.annotation)
        if len(kinds) == 1:
            section = next(iter(kinds.values()))
    return parts, section
