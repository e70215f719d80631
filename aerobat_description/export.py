"""Export a morphology for tools that do not use this package: URDF, SRDF, linkage and meshes, or MJCF and meshes.

All files are in one folder.
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from aerobat_description import MORPHOLOGIES, PACKAGE_PATH
from aerobat_description.bars import BarMasses
from aerobat_description.generate import files
from aerobat_description.morphology import Morphology
from aerobat_description.write_mjcf import mjcf_text
from aerobat_description.write_urdf import PACKAGE_MESHES, urdf_text

Form = Literal["urdf", "mjcf"]
MeshPaths = Literal["package", "relative", "absolute"]


def export(
    morphology: Morphology,
    target: Path,
    form: Form = "urdf",
    meshes: MeshPaths | None = None,
    bars: BarMasses | None = None,
) -> dict[Path, bytes]:
    """Return the files of a robot without writing them: path -> content.

    Beside the URDF are its SRDF and the folders `linkage/` and `meshes/`, beside an MJCF file is the folder `meshes/`.

    Args:
        morphology: the robot.
        target: path of the URDF or MJCF file.
        form: which of the two it is.
        meshes: how it names its meshes: `package://<folder of target>/meshes/...` (of a URDF only, its default),
            relative to the file, or absolute.
        bars: of an MJCF file, masses of the linkage's bars, see `bar_bodies`; light when omitted.
    """
    target = target.absolute()
    folder = target.parent / "meshes"
    package = f"package://{target.parent.name}/meshes"
    made = {target: _text(morphology, form, meshes, bars, package, "meshes", folder).encode()}
    for name, content in files(morphology).items():
        path = Path(name)
        if path.parent.as_posix() == {"urdf": "meshes", "mjcf": "mjcf/meshes"}[form]:
            made[folder / path.name] = content
        elif form == "urdf" and path.parent.name == "linkage":  # the morphology beside the URDF can have the same name
            made[target.parent / "linkage" / f"{target.stem}.toml"] = content
        elif form == "urdf" and path.suffix == ".srdf":
            made[target.with_suffix(path.suffix)] = content
    return made


def shipped_text(
    morphology: Morphology, form: Form = "urdf", meshes: MeshPaths | None = None, bars: BarMasses | None = None
) -> str | None:
    """Return the URDF or MJCF text of a shipped robot, whose meshes are in this package; None for any other robot.

    The arguments are those of `export`; relative paths start at the folder `urdf` or `mjcf` of this package.
    """
    if morphology.name not in MORPHOLOGIES or morphology != Morphology.load(morphology.name):
        return None
    relative, folder = {"urdf": ("../meshes", "meshes"), "mjcf": ("meshes", "mjcf/meshes")}[form]
    return _text(morphology, form, meshes, bars, PACKAGE_MESHES, relative, Path(PACKAGE_PATH, folder))


def _text(
    morphology: Morphology,
    form: Form,
    meshes: MeshPaths | None,
    bars: BarMasses | None,
    package: str,
    relative: str,
    absolute: Path,
) -> str:
    """Return the text of a robot whose meshes are in a folder with these three paths."""
    meshdir = absolute.as_posix() if meshes == "absolute" else relative
    if form == "mjcf":
        return mjcf_text(morphology, bars or "light", meshdir)
    return urdf_text(morphology, package if meshes in (None, "package") else meshdir, meshdir)
