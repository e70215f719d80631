"""Every key of a scenario file in words: type, unit, default and meaning, from the sections themselves."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator
from typing import Any, Literal, get_args, get_origin

from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from aerobat_pin.scenario.scenario import Scenario
from aerobat_pin.scenario.tables import Section, sections_of
from aerobat_pin.scenario.toml import scenario_value

WIDTH = 100  # columns
UNIT = re.compile(r"\s*\[([^\]]+)\](?=$|[,;])")
NOUNS = {float: ("number", "numbers"), int: ("whole number", "whole numbers"), str: ("text", "texts")}
BOUNDS = {"gt": ">", "ge": ">=", "lt": "<", "le": "<="}


def describe_scenario() -> str:
    """Return all keys of a scenario file as text of `WIDTH` columns."""
    head = "A scenario is a TOML file of these tables and keys. Only what is marked required must be written."
    return "\n".join([head, *_table(Scenario), *_tables(Scenario, "")]) + "\n"


def unit_and_meaning(field: FieldInfo) -> tuple[str, str]:
    """Split a description into the unit in its brackets, which may be missing, and the rest."""
    text = field.description or ""
    found = UNIT.search(text)
    return (found[1], UNIT.sub("", text, count=1).strip()) if found else ("", text)


def kind_of(field: FieldInfo) -> str:
    """Return what values a key takes, such as `number > 0` or `3 numbers`."""
    if sections_of(field.annotation):
        return "table"
    rules = [*field.metadata, *_rules(field.annotation)]
    bounds = [f"{sign} {getattr(one, name):g}" for one in rules for name, sign in BOUNDS.items() if hasattr(one, name)]
    return " ".join([_noun(field.annotation), ", ".join(dict.fromkeys(bounds))]).strip()


def _table(section: type[Section], base: type[Section] = Section) -> Iterator[str]:
    """Say a section's keys that its base does not have alike, and its tables where they have something to say."""
    inherited = {key: repr(field) for key, field in base.model_fields.items()}
    fields = {
        key: field
        for key, field in section.model_fields.items()
        if (field.description or not sections_of(field.annotation))
        and inherited.get(key) != repr(field)
        and not (key == "signal" and base is not Section)
    }
    indent = 4 + max((len(key) for key in fields), default=0)
    for key, field in fields.items():
        unit, meaning = unit_and_meaning(field)
        facts = kind_of(field) + (f" [{unit}]" if unit else "")
        if not sections_of(field.annotation):
            facts += f", {_default(field)}"
        for start, text in ((f"  {key:<{indent - 2}}", facts), (" " * indent, meaning)):
            yield from textwrap.wrap(text, WIDTH, initial_indent=start, subsequent_indent=" " * indent)


def _tables(section: type[Section], path: str) -> Iterator[str]:
    """Say the tables of a section, those of one kind once."""
    named: dict[tuple[type[Section], ...], list[str]] = {}
    for key, field in section.model_fields.items():
        kinds = tuple(sections_of(field.annotation).values())
        if kinds:
            named.setdefault(kinds, []).append(f"{path}{key}")
    for kinds, paths in named.items():
        brackets = "[[{}]]" if len(kinds) > 1 else "[{}]"
        title = ", ".join(brackets.format(one) for one in paths)
        common = kinds[0] if len(kinds) == 1 else kinds[0].__mro__[1]
        assert issubclass(common, Section)
        yield from _heading(title, common)
        yield from _table(common)
        for kind in kinds if len(kinds) > 1 else ():
            yield from _heading(f'{title} with signal = "{get_args(kind.model_fields["signal"].annotation)[0]}"', kind)
            yield from _table(kind, common)
        if len(kinds) == 1:
            yield from _tables(common, f"{paths[0]}.")


def _heading(title: str, section: type[Section]) -> Iterator[str]:
    meaning = " ".join((section.__doc__ or "").split())
    yield ""
    yield from textwrap.wrap(f"{title}  {meaning}", WIDTH, subsequent_indent="  ")


def _default(field: FieldInfo) -> str:
    value = field.get_default(call_default_factory=True)
    if value is PydanticUndefined:
        return "required"
    if value is None:
        return "may be left out"
    return f"default {scenario_value(value)}" if value != {} else "default none"


def _rules(annotation: Any) -> Iterator[Any]:
    """Give the rules of a type that stand inside it, as for an optional number or a list of numbers."""
    for rule in getattr(annotation, "__metadata__", ()):
        yield from rule.metadata if isinstance(rule, FieldInfo) else [rule]
    for inner in get_args(annotation):
        yield from _rules(inner)


def _noun(annotation: Any, plural: bool = False) -> str:
    """Return a type in words."""
    origin, inner = get_origin(annotation), [one for one in get_args(annotation) if one is not type(None)]
    if annotation in NOUNS:
        return NOUNS[annotation][plural]
    if origin is Literal:
        return " or ".join(f'"{one}"' for one in inner)
    if origin is dict:
        return "table"
    if origin is tuple:
        count = "list of" if Ellipsis in inner else str(len(inner))
        return f"{count} {_noun(inner[0], plural=True)}"
    return _noun(inner[0], plural) if inner else str(annotation)
