"""The door for files of strangers: each thing that it looks at, on both sides of its limit."""

import gzip
import os
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from support.bad_strangers import ARM_MJCF, chain, mcap_bomb
from support.walking_log import bag, urdf, walk

from aerobat_pin.errors import LogError, foreign_file, foreign_xml
from aerobat_pin.numerics import checked_robot
from aerobat_pin.records import LogTable, netcdf_bytes, read_columns

UNREAD = (  # what public files of Sawyer, Jaco, Valkyrie, PR2, OpenManipulator and Fetch have, and no dynamics read
    '<box size="0 0 0"/><sphere radius="0.0"/><material value="PR2/wheel"/><RefLink ref="link1"/>'
    '<gazebo><axis xyz="0 0 0"/><sensor:camera name="rgb"/></gazebo>'
)

GZIPPED = gzip.compress(b"time,q1\n", mtime=0)  # of no time: pytest's workers must agree on the names of the cases


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("log.csv.gz", GZIPPED, "is gzip-compressed: unpack it first"),
        ("log.nc", GZIPPED, "is gzip-compressed: unpack it first"),
        ("log.mcap", GZIPPED, "is gzip-compressed: unpack it first"),
        ("log.xlsx", b"PK\x03\x04\x14", "is a zip archive or a spreadsheet"),
        ("log.parquet", b"PAR1\x15\x04", "is in the Parquet format: save it as CSV or NetCDF first"),
        ("log.ulg", b"ULog\x01\x12\x35", "is a ULog file of PX4: make a table of its topics first"),
        ("log.mat", b"MATLAB 5.0 MAT-file", "is a MATLAB file: save its numbers as CSV"),
        ("log.json", b'[{"time": 0.0, "q": [0.1, 0.2]}, {"time": 0.1, "q": [0.1, 0.3]}]', "is JSON: save it as CSV"),
        ("log.jsonl", b'{"time": 0.0, "q": [0.1, 0.2]}\n{"time": 0.1, "q": [0.1, 0.3]}\n', "is JSON: save it as CSV"),
        ("log.csv", "time,q1\n0,1\n".encode("utf-16"), "is text in UTF-16: save it as UTF-8 first"),
    ],
)
def test_what_a_log_is_that_nothing_here_reads_is_said(tmp_path: Path, name: str, content: bytes, said: str) -> None:
    """Whatever its name says, and by whatever reader."""
    (tmp_path / name).write_bytes(content)
    with pytest.raises(LogError, match=f"log .*{name}: .*{said}"):
        read_columns(tmp_path / name, LogTable())


def test_a_file_is_regular_and_not_too_large(tmp_path: Path) -> None:
    """A pipe would wait for ever, whatever its name says."""
    os.mkfifo(tmp_path / "pipe.csv")
    (tmp_path / "file").write_bytes(bytes(100))
    (tmp_path / "link").symlink_to("file")
    (tmp_path / os.fsdecode(b"pr\xfcfung.csv")).touch()  # half a minute later it ended in a traceback
    assert foreign_file(tmp_path / "link", "x", 100).name == "link"
    for name, said in (
        ("pipe.csv", "log x: a folder, pipe or device: a file was expected"),
        (".", "a folder, pipe or device"),
        ("none", "log x: there is no such file"),
        (300 * "n", "there is no such file"),
        (os.fsdecode(b"pr\xfcfung.csv"), "log x: its name is not in UTF-8: another name was"),
    ):
        with pytest.raises(LogError, match=said):
            foreign_file(tmp_path / name, "log x")
    with pytest.raises(LogError, match="log x: 100 bytes: at most 99 were expected"):
        foreign_file(tmp_path / "file", "log x", 99)


def test_xml_nests_to_a_depth(tmp_path: Path) -> None:
    """A hundred levels, which no robot reaches; a library that calls itself for each would end the process."""
    file = tmp_path / "a.xml"
    file.write_text(99 * "<a>" + "<b/>" + 99 * "</a>")
    assert foreign_xml(file, "x", "a").tag == "a"
    file.write_text(100 * "<a>" + "<b/>" + 100 * "</a>")
    with pytest.raises(LogError, match="x: more than 100 levels of elements"):
        foreign_xml(file, "x", "a")
    file.write_text(f"<a>{200_001 * '<b/>'}</a>")
    with pytest.raises(LogError, match="x: more than 200000 elements"):
        foreign_xml(file, "x", "a")


