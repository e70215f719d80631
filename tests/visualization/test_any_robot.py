"""Robots from strangers: only files of the robot's own packages enter a page; what is no robot is refused by name."""

import base64
import os
import re
import uuid
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import pytest
from support.bad_robots import ARM, COLLADA, MOTIONS, PICTURE, ROBOTS, SECRET, SHAPE, stl

from aerobat_description import PACKAGE_PATH
from aerobat_description.generate import shipped_text
from aerobat_description.morphology import Morphology
from aerobat_pin.errors import AerobatError, LogError
from aerobat_pin.records.robot_files import model_of_file, robot_of_map
from aerobat_pin.records.robot_tables import RobotTable
from aerobat_pin.visualization.replay.any_robot import load_any_robot, replay_table, sticks, visible_parts
from aerobat_pin.visualization.replay.moving_page import Replay
from aerobat_pin.visualization.replay.scene import box_corners, drawable

HOPPER = Path(__file__).parents[2] / "examples" / "recordings" / "teststand.urdf"
HINGE = '<joint name="j{0}" type="continuous"><parent link="l{0}"/><child link="l{1}"/><axis xyz="0 0 1"/></joint>'
BODY = (
    '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    '<visual><geometry><box size="0.1 0.1 0.1"/></geometry></visual>'
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder of a robot, with a table that moves it, beside files that are none of its business."""
    inside = tmp_path / "arm"
    (inside / "meshes").mkdir(parents=True)
    for place in (tmp_path, inside / "meshes"):
        (place / "bar.stl").write_bytes(stl(0.0, 0.0, 0.0))
        (place / "bar.png").write_bytes(PICTURE)
        (place / "bar.txt").write_bytes(SECRET)
    (inside / "motion.csv").write_text("time,q[0]\n0,0\n1,0.5\n")  # `[0]` is no unit
    return inside


def page_of(folder: Path, mesh: str) -> str:
    (folder / "arm.urdf").write_text(ARM.replace(SHAPE, f'<mesh filename="{mesh}"/>'))
    return replay_table(folder / "motion.csv", folder / "arm.urdf").html()


def test_meshes_of_the_robots_own_folders_are_drawn(folder: Path) -> None:
    """Relative, absolute, as an address; from a folder called urdf, its sibling; by `package.xml`, any below it."""
    for mesh in ("meshes/bar.stl", str(folder / "meshes" / "bar.stl"), f"file://{folder}/meshes/bar.stl"):
        page_of(folder, mesh)
    page_of(folder, "package://arm/meshes/bar.stl")
    for deeper in ("urdf", "some/where"):
        place = folder / deeper
        place.mkdir(parents=True)
        (place / "motion.csv").write_bytes((folder / "motion.csv").read_bytes())
        if deeper != "urdf":
            (folder / "package.xml").touch()
        page_of(place, os.path.relpath(folder / "meshes" / "bar.stl", place))
    absolute = shipped_text(Morphology.load("aerobat"), meshes="absolute")
    (folder / "bird.urdf").write_text(absolute)  # printed by `aerobat urdf --meshes absolute` and saved anywhere
    _, visual_model = load_any_robot(folder / "bird.urdf", 11, folder / "motion.csv")
    assert all(part.meshPath.startswith(PACKAGE_PATH) for part in visual_model.geometryObjects)


@pytest.mark.parametrize(
    ("mesh", "message"),
    [
        ("../bar.stl", r"names \.\./bar\.stl: a file in the folder of the robot"),
        ("{above}/bar.stl", "link .bar.: <mesh filename=.*>: a file in the folder of the robot"),
        ("file://{above}/bar.stl", "a file in the folder of the robot"),
        ("package://../bar.stl", "a file in the folder of the robot"),
        ("package://arm/../bar.stl", "a file in the folder of the robot"),
        ("package:///../bar.stl", "a file in the folder of the robot"),
        ("link.stl", "a file in the folder of the robot"),
        ("meshes/bar.txt", r"\.txt: one of \.dae, \.obj, \.stl was expected"),
        ("pipe.stl", "a folder, pipe or device: a file was expected"),
        ("meshes", "a folder, pipe or device: a file was expected"),
        ("http://example.org/a.stl", "there is no such file"),
        ("cut.stl", "Pinocchio cannot read it: Could not load resource"),
        ("nan.stl", r"mesh .*nan\.stl holds NaN or infinity"),
        ("huge.stl", "bytes: at most 100000000 were expected"),
    ],
)
def test_meshes_from_elsewhere_or_of_another_kind_are_refused(mesh: str, message: str, folder: Path) -> None:
    """By their address; and the page of a mesh that cannot be read is not the page of the robot."""
    (folder / "link.stl").symlink_to(folder.parent / "bar.stl")
    (folder / "cut.stl").write_bytes(stl(0.0, 0.0, 0.0)[:-9])
    (folder / "nan.stl").write_bytes(stl(np.nan, 0.0, 0.0))
    with (folder / "huge.stl").open("wb") as file:
        file.truncate(10**11)
    os.mkfifo(folder / "pipe.stl")
    with pytest.raises(LogError, match=message):
        page_of(folder, mesh.format(above=folder.parent))


@pytest.mark.parametrize(
    "texture",
    ["{above}/bar.txt", "../bar.txt", "../../bar.txt", "bar.txt", "{above}/bar.png", "../../bar.png", "link.png"],
)
def test_a_texture_pulls_no_file_into_the_page(texture: str, folder: Path) -> None:
    """A text within the folder is no picture, and a picture of another folder is not this robot's."""
    (folder / "meshes" / "link.png").symlink_to(folder.parent / "bar.png")
    (folder / "bar.txt").write_bytes(SECRET)
    (folder / "meshes" / "bar.dae").write_text(COLLADA.format(texture.format(above=folder.parent)))
    said = r"names .*: a (file in the folder of the robot's file|picture \(PNG, JPEG, GIF or BMP\))"
    with pytest.raises(LogError, match=said):
        page_of(folder, "meshes/bar.dae")


def test_a_texture_of_the_robots_own_is_drawn(folder: Path) -> None:
    (folder / "meshes" / "bar.dae").write_text(COLLADA.format("bar.png"))
    (folder / "arm.urdf").write_text(ARM.replace(SHAPE, '<mesh filename="meshes/bar.dae"/>'))
    recording = replay_table(folder / "motion.csv", folder / "arm.urdf")
    assert base64.b64encode(PICTURE)[:20].decode() in base64.b64decode(_commands(recording.html())).decode("latin-1")


def _commands(page: str) -> bytes:
    """Return the longest run of base64 text in a page: the command that draws the mesh."""
    runs = [run for run in re.findall(r'"([A-Za-z0-9+/=]{400,})"', page) if b"init_from" in base64.b64decode(run)]
    return runs[0].encode()


@pytest.mark.parametrize("text", ROBOTS)
def test_what_is_no_robot_is_refused_with_reason(text: str, folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Pinocchio's parser leaves out what it cannot read, and tells it to the terminal alone: the error says it here."""
    (folder / "arm.urdf").write_text(text)
    with pytest.raises(LogError, match=ROBOTS[text]):
        replay_table(folder / "motion.csv", folder / "arm.urdf")
    assert capfd.readouterr().err == ""


def test_a_robot_without_visible_parts_is_drawn_by_its_joints(folder: Path) -> None:
    """As sticks; it used to end in a message of numpy about shapes, then in a page on which nothing moved."""
    (folder / "arm.urdf").write_text(ARM.replace(f"<visual><geometry>{SHAPE}</geometry></visual>", ""))
    skeleton = replay_table(folder / "motion.csv", folder / "arm.urdf")
    assert "hinge" not in skeleton.title
    assert [part.name for part in skeleton.visual_model.geometryObjects] == ["box"]
    (folder / "ball.urdf").write_text('<robot name="r"><link name="base"/></robot>')
    (folder / "ball.csv").write_text("time,a,b,c,d,e,f,g\n0,0,0,0,0,0,0,1\n1,1,0,0,0,0,0,1\n")
    ball = replay_table(folder / "ball.csv", folder / "ball.urdf")
    assert (ball.duration, ball.visual_model.ngeoms) == (1.0, 5)


@pytest.mark.parametrize("text", MOTIONS)
def test_a_motion_that_does_not_fit_is_refused_with_what_was_expected(text: str, folder: Path) -> None:
    """Too short, doubled or foreign columns, absurd numbers: a page holds single precision."""
    (folder / "arm.urdf").write_text(ARM)
    (folder / "motion.csv").write_text(text)
    with pytest.raises(AerobatError, match=MOTIONS[text]):
        replay_table(folder / "motion.csv", folder / "arm.urdf")


PAINTS = "<library_effects>{}</library_effects><library_materials>{}</library_materials>".format(
    "".join(
        f'<effect id="{name}-paint"><profile_COMMON><technique sid="t"><phong><diffuse><color>{colour}</color>'
        "</diffuse></phong></technique></profile_COMMON></effect>"
        for name, colour in (("red", "1 0 0 1"), ("blue", "0 0 1 1"))
    ),
    "".join(f'<material id="{name}"><instance_effect url="#{name}-paint"/></material>' for name in ("red", "blue")),
)
TRIANGLES = re.findall("<triangles.*?</triangles>", COLLADA, re.DOTALL)[0]


def triangles(material: str, count: int) -> str:
    """Return `count` triangles of a material."""
    corners = " ".join(count * ["0 1 2"])
    return TRIANGLES.replace('count="1"', f'count="{count}" material="{material}"').replace("0 1 2", corners)


@pytest.mark.parametrize(
    ("pieces", "merged"),
    [(triangles("red", 1), True), (triangles("red", 1) + triangles("blue", 3), False)],
    ids=["one material", "two"],
)
def test_a_collada_mesh_that_viewers_cannot_merge_is_triangles(folder: Path, pieces: str, merged: bool) -> None:
    """In the colour of most of them; any other goes into the page as the file that it is."""
    text = (
        COLLADA.format("bar.png")
        .replace(TRIANGLES, pieces)
        .replace("<library_geometries>", f"{PAINTS}<library_geometries>")
    )
    (folder / "meshes" / "bar.dae").write_text(text)
    (folder / "arm.urdf").write_text(ARM.replace(SHAPE, '<mesh filename="meshes/bar.dae"/>'))
    _, visual_model = load_any_robot(folder / "arm.urdf", 1, folder / "motion.csv")
    [part] = drawable(visual_model).geometryObjects
    assert bool(part.meshPath) == merged
    if not merged:
        assert part.meshColor.tolist() == [0.0, 0.0, 1.0, 1.0]
    assert visual_model.geometryObjects[0].meshPath  # as it was


def test_the_axis_of_a_fixed_joint_may_be_zero(folder: Path) -> None:
    """Exporters write it, and nobody reads it; that of a joint which moves may not."""
    weld = '<joint name="weld" type="fixed"><parent link="bar"/><child link="tip"/><axis xyz="0 0 0"/></joint>'
    (folder / "arm.urdf").write_text(ARM.replace("</robot>", f'<link name="tip"/>{weld}</robot>'))
    load_any_robot(folder / "arm.urdf", 1, folder / "motion.csv")
    (folder / "arm.urdf").write_text(ARM.replace('xyz="0 1 0"', 'xyz="0 0 0"'))
    with pytest.raises(LogError, match="more than 0 was expected"):
        load_any_robot(folder / "arm.urdf", 1, folder / "motion.csv")


def test_the_box_of_a_mesh_is_that_of_its_triangles_as_they_were_loaded() -> None:
    """Pinocchio scales them; scaled again, a robot in mm was a point, with the camera inside and arrows of kN."""
    cube = pin.GeometryObject("cube", 0, 0, pin.SE3.Identity(), coal.Box(0.2, 0.2, 0.2), "", np.full(3, 1e-3))
    np.testing.assert_allclose(np.ptp(box_corners(cube), axis=0), 0.2)


@pytest.mark.parametrize("free", [False, True])
def test_joints_that_turn_for_ever_are_drawn_with_their_shapes(free: bool, folder: Path) -> None:
    """In a record they have one angle, in their file cosine and sine: such robots were sticks, or another robot."""
    hinges = "".join(HINGE.format(k, k + 1) for k in range(7))
    links = "".join(f'<link name="l{k}">{BODY}</link>' for k in range(8))
    (folder / "arm.urdf").write_text(f'<robot name="arm">{links}{hinges}</robot>')
    model = model_of_file(folder / "arm.urdf", mjcf=False, free=free)
    drawn, shapes = visible_parts(folder / "arm.urdf", model, "log")
    kinds, others = ([joint.shortname() for joint in each.joints.tolist()] for each in (drawn, model))
    assert kinds == others
    assert shapes.ngeoms == 8


def test_a_motion_far_away_is_shown_where_it_begins(monkeypatch: pytest.MonkeyPatch) -> None:
    """At coordinates of a map (UTM) a page's single precision made a drone jump by half a metre."""
    drone = pin.Model()
    drone.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base")
    drone.addBodyFrame("tool", 1, pin.SE3.Identity(), 0)
    time = np.linspace(0.0, 1.0, 9)
    q = np.tile(pin.neutral(drone), (9, 1))
    q[:, 0] = time
    far = q + np.array([5e5, 4.5e6, 128.0, 0.0, 0.0, 0.0, 0.0])
    monkeypatch.setattr(uuid, "uuid1", lambda: "the same")
    near, away = (Replay(drone, sticks(drone), time, each, floor=float(each[0, 2]) - 1.0) for each in (q, far))
    assert away.html() == near.html()


def test_arrows_come_out_of_a_robot_that_is_one_body() -> None:
    """Of a drone by its numbers, the box hid each arrow along x or y: no force was to be seen."""
    body = {"body": {"mass": 1, "inertia": [1, 1, 1]}, "points": ["body"]}
    drone = robot_of_map(RobotTable.model_validate(body), Path())
    model, shapes = drone.model, sticks(drone.model)
    replay = Replay(model, shapes, [0.0, 1.0], np.tile(pin.neutral(model), (2, 1)))
    replay.add_forces("force", "#000000", {"body": [[2.1, 0.0, 0.0]] * 2})
    [box] = [part.geometry for part in shapes.geometryObjects if isinstance(part.geometry, coal.Box)]
    length = 2.1 / (100.0 * replay.newtons_per_centimetre)
    assert length > 2.0 * max(box.halfSide)
    leg = model_of_file(HOPPER, mjcf=False, free=False)
    assert "stick_1_0" not in [part.name for part in sticks(leg).geometryObjects]  # its hip has no arms
