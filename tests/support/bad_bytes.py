"""Good files of every reader with bytes changed, taken out, doubled or cut off."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import tomli_w

from support.bad_robots import ARM, SHAPE, stl
from support.bad_strangers import ARM_MJCF

Rng = np.random.Generator
WITH_MAP, SUGGESTED = ["--map", "map.toml", "--out", "out"], ["--suggest"]
PLAY = ["play", "--from-csv", "motion.csv", "--urdf", "arm.urdf", "--out", "out.html"]
SEAL = 12  # bytes of the checksum at the end of a NetCDF file, without which the HDF5 library reads what is damaged
READERS = {  # file that is changed -> the words that read it, and the other files that they need
    "log.csv": (["estimate", "log.csv", *SUGGESTED], ()),
    "map.toml": (["estimate", "short.csv", *WITH_MAP], ("robot.urdf", "short.csv")),
    "robot.urdf": (["estimate", "short.csv", *WITH_MAP], ("map.toml", "short.csv")),
    "robot.mjcf": (["estimate", "short.csv", "--map", "mjcf.toml", "--out", "out"], ("mjcf.toml", "short.csv")),
    "bag.mcap": (["estimate", "bag.mcap", *SUGGESTED], ()),
    "bag.db3": (["estimate", "bag.db3", *SUGGESTED], ()),
    "flight.h5": (["estimate", "flight.h5", *SUGGESTED], ()),
    "flight.nc": (["estimate", "flight.nc", *SUGGESTED], ()),
    "c.h5": (["estimate", "flight.nc", "--calibration", "c.h5", "--out", "out"], ("flight.nc",)),
    "mesh.stl": (PLAY, ("arm.urdf", "motion.csv")),
    "motion.csv": (PLAY, ("arm.urdf", "mesh.stl")),
    "arm.urdf": (PLAY, ("mesh.stl", "motion.csv")),
}


def write_readable(good: Path, flight: Path, calibration: Path) -> None:
    """Write the good files beside those of `bad_recordings.write_good`.

    Args:
        good: their folder.
        flight: log of a flight, `.nc`.
        calibration: what was learnt from it.
    """
    shutil.copy(next((good / "bag").glob("*.mcap")), good / "bag.mcap")
    _as_database(good / "bag.mcap", good / "database")
    shutil.copy(next((good / "database").glob("*.db3")), good / "bag.db3")
    (good / "flight.nc").write_bytes(flight.read_bytes())
    (good / "flight.h5").write_bytes(flight.read_bytes()[:-SEAL])
    (good / "c.h5").write_bytes(calibration.read_bytes()[:-SEAL])
    (good / "robot.mjcf").write_text(ARM_MJCF)
    (good / "mjcf.toml").write_text(tomli_w.dumps({"robot": {"mjcf": "robot.mjcf", "points": ["bar"]}}))
    (good / "short.csv").write_text("t,x\n0,0\n1,0\n")
    (good / "mesh.stl").write_bytes(stl(0.0, 0.0, 0.0))
    (good / "arm.urdf").write_text(ARM.replace(SHAPE, '<mesh filename="mesh.stl"/>'))
    (good / "motion.csv").write_text("time,hinge\n0,0\n1,1\n")


def _as_database(bag: Path, folder: Path) -> None:
    """Write a bag again as an SQLite database."""
    from rosbags.rosbag2 import Reader, StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    with Reader(bag) as reader, Writer(folder, version=8, storage_plugin=StoragePlugin.SQLITE3) as writer:
        made = {
            one.id: writer.add_connection(one.topic, one.msgtype, typestore=store, serialization_format="cdr")
            for one in reader.connections
        }
        for connection, time, raw in reader.messages():
            writer.write(made[connection.id], time, raw)


def changed_bytes(rng: Rng, good: Path, place: Path) -> tuple[str, list[str]]:
    """Write one changed file, and those that are read with it; return its name and the words that read it."""
    name = str(rng.choice(list(READERS)))
    words, others = READERS[name]
    for other in others:
        shutil.copy(good / other, place)
    (place / name).write_bytes(changed(rng, (good / name).read_bytes()))
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
