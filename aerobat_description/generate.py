"""Generate the files of a morphology: URDF, MJCF, SRDF, linkage and meshes.

To rewrite the committed files of all shipped morphologies, run: python -m aerobat_description.generate
"""

from __future__ import annotations

from pathlib import Path

from aerobat_description import MORPHOLOGIES, PACKAGE_PATH
from aerobat_description.bars import closing_bars
from aerobat_description.meshes import binary_stl, obj_text, parts
from aerobat_description.morphology import Morphology
from aerobat_description.sidecar import linkage_toml
from aerobat_description.write_mjcf import mjcf_text, obj_name
from aerobat_description.write_urdf import mesh_name, srdf_text, urdf_text


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


if __name__ == "__main__":
    rewrite_files()
