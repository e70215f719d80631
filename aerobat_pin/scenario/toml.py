"""A scenario as TOML text."""

from __future__ import annotations

import re
from typing import Any

import tomli_w

from aerobat_pin.scenario.tables import Section

PLAIN_LIST = re.compile(r"\[\n((?: +[^\n\[\]{}]+,\n)+) *\]")  # as tomli_w writes it: each value on a line of its own


def scenario_toml(scenario: Section) -> str:
    """Write a resolved scenario, every default included, as TOML that `load_scenario` reads back."""

    def in_one_line(found: re.Match[str]) -> str:
        return f"[{', '.join(line.strip(' ,') for line in found[1].splitlines())}]"

    return PLAIN_LIST.sub(in_one_line, tomli_w.dumps(scenario.model_dump(exclude_none=True)))


def scenario_value(value: Any) -> str:
    """Write one value as TOML, in one line."""
    if isinstance(value, tuple | list):
        return f"[{', '.join(scenario_value(item) for item in value)}]"
    return tomli_w.dumps({"value": value}).removeprefix("value = ").rstrip("\n")
