"""Export a morphology for tools that do not use this package: URDF, SRDF, linkage and meshes, or MJCF and meshes.

All files are in one folder.
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from aerobat_description import MORPHOLOGIES, PACKAGE_PATH
from aerobat_description.bar_bodies import BarMasses
from aerobat_description.generate import files
from aerobat_description.morphology import Morphology
from aerobat_description.write_mjcf import mjcf_text
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
        if path.parts[0] == "meshes":
            made[folder / "meshes" / path.name] = content
        elif path.parent.name == "linkage":  # in a subfolder: the morphology beside the URDF can have the same name
            made[folder / "linkage" / f"{target.stem}.toml"] = content
        elif path.suffix == ".srdf":
            made[target.with_suffix(path.suffix)] = content
    return made


def export_mjcf(
    morphology: Morphology, target: Path, *, absolute: bool = False, bars: BarMasses = "light"
) -> dict[Path, bytes]:
    """Return the files of a robot with its closed linkage without writing them: the MJCF file, and meshes beside it.

    Args:
        morphology: the robot.
        target: path of the MJCF file.
        absolute: write the path of the meshes' folder as an absolute one.
        bars: masses of the linkage's bars, see `bar_bodies`.

    Returns:
        Path -> content of each file.
    """
    target = target.absolute()
    folder = target.parent / "meshes"
    made = {target: mjcf_text(morphology, bars, folder.as_posix() if absolute else "meshes").encode()}
    meshes = {name: content for name, content in files(morphology).items() if name.startswith("mjcf/meshes/")}
    return made | {folder / Path(name).name: content for name, content in meshes.items()}


def shipped_mjcf(morphology: Morphology, *, absolute: bool = False, bars: BarMasses = "light") -> str | None:
    """Return the MJCF text of a shipped robot, whose meshes are in this package; None for any other robot.

    Args:
        morphology: the robot.
        absolute: name the folder of the meshes by its absolute path, else from the `mjcf` folder of this package.
        bars: masses of the linkage's bars, see `bar_bodies`.
    """
    if not _is_shipped(morphology):
        return None
    return mjcf_text(morphology, bars, Path(PACKAGE_PATH, "mjcf", "meshes").as_posix() if absolute else "meshes")


def shipped_urdf(morphology: Morphology, meshes: MeshPaths = "package") -> str | None:
    """Return the URDF text of a shipped robot, whose meshes are in this package; None for any other robot.

    Args:
        morphology: the robot.
        meshes: kind of the mesh paths, as in `export`; relative paths start at the `urdf` folder of this package.
    """
    if not _is_shipped(morphology):
        return None
    absolute = Path(PACKAGE_PATH, "meshes").as_posix()
    uri = {"package": PACKAGE_MESHES, "relative": "../meshes", "absolute": absolute}[meshes]
    return urdf_text(morphology, uri, absolute if meshes == "absolute" else "../meshes")


def _is_shipped(morphology: Morphology) -> bool:
    return morphology.name in MORPHOLOGIES and morphology == Morphology.load(morphology.name)
