"""Export a morphology as URDF, SRDF, linkage and meshes in one folder, for tools that do not use this package."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from aerobat_description import MORPHOLOGIES, PACKAGE_PATH
from aerobat_description.generate import files
from aerobat_description.morphology import Morphology
from aerobat_description.write_urdf import PACKAGE_MESHES, urdf_text

MeshPaths = Literal["package", "relative", "absolute"]


def export(morphology: Morphology, target: Path, meshes: MeshPaths = "package") -> dict[Path, bytes]:
    """Return the files of a robot without writing them.

    The path of the URDF is `target`; the SRDF and the folders `linkage/` and `meshes/` are in the same folder. In the
    URDF, the paths of the meshes are `package://<folder of target>/meshes/...`, relative to the URDF, or absolute.

    Args:
        morphology: the robot.
        target: path of the URDF file.
        meshes: kind of the mesh paths in the URDF.

    Returns:
        Path -> content of each file.
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
        elif path.parent.name == "linkage":  # in a subfolder: the morphology beside the URDF can have the same name
            made[folder / "linkage" / f"{target.stem}.toml"] = content
        elif path.suffix != ".urdf":
            made[target.with_suffix(path.suffix)] = content
    return made


def shipped_urdf(morphology: Morphology, meshes: MeshPaths = "package") -> str | None:
    """Return the URDF text of a shipped robot, whose meshes are in this package; None for any other robot.

    Args:
        morphology: the robot.
        meshes: kind of the mesh paths, as in `export`; relative paths start at the `urdf` folder of this package.
    """
    if morphology.name not in MORPHOLOGIES or morphology != Morphology.load(morphology.name):
        return None
    absolute = Path(PACKAGE_PATH, "meshes").as_posix()
    uri = {"package": PACKAGE_MESHES, "relative": "../meshes", "absolute": absolute}[meshes]
    return urdf_text(morphology, uri, absolute if meshes == "absolute" else "../meshes")
