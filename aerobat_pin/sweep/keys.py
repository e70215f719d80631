"""Dotted keys into plain values; a `*` stands for every item of a list."""

from __future__ import annotations

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
