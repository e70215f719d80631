"""Bad recordings, maps and calibrations, drawn at random: each kind writes its files and returns a command line."""

import shutil
from pathlib import Path

import tomli_w

from support.bad_texts import SHORT, WITH_MAP, Kind, Rng
from support.walking_log import bag, bag_map, table, table_map, urdf, walk


def write_good(place: Path) -> None:
    """Write a robot, its walk as a table and as a bag, and a map of each."""
    walked = walk(0.3, 200.0)
    (place / "robot.urdf").write_text(urdf())
    table(walked).to_csv(place / "log.csv", index=False)
    bag(walked, place / "bag")
    for name, made in (("map.toml", table_map), ("bag.toml", bag_map)):
        (place / name).write_text(tomli_w.dumps(made(Path("robot.urdf"))))


def copied(good: Path, place: Path, *names: str) -> None:
    for name in names:
        (shutil.copytree if (good / name).is_dir() else shutil.copy)(good / name, place / name)


def recordings(good: Path, free: Path, calibration: Path) -> dict[str, Kind]:
    """Return the kinds by name, of the folder of `write_good`, a free flight (`.nc`) and what was learnt from it."""

    def map_text(rng: Rng, place: Path) -> list[str]:
        """Give a map that is none."""
        copied(good, place, "robot.urdf", "log.csv")
        text = (good / "map.toml").read_bytes()
        cut = text[: int(rng.integers(1, len(text) // 3))]
        others = (b"", b"[robot", b"\xff" + text, text.decode().encode("utf-16"), 9000 * b"[", b"x = " + 5000 * b"9")
        others += (cut, text + b"\n[robot]\n", text + b"\n[unknown]\na = 1\n", b"#" * 2_000_000 + b"\n" + text)
        (place / "map.toml").write_bytes(others[rng.integers(len(others))])
        doors = (
            ["estimate", "log.csv", *WITH_MAP],
            ["node", "--map", "map.toml"],
            ["live", "log.csv", "--map", "map.toml"],
        )
        return list(doors[rng.integers(3)])

    def rows(rng: Rng, place: Path) -> list[str]:
        """Damage the table that a map reads."""
        copied(good, place, "robot.urdf", "map.toml")
        lines = (good / "log.csv").read_text().splitlines()
        k, cells = int(rng.integers(1, len(lines))), []
        choice = rng.integers(7)
        if choice == 0:
            cells = lines[k].split(",")
            cells[rng.integers(len(cells))] = str(rng.choice(["far", "²", "1 2", "0x1g", 50 * "9" + "e999"]))
            lines[k] = ",".join(cells)
        elif choice == 1:
            lines = lines[: int(rng.integers(0, 3))]
        elif choice == 2:
            lines[k] += ",0,0"
        elif choice == 3:
            lines[0] = ",".join(cell for cell in lines[0].split(",")[::-1])[3:]
        elif choice == 4:
            lines[0] = lines[0].replace("_tau", "_effort")
        elif choice == 5:
            lines[1:] = [line.rpartition(",")[0] for line in lines[1:]]
        else:
            lines = [rng.bytes(2000).hex()]
        (place / "log.csv").write_text("\n".join(lines))
        return ["estimate", "log.csv", *WITH_MAP]

    def messages(rng: Rng, place: Path) -> list[str]:
        """Damage a bag: its description, its file, or the map's topics."""
        copied(good, place, "robot.urdf", "bag")
        text = (good / "bag.toml").read_text()
        file = next((place / "bag").glob("*.mcap"))
        data, choice = file.read_bytes(), rng.integers(5)
        log = str(rng.choice(["bag", f"bag/{file.name}"]))
        if choice == 0:
            file.write_bytes(data[: int(rng.integers(len(data) - 100))])
        elif choice == 1:
            file.write_bytes(rng.bytes(500) + data[500:])
        elif choice == 2:
            log = "bag"
            described = place / "bag" / "metadata.yaml"
            described.write_bytes([b"", b"a: [", 3000 * b"[", rng.bytes(100), b"- 1\n"][rng.integers(5)])
        elif choice == 3:
            text = text.replace("/joint_states", str(rng.choice(["/none", "", "/imu", "/odom"])))
        else:
            file.unlink()
        (place / "map.toml").write_text(text)
        return ["estimate", log, *WITH_MAP]

    def learnt(rng: Rng, place: Path) -> list[str]:
        """Give a calibration that is none."""
        data = calibration.read_bytes()
        others = (b"", rng.bytes(3000), data[: int(rng.integers(len(data) - 8))], free.read_bytes(), b"a = 1\n")
        at = int(rng.integers(64))
        others += (data[:at] + rng.bytes(64) + data[at + 64 :],)
        (place / "c.nc").write_bytes(others[rng.integers(len(others))])
        shutil.copy(free, place / "free.nc")
        copied(good, place, "bag.toml", "robot.urdf")
        doors = (
            ["run", "paper", *SHORT, "--out", "out"],
            ["estimate", "free.nc", "--out", "out"],
            ["check", "free.nc", "--out", "out.png"],
            ["node", "--map", "bag.toml"],
        )
        return [*doors[rng.integers(len(doors))], "--calibration", "c.nc"]

    def calibrated(rng: Rng, place: Path) -> list[str]:
        """Calibrate by flights that are none, or ask for what there is not."""
        shutil.copy(free, place / "free.nc")
        data = free.read_bytes()
        (place / "cut.nc").write_bytes(data[: int(rng.integers(len(data) // 2))])
        (place / "table.csv").write_text("time,x\n0,0\n1,0\n")
        (place / "folder").mkdir()
        wrong = (["cut.nc"], ["free.nc", "cut.nc"], ["table.csv"], ["folder"], ["none"], ["free.nc", "--identify", "²"])
        wrong += (["free.nc", "--harmonics", "41"], ["free.nc", "--set", "robot.x=1"])
        wrong += (["free.nc", "--morphology", "robot"], [300 * "n"], ["free.nc", "--set", "air.density=nan"])
        chosen = wrong[rng.integers(len(wrong))]
        if len(chosen) == 1 and rng.integers(2):
            return ["check", *chosen, "--calibration", str(calibration), "--out", "out.png"]
        return ["calibrate", *chosen, "--out", "out.nc"]

    return {
        "text for a map": map_text,
        "table of a map": rows,
        "bag": messages,
        "calibration": learnt,
        "flights to calibrate": calibrated,
    }
