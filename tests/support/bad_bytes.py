"""Good files of every reader with bytes changed, taken out, doubled or cut off."""

import re
import shutil
from pathlib import Path

import tomli_w

from support.bad_recordings import copied
from support.bad_robots import ARM, COLLADA, SHAPE, stl
from support.bad_strangers import ARM_MJCF
from support.bad_texts import FORMATS, SHORT, WITH_MAP, Rng

SUGGESTED = ["--suggest"]
PLAY = ["play", "--from-csv", "motion.csv", "--urdf", "arm.urdf", "--out", "out.html"]
PLAY_RUN, SWEEP = ["play", "run", "--out", "out.html"], ["sweep", "s.toml", "--out", "out", "--jobs", "1"]
CHECK = ["check", "flight.nc", "--calibration", "c.h5", "--out", "out.png"]
FORCE = 'unknown_force=[{signal="recorded", frame="left_distal", file="force.csv"}]'
SEAL = 12  # bytes of the checksum at the end of a NetCDF file, without which the HDF5 library reads what is damaged
READERS: tuple[tuple[str, list[str], tuple[str, ...]], ...] = (  # what is changed, the words that read it, other files
    ("log.csv", ["estimate", "log.csv", *SUGGESTED], ()),
    ("map.toml", ["estimate", "log.csv", *WITH_MAP], ("robot.urdf", "log.csv")),
    ("robot.urdf", ["estimate", "log.csv", *WITH_MAP], ("map.toml", "log.csv")),
    ("robot.mjcf", ["estimate", "short.csv", "--map", "mjcf.toml", "--out", "out"], ("mjcf.toml", "short.csv")),
    ("bag.mcap", ["estimate", "bag.mcap", *SUGGESTED], ()),
    ("bag.db3", ["estimate", "bag.db3", *SUGGESTED], ()),
    ("old.bag", ["estimate", "old.bag", *SUGGESTED], ()),
    ("flight.h5", ["estimate", "flight.h5", *SUGGESTED], ()),
    ("flight.nc", ["estimate", "flight.nc", *SUGGESTED], ()),
    ("c.h5", ["estimate", "flight.nc", "--calibration", "c.h5", "--out", "out"], ("flight.nc",)),
    ("c.h5", CHECK, ("flight.nc",)),
    ("mesh.stl", PLAY, ("arm.urdf", "motion.csv")),
    ("mesh.dae", [word.replace("arm", "dae") for word in PLAY], ("dae.urdf", "motion.csv")),
    ("motion.csv", PLAY, ("arm.urdf", "mesh.stl")),
    ("arm.urdf", PLAY, ("mesh.stl", "motion.csv")),
    ("paper.toml", ["run", "paper.toml", "--out", "out", *SHORT], ()),
    ("force.csv", ["run", "paper", "--out", "out", *SHORT, "--set", FORCE], ()),
    ("robot.toml", ["linkage", "robot.toml", "--out", "out.png"], ()),
    ("s.toml", SWEEP, ("out",)),
    ("out/finished.jsonl", SWEEP, ("s.toml", "out")),
    ("run/scenario.toml", PLAY_RUN, ("run",)),
    ("run/estimate.nc", PLAY_RUN, ("run",)),
    ("run/flight.nc", ["convert", "run", "--out", "out.mcap"], ("run",)),
    ("run/metrics.json", ["compare", "run", "free", "--out", "compared"], ("run", "free")),
)


