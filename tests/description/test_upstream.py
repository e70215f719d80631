"""What collections of robots ask of a robot that is added to them; docs/upstream.md says where they ask it."""

import re
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
from support.readers import ROBOTS, URDF, in_pinocchio

ROOT = Path(__file__).resolve().parents[2]


@ROBOTS
def test_the_urdf_is_what_the_page_states(name: str) -> None:
    """Eleven positions, ten velocities; on every link a body of strict triangle inequality, or no mass and inertia.

    A colour for every visual, as no reader's default grey is meant.
    """
    assert (in_pinocchio(name).nq, in_pinocchio(name).nv) == (11, 10)
    root = ET.parse(URDF[name]).getroot()
    for link in root.iter("link"):
        mass, inertia = float(link.find("inertial/mass").get("value")), link.find("inertial/inertia")
        xx, xy, xz, yy, yz, zz = (float(inertia.get(f"i{axes}")) for axes in ("xx", "xy", "xz", "yy", "yz", "zz"))
        small, middle, large = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        if mass == 0.0:
            assert small == large == 0.0, link.get("name")
        else:
            assert min(mass, small, small + middle - large) > 0.0, link.get("name")
    assert all(visual.find("material") is not None for visual in root.iter("visual"))


def test_every_test_that_the_page_names_is_there() -> None:
    """Files of this folder, and functions in them."""
    page, folder = (ROOT / "docs" / "upstream.md").read_text("utf-8"), Path(__file__).parent
    named = set(re.findall(r"`(test_\w+\.py)`", page))
    assert {name for name in named if not (folder / name).is_file()} == set()
    functions = set(re.findall(r"`(test_\w+)`", page))
    held = {
        name for file in folder.glob("test_*.py") for name in re.findall(r"^def (test_\w+)", file.read_text(), re.M)
    }
    assert functions - held == set()
