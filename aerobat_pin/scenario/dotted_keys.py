"""Dotted keys into plain values; a `*` stands for every item of a list."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable
from typing import Any

from aerobat_pin.errors import ScenarioError


def assign(values: Any, key: str, value: Any) -> None:
    """Set a dotted key in plain values. Raises ScenarioError where there is no such place."""
    *path, last = key.split(".")
    places, way = [values], ""
    for part in path:
        places = [below for here in places for below in _below(here, part, key, way)]
        way = f"{way}{part}."
    for here in places:
        if isinstance(here, dict) and last != "*":
            here[last] = value
        elif isinstance(here, list):
            for at in _positions(here, last, key, way):
                here[at] = value
        else:
            raise ScenarioError(f"key '{key}': '{way.removesuffix('.')}' is a value, not a table")


def _below(here: Any, part: str, key: str, way: str) -> list[Any]:
    if isinstance(here, list):
        return [here[at] for at in _positions(here, part, key, way)]
    if isinstance(here, dict) and part != "*":
        return [here.setdefault(part, {})]
    raise ScenarioError(f"key '{key}': '{way.removesuffix('.')}' is no list, so '{part}' finds nothing in it")


def _positions(items: list[Any], part: str, key: str, way: str) -> range:
    if part == "*" and items:
        return range(len(items))
    if part.isdigit() and int(part) < len(items):
        return range(int(part), int(part) + 1)
    raise ScenarioError(f"key '{key}': '{part}' is not an index of '{way.removesuffix('.')}', a list of {len(items)}")


def with_settings(values: dict[str, Any], settings: Iterable[str]) -> dict[str, Any]:
    """Set dotted keys of plain values, in place; returns them. Raises ScenarioError for a setting that is none."""
    for setting in settings:
        key, equals, text = setting.partition("=")
        if not equals or not key.strip():
            raise ScenarioError(f"--set {setting}: dotted.key=value was expected")
        _assign(values, key.strip().split("."), parsed_value(text.strip()), setting)
    return values


def parsed_value(text: str) -> Any:
    """Read a value as TOML; what is not TOML is a bare word."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


def _assign(values: dict[str, Any], keys: list[str], value: Any, setting: str) -> None:
    """Set a nested value; a list of tables is reached by its index."""
    here: Any = values
    for depth, key in enumerate(keys):
        last = depth == len(keys) - 1
        if isinstance(here, list):
            if not key.isdigit() or int(key) >= len(here):
                raise ScenarioError(f"--set {setting}: '{key}' is not an index of a list of {len(here)}")
            if last:
                here[int(key)] = value
            else:
                here = here[int(key)]
        elif isinstance(here, dict):
            if last:
                here[key] = value
            else:
                here = here.setdefault(key, {})
        else:
            raise ScenarioError(f"--set {setting}: '{'.'.join(keys[:depth])}' is a value, not a table")
