"""The description is what its morphologies say, and refuses robots that cannot be."""

import os
import re
import struct
import subprocess
import sys
from collections import Counter
from contextlib import nullcontext
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pinocchio as pin
import pytest
from support.readers import PACKAGE, ROBOTS, URDF, in_pinocchio, plain

import aerobat_description as description
from aerobat_description.generate import files
from aerobat_description.meshes import parts
from aerobat_description.morphology import Morphology
from aerobat_description.morphology_tables import Body
from aerobat_description.reading import MorphologyError
from aerobat_pin.aerobat import JOINTS, load_aerobat
from aerobat_pin.errors import AerobatError, MorphologyFileError

LINKS = ("proximal", "distal")
SIDES = ("left", "right")
MIRROR = np.diag([1.0, -1.0, 1.0])
STANDARD_LIBRARY_ONLY = """
import sys
sys.path.insert(0, sys.argv[1])
import aerobat_description, aerobat_description.generate, aerobat_description.meshes, aerobat_description.morphology
for name in aerobat_description.MORPHOLOGIES:
    aerobat_description.generate.files(aerobat_description.morphology.Morphology.load(name))
strangers = {name.split(".")[0] for name in sys.modules} - sys.stdlib_module_names - {"aerobat_description"}
sys.exit(f"imported {strangers}" if strangers - {"__main__"} else 0)
"""


def test_the_description_needs_only_the_standard_library() -> None:
    """Import and generate everything in an isolated interpreter without site-packages."""
    subprocess.run([sys.executable, "-ISc", STANDARD_LIBRARY_ONLY, description.REPOSITORY_PATH], check=True)


def test_committed_files_are_small_and_what_the_generator_writes_and_nothing_more() -> None:
    """Byte for byte, for every morphology; no stale file beside them, none over 100 kB, 1.1 MB in all."""
    made = {path: data for name in description.MORPHOLOGIES for path, data in files(Morphology.load(name)).items()}
    for path, data in made.items():
        assert (PACKAGE / path).read_bytes() == data, path
    there = {
        str(file.relative_to(PACKAGE))
        for folder in ("urdf", "srdf", "mjcf", "meshes", "linkage")
        for file in (PACKAGE / folder).rglob("*")
        if file.is_file()
    }
    assert there == set(made)
    sizes = [file.stat().st_size for file in PACKAGE.rglob("*") if file.is_file() and "__pycache__" not in file.parts]
    assert max(sizes) < 100_000
    assert sum(sizes) < 1_100_000


def test_the_constants_point_at_what_is_there() -> None:
    """Names of robot_descriptions; Pinocchio wants the parent of the package folder as package directory."""
    for name in ("REPOSITORY_PATH", "PACKAGE_PATH", "URDF_PATH", "SRDF_PATH", "MJCF_PATH", "MESHES_PATH"):
        path = getattr(description, name)
        assert os.path.isabs(path), name
        assert Path(path).exists(), name
    assert all(Path(folder, "aerobat_description").samefile(PACKAGE) for folder in description.PACKAGE_DIRS)
    assert {file.stem for file in (PACKAGE / "morphologies").iterdir()} == set(description.MORPHOLOGIES)


@ROBOTS
def test_inertias_are_those_of_the_morphology(name: str) -> None:
    """Bit for bit in the URDF's text, and through Pinocchio; strict triangle inequality; no mass, no inertia."""
    model, root = in_pinocchio(name), ET.parse(URDF[name]).getroot()
    assert all(visual.find("material") is not None for visual in root.iter("visual"))  # no grey default
    for inertial in root.iter("inertial"):
        moments = [float(value) for value in inertial.find("inertia").attrib.values()]
        assert np.all(np.isfinite(moments))
        assert any(moments) == (float(inertial.find("mass").get("value")) > 0.0)
    for link, table in (("base_link", "body"), *((f"left_{panel}", panel) for panel in LINKS)):
        body = plain(name)[table]
        written = root.find(f"link[@name='{link}']/inertial")
        keys = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
        assert [float(written.find("inertia").get(key)) for key in keys] == body["inertia"]
        assert float(written.find("mass").get("value")) == body["mass"]
        read = model.inertias[model.frames[model.getFrameId(link)].parentJoint]
        xx, yy, zz, xy, xz, yz = body["inertia"]
        matrix = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        assert np.max(np.abs(read.inertia - matrix)) <= 1e-15 * np.max(matrix)
        assert read.lever == pytest.approx(body.get("com", [0.0, 0.0, 0.0]), rel=1e-15, abs=1e-18)
        small, middle, large = np.linalg.eigvalsh(matrix)
        assert max(0.0, large - middle) < small


