"""Arguments and options that several commands share."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from aerobat_pin.estimation import Calibration

PROJECT_FOLDER = Path(__file__).parents[2]
SHIPPED = {  # command -> folder of what its first argument can name
    "sweep": "aerobat_pin/experiments/sweep/shipped",
    "urdf": "aerobat_description/morphologies",
    "linkage": "aerobat_description/morphologies",
    "crank": "aerobat_description/morphologies",
}

RENAMED = {  # command -> how options were called -> how they are called now
    "urdf": {"--output": "--out"},
    "crank": {"--output": "--out"},
    "play": {"--html": "--out"},
    "convert": {"--mcap": "--out"},
}


def renamed(words: list[str]) -> list[str]:
    """Return a command line with options as they are called now, and tell of each that was called otherwise."""
    now = RENAMED.get(words[0] if words else "", {})
    for k, word in enumerate(words):
        option, equals, value = word.partition("=")
        if option in now:
            typer.echo(f"note: {option} of `aerobat {words[0]}` is called {now[option]} now", err=True)
            words[k] = f"{now[option]}{equals}{value}"
    return words


def out_option(what: str) -> Any:
    """Return the option `--out`, which says where a command writes; missing folders are made."""
    return typer.Option("--out", "-o", help=what)


def read_learnt(calibration: Path | None, *, correct: bool) -> Calibration | None:
    """Return what a calibration's file says, if one is given. Raises CalibrationError if it cannot be, or must be."""
    from aerobat_pin.errors import CalibrationError

    if calibration is not None:
        from aerobat_pin.estimation import read_calibration

        return replace(read_calibration(calibration), correct=correct)
    if correct:
        raise CalibrationError("--correct takes off what changed since a calibration: --calibration FILE was expected")
    return None


def option_names(words: str | None) -> list[str]:
    """Return the names that an option lists, with commas between them."""
    return [word.strip() for word in (words or "").split(",") if word.strip()]


def one_each(names: list[str] | None) -> list[str] | None:
    """Return the names of a repeatable option. Raises BadParameter where one is a list with commas."""
    for name in names or []:
        if "," in name:
            repeated = " ".join(f"--observer {each}" for each in option_names(name))
            raise typer.BadParameter(f"'{name}': one name each was expected, such as {repeated}")
    return names


def complete_name(ctx: typer.Context, incomplete: str) -> list[str]:
    """Return the shipped names that begin with what was typed, for completion in a shell."""
    folder = PROJECT_FOLDER / SHIPPED.get(ctx.info_name or "", "aerobat_pin/scenario/shipped")
    return sorted(path.stem for path in folder.glob("*.toml") if path.stem.startswith(incomplete))


def complete_observer(incomplete: str) -> list[str]:
    """Return the observers that begin with what was typed, for completion in a shell."""
    from aerobat_pin.observers import OBSERVERS

    return [name for name in OBSERVERS if name.startswith(incomplete)]


def complete_key(ctx: typer.Context, incomplete: str) -> list[str]:
    """Return the keys of a scenario, or of a map, that begin with what was typed, for completion in a shell."""
    from aerobat_pin.scenario import scenario_keys

    if ctx.params.get("what") == "map":
        from aerobat_pin.records import Map

        return [key for key in scenario_keys(Map) if key.startswith(incomplete)]
    return [key for key in scenario_keys() if key.startswith(incomplete)]


def complete_setting(ctx: typer.Context, incomplete: str) -> list[str]:
    """Return the keys of a scenario as `--set` takes them, for completion in a shell."""
    return [f"{key}=" for key in complete_key(ctx, incomplete)]


NameOrFile = Annotated[
    str, typer.Argument(help="Shipped name (see `aerobat list`) or TOML file.", autocompletion=complete_name)
]
BelievedMorphology = Annotated[
    str | None,
    typer.Option("--morphology", help="Robot that flew a log: shipped name or TOML file; else what the log notes."),
]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Set one dotted key; repeatable.", autocompletion=complete_setting),
]
ObserverNames = Annotated[
    list[str] | None,
    typer.Option(
        "--observer",
        metavar="NAME",
        help="Run this observer; repeatable.",
        autocompletion=complete_observer,
        callback=one_each,
    ),
]
CalibrationFile = Annotated[
    Path | None, typer.Option(metavar="FILE", help="What `aerobat calibrate` learnt about this belief.")
]
Correct = Annotated[
    bool, typer.Option("--correct", help="Correct what changed since the calibration where it has a name.")
]
Force = Annotated[bool, typer.Option("--force", help="Replace earlier results.")]
