"""Generate the files of a morphology: URDF, SRDF, linkage and meshes.

To rewrite the committed files of all shipped morphologies, run: python -m aerobat_description.generate
"""

from __future__ import annotations

from pathlib import Path

from aerobat_description import MORPHOLOGIES, PACKAGE_PATH
from aerobat_description.bars import closing_bars
from aerobat_description.meshes import binary_stl, parts
from aerobat_description.morphology import Morphology
from aerobat_description.sidecar import linkage_toml
from aerobat_description.write_urdf import mesh_name, srdf_text, urdf_text


def files(morphology: Morphology) -> dict[str, bytes]:
    """Return all generated files of a morphology: path relative to the package -> content."""
    made = {
        f"urdf/{morphology.name}.urdf": urdf_text(morphology).encode(),
        f"srdf/{morphology.name}.srdf": srdf_text(morphology).encode(),
    }
    for name, part in parts(morphology).items():
        made[f"meshes/{mesh_name(morphology, name)}"] = binary_stl(part.mesh)
    made[f"linkage/{morphology.name}.toml"] = linkage_toml(morphology).encode()
    for name, (bar, side) in closing_bars(morphology.linkage).items():
        made[f"meshes/{mesh_name(morphology, name)}"] = binary_stl(bar.mesh(side))
    return made


def rewrite_files() -> None:
    """Rewrite the committed files of every shipped morphology."""
    for name in MORPHOLOGIES:
        for relative, content in files(Morphology.load(name)).items():
            path = Path(PACKAGE_PATH, relative)
            path.parent.mkdir(exist_ok=True)
            path.write_bytes(content)
            print(f"{relative}  {len(content)} bytes")


if __name__ == "__main__":
    rewrite_files()
