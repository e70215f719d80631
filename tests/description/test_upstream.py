"""What collections of robots ask of a robot that is added to them; docs/upstream.md says where they ask it."""

import re
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pinocchio as pin
from support.readers import PACKAGE, ROBOTS, URDF, in_pinocchio

ROOT = Path(__file__).resolve().parents[2]
MOST_BYTES = 300_000  # of a mesh, as reviewers of example-robot-data saw it


@ROBOTS
def test_every_link_is_a_rigid_body_or_weighs_nothing(name: str) -> None:
    """Of the file itself: finite, positive, triangle inequality of the principal moments; no mass, no inertia."""
    for link in ET.parse(URDF[name]).getroot().iter("link"):
        mass, inertia = float(link.find("inertial/mass").get("value")), link.find("inertial/inertia")
        xx, xy, xz, yy, yz, zz = (float(inertia.get(f"i{axes}")) for axes in ("xx", "xy", "xz", "yy", "yz", "zz"))
        moments = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        assert np.all(np.isfinite([mass, *moments]))
        if mass == 0.0:
            assert np.all(moments == 0.0), link.get("name")
        else:
            assert mass > 0.0
            assert moments[0] > 0.0, link.get("name")
            assert moments[0] + moments[1] > moments[2], link.get("name")


@ROBOTS
def test_sizes_postures_and_colours_are_those_that_the_page_states(name: str) -> None:
    """As the unit tests of example-robot-data load it: nq = 11, nv = 10, a posture, small meshes, no grey default."""
    model = in_pinocchio(name).copy()
    pin.loadReferenceConfigurations(model, str(PACKAGE / "srdf" / f"{name}.srdf"))
    assert (model.nq, model.nv) == (11, 10)
    assert model.referenceConfigurations["neutral"].shape == (11,)
    visuals = list(ET.parse(URDF[name]).getroot().iter("visual"))
    assert visuals
    assert all(visual.find("material") is not None for visual in visuals)
    assert max(path.stat().st_size for path in (PACKAGE / "meshes").glob("*.stl")) < MOST_BYTES


def test_every_test_that_the_page_names_is_there() -> None:
    page, folder = (ROOT / "docs" / "upstream.md").read_text("utf-8"), Path(__file__).parent
    named = set(re.findall(r"`(test_\w+\.py)`", page))
    assert {name for name in named if not (folder / name).is_file()} == set()
    functions = set(re.findall(r"`(test_\w+)`", page))
    held = {one for file in folder.glob("test_*.py") for one in re.findall(r"^def (test_\w+)", file.read_text(), re.M)}
    assert functions - held == set()
