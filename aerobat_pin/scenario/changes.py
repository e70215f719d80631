"""What a scenario changes of the shipped one whose name it carries, so that nobody takes its results for those."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any

from aerobat_pin.scenario.scenario import SHIPPED_SCENARIOS, Scenario, load_scenario

UNCHANGING = {"name", "description"}  # words about a scenario; they do not alter a flight
MOST_SHOWN = 8  # changes in a line of text
LONGEST_VALUE = 60  # characters of a value in a line of text


def changed_keys(scenario: Scenario) -> dict[str, Any]:
    """Return dotted key -> value of all that differs from the shipped scenario of the same name; None: taken away.

    Empty if no such scenario is shipped. A list of another length than the shipped one counts as one value.
    """
    shipped = _shipped(scenario.name)
    return {} if shipped is None else differing_keys(shipped, scenario)


def differing_keys(old: Scenario, new: Scenario) -> dict[str, Any]:
    """Return dotted key -> new value of all that differs between two scenarios but name and description."""
    before, after, given = (
        scenario.model_dump(mode="json", exclude=UNCHANGING, exclude_defaults=short)
        for scenario, short in ((old, False), (new, False), (new, True))
    )
    return dict(_altered(before, after, given, ""))


def changes_text(name: str, changed: Mapping[str, Any]) -> str:
    """Return `changed from NAME: key = value, ...`, or nothing without changes."""
    return f"changed from {name}: {keys_text(changed)}" if changed else ""


def described(scenario: Scenario) -> Scenario:
    """Return a scenario whose description does not contradict it: that of a shipped one goes when a key is changed.

    A description of the user's own stays.
    """
    shipped, begin = shipped_description(scenario.name), f"changed from {scenario.name}: "
    if scenario.description != shipped and not scenario.description.startswith(begin):
        return scenario
    text = changes_text(scenario.name, changed_keys(scenario)) or shipped
    return scenario.model_copy(update={"description": text})


def shipped_description(name: str) -> str:
    """Return the description of the shipped scenario of a name; nothing if there is none."""
    shipped = _shipped(name)
    return "" if shipped is None else shipped.description


def keys_text(changed: Mapping[str, Any]) -> str:
    """Return `key = value, ...` as a line of text."""
    shown = [f"{key} = {_short_value(value)}" for key, value in list(changed.items())[:MOST_SHOWN]]
    if len(changed) > MOST_SHOWN:
        shown.append(f"and {len(changed) - MOST_SHOWN} more")
    return ", ".join(shown)


@cache
def _shipped(name: str) -> Scenario | None:
    """Return the shipped scenario of a name, or None."""
    return load_scenario(name) if os.path.isfile(SHIPPED_SCENARIOS / f"{name}.toml") else None


def _altered(old: Any, new: Any, given: Any, path: str) -> Iterator[tuple[str, Any]]:
    """Yield (dotted key, new value) where two nested values differ; of a table that is new, what is `given` in it."""
    pairs: list[tuple[str, Any, Any, Any]] = []
    if isinstance(old, dict) and isinstance(new, dict):
        inner = given if isinstance(given, dict) else {}
        pairs = [(key, old.get(key), new.get(key), inner.get(key)) for key in {**old, **new}]
    elif old is None and isinstance(given, dict):
        pairs = [(key, None, value, value) for key, value in given.items()]
    elif _are_tables(old) and _are_tables(new) and len(old) == len(new):
        rows = given if isinstance(given, list) else new
        pairs = [(str(i), *three) for i, three in enumerate(zip(old, new, rows, strict=True))]
    for key, before, after, said in pairs:
        yield from _altered(before, after, said, f"{path}.{key}" if path else key)
    if not pairs and old != new:
        yield path, new


def _are_tables(values: Any) -> bool:
    return isinstance(values, list) and bool(values) and all(isinstance(value, dict) for value in values)


def _short_value(value: Any) -> str:
    """Return a value as short text, with six digits of a number."""
    if value is None:
        return "none"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, list):
        text = f"[{', '.join(map(_short_value, value))}]"
    elif isinstance(value, dict):
        text = f"{{{', '.join(f'{key} = {_short_value(item)}' for key, item in value.items() if item is not None)}}}"
    else:
        text = str(value)
    return text if len(text) <= LONGEST_VALUE else f"{text[: LONGEST_VALUE - 3]}..."
