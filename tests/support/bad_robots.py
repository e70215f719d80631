"""Bad robots, drawn at random: URDF files, motions and meshes that are none, and robots that name files of others."""

import os
import struct
from pathlib import Path

from support.bad_texts import Kind, Rng

HINGE = """<joint name="hinge" type="revolute"><parent link="base"/><child link="bar"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>"""
SHAPE = '<box size="1 1 1"/>'
ARM = f"""<robot name="arm"><link name="base"/><link name="bar"><visual><geometry>{SHAPE}</geometry></visual></link>
{HINGE}</robot>"""
SECRET, PICTURE = b"the secret of this machine", b"\x89PNG\r\n\x1a\n" + 40 * b"\0"
COLLADA = """<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><up_axis>Z_UP</up_axis></asset><library_images><image id="i"><init_from>{}</init_from></image></library_images>
<library_geometries><geometry id="g"><mesh><source id="p"><float_array id="a" count="9">0 0 0 1 0 0 0 1 0</float_array>
<technique_common><accessor source="#a" count="3" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source><vertices id="v">
<input semantic="POSITION" source="#p"/></vertices><triangles count="1">
<input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2</p></triangles></mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node id="n">
<instance_geometry url="#g"/></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>"""
PLAY = ["play", "--from-csv", "motion.csv", "--urdf", "arm.urdf", "--out", "out.html"]
ENTITIES = "".join(f'<!ENTITY a{i} "{16 * f"&a{i - 1 if i else str()};"}">' for i in range(8))
ROBOTS = {  # text -> what is said of it
    "": "cannot be read as XML: no element found",
    "\0\1\2": "cannot be read as XML",
    "<a/>": "an outermost element <robot> was expected",
    "<robot": "cannot be read as XML",
    '<robot name="r"><link name="base"/></robot>': "no joint of it moves; a joint, or the 7 columns",
    f'<!DOCTYPE r [<!ENTITY a "aaaaaaaaaaaaaaaa">{ENTITIES}]><robot name="&a7;"/>': "cannot be read as XML",
    ARM.replace(SHAPE, 9000 * "<b>" + 9000 * "</b>"): "more than 100 levels of elements",
    ARM.replace("0 1 0", "a b c"): '<axis xyz="a b c">: numbers up to',
    ARM.replace("0 1 0", "0 0 0"): '<axis xyz="0 0 0">: more than 0 was expected',
    ARM.replace("1 1 1", "nan 1 1"): '<box size="nan 1 1">: numbers up to 1e',
    ARM.replace("1 1 1", "-1 1 1"): '<box size="-1 1 1">: 0 or more',
    ARM.replace('name="bar"', 'name="base"'): "Pinocchio cannot read it: link 'base' is not unique",
    ARM.replace('name="bar"', 'name=""'): r"child link \[bar\] of joint \[hinge\] not found",
    ARM.replace("<limit", "<!-- ").replace('velocity="1"/>', "-->"): "it does not specify limits",
    ARM.replace('child link="bar"', 'child link="base"'): "links in a row, or a closed chain",
    ARM.replace("revolute", "magic"): r"of a type that URDF does not have, 'magic'",
    ARM.replace("revolute", "floating"): "1 columns of configuration; arm.urdf takes 7, or 14 on a free base",
    ARM.replace("revolute", "continuous"): r"takes 2, or 9 on a free base, in the order hinge \(cosine and sine\)",
    ARM.replace("revolute", "fixed"): "no joint of it moves",
    ARM.replace(HINGE, ""): "Two root links found",
    ARM.replace('name="arm"', ""): "No name given for the robot",
    ARM.replace("</robot>", f"{HINGE}</robot>"): "joint 'hinge' is not unique",
}
MOTIONS = {  # text -> what is said of it, with the arm
    "": "a header of two columns or more",
    "time,hinge\n": "0 rows: two or more",
    "time,hinge\n0,0\n": "1 rows: two or more",
    "t,hinge\n0,0\n1,0\n": "no column named time",
    "time,a,b\n0,0,0\n1,0,0\n": "2 columns of configuration; arm.urdf takes 1, or 8 .* hinge",
    "time,hinge\n0,0\n1,nan\n": "line 3: hinge = 'nan': a number was expected",
    "time,hinge\n0,0\n1,1e300\n": r"row 2: hinge = 1e\+300: numbers up to 1e\+06",
    "time,hinge\n0,0\n1\n": "line 3: 1 cells: 2, as in the header",
    "time,hinge\n0,0\n1,\n": "row 2: hinge is empty",
    "time,hinge [deg]\n0,0\n1,9\n": r"column 'hinge \[deg\]': m, rad, -, 1, N was expected",
    "time,hinge,hinge\n0,0,0\n1,0,0\n": "column 'hinge' appears twice",
    "time,hinge\n1,0\n0,0\n": "line 3: time = 0 s runs backwards",
    "time,hinge\n0,0\n0,0\n": "line 3: time = 0 s is repeated",
    "time,hinge,bar.Fx\n0,0,0\n1,0,0\n": "three columns bar.Fx",
    "time,hinge,x.Fx,x.Fy,x.Fz\n0,0,0,0,0\n1,0,0,0,0\n": "no frame named 'x' in the model: it has .*bar",
    "time,x,y,z,a,b,c,d,hinge\n0,0,0,0,0,0,0,0,0\n1,0,0,0,0,0,0,0,0\n": "no unit quaternion",
}


