"""The command `aerobat compare`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from aerobat_pin.cli.console import files_in
from aerobat_pin.cli.options import Force


def compare_command(
    first: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run.")],
    second: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of another run.")],
    out: Annotated[Path | None, typer.Option(help="Output folder; default runs/compare-<first>-<second>.")] = None,
    force: Force = False,
) -> None:
    """Set two runs side by side: what differs between their scenarios, their scores and their figures."""
    from aerobat_pin.errors import output_folder
    from aerobat_pin.visualization import compare_runs

    comparison = compare_runs(first, second)
    typer.echo(str(comparison))
    target = out or Path("runs") / f"compare-{first.resolve().name}-{second.resolve().name}"
    with output_folder(target, force=force, replaces=comparison.FILES) as folder:
        comparison.write(folder)
        files = files_in(folder)
    typer.echo(f"\nresults in {target}/: {', '.join(map(str, files))}\nopen {target / 'comparison.html'}")
