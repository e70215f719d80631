"""Read TOML files by path or by shipped name, and write scenarios as TOML."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import tomli_w

from aerobat_description.toml_text import TomlError, toml_file
from aerobat_pin.errors import AerobatError
from aerobat_pin.numerics import guarded
from aerobat_pin.scenario.section import Section

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
    raise error(f"no {kind} '{source}': shipped are {', '.join(shipped_names(shipped))}; or give a TOML file")


@guarded()
def scenario_toml(scenario: Section) -> str:
    """Return a scenario with all its defaults as TOML text that `load_scenario` can read."""

    def in_one_line(found: re.Match[str]) -> str:
        return f"[{', '.join(line.strip(' ,') for line in found[1].splitlines())}]"

    return PLAIN_LIST.sub(in_one_line, tomli_w.dumps(scenario.model_dump(exclude_none=True)))


def scenario_value(value: Any) -> str:
    """Return one value as TOML on a single line."""
    if isinstance(value, tuple | list):
        return f"[{', '.join(scenario_value(item) for item in value)}]"
    return tomli_w.dumps({"value": value}).removeprefix("value = ").rstrip("\n")
