"""The channels that a log may lack: all of a channel's columns are there or none, and so are its samples in a row."""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np

from aerobat_pin.errors import LogError
from aerobat_pin.records.channels import Request
from aerobat_pin.records.columns import Columns, in_step
from aerobat_pin.records.map_tables import ChannelSection
from aerobat_pin.records.table_cells import line_of
from aerobat_pin.scenario import Section

MapPart = TypeVar("MapPart", bound=Section)


def without_absent(table: MapPart, columns: Columns) -> MapPart:
    """Return a table of a map without the optional channels that a log does not have.

    Raises:
        LogError: the log has some columns of an optional channel and lacks others.
    """
    changes: dict[str, Any] = {}
    for key, value in table:
        present: Any = value
        if isinstance(value, ChannelSection):
            present = value if _is_there(value, columns) else None
        elif isinstance(value, dict) and any(isinstance(section, ChannelSection) for section in value.values()):
            present = {name: section for name, section in value.items() if _is_there(section, columns)}
        elif isinstance(value, Section):
            present = without_absent(value, columns)
        if present != value:
            changes[key] = present
    return table.model_copy(update=changes) if changes else table


def _is_there(section: ChannelSection, columns: Columns) -> bool:
    """Return whether a log has a channel; one that is not optional is asked for in any case."""
    if not section.optional:
        return True
    if section.topic is not None and not section.columns:
        return any(name.startswith(f"{section.topic}.") for name in columns.names)
    present = [name for name in section.columns if name in columns.values]
    missing = [name for name in section.columns if name not in columns.values]
    if present and missing:
        raise LogError(f"log {columns.path}: {', '.join(present)} without {', '.join(missing)}: all of them or none")
    return not missing


def check_same_rows(request: Request, columns: Columns) -> None:
    """Raise LogError if a row has samples in some columns of a channel and none in others."""
    series = [columns.values[name] for name in request.names if name in columns.values]
    if all(values.finite for values in series) or len({columns.clock_of[name] for name in request.names}) > 1:
        return
    before = 0
    for pieces in in_step(*series):
        empty = ~np.isfinite(np.stack(pieces, axis=1))
        part = np.any(empty, axis=1) & ~np.all(empty, axis=1)
        if np.any(part):
            row = int(np.argmax(part))
            name, every = request.names[int(np.argmax(empty[row]))], ", ".join(request.names)
            where = f"log {columns.path}, line {line_of(columns.path, before + row)}"
            raise LogError(f"{where}: {name} is empty: all of {every} or none")
        before += len(empty)
