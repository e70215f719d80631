"""The command `aerobat urdf`."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from aerobat_pin.cli.options import Force, NameOrFile

if TYPE_CHECKING:
    from aerobat_description.morphology import Morphology

MeshOption = Literal["package", "relative", "absolute"]
BarOption = Literal["light", "cad"]


def urdf_command(
    morphology: NameOrFile = "aerobat",
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="File; what it needs goes beside it. Else it is printed.")
    ] = None,
    form: Annotated[
        Literal["urdf", "mjcf"], typer.Option("--format", help="URDF: a tree. MJCF: with the closed linkage.")
    ] = "urdf",
    meshes: Annotated[
        MeshOption | None, typer.Option(help="How the file names its meshes; default package, relative for MJCF.")
    ] = None,
    bars: Annotated[
        BarOption | None,
        typer.Option(help="MJCF: masses of the linkage's bars, a hundredth of the CAD's or those; light."),
    ] = None,
    force: Force = False,
) -> None:
    """Convert a morphology to URDF, SRDF and meshes, or to MJCF and meshes, for other tools."""
    from aerobat_pin.errors import OutputError, check_file, write_files
    from aerobat_pin.robot import load_morphology

    if form == "mjcf" and meshes == "package":
        raise OutputError("urdf: --meshes package: MJCF knows no packages; relative or absolute was expected")
    if form == "urdf" and bars is not None:
        raise OutputError(f"urdf: --bars {bars}: a URDF has no bars that close its loops; --format mjcf was expected")
    robot = load_morphology(morphology)
    if output is None:
        text = _printed(robot, form, meshes, bars)
        if text is None:
            raise OutputError(f"robot {robot.name}: its meshes must be written somewhere; give --output FILE")
        typer.echo(text, nl=False)
        return
    contents = _exported(robot, output, form, meshes, bars)
    for path in (output, *filter(os.path.exists, contents)):
        check_file(path, force=force)
    write_files(contents)
    typer.echo(f"written {output} and, beside it, {len(contents) - 1} files it needs:")
    for path in contents:
        if path != output.absolute():
            typer.echo(f"  {path}")


def _printed(robot: Morphology, form: str, meshes: MeshOption | None, bars: BarOption | None) -> str | None:
    from aerobat_description.export import shipped_mjcf, shipped_urdf

    if form == "mjcf":
        return shipped_mjcf(robot, absolute=meshes == "absolute", bars=bars or "light")
    return shipped_urdf(robot, meshes or "package")


def _exported(
    robot: Morphology, output: Path, form: str, meshes: MeshOption | None, bars: BarOption | None
) -> dict[Path, bytes]:
    from aerobat_description.export import export, export_mjcf

    if form == "mjcf":
        return export_mjcf(robot, output, absolute=meshes == "absolute", bars=bars or "light")
    return export(robot, output, meshes or "package")