def stl(*corner: float) -> bytes:
    """Return a mesh of one triangle."""
    return 80 * b"\0" + struct.pack("<I12fH", 1, 0, 0, 1, *corner, 1, 0, 0, 0, 1, 0, 0)


def _arm(place: Path, text: str = ARM, motion: str = "time,hinge\n0,0\n1,0.5\n") -> list[str]:
    (place / "arm.urdf").write_text(text)
    (place / "motion.csv").write_text(motion)
    return list(PLAY)


ROBOT: dict[str, Kind] = {
    "robot": lambda rng, place: _arm(place, list(ROBOTS)[rng.integers(len(ROBOTS))]),
    "motion": lambda rng, place: _arm(place, motion=list(MOTIONS)[rng.integers(len(MOTIONS))]),
}


def _elsewhere(rng: Rng, place: Path) -> str:
    """Write files that are none of the robot's business, and return the address of one, without its ending."""
    (place / "other").mkdir()
    for folder in (place, place / "other"):
        (folder / "private.stl").write_bytes(stl(0.0, 0.0, 0.0))
        (folder / "private.png").write_bytes(PICTURE)
        (folder / "private.txt").write_bytes(SECRET)
    (place / "arm").mkdir()
    for suffix in (".stl", ".png", ".txt"):
        (place / "arm" / f"link{suffix}").symlink_to(f"../private{suffix}")
    addresses = ("../private", "{}/private", "../other/private", "link", "file://{}/private", "package://other/private")
    addresses += ("package://../private", "package://arm/../private", "model://other/private", "../arm/../private")
    return addresses[rng.integers(len(addresses))].format(place)


def _in_its_folder(words: list[str]) -> list[str]:
    return [f"arm/{word}" if word in ("arm.urdf", "motion.csv") else word for word in words]


def _foreign_mesh(rng: Rng, place: Path) -> list[str]:
    """Name a mesh outside the robot's packages, or a text, a pipe or a missing file within them."""
    address = _elsewhere(rng, place) + str(rng.choice([".stl", ".png", ".txt"]))
    os.mkfifo(place / "arm" / "pipe.stl")
    (place / "arm" / "notes.txt").write_bytes(SECRET)
    if rng.integers(4) == 0:
        address = str(rng.choice(["pipe.stl", "notes.txt", "none.stl", ".", "http://example.org/a.stl", 300 * "m"]))
    return _in_its_folder(_arm(place / "arm", ARM.replace(SHAPE, f'<mesh filename="{address}"/>')))


def _foreign_texture(rng: Rng, place: Path) -> list[str]:
    """Name a texture outside the robot's packages, or one within them that is no picture."""
    address = _elsewhere(rng, place) + str(rng.choice([".png", ".txt"]))
    (place / "arm" / "notes.txt").write_bytes(SECRET)
    if rng.integers(4) == 0:
        address = str(rng.choice(["notes.txt", "none.png", "arm.urdf", "mesh.dae", ""]))
    (place / "arm" / "mesh.dae").write_text(COLLADA.format(address))
    return _in_its_folder(_arm(place / "arm", ARM.replace(SHAPE, '<mesh filename="mesh.dae"/>')))


FOREIGN: dict[str, Kind] = {"mesh of others": _foreign_mesh, "texture of others": _foreign_texture}