@ROBOTS
def test_the_right_wing_is_the_exact_mirror_image_of_the_left(name: str) -> None:
    """Reflection in the x-z plane: masses, centres of mass, inertias, and every frame at equal joint angles."""
    model = in_pinocchio(name)
    data, q = model.createData(), pin.neutral(model)
    for joint, angle in zip(JOINTS, (0.4, -0.9, 0.4, -0.9), strict=True):
        q[model.joints[model.getJointId(joint)].idx_q] = angle
    pin.framesForwardKinematics(model, data, q)
    for panel in LINKS:
        left, right = (model.inertias[model.frames[model.getFrameId(f"{s}_{panel}")].parentJoint] for s in SIDES)
        assert left.mass == right.mass
        assert np.array_equal(right.lever, MIRROR @ left.lever)
        assert np.array_equal(right.inertia, MIRROR @ left.inertia @ MIRROR)
    for frame in (*LINKS, "force_point", "linkage_J1", "linkage_J8"):
        left, right = (data.oMf[model.getFrameId(f"{side}_{frame}")] for side in SIDES)
        assert right.translation == pytest.approx(MIRROR @ left.translation, abs=1e-16)
        assert right.rotation == pytest.approx(MIRROR @ left.rotation @ MIRROR, abs=1e-15)


def test_the_light_robot_has_the_inertias_of_its_shapes() -> None:
    """Textbook moments of a cylinder along x, a rod along y and a plate, of the sizes published for it."""
    m, r, length = 0.010, 0.025, 0.100
    body = (m * r**2 / 2, m * (r**2 / 4 + length**2 / 12), m * (r**2 / 4 + length**2 / 12))
    m, r, length = 0.001, 0.002, 0.050
    rod = (m * (r**2 / 4 + length**2 / 12), m * r**2 / 2, m * (r**2 / 4 + length**2 / 12))
    m, x, y, z = 0.004, 0.100, 0.120, 0.25e-3
    plate = (m * (y**2 + z**2) / 12, m * (x**2 + z**2) / 12, m * (x**2 + y**2) / 12)
    light = Morphology.load("aerobat_light")
    for part, moments in zip((light.body, light.proximal, light.distal), (body, rod, plate), strict=True):
        assert part.inertia == pytest.approx((*moments, 0.0, 0.0, 0.0), rel=1e-12)
    assert (light.proximal.com, light.distal.com) == ((0.0, 0.025, 0.0), (0.0, 0.060, 0.0))


