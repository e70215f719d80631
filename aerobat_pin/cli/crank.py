"""The command `aerobat crank`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from aerobat_pin.cli.options import Force, NameOrFile


def crank_command(
    morphology: NameOrFile = "aerobat",
    output: Annotated[Path, typer.Option("--output", "-o", help="The page, an HTML file.")] = Path("crank.html"),
    force: Force = False,
) -> None:
    """Write a page on which one turns the crank by hand and changes the linkage's lengths; it needs no network."""
    from aerobat_pin.errors import check_file, write_text
    from aerobat_pin.robot import load_morphology
    from aerobat_pin.visualization import crank_page

    check_file(output, force=force)
    write_text(output, crank_page(load_morphology(morphology)))
    typer.echo(f"written to {output}")
