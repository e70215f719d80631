"""Generate the files of a morphology: URDF, MJCF, SRDF, linkage and meshes; or some of them, for other tools.

To rewrite the committed files of all shipped morphologies, run: python -m aerobat_description.generate
`export` puts a URDF or an MJCF file, and what it needs, into one folder for tools that do not use this package.
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from aerobat_description import MORPHOLOGIES, PACKAGE_PATH
from aerobat_description.bars import BarMasses, closing_bars
from aerobat_description.meshes import binary_stl, obj_text, parts
from aerobat_description.morphology import Morphology
from aerobat_description.sidecar import linkage_toml
from aerobat_description.write_mjcf import mjcf_text, obj_name
from aerobat_description.write_urdf import PACKAGE_MESHES, mesh_name, srdf_text, urdf_text

Form = Literal["urdf", "mjcf"]
MeshPaths = Literal["package", "relative", "absolute"]


def files(morphology: Morphology) -> dict[str, bytes]:
    """Return all generated files of a morphology: path relative to the package -> content."""
    made = {
        f"urdf/{morphology.name}.urdf": urdf_text(morphology).encode(),
        f"mjcf/{morphology.name}.xml": mjcf_text(morphology).encode(),
        f"srdf/{morphology.name}.srdf": srdf_text(morphology).encode(),
    }
    drawn = {name: part.mesh() for name, part in parts(morphology).items()}
    drawn |= {name: bar.mesh(side) for name, (bar, side) in closing_bars(morphology.linkage).items()}
    for name, mesh in drawn.items():
        file = mesh_name(morphology, name)
        made[f"meshes/{file}"] = binary_stl(mesh)
        made[f"mjcf/meshes/{obj_name(file)}"] = obj_text(mesh).encode()
    made[f"linkage/{morphology.name}.toml"] = linkage_toml(morphology).encode()
    return made


def rewrite_files() -> None:
    """Rewrite the committed files of every shipped morphology."""
    for name in MORPHOLOGIES:
        for relative, content in files(Morphology.load(name)).items():
            path = Path(PACKAGE_PATH, relative)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
            print(f"{relative}  {len(content)} bytes")


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


if __name__ == "__main__":
    rewrite_files()
