"""Set values by dotted keys in nested dictionaries and lists.

A part of a key that applies to a list is an index, counted from 0, or `*` for every item of the list.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from aerobat_description.toml_text import MOST_LEVELS, TomlError, toml_values
from aerobat_pin.errors import ScenarioError
from aerobat_pin.numerics import guarded


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


def _assign(here: Any, parts: list[str], depth: int, value: Any, source: str) -> None:
    part, path = parts[depth], f"'{'.'.join(parts[:depth])}'" if depth else "the scenario"
    places: list[Any] = [part]
    if isinstance(here, list):
        places = [i for i in range(len(here)) if part in ("*", str(i))]
        if not places:
            raise ScenarioError(f"{source}: '{part}' is not an index of {path}, a list of {len(here)}")
    elif not isinstance(here, dict):
        raise ScenarioError(f"{source}: {path} is a value, not a table")
    elif part == "*":
        raise ScenarioError(f"{source}: {path} is a table, not a list; '*' stands for the items of a list")
    for place in places:
        if depth == len(parts) - 1:
            here[place] = value
        else:
            below = here[place] if isinstance(here, list) else here.setdefault(place, {})
            _assign(below, parts, depth + 1, value, source)
