"""The robot Aerobat as data: morphologies, URDF, MJCF, SRDF and meshes. It needs only Python's standard library.

The constants are the paths of the default morphology, `aerobat`, and have the names that robot_descriptions expects.
"""

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent

REPOSITORY_PATH = str(_PACKAGE.parent)
PACKAGE_PATH = str(_PACKAGE)
URDF_PATH = str(_PACKAGE / "urdf" / "aerobat.urdf")
MJCF_PATH = str(_PACKAGE / "mjcf" / "aerobat.xml")
SRDF_PATH = str(_PACKAGE / "srdf" / "aerobat.srdf")
MESHES_PATH = str(_PACKAGE / "meshes")
PACKAGE_DIRS = [str(_PACKAGE.parent)]
MORPHOLOGIES = ("aerobat", "aerobat_guard", "aerobat_light")

__all__ = [
    "MESHES_PATH",
    "MJCF_PATH",
    "MORPHOLOGIES",
    "PACKAGE_DIRS",
    "PACKAGE_PATH",
    "REPOSITORY_PATH",
    "SRDF_PATH",
    "URDF_PATH",
]
