"""Bad TOML files, settings, names and sizes: a command line each, to be refused with one message (exit code 2)."""

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np

from aerobat_description import PACKAGE_PATH

Rng = np.random.Generator
Kind = Callable[[Rng, Path], list[str]]
SHIPPED = Path(__file__).parents[2] / "aerobat_pin"
WITH_MAP = ["--map", "map.toml", "--out", "out"]
SHORT = ["--no-report", "--set", "simulation.duration=0.01", "--set", "air.warm_up_cycles=0"]
FORMATS = {  # door -> a good file, numbers in it, keys that it must have
    "run": (
        (SHIPPED / "scenario" / "shipped" / "paper.toml").read_text(),
        ("flight.gravity", "air.density", "simulation.dt", "crank.frequency", "observers.gain", "air.strips"),
        ("name",),
    ),
    "linkage": (
        Path(PACKAGE_PATH, "morphologies", "aerobat.toml").read_text(),
        ("wing.offset_x", "body.mass", "proximal.mass", "linkage.L1", "linkage.L3b", "distal.mass"),
        ("name", "description"),
    ),
    "sweep": (
        'name = "s"\nbase = "paper"\nseeds = 2\n',
        ("seeds", "draws.count", "factors.a.values"),
        ("name", "base"),
    ),
}
FORMATS["urdf"] = FORMATS["mjcf"] = FORMATS["crank"] = FORMATS["linkage"]
FORMATS["trim"] = FORMATS["live"] = FORMATS["run"]
WRONG_VALUES = ('"text"', "true", "1979-05-27", "[[1]]", "{a = 1}", "nan", "inf", "-inf", "-1e400", "-7", '""', "[]")
KEYS = ("flight.gravity", "simulation.dt", "air.density", "crank.frequency", "observers.gain", "sensors.gyro.rate")
AT_LEAST = 33  # levels that are too many


def words_for(door: str, file: str) -> list[str]:
    """Return the command line that reads a file at a door and would write beside it."""
    if door in ("urdf", "mjcf", "crank"):
        words = ["crank", file] if door == "crank" else ["urdf", file, "--format", door]
        return [*words, "--out", "out.html" if door == "crank" else f"out.{door}"]
    out = {"linkage": "out.png", "trim": "out.toml"}.get(door, "out")
    return [door, file, "--out", out, *(SHORT if door == "run" else ["--jobs", "1"] if door == "sweep" else [])]


def _written(change: Callable[[Rng, str], str | bytes]) -> Kind:
    """Return a kind that changes the text of a good file of a random format."""

    def write(rng: Rng, place: Path) -> list[str]:
        door = str(rng.choice(list(FORMATS)))
        made = change(rng, door)
        (place / "file.toml").write_bytes(made if isinstance(made, bytes) else made.encode())
        return words_for(door, "file.toml")

    return write


def _deep(rng: Rng) -> int:
    return int(rng.integers(AT_LEAST, 9000))


def _lists(rng: Rng, door: str) -> str:
    depth = _deep(rng)
    return f"{FORMATS[door][0]}\nmore = {depth * '['}{rng.choice(['', depth * ']'])}\n"


def _encoding(rng: Rng, door: str) -> bytes:
    good = FORMATS[door][0]
    at = int(rng.integers(len(good.encode())))
    choices = (good.encode()[:at] + b"\xff" + good.encode()[at:], good.encode("utf-16"), b"\0" + good.encode())
    return choices[rng.integers(len(choices))]


def _unknown(rng: Rng, door: str) -> str:
    name = str(rng.choice(["nmae", "²", "a b", "name ", "Name", "", "é", "name\\u0000", "a.b", "__class__"]))
    return f'"{name}" = 1\n{FORMATS[door][0]}'


def _value(rng: Rng, door: str) -> str:
    key, value = str(rng.choice(FORMATS[door][1])), str(rng.choice(WRONG_VALUES))
    table, _, last = key.rpartition(".")
    kept = [line for line in FORMATS[door][0].splitlines() if not line.startswith(f"{last} =")]
    if not table:
        return f"{last} = {value}\n" + "\n".join(kept)
    if f"[{table}]" not in kept:
        kept.append(f"[{table}]")
    kept.insert(kept.index(f"[{table}]") + 1, f"{last} = {value}")
    return "\n".join(kept) + "\n"