@pytest.mark.parametrize("before", ["\n", "  \t\n", "\ufeff", "\ufeff\r\n"])
def test_what_stands_before_the_declaration_of_an_xml_file_is_no_matter(before: str, tmp_path: Path) -> None:
    """Public robots' files begin with an empty line, which ROS and Pinocchio read; they were refused."""
    (tmp_path / "a.xml").write_text(f'{before}<?xml version="1.0" encoding="utf-8"?>\n<a/>', encoding="utf-8")
    assert foreign_xml(tmp_path / "a.xml", "x", "a").tag == "a"


def _urdf(old: str, new: str) -> str:
    return urdf().replace(old, new, 1)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (chain(100), None),
        (chain(101), "more than 100 links in a row, or a closed chain"),
        (chain(999, star=True), None),
        (chain(1000, star=True), "1001 bodies: at most 1000 were expected"),
        (urdf(), None),
        (_urdf('<mass value="0.3"', '<mass value="-0.3"'), "link 'FL_hip': <mass value=\"-0.3\">: 0 or more"),
        (_urdf("<mass value=", '<mass value="nan" was='), "link 'trunk': <mass value=\"nan\">: numbers up to"),
        (_urdf('ixx="', 'ixx="-'), "link 'trunk': <inertia ixx=\"-0.045"),
        (_urdf('xyz="1 0 0"', 'xyz="0 0 0"'), "joint 'FL_HAA': <axis xyz=\"0 0 0\">: more than 0"),
        (_urdf("</robot>", '<mesh filename="/etc/passwd"/></robot>'), 'passwd">: a file in the folder'),
        (_urdf("</robot>", '<mesh filename="/nowhere/a.stl"/></robot>'), None),
        (_urdf("</robot>", f"{UNREAD}</robot>"), None),
        (_urdf("</robot>", '<xacro:gripper parent="trunk"/></robot>'), "<xacro:gripper>: left for xacro"),
        (_urdf("<link", '<xacro:leg xmlns:xacro="x"/><link'), "<xacro:leg>: left for xacro"),
        (_urdf("<mass value=", '<mass value="${m}" was='), "link 'trunk': <mass>: left for xacro"),
        (_urdf("</robot>", '<box size="0 -1 0"/></robot>'), '<box size="0 -1 0">: 0 or more'),
    ],
)
def test_a_urdf_can_be_a_robot(text: str, said: str | None, tmp_path: Path) -> None:
    """Else link and key are named; a mesh that is on another machine is not read, and does not matter."""
    _look(tmp_path / "robot.urdf", "urdf", text, said)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("", "", None),
        ('quat="1 0 0 0"', 'quat="0 0 0 0"', "body 'bar': <body quat=\"0 0 0 0\">: more than 0"),
        ('axis="0 1 0"', 'axis="0 0 0"', "joint 'hinge': <joint axis=\"0 0 0\">: more than 0"),
        ('mass="1"', 'mass="-1"', "body 'base': <inertial mass=\"-1\">: 0 or more"),
        ('diaginertia="1 1 1"', 'diaginertia="1 -1 1"', "body 'base': <inertial diaginertia=\"1 -1 1\">: 0 or more"),
        ('geom class="main"', 'geom class="none"', "body 'bar': <geom class=\"none\">: no such class; there are main"),
        ('<default class="main"/>', "", "body 'bar': <geom class=\"main\">: no such class; there are none"),
        ('ref="0"', 'childclass="none"', "joint 'hinge': <joint childclass=\"none\">: no such class"),
        ("<worldbody>", '<asset><mesh file="/etc/passwd"/></asset><worldbody>', '<mesh file="/etc/passwd">: a file in'),
        ("<worldbody>", '<include file="more.xml"/><worldbody>', "<include>: Pinocchio leaves it out"),
    ],
)
def test_an_mjcf_can_be_a_robot(old: str, new: str, said: str | None, tmp_path: Path) -> None:
    """Pinocchio takes a quaternion of zeros for none, a negative mass for 0, and leaves included files out."""
    _look(tmp_path / "robot.xml", "mjcf", ARM_MJCF.replace(old, new, 1), said)