@pytest.mark.parametrize("file", sorted(path.name for path in (PACKAGE / "meshes").iterdir()))
def test_meshes_are_closed_face_outward_and_measure_metres(file: str) -> None:
    """Every edge is walked once each way, the enclosed volume is positive, and nothing exceeds 0.6 m."""
    data = (PACKAGE / "meshes" / file).read_bytes()
    assert len(data) == 84 + 50 * struct.unpack_from("<I", data, 80)[0]
    facets = np.array([struct.unpack_from("<12f", data, 84 + 50 * i) for i in range((len(data) - 84) // 50)])
    normals, corners = facets[:, :3], facets[:, 3:].reshape(-1, 3, 3)
    walked = Counter((tuple(t[i]), tuple(t[(i + 1) % 3])) for t in corners for i in range(3))
    assert set(walked.values()) == {1}
    assert {(end, start) for start, end in walked} == set(walked)
    assert np.linalg.det(corners).sum() / 6.0 > 0.0
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.all(np.sum(normals * areas, axis=1) > 0.99 * np.linalg.norm(areas, axis=1))
    assert 0.01 < np.ptp(corners.reshape(-1, 3), axis=0).max() < 0.6


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[wing]\nofset_x = 0.0", r"unknown key 'wing\.ofset_x'; did you mean 'offset_x'\?"),
        ("[body]\nmass = -0.03", r"body\.mass = -0\.03: it must be positive"),
        ("[distal]\nmass = nan", r"distal\.mass = nan: finite numbers"),
        ("[distal]\ncom = [0.1, 0.2]", r"distal\.com = \[0\.1, 0\.2\]: a list of 3 numbers"),
        ("[body]\ninertia = [1e-4, 1e-4, 1e-4]", r"body\.inertia = .*: a list of 6 numbers"),
        ("[body]\nmass = 1" + 400 * "0", r"line 4: a word of 401 characters: at most 255"),
        ("[linkage]\nL2a = 1e200", r"linkage\.L2a = 1e\+200: finite numbers were expected, below 1e\+30"),
        ("[joints]\nelbow_limits = [0.7, -1.6]", r"joints\.elbow_limits = .*: the lower limit comes first"),
        ("[aerodynamics]\nprofile_drag = -1", r"aerodynamics\.profile_drag = -1\.0: it is not negative"),
        ("name = 'a b/c'", r"name = 'a b/c': letters, digits"),
        ("[body]\ninertia = [1e-4, 1e-4, 2e-4, 0, 0, 0]", r"body\.inertia = .*: each principal moment .* smaller"),
        ("[wing]\ndistal_stations = [0.0, 0.1]", r"wing\.distal_stations = .*: .* same length"),
        ("[wing]\nproximal_stations = [0.0, 0.0]", r"wing\.proximal_stations = .*: stations start at 0 and increase"),
        ("[wing]\nproximal_leading_edge = [-0.2, 0.1]", r"wing\.proximal_leading_edge = .* ahead of the trailing edge"),
        ("body = 3", "body = 3: a table was expected"),
        ("mass = [", "not valid TOML"),
    ],
)
def test_a_morphology_that_cannot_be_is_refused_by_key_value_and_rule(tmp_path: Path, text: str, message: str) -> None:
    """The same message from the reader, and as this project's own error from `load_aerobat`."""
    file = tmp_path / "odd.toml"
    name = "" if text.startswith("name") else 'name = "odd"'
    file.write_text(f'extends = "aerobat"\n{name}\n{text}\n')
    with pytest.raises(MorphologyError, match=message):
        Morphology.load(file)
    with pytest.raises(MorphologyFileError, match=message) as caught:
        load_aerobat(file)
    assert isinstance(caught.value, AerobatError)


def test_an_inertia_is_refused_exactly_when_no_body_can_have_it() -> None:
    """Strict triangle inequality of the principal moments, by eigenvalues here, on 400 random symmetric matrices."""
    verdicts = []
    for half in np.random.default_rng(12).normal(size=(400, 3, 3)):
        J = 6.0 * np.eye(3) + half + half.T
        small, middle, large = np.linalg.eigvalsh(J)
        verdicts.append(max(0.0, large - middle) < small)
        with nullcontext() if verdicts[-1] else pytest.raises(MorphologyError, match="principal moment"):
            Body(1.0, (*np.diag(J), J[0, 1], J[0, 2], J[1, 2])).check("body")
    assert 100 < sum(verdicts) < 300


def test_a_morphology_that_is_not_there_is_refused(tmp_path: Path) -> None:
    """Unknown names list the shipped ones; a file must be complete, or extend a shipped morphology."""
    said = r"'aerobot': did you mean 'aerobat'\? Shipped are aerobat, aerobat_g"
    with pytest.raises(MorphologyFileError, match=said):
        load_aerobat("aerobot")
    own = "a robot that extends 'aerobat' has a name of its own"
    for text, message in (
        ('name = "mine"', "missing key 'description'"),
        ('extends = "mine"', "extends = 'mine'"),
        ('extends = "aerobat"', rf"mine\.toml: missing key 'name': {own}"),
        ('extends = "aerobat"\nname = "aerobat"', "extends = 'aerobat': name another shipped morphology"),
    ):
        (tmp_path / "mine.toml").write_text(text)
        with pytest.raises(MorphologyError, match=message):
            Morphology.load(tmp_path / "mine.toml")
    with pytest.raises(MorphologyError, match="did you mean 'linkage'"):
        Morphology.load("aerobat", {"linkages": {}})


@ROBOTS
def test_a_loaded_robot_shows_its_parts_and_takes_changes(name: str) -> None:
    """The model equals the committed URDF and SRDF; `changes` move the whole wing and nothing else."""
    robot, moved = load_aerobat(name), load_aerobat(name, {"wing": {"offset_x": -0.06}})
    committed = in_pinocchio(name).copy()
    pin.loadReferenceConfigurations(committed, str(PACKAGE / "srdf" / f"{name}.srdf"))
    for limit in ("lowerPositionLimit", "upperPositionLimit", "velocityLimit", "effortLimit"):
        setattr(committed, limit, getattr(robot.model, limit))  # the base's, which a URDF cannot say
    assert robot.model == committed
    assert {item.name for item in robot.visual_model.geometryObjects} == set(parts(robot.morphology))
    assert np.array_equal(robot.model.referenceConfigurations["neutral"], pin.neutral(robot.model))
    for side, sign in zip(SIDES, (1.0, -1.0), strict=True):
        joint = robot.model.getJointId(f"{side}_shoulder")
        place, new_place = (r.model.jointPlacements[joint].translation for r in (robot, moved))
        assert place == pytest.approx([0.0075, sign * 20.6732e-3, 7.5244e-3], abs=5e-8)
        assert new_place == pytest.approx([-0.06, *place[1:]], abs=1e-18)
    assert moved.mass == robot.mass


@ROBOTS
def test_the_srdf_says_of_every_pair_why_it_need_not_be_looked_at(name: str) -> None:
    """Adjacent: those that a turning joint joins. Never: all others."""
    joints = ET.parse(URDF[name]).findall("joint[@type='revolute']")
    joined = {frozenset((one.find("parent").get("link"), one.find("child").get("link"))) for one in joints}
    pairs = [
        (frozenset((one.get("link1"), one.get("link2"))), one.get("reason"))
        for one in ET.parse(PACKAGE / "srdf" / f"{name}.srdf").findall("disable_collisions")
    ]
    assert len(pairs) == len(dict(pairs)) == 10
    assert {pair for pair, reason in pairs if reason == "Adjacent"} == joined
    assert {reason for _, reason in pairs} == {"Adjacent", "Never"}


@ROBOTS
def test_collision_boxes_overlap_at_no_crank_angle(name: str) -> None:
    """By Pinocchio, in 180 poses, also of links that a joint joins; half a millimetre apart, so nothing rests on it."""
    robot = load_aerobat(name)
    boxes = robot.collision_model.copy()
    boxes.addAllCollisionPairs()
    assert len(boxes.collisionPairs) == 10
    data, work = robot.model.createData(), boxes.createData()
    cycle = robot.linkage.solve(np.radians(np.arange(0.0, 360.0, 2.0)))
    least = np.inf
    for q in robot.configuration(np.tile(pin.neutral(robot.model)[:7], (180, 1)), cycle.theta_s, cycle.theta_e):
        pin.updateGeometryPlacements(robot.model, data, boxes, work, q)
        pin.computeDistances(boxes, work)
        least = min(least, *(result.min_distance for result in work.distanceResults))
    assert least > 0.5e-3


def test_every_test_that_the_page_names_is_there() -> None:
    folder = Path(__file__).parent
    page = (folder.parents[1] / "docs" / "upstream.md").read_text("utf-8")
    named = set(re.findall(r"`(test_\w+\.py)`", page))
    assert {name for name in named if not (folder / name).is_file()} == set()
    functions = set(re.findall(r"`(test_\w+)`", page))
    held = {one for file in folder.glob("test_*.py") for one in re.findall(r"^def (test_\w+)", file.read_text(), re.M)}
    assert functions - held == set()
