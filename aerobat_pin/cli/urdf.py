"""The command `aerobat urdf`."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Literal

import typer

from aerobat_pin.cli.options import Force, NameOrFile, out_option


def urdf_command(
    morphology: NameOrFile = "aerobat",
    out: Annotated[Path | None, out_option("File; what it needs goes beside it. Else it is printed.")] = None,
    form: Annotated[
        Literal["urdf", "mjcf"], typer.Option("--format", help="URDF: a tree. MJCF: with the closed linkage.")
    ] = "urdf",
    meshes: Annotated[
        Literal["package", "relative", "absolute"] | None,
        typer.Option(help="How the file names its meshes; default package, relative for MJCF."),
    ] = None,
    bars: Annotated[
        Literal["light", "cad"] | None,
        typer.Option(help="MJCF: masses of the linkage's bars, a hundredth of the CAD's or those; light."),
    ] = None,
    force: Force = False,
) -> None:
    """Convert a morphology to URDF, SRDF and meshes, or to MJCF and meshes, for other tools."""
    from aerobat_description.generate import export, shipped_text
    from aerobat_pin.aerobat import load_morphology
    from aerobat_pin.errors import OutputError, check_file, write_files

    if form == "mjcf" and meshes == "package":
        raise OutputError("urdf: --meshes package: MJCF knows no packages; relative or absolute was expected")
    if form == "urdf" and bars is not None:
        raise OutputError(f"urdf: --bars {bars}: a URDF has no bars that close its loops; --format mjcf was expected")
    robot = load_morphology(morphology)
    if out is None:
        text = shipped_text(robot, form, meshes, bars)
        if text is None:
            raise OutputError(f"robot {robot.name}: its meshes must be written somewhere; give --out FILE")
        typer.echo(text, nl=False)
        return
    contents = export(robot, out, form, meshes, bars)
    for path in (out, *filter(os.path.exists, contents)):
        check_file(path, force=force)
    write_files(contents, out.absolute().parent)
    typer.echo(f"written {out} and, beside it, {len(contents) - 1} files it needs:")
    for path in contents:
        if path != out.absolute():
            typer.echo(f"  {path}")
