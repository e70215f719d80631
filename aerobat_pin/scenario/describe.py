"""Describe every key of a scenario file (type, unit, default, meaning), as `aerobat describe scenario` prints it.

The descriptions come from the JSON schema that pydantic makes of the classes in `tables`.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator
from typing import Any, get_args

from aerobat_description.reading import did_you_mean
from aerobat_pin.errors import ScenarioError
from aerobat_pin.scenario.scenario import Scenario
from aerobat_pin.scenario.tables import LARGEST_NUMBER, Section, sections_of
from aerobat_pin.scenario.toml import scenario_value

COLUMNS = 100  # width of the text in characters
UNIT = re.compile(r"\s*\[([^\]]+)\](?=$|[,;])")
NOUNS = {"number": "number", "integer": "whole number", "string": "text", "object": "table", "boolean": "true or false"}
BOUNDS = {"exclusiveMinimum": ">", "minimum": ">=", "exclusiveMaximum": "<", "maximum": "<="}


def describe_scenario(wanted: str | None = None) -> str:
    """Return the description of the keys of a scenario file, or of one table or key; see `describe_tables`."""
    head = "A scenario is a TOML file of these tables and keys. Only what is marked required must be written."
    return describe_tables(Scenario, head, "scenario", wanted)


def scenario_keys(root: type[Section] = Scenario) -> list[str]:
    """Return the dotted keys of a scenario file, or of another; `*` stands for the number of an item in a list."""
    return list(_keys_below(root, ""))


def _keys_below(section: type[Section], table: str) -> dict[str, None]:
    keys: dict[str, None] = {}
    for key, field in section.model_fields.items():
        kinds, name = sections_of(field.annotation).values(), f"{table}{key.rstrip('_')}"
        for kind in kinds:
            keys |= _keys_below(kind, f"{name}{'.*' * (len(kinds) > 1)}.")
        if not kinds:
            keys[name] = None
    return keys


def describe_tables(root: type[Section], head: str, kind: str, wanted: str | None = None) -> str:
    """Return the description of the keys of a file, wrapped at `COLUMNS` characters.

    Args:
        root: its outermost table.
        head: text before the first key.
        kind: what `aerobat describe` calls such a file.
        wanted: a table such as `crank`, or a dotted key such as `observers.gain`; all of them when omitted.

    Raises:
        ScenarioError: there is no such table or key.
    """
    text = "\n".join([*textwrap.wrap(head, COLUMNS), *_keys(root), *_tables(root, "")])
    return (text if wanted is None else _part_of(text, wanted, kind)) + "\n"


def _part_of(text: str, wanted: str, kind: str) -> str:
    """Return the blocks of a description that belong to a table, or the title and lines of one key in them."""
    blocks = text.split("\n\n")
    titles = [re.split(r"(?<!\n)  ", block)[0] for block in blocks]  # a long one goes on in the next line
    names = [re.findall(r"\[([\w.]+)\]", title) for title in titles]
    plain = ".".join(part for part in wanted.split(".") if part != "*" and not part.isdigit())
    parts = [
        block
        for block, tables in zip(blocks, names, strict=True)
        if any(f"{table}.".startswith(f"{plain}.") for table in tables)
    ]
    table, _, key = plain.rpartition(".")
    known = {name for tables in names for name in tables}
    for block, title, tables in zip(blocks, titles, names, strict=True):
        entries = {entry.split()[0]: entry for entry in re.split(r"\n(?=  \w+  )", block)[1:]}
        known |= {f"{name}.{entry}".lstrip(".") for name in tables or [""] for entry in entries}
        if not parts and key in entries and table in (tables or [""]):
            parts.append("\n".join([*([title] if tables else []), entries[key]]))
    if not parts:
        hint = did_you_mean(plain, sorted(known))
        raise ScenarioError(f"describe {kind} {wanted[:60]}: there is no such table or key: {hint}")
    return "\n\n".join(parts)


def unit_and_meaning(description: str) -> tuple[str, str]:
    """Split a description into the unit in brackets (empty if there is none) and the remaining text."""
    unit = UNIT.search(description)
    return (unit[1], UNIT.sub("", description, count=1).strip()) if unit else ("", description)


def kind_of(schema: dict[str, Any]) -> str:
    """Return the type of a key's values, such as `number > 0` or `3 numbers`, from its JSON schema."""
    count = ""
    while inner := schema.get("anyOf") or schema.get("prefixItems") or ([schema["items"]] if "items" in schema else []):
        if schema.get("type") == "array":
            count = f"{len(inner)} " if "prefixItems" in schema else "list of "
        schema = inner[0]
    bounded = schema.get("additionalProperties", schema)
    given = {key: bounded[key] for key in BOUNDS if bounded is not True and key in bounded}
    bounds = [f"{BOUNDS[key]} {value:g}" for key, value in given.items() if abs(value) < LARGEST_NUMBER]
    choices = schema.get("enum", [schema["const"]] if "const" in schema else [])
    noun = " or ".join(f'"{choice}"' for choice in choices) or NOUNS[schema["type"]]
    return f"{count}{noun}{'s' if count else ''} {', '.join(bounds)}".rstrip()