def _missing(rng: Rng, door: str) -> str:
    key = str(rng.choice(FORMATS[door][2]))
    return "\n".join(line for line in FORMATS[door][0].splitlines() if not line.startswith(f"{key} ="))


def _syntax(rng: Rng, door: str) -> str:
    good = FORMATS[door][0]
    broken = 'a = "', "a = [1,", "[a", "a =", "= 1", "a = 1 b = 2", 'a = """x', "a = 1979-02-31", "a = 1\na = 2", "²=1"
    line = str(rng.choice(broken))
    return f"{good}\n{line}" if rng.integers(2) else f"{line}\n{good}"


def _name(rng: Rng, door: str) -> str:
    name = str(rng.choice(["a/b", "", "..", "a b", "/etc/passwd", 300 * "n", "é/", "a\\n", "x\\u0000"]))
    rest = [line for line in FORMATS[door][0].splitlines() if not line.startswith("name =")]
    return f'name = "{name}"\n' + "\n".join(rest)


def _setting(rng: Rng, place: Path) -> list[str]:
    """Give a wrong `--set`."""
    deep, digits, key = _deep(rng), 5000 * "9", str(rng.choice(KEYS))
    settings = (
        f"{deep * 'a.'}a=1",
        f"{key}={deep * '['}",
        f"{key}={digits}",
        f"{key}=-{digits}",
        f"{key}={rng.choice(['nan', 'inf', '-1', 'text', '[1]', 'true', '1979-05-27'])}",
        f"unknown_force.{rng.choice(['²', '-1', '9', '1.5', 'a', ''])}.noise=1",
        f"{rng.choice(['', '=', '.=1', 'a', '=1', '..a=1', 'flight..gravity=1'])}",
        f"{300 * 'k'}=1",
        f"robot.morphology={rng.choice([300 * 'm', '/', '.', 'none', '/dev/null', '../x.toml'])}",
        "observers.names=" + str(rng.choice(["[]", "[1]", '["x"]', '["momentum", "momentum"]', "x"])),
        "observers.frames=" + str(rng.choice(['["x"]', '["left_distal", "left_distal"]', "3"])),
        "robot.changes." + str(rng.choice(["linkage.L1=0", "body.mass=-1", "wing.x=1", "name=", "linkage=3"])),
        "unknown_force.0=" + str(rng.choice(["3", "{}", "[]", '{frame="left_distal", signal="none"}'])),
        'unknown_force=[{signal="recorded", frame="left_distal", file="'
        + str(rng.choice([300 * "f", ".", "x"]))
        + '"}]',
    )
    return ["run", "paper", "--out", "out", *SHORT, "--set", settings[rng.integers(len(settings))]]


def _path(rng: Rng, place: Path) -> list[str]:
    """Give a path that no file has, that is too long, or that is a pipe or a folder."""
    os.mkfifo(place / "pipe")
    os.mkfifo(place / "pipe.toml")
    (place / "loop.toml").symlink_to("loop.toml")
    long = int(rng.integers(256, 5000)) * "n"
    names = [long, f"{long}.toml", f"a/{long}", "pipe", "pipe.toml", "loop.toml", ".", "/", "/dev/null", "x"]
    name = str(rng.choice(names))
    reads = (["run", name], ["sweep", name], ["linkage", name], ["urdf", name], ["trim", name], ["estimate", name])
    reads += (["crank", name], ["compare", name, name], ["estimate", name, "--suggest"])
    reads += (["convert", name, "--out", "out.mcap"],)
    reads += (["calibrate", name, "--out", "out.nc"], ["estimate", "x.csv", "--map", name], ["describe", "map", name])
    reads += (["live", name], ["live", "x.csv", "--map", name], ["node", "--map", name])
    reads += (["check", name, "--calibration", "x.nc"], ["check", "x.nc", "--calibration", name])
    reads += (["play", name], ["play", "--from-csv", name, "--urdf", name])
    good = ["run", "paper", *SHORT]
    writes = ([*good, "--out", long], ["linkage", "--out", long], ["linkage", "--out", f"{long}.png"])
    writes += (["urdf", "--out", f"{long}.urdf"], ["trim", "paper", "--out", long], ["play", "x.nc", "--out", long])
    writes += (["run", "paper", *SHORT, "--out", f"pipe/{long}"],)
    words = [*reads, *writes]
    return list(words[rng.integers(len(words))])


