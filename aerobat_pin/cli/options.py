"""Arguments and options that several commands share."""

from __future__ import annotations

from typing import Annotated

import typer

NameOrFile = Annotated[str, typer.Argument(help="Shipped name (see `aerobat list`) or TOML file.")]
BelievedMorphology = Annotated[
    str | None,
    typer.Option("--morphology", help="Robot that flew a log: shipped name or TOML file; else what the log notes."),
]
Settings = Annotated[
    list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Set one dotted key; repeatable.")
]
ObserverNames = Annotated[
    list[str] | None, typer.Option("--observer", metavar="NAME", help="Run this observer; repeatable.")
]
Force = Annotated[bool, typer.Option("--force", help="Replace files of an earlier run.")]
