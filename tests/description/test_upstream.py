"""What collections of robots ask of a robot that is added to them; docs/upstream.md says where they ask it."""

import re
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pinocchio as pin
import pytest

import aerobat_description as description

ROOT = Path(__file__).resolve().parents[2]
MOST_BYTES = 300_000  # of a mesh, as reviewers of example-robot-data saw it


def number(element: ET.Element, path: str, key: str) -> float:
    """Return an attribute of the first element at a path."""
    found = element.find(path)
    return float(found.attrib[key])


@pytest.mark.parametrize("name", description.MORPHOLOGIES)
def test_every_link_is_a_rigid_body_or_weighs_nothing(name: str) -> None:
    """Of the file itself: finite, positive, triangle inequality of the principal moments; no mass, no inertia."""
    for link in ET.parse(Path(description.PACKAGE_PATH, "urdf", f"{name}.urdf")).getroot().iter("link"):
        mass = number(link, "inertial/mass", "value")
        xx, xy, xz, yy, yz, zz = (
            number(link, "inertial/inertia", f"i{axes}") for axes in ("xx", "xy", "xz", "yy", "yz", "zz")
        )
        moments = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        assert np.all(np.isfinite([mass, *moments]))
        if mass == 0.0:
            assert np.all(moments == 0.0), link.get("name")
        else:
            assert mass > 0.0
            assert moments[0] > 0.0, link.get("name")
            assert moments[0] + moments[1] > moments[2], link.get("name")


@pytest.mark.parametrize("name", description.MORPHOLOGIES)
def test_sizes_postures_and_colours_are_those_that_the_page_states(name: str) -> None:
    """As the unit tests of example-robot-data load it: nq = 11, nv = 10, a posture, small meshes, no grey default."""
    urdf = Path(description.PACKAGE_PATH, "urdf", f"{name}.urdf")
    model = pin.buildModelFromUrdf(str(urdf), pin.JointModelFreeFlyer())
    pin.loadReferenceConfigurations(model, str(Path(description.PACKAGE_PATH, "srdf", f"{name}.srdf")))
    assert (model.nq, model.nv) == (11, 10)
    assert model.referenceConfigurations["neutral"].shape == (11,)
    visuals = list(ET.parse(urdf).getroot().iter("visual"))
    assert visuals
    assert all(visual.find("material") is not None for visual in visuals)
    assert max(path.stat().st_size for path in Path(description.MESHES_PATH).glob("*.stl")) < MOST_BYTES


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