CHANGES: dict[str, Callable[[Rng, str], str | bytes]] = {
    "nested lists": _lists,
    "not UTF-8": _encoding,
    "unknown key": _unknown,
    "wrong value": _value,
    "missing key": _missing,
    "broken syntax": _syntax,
    "wrong name": _name,
}
TEXT: dict[str, Kind] = {name: _written(change) for name, change in CHANGES.items()}
TEXT |= {"setting": _setting, "path": _path}


def _flight(rng: Rng, place: Path) -> list[str]:
    settings = (
        [f"simulation.duration=1e{rng.integers(4, 300)}"],
        [f"simulation.dt=1e-{rng.integers(8, 300)}"],
        [f"simulation.dt=1e-{rng.integers(10, 15)}", "simulation.duration=1e-9"],
        ["simulation.duration=10000", "unknown_force.*.tick=1e-5", "simulation.dt=0.02"],
        ["crank.frequency=1e-9", "air.warm_up_cycles=6"],
    )
    door = [["run", "paper", "--out", "out", "--no-report"], ["trim", "paper", "--out", "out.toml"]][rng.integers(2)]
    chosen = settings[rng.integers(len(settings))]
    if door[0] == "trim":
        chosen = [f"simulation.dt=1e-{rng.integers(7, 12)}", "simulation.duration=1e-3", "air.warm_up_cycles=0"]
    return [*door, *(word for setting in chosen for word in ("--set", setting))]


def _runs(rng: Rng, place: Path) -> list[str]:
    """Ask for more runs than a sweep may have, or for runs that are too long together."""
    count = int(10.0 ** rng.uniform(5.1, 18.0))
    texts = (
        f"seeds = {count}",
        f'[ranges]\n"observers.gain" = {{from = 1, to = 2, count = {count}}}',
        f'[draws]\ncount = {count}\n[draws.values]\n"air.density" = {{distribution = "uniform", low = 1, high = 2}}',
        f'[factors.a]\nvalues = {{from = 1, to = 2, count = {count}}}\nof = {{"observers.gain" = 1}}',
        f'[ranges]\n"simulation.duration" = [1e{rng.integers(4, 300)}]',
    )
    (place / "s.toml").write_text('name = "s"\nbase = "paper"\n' + texts[rng.integers(len(texts))])
    return words_for("sweep", "s.toml")


def _table(rng: Rng, place: Path) -> list[str]:
    """Give a table of hundreds of megabytes, which is sparse here."""
    with (place / "log.csv").open("wb") as file:
        file.write(b"time,x,y,z,qx,qy,qz,qw,crank_angle\n0,0,0,0,0,0,0,1,0\n")
        file.truncate(int(10.0 ** rng.uniform(8.1, 12.0)))
    (place / "arm.urdf").write_text('<robot name="r"><link name="base"/></robot>')
    (place / "map.toml").write_text('[robot]\nurdf = "arm.urdf"\npoints = ["base"]\n')
    force = 'unknown_force=[{signal="recorded", frame="left_distal", file="log.csv"}]'
    doors = (
        ["estimate", "log.csv", "--out", "out"],
        ["estimate", "log.csv", "--map", "map.toml", "--out", "out"],
        ["calibrate", "log.csv", "--out", "out.nc"],
        ["play", "log.csv", "--out", "out.html"],
        ["play", "--from-csv", "log.csv", "--urdf", "arm.urdf", "--out", "out.html"],
        ["run", "paper", "--out", "out", *SHORT, "--set", force],
    )
    return list(doors[rng.integers(len(doors))])


SIZES: dict[str, Kind] = {"long or fine flight": _flight, "many runs": _runs, "large table": _table}