def write_readable(good: Path, run: Path, swept: Path) -> None:
    """Write the good files beside those of `write_good`, from its folder, a good run's and a good sweep's."""
    flight = good / "free" / "flight.nc"
    shutil.copy(next((good / "bag").glob("*.mcap")), good / "bag.mcap")
    _as_databases(good / "bag.mcap", good / "database")
    shutil.copy(next((good / "database").glob("*.db3")), good / "bag.db3")
    (good / "flight.nc").write_bytes(flight.read_bytes())
    (good / "flight.h5").write_bytes(flight.read_bytes()[:-SEAL])
    (good / "c.h5").write_bytes((good / "c.nc").read_bytes()[:-SEAL])
    (good / "robot.mjcf").write_text(ARM_MJCF)
    (good / "mjcf.toml").write_text(tomli_w.dumps({"robot": {"mjcf": "robot.mjcf", "points": ["bar"]}}))
    (good / "short.csv").write_text("t,x\n0,0\n1,0\n")
    (good / "mesh.stl").write_bytes(stl(0.0, 0.0, 0.0))
    (good / "arm.urdf").write_text(ARM.replace(SHAPE, '<mesh filename="mesh.stl"/>'))
    (good / "dae.urdf").write_text(ARM.replace(SHAPE, '<mesh filename="mesh.dae"/>'))
    (good / "mesh.dae").write_text(re.sub("<library_images>.*</library_images>", "", COLLADA))
    (good / "motion.csv").write_text("time,hinge\n0,0\n1,1\n")
    (good / "force.csv").write_text("time,force\n0,0\n1,1\n")
    for name, door in (("paper.toml", "run"), ("robot.toml", "linkage")):
        (good / name).write_text(FORMATS[door][0])
    shutil.copytree(run, good / "run")
    shutil.copytree(swept, good, dirs_exist_ok=True)


def _as_databases(bag: Path, folder: Path) -> None:
    """Write a bag again as an SQLite database, and its joint states as a bag of ROS 1."""
    from rosbags.rosbag1 import Writer as OldWriter
    from rosbags.rosbag2 import Reader, StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store, old = get_typestore(Stores.ROS2_HUMBLE), get_typestore(Stores.ROS1_NOETIC)
    with (
        Reader(bag) as reader,
        Writer(folder, version=8, storage_plugin=StoragePlugin.SQLITE3) as writer,
        OldWriter(folder.with_name("old.bag")) as old_writer,
    ):
        made = {
            one.id: writer.add_connection(one.topic, one.msgtype, typestore=store, serialization_format="cdr")
            for one in reader.connections
        }
        names = {one.id: one.msgtype for one in reader.connections if one.topic == "/joint_states"}
        kept = {key: old_writer.add_connection("/joint_states", name, typestore=old) for key, name in names.items()}
        kind = old.types["std_msgs/msg/Header"]
        for connection, time, raw in reader.messages():
            writer.write(made[connection.id], time, raw)
            if connection.id in kept:
                message = store.deserialize_cdr(raw, connection.msgtype)
                message.header = kind(seq=0, stamp=message.header.stamp, frame_id="")
                old_writer.write(kept[connection.id], time, bytes(old.serialize_ros1(message, connection.msgtype)))


def changed_bytes(rng: Rng, good: Path, place: Path) -> tuple[str, list[str]]:
    """Write one changed file, and those that are read with it; return its name and the words that read it."""
    name, words, others = READERS[rng.integers(len(READERS))]
    copied(good, place, *others, name)
    path = place / name
    path.write_bytes(changed(rng, path.read_bytes()))
    return name, list(words)


def changed(rng: Rng, data: bytes) -> bytes:
    """Return bytes with some of them changed, taken out, doubled, moved or cut off."""
    made = bytearray(data)
    for _ in range(int(rng.integers(1, 5))):
        size, at = len(made), int(rng.integers(max(len(made), 1)))
        length = int(min(2 ** rng.integers(0, 8), max(size - at, 0)))
        choice = rng.integers(6)
        if choice == 0 and size:
            made[at] ^= 1 << int(rng.integers(8))
        elif choice == 1:
            made[at : at + length] = rng.bytes(length)
        elif choice == 2:
            del made[at : at + length]
        elif choice == 3:
            made[at:at] = made[at : at + length] * int(rng.integers(1, 20))
        elif choice == 4:
            made[at : at + length] = bytes([(0, 255)[int(rng.integers(2))]]) * length
        elif rng.integers(3) == 0:
            del made[at:]
    return bytes(made)
