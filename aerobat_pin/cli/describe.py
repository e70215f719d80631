"""The command `aerobat describe`."""

from __future__ import annotations

from typing import Annotated, Literal

import typer


def describe_command(
    what: Annotated[Literal["scenario", "map"], typer.Argument(help="What to describe.")],
    key: Annotated[
        str | None, typer.Argument(help="One table or key alone, such as crank or observers.gain; else all of them.")
    ] = None,
) -> None:
    """Print all keys of a scenario file or of a recording's map, or one, with type, unit, default and meaning."""
    from aerobat_pin.estimation import describe_map
    from aerobat_pin.scenario import describe_scenario

    typer.echo({"scenario": describe_scenario, "map": describe_map}[what](key), nl=False)
