"""A morphology as files of its own: URDF, SRDF, linkage and meshes in a folder, for tools that know nothing of us."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from aerobat_description import MORPHOLOGIES, PACKAGE_PATH
from aerobat_description.generate import files
from aerobat_description.morphology import Morphology
from aerobat_description.write_urdf import PACKAGE_MESHES, urdf_text

MeshPaths = Literal["package", "relative", "absolute"]


def export(morphology: Morphology, target: Path, meshes: MeshPaths = "package") -> dict[Path, bytes]:
    """Return the files of a robot: path -> content. Nothing is written.

    The URDF goes to `target`, the SRDF beside it, linkage and meshes into `linkage/` and `meshes/` there. Paths of
    meshes in the URDF are `package://<folder of target>/meshes/...`, relative to the URDF, or absolute.

    Args:
        morphology: the robot.
        target: file of the URDF.
        meshes: how the URDF names the meshes.
    """
    target = target.absolute()
    folder = target.parent
    uri = {
        "package": f"package://{folder.name}/meshes",
        "relative": "meshes",
        "absolute": (folder / "meshes").as_posix(),
    }[meshes]
    meshdir = uri if meshes == "absolute" else "meshes"
    made = {target: urdf_text(morphology, uri, meshdir).encode()}
    for name, content in files(morphology).items():
        path = Path(name)
        if path.parent.name == "meshes":
            made[folder / "meshes" / path.name] = content
        elif path.parent.name == "linkage":  # in a folder of its own, for beside the URDF there may lie the morphology
            made[folder / "linkage" / f"{target.stem}.toml"] = content
        elif path.suffix != ".urdf":
            made[target.with_suffix(path.suffix)] = content
    return made


def shipped_urdf(morphology: Morphology, meshes: MeshPaths = "package") -> str | None:
    """Return the URDF text of a shipped robot, whose meshes this package holds; None for any other robot.

    Args:
        morphology: the robot.
        meshes: as in `export`; relative paths are seen from this package's `urdf` folder.
    """
    if morphology.name not in MORPHOLOGIES or morphology != Morphology.load(morphology.name):
        return None
    absolute = Path(PACKAGE_PATH, "meshes").as_posix()
    uri = {"package": PACKAGE_MESHES, "relative": "../meshes", "absolute": absolute}[meshes]
    return urdf_text(morphology, uri, absolute if meshes == "absolute" else "../meshes")