def _look(file: Path, kind: str, text: str, said: str | None) -> None:
    file.write_text(text)
    if said is None:
        checked_robot(file, kind)
    else:
        with pytest.raises(LogError, match=r"^robot .*robot\.(urdf|xml): ") as caught:
            checked_robot(file, kind)
        assert said in str(caught.value)


@pytest.mark.parametrize(
    ("compression", "stated", "chunks", "size", "said"),
    [
        ("zstd", None, 1, 60_000_000, "one chunk unpack to 5.* bytes: at most 50000000"),
        ("lz4", 1000, 1, 60_000_000, "a chunk unpacks to more than the 1000 bytes"),
        ("zstd", 1000, 1, 60_000_000, "a chunk unpacks to more than the 1000 bytes"),
        ("lz4", None, 0, 60_000_000, "a chunk unpacks to more than the 50000000 bytes"),
        ("zstd", None, 40, 2_000_000, "26 chunks of one time unpack to 5.* bytes: at most 50000000"),
    ],
)
def test_a_bag_unpacks_to_what_fits(
    compression: str, stated: int | None, chunks: int, size: int, said: str, tmp_path: Path
) -> None:
    """As its chunks state, as they are, and as many as its index names at one time."""
    (tmp_path / "a.mcap").write_bytes(mcap_bomb(compression, stated, chunks, size))
    with pytest.raises(LogError, match=said):
        read_columns(tmp_path / "a.mcap", LogTable())


def test_a_bag_of_pipes_is_refused_and_a_good_one_is_read(tmp_path: Path) -> None:
    """Also where the pipe is a file in the bag's folder."""
    bag(walk(0.3, 200.0), tmp_path / "bag")
    file = next((tmp_path / "bag").glob("*.mcap"))
    assert "/joint_states" in read_columns(tmp_path / "bag", LogTable()).kinds
    file.unlink()
    os.mkfifo(file)
    with pytest.raises(LogError, match=r"bag\.mcap: a folder, pipe or device"):
        read_columns(tmp_path / "bag", LogTable())


@pytest.mark.parametrize(
    ("header", "said"),
    [
        (140_000 * "x" + ",t", "cannot be read as a header: field larger than field limit"),
        (",".join(f"c{k}" for k in range(10_001)), "10001 cells or more"),
        (600_000 * "x,", "1000000 characters: a header of at most 10000 columns"),
    ],
)
def test_a_header_is_one(header: str, said: str, tmp_path: Path) -> None:
    """Python's reader of tables stops at cells above 131,072 characters."""
    (tmp_path / "log.csv").write_text(f"{header}\n0,0\n1,0\n")
    with pytest.raises(LogError, match=said):
        read_columns(tmp_path / "log.csv", LogTable(), ())


def test_a_file_in_which_the_hdf5_library_hangs_is_refused(tmp_path: Path) -> None:
    """Zeros in the heap of texts and references: the library looks for their end for ever; under a checksum: damage."""
    whole = netcdf_bytes(xr.Dataset({"x": ("time", np.arange(5.0))}, {"time": np.arange(5.0)}))
    made = bytearray(whole)
    heap = made.index(b"GCOL") + 16  # HDF5 File Format Specification, III.E: the first object follows 16 bytes
    made[heap : heap + 16] = bytes(16)
    for name, content, said in (
        ("open.nc", made[:-12], "the HDF5 library ends by signal .* or does not end"),
        ("sealed.nc", made, "it is damaged, as its checksum tells"),
    ):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(LogError, match=said):
            read_columns(tmp_path / name, LogTable())
    (tmp_path / "good.nc").write_bytes(whole[:-12])
    assert "x" in read_columns(tmp_path / "good.nc", LogTable()).names