def _keys(section: type[Section], base: type[Section] = Section) -> Iterator[str]:
    """Describe a section's keys; leave out those that the base class describes in the same way."""
    schema, inherited = section.model_json_schema(by_alias=False), base.model_json_schema().get("properties", {})
    fields = {
        key: schema["properties"][key]
        for key, field in section.model_fields.items()
        if (field.description or not sections_of(field.annotation))
        and inherited.get(key) != schema["properties"][key]
        and not (key == "signal" and base is not Section)
    }
    indent = 4 + max((len(key) for key in fields), default=0)
    for key, rules in fields.items():
        unit, meaning = unit_and_meaning(rules.get("description", ""))
        is_table = bool(sections_of(section.model_fields[key].annotation))
        facts = ("table" if is_table else kind_of(rules)) + (f" [{unit}]" if unit else "")
        if not is_table:
            facts += ", required" if key in schema.get("required", []) else f", {_default(rules.get('default', {}))}"
        for start, text in ((f"  {key.rstrip('_'):<{indent - 2}}", facts), (" " * indent, meaning)):
            yield from textwrap.wrap(text, COLUMNS, initial_indent=start, subsequent_indent=" " * indent)


def _tables(section: type[Section], path: str) -> Iterator[str]:
    """Describe the tables within a section; tables of the same class share one description."""
    named: dict[tuple[type[Section], ...], list[str]] = {}
    for key, field in section.model_fields.items():
        kinds = tuple(sections_of(field.annotation).values())
        if kinds:
            named.setdefault(kinds, []).append(f"{path}{key}")
    for kinds, paths in named.items():
        brackets = "[[{}]]" if len(kinds) > 1 else "[{}]"
        title = ", ".join(brackets.format(name) for name in paths)
        common = kinds[0] if len(kinds) == 1 else kinds[0].__mro__[1]
        assert issubclass(common, Section)
        yield from _title(title, common)
        yield from _keys(common)
        for kind in kinds if len(kinds) > 1 else ():
            yield from _title(f'{title} with signal = "{get_args(kind.model_fields["signal"].annotation)[0]}"', kind)
            yield from _keys(kind, common)
        if len(kinds) == 1:
            yield from _tables(common, f"{paths[0]}.")


def _title(title: str, section: type[Section]) -> Iterator[str]:
    meaning = " ".join((section.__doc__ or "").split())
    yield ""
    yield from textwrap.wrap(f"{title}  {meaning}", COLUMNS, subsequent_indent="  ")


def _default(value: Any) -> str:
    if value is None:
        return "may be left out"
    return f"default {scenario_value(value)}" if value != {} else "default none"
