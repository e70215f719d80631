"""TOML: read files by path or by shipped name, set values by dotted keys, and write scenarios.

A part of a dotted key that applies to a list is an index, counted from 0, or `*` for every item of the list.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import tomli_w

from aerobat_description.reading import did_you_mean
from aerobat_description.toml_text import MOST_LEVELS, TomlError, toml_file, toml_values
from aerobat_pin.errors import AerobatError, ScenarioError
from aerobat_pin.numerics import guarded
from aerobat_pin.scenario.tables import Section

PLAIN_LIST = re.compile(r"\[\n((?: +[^\n\[\]{}]+,\n)+) *\]")  # a list as tomli_w writes it, with one value on each line


@guarded()
def shipped_names(folder: Path) -> list[str]:
    """Return the names, without ending, of the TOML files in a folder."""
    return sorted(path.stem for path in folder.glob("*.toml"))


@guarded()
def read_toml(kind: str, source: str, shipped: Path, error: Callable[[str], AerobatError]) -> dict[str, Any]:
    """Read a TOML file.

    Args:
        kind: what the file describes, such as `scenario`; used in error messages.
        source: name of a shipped file, or path.
        shipped: folder of the shipped files.
        error: error class to raise.

    Raises:
        AerobatError: of the class `error`: there is no such file, it cannot be read, or `toml_file` refuses it.
    """
    file = shipped / f"{source}.toml"
    if "/" in source or not os.path.isfile(file):
        file = Path(source)
    if os.path.isfile(file) or source.endswith(".toml") or "/" in source:
        try:
            return toml_file(file)
        except TomlError as cause:
            raise error(f"{kind} file {file}: {cause}") from cause
    hint = did_you_mean(source, shipped_names(shipped), "shipped are")
    raise error(f"no {kind} '{source}': {hint}; or give a TOML file")


@guarded()
def scenario_toml(scenario: Section) -> str:
    """Return a scenario with all its defaults as TOML text that `load_scenario` can read."""

    def in_one_line(match: re.Match[str]) -> str:
        return f"[{', '.join(line.strip(' ,') for line in match[1].splitlines())}]"

    return PLAIN_LIST.sub(in_one_line, tomli_w.dumps(scenario.model_dump(exclude_none=True)))


def scenario_value(value: Any) -> str:
    """Return one value as TOML on a single line."""
    if isinstance(value, tuple | list):
        return f"[{', '.join(scenario_value(item) for item in value)}]"
    if isinstance(value, dict):
        return f"{{{', '.join(f'{key} = {scenario_value(item)}' for key, item in value.items())}}}"
    return tomli_w.dumps({"value": value}).removeprefix("value = ").rstrip("\n")


@guarded()
def with_settings(values: dict[str, Any], settings: Iterable[str]) -> dict[str, Any]:
    """Apply `dotted.key=value` texts to nested values, in place, and return the values. Raises ScenarioError."""
    for setting in settings:
        key, equals, text = setting.partition("=")
        if not equals or not key.strip():
            raise ScenarioError(f"--set {setting}: dotted.key=value was expected")
        assign(values, key.strip(), parsed_value(text.strip()), f"--set {setting}")
    return values


def parsed_value(text: str) -> Any:
    """Read a value as TOML; return the text unchanged if it is not TOML, so that strings need no quotes."""
    try:
        return toml_values(f"value = {text}")["value"]
    except TomlError:
        return text


@guarded()
def assign(values: Any, key: str, value: Any, source: str | None = None) -> None:
    """Set the value of a dotted key, and create tables that are missing on its path.

    Args:
        values: nested dictionaries and lists, changed in place.
        key: dotted key, such as `unknown_force.*.noise`.
        value: new value.
        source: where the setting comes from; error messages begin with it. The key itself when omitted.

    Raises:
        ScenarioError: the key has too many parts, or leads to a list item that does not exist or into a plain value.
    """
    parts = key.split(".")
    if len(parts) > MOST_LEVELS:
        raise ScenarioError(
            f"{source or 'key'}: {len(parts)} parts of a dotted key: at most {MOST_LEVELS} were expected"
        )
    _assign(values, parts, 0, value, source or f"key '{key}'")


def _assign(node: Any, parts: list[str], depth: int, value: Any, source: str) -> None:
    part, path = parts[depth], f"'{'.'.join(parts[:depth])}'" if depth else "the scenario"
    places: list[Any] = [part]
    if isinstance(node, list):
        places = [i for i in range(len(node)) if part in ("*", str(i))]
        if not places:
            raise ScenarioError(f"{source}: '{part}' is not an index of {path}, a list of {len(node)}")
    elif not isinstance(node, dict):
        raise ScenarioError(f"{source}: {path} is a value, not a table")
    elif part == "*":
        raise ScenarioError(f"{source}: {path} is a table, not a list; '*' stands for the items of a list")
    for place in places:
        if depth == len(parts) - 1:
            node[place] = value
        else:
            below = node[place] if isinstance(node, list) else node.setdefault(place, {})
            _assign(below, parts, depth + 1, value, source)
