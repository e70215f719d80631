"""Files made to eat the machine: bombs, pipes, and robots that no arm can have; each a command line that is refused."""

import os
import sqlite3
import struct
from pathlib import Path
from xml.etree import ElementTree

import tomli_w

from support.bad_texts import WITH_MAP, Kind, Rng
from support.foreign_channels import mcap_record, mcap_texts
from support.walking_log import bag_map, table_map, urdf

BOMB = 300_000_000  # bytes
LINK = (
    '<link name="l{}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    "</link>"
)
HINGE = (
    '<joint name="j{0}" type="revolute"><parent link="l{1}"/><child link="l{2}"/><axis xyz="0 1 0"/>'
    '<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
)
INERTIAL = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
ARM_MJCF = (
    f'<mujoco model="arm"><default class="main"/><worldbody><body name="base"><freejoint/>{INERTIAL}'
    f'<body name="bar" pos="0 0 1" quat="1 0 0 0"><joint name="hinge" axis="0 1 0" ref="0"/>{INERTIAL}'
    '<geom class="main" size=".1" mass="0"/></body></body></worldbody></mujoco>'
)


def mcap_bomb(compression: str, stated: int | None = None, chunks: int = 1, size: int = BOMB) -> bytes:
    """Return an MCAP file of zeros: its chunk unpacks to `size` bytes, states `stated`, is listed `chunks` times."""
    from lz4.frame import compress
    from rosbags.rosbag2.storage_mcap import zstd

    message = mcap_record(5, struct.pack("<HIQQ", 1, 0, 0, 0) + bytes(10_000))
    raw = message * (size // len(message))
    packed = (compress if compression == "lz4" else zstd.compress)(raw)
    head = b"\x89MCAP0\r\n" + mcap_record(1, mcap_texts(b"ros2", b"x"))
    made = mcap_record(3, struct.pack("<H", 1) + mcap_texts(b"sensor_msgs/msg/JointState", b"ros2msg", b""))
    made += mcap_record(4, struct.pack("<HH", 1, 1) + mcap_texts(b"/joint_states", b"cdr", b""))
    stated = len(raw) if stated is None else stated
    how, size_packed = mcap_texts(compression.encode()), struct.pack("<Q", len(packed))
    chunk = struct.pack("<QQQI", 0, 9, stated, 0) + how + size_packed + packed
    body = head + made + mcap_record(6, chunk)
    index = struct.pack("<QQQQ", 0, 9, len(head) + len(made), 9 + len(chunk)) + struct.pack("<IHQ", 10, 1, len(body))
    index += struct.pack("<Q", 31) + how + size_packed + struct.pack("<Q", stated)
    body += mcap_record(7, struct.pack("<HI", 1, 16) + bytes(16)) + mcap_record(15, bytes(4))
    start = len(body) if chunks else 0
    body += (made + chunks * mcap_record(8, index)) if chunks else b""
    return body + mcap_record(2, struct.pack("<QQI", start, 0, 0)) + b"\x89MCAP0\r\n"


def _mapped(place: Path, **changes: object) -> list[str]:
    """Write a robot and a map of the table `log.csv`."""
    values = table_map(Path("robot.urdf"))
    (place / "robot.urdf").write_text(urdf())
    (place / "map.toml").write_text(tomli_w.dumps({**values, **changes}))
    return ["estimate", "log.csv", *WITH_MAP]


def _bag(place: Path, name: str) -> list[str]:
    (place / "robot.urdf").write_text(urdf())
    (place / "map.toml").write_text(tomli_w.dumps(bag_map(Path("robot.urdf"))))
    return ["estimate", name, *WITH_MAP]


def _unpacks(rng: Rng, place: Path) -> list[str]:
    """Give a bag whose chunks unpack to hundreds of megabytes, one of them or all together."""
    compression = str(rng.choice(["lz4", "zstd"]))
    stated, chunks, size = ((None, 1, BOMB), (1000, 1, BOMB), (None, 0, BOMB), (None, 40, 10_000_000))[rng.integers(4)]
    (place / "a.mcap").write_bytes(mcap_bomb(compression, stated, chunks, size))
    return _bag(place, "a.mcap")


def _endless(rng: Rng, place: Path) -> list[str]:
    """Give a database whose messages are computed, without an end."""
    made = (
        "CREATE VIEW messages AS WITH RECURSIVE r(n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM r) "
        "SELECT n AS id, 1 AS topic_id, n AS timestamp, zeroblob(1000) AS data FROM r",
        "CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id, timestamp, "
        "data BLOB GENERATED ALWAYS AS (zeroblob(900000000)) VIRTUAL)",
    )[rng.integers(2)]
    file = sqlite3.connect(place / "a.db3")
    file.execute("CREATE TABLE topics (id, name, type, serialization_format, offered_qos_profiles)")
    file.execute("INSERT INTO topics VALUES (1, '/joint_states', 'sensor_msgs/msg/JointState', 'cdr', '')")
    file.execute(made)
    file.commit()
    file.close()
    return _bag(place, "a.db3")


def _pipe(rng: Rng, place: Path) -> list[str]:
    """Give a pipe in the place of a file, for which nothing is ever written."""
    name = str(rng.choice(["log.csv", "log.nc", "log.mcap", "log.db3", "log.bag", "robot.urdf", "map.toml", "bag"]))
    words = _mapped(place)
    if name.startswith("log"):
        words[1] = name
    if name == "bag":
        words[1] = "bag"
        (place / "bag").mkdir()
        (place / "bag" / "metadata.yaml").write_text("rosbag2_bagfile_information: {}\n")
        os.mkfifo(place / "bag" / "bag.mcap")
        return words
    (place / name).unlink(missing_ok=True)
    os.mkfifo(place / name)
    if not os.path.lexists(place / "log.csv"):
        (place / "log.csv").write_text("t,px\n0,0\n1,0\n")
    return [*words[:2], "--suggest"] if name.startswith("log") and rng.integers(2) else words


def chain(count: int, *, star: bool = False) -> str:
    """Return a URDF of links in a row, or all on the first."""
    joints = "".join(HINGE.format(k, 0 if star else k, k + 1) for k in range(count))
    return f'<robot name="chain">{"".join(LINK.format(k) for k in range(count + 1))}{joints}</robot>'


def _large(rng: Rng, place: Path) -> list[str]:
    """Give a robot of too many levels, bodies or links in a row."""
    words, depth = _mapped(place), int(rng.integers(101, 50_000))
    nested = f'<body name="b">{INERTIAL}<joint name="j"/>'
    texts = (
        urdf().replace("</robot>", depth * "<a>" + depth * "</a>" + "</robot>"),
        chain(int(rng.integers(101, 5000))),
        chain(int(rng.integers(1001, 5000)), star=True),
        f'<mujoco model="m"><worldbody>{depth * nested}{depth * "</body>"}</worldbody></mujoco>',
        f'<mujoco model="m">{depth * "<default>"}{depth * "</default>"}</mujoco>',
        f'<mujoco model="m"><worldbody>{(1001 + depth // 10) * (nested + "</body>")}</worldbody></mujoco>',
    )
    return _robot(place, words, texts[rng.integers(len(texts))])


def _robot(place: Path, words: list[str], text: str) -> list[str]:
    kind = "mjcf" if text.startswith("<mujoco") else "urdf"
    _mapped(place, robot={kind: f"robot.{kind}", "points": ["bar"]})
    (place / f"robot.{kind}").write_text(text)
    (place / "log.csv").write_text("t,px\n0,0\n1,0\n")
    return words


def impossible(rng: Rng) -> str:
    """Return a URDF or MJCF in which one number, drawn among all that it has, cannot be."""
    from aerobat_pin.numerics.foreign_robots import DIRECTION_KEYS, LARGEST_NUMBERS, NEVER_NEGATIVE

    root = ElementTree.fromstring(urdf() if rng.integers(2) else ARM_MJCF)
    places = [(one, key) for one in root.iter() for key in one.attrib if key in LARGEST_NUMBERS]
    one, key = places[rng.integers(len(places))]
    count = len(one.attrib[key].split())
    wrong = ["nan", "inf", "-inf", "1e300", "far", ""]
    wrong += ["-1"] if key in NEVER_NEGATIVE or one.tag == "mass" else []
    wrong += ["0"] if key in DIRECTION_KEYS or one.tag == "axis" else []
    one.set(key, " ".join(count * [str(rng.choice(wrong))]))
    return ElementTree.tostring(root, encoding="unicode")


STRANGERS: dict[str, Kind] = {
    "bag that unpacks": _unpacks,
    "endless bag": _endless,
    "pipe": _pipe,
    "large robot": _large,
    "robot that cannot be": lambda rng, place: _robot(place, _mapped(place), impossible(rng)),
}
