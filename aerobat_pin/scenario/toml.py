"""A scenario as TOML text."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from aerobat_pin.scenario.tables import Section


def scenario_toml(scenario: Section) -> str:
    """Write a resolved scenario, every default included, as TOML that `load_scenario` reads back."""
    values = scenario.model_dump(exclude_none=True)
    return "\n".join(_table_lines(values, ())).strip() + "\n"


def _table_lines(values: Mapping[str, Any], path: tuple[str, ...]) -> list[str]:
    """Write plain values first, then tables, then lists of tables."""
    lines, tables, lists = [], [], []
    for key, value in values.items():
        if isinstance(value, Mapping):
            if value:
                tables += ["", f"[{'.'.join((*path, key))}]", *_table_lines(value, (*path, key))]
        elif isinstance(value, tuple | list) and value and isinstance(value[0], Mapping):
            for item in value:
                lists += ["", f"[[{'.'.join((*path, key))}]]", *_table_lines(item, (*path, key))]
        else:
            lines.append(f"{key} = {scenario_value(value)}")
    return lines + tables + lists


def scenario_value(value: Any) -> str:
    """Write one value as TOML."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, tuple | list):
        return "[" + ", ".join(scenario_value(item) for item in value) + "]"
    return repr(value)
