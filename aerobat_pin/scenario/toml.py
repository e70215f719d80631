"""TOML in, by a path or a shipped name, and scenarios out as TOML."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import tomli_w

from aerobat_pin.errors import AerobatError
from aerobat_pin.scenario.tables import Section

PLAIN_LIST = re.compile(r"\[\n((?: +[^\n\[\]{}]+,\n)+) *\]")  # as tomli_w writes it: each value on a line of its own


def shipped_names(folder: Path) -> list[str]:
    """Return the names of the TOML files of a folder of this package."""
    return sorted(path.stem for path in folder.glob("*.toml"))


def read_toml(kind: str, source: str, shipped: Path, error: Callable[[str], AerobatError]) -> dict[str, Any]:
    """Read a TOML file.

    Args:
        kind: of file, to begin a message with.
        source: shipped name, or path.
        shipped: folder of the shipped files.
        error: what to raise with a message.

    Raises:
        AerobatError: of the given kind: there is no such file, it cannot be read, or it is not TOML.
    """
    file = shipped / f"{source}.toml"
    if "/" in source or not file.is_file():
        file = Path(source)
    try:
        return tomllib.loads(file.read_text(encoding="utf-8"))
    except tomllib.TOMLDecodeError as cause:
        raise error(f"{kind} {source}: not valid TOML: {cause}") from cause
    except (OSError, UnicodeDecodeError) as cause:
        if file.is_file():
            raise error(f"{kind} file {file}: cannot be read: {cause}") from cause
    if source.endswith(".toml") or "/" in source:
        raise error(f"{kind} file {source}: there is no such file")
    raise error(f"no {kind} '{source}': shipped are {', '.join(shipped_names(shipped))}; or give a TOML file")


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
