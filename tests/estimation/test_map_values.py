"""Values of a map that no recording can mean: each is refused by its key, or by name once the record is known."""

from pathlib import Path
from typing import Any

import pytest
from support.bad_maps import keys
from support.recorded import edited, recorded
from support.walking_log import table, table_map, urdf, walk

from aerobat_pin.errors import LogError, MapError
from aerobat_pin.estimation import estimate
from aerobat_pin.records import parse_map

SENSOR = {"columns": ["fl_fx", "fl_fy", "fl_fz"], "point": "FL_FOOT"}


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a robot and the table of its walk, 0.3 s at 200 Hz."""
    folder = tmp_path_factory.mktemp("walk")
    (folder / "robot.urdf").write_text(urdf())
    table(walk(0.3, 200.0)).to_csv(folder / "log.csv", index=False)
    return folder


RIGHT = table_map(Path("robot.urdf"))


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("use.free", [0.2, 0.1], r"use\.free = \[0\.2, 0\.1\]: from and to were expected, the smaller one first"),
        ("check.wrench.tare", [0.2, 0.1], r"check\.wrench\.tare = .*the smaller one first"),
        ("log.delimiter", "\\s+", r"log\.delimiter = .*at most 1 character"),
        ("use.when", {"above": 1.0}, r"missing key 'use\.when\.column'"),
        ("use.when", {"column": "px"}, r"use\.when: above or below was expected"),
        ("use.when", {"column": "px", "above": 1.0, "below": -1.0}, r"use\.when: above or below was expected"),
        ("use.when", {"column": "px", "above": 0.0, "trim": [-1.0, 0.0]}, r"use\.when\.trim\.0 = -1\.0"),
        ("known.t", {"columns": ["px"], "law": "polynomial 1 1"}, 'law = "polynomial 1 1": .*once each'),
        ("known.t", {"columns": ["px"], "law": "polynomial 1", "fit": {"part": [0.5, 1.5]}}, r"fit\.part\.1 = 1\.5"),
        ("known.t", {"columns": ["px"], "law": "polynomial 1", "fit": {"part": [0.5, 0.1]}}, r"fit\.part = .*smaller"),
        ("payload", {"frame": "trunk", "mass": 1.0, "inertia": [-1.0, 0.0, 0.0]}, r"payload\.inertia\.0 = -1\.0"),
        ("payload", {"frame": "trunk", "mass": 1, "com": [0.1, 0.2]}, r"payload\.com = \[0\.1, 0\.2\]: 3 numbers were"),
        ("payload", {"frame": "trunk", "mass": 1.0, "com": [0.1, 0.2, 0.3, 0.4]}, r"payload\.com = .*3 numbers were"),
        ("robot.down", [0.0, 1.0], r"robot\.down"),
        ("joints.effort.torque_per_unit", {"*": 0.0}, "another number than 0 was expected"),
        ("joints.effort.torque_per_unit", [6.1, 5.2], r"\[6\.1, 5\.2\]: a table \{joint = 6\.1, \.\.\.\} was expected"),
        ("joints.friction", "coulomb+viscous", r"joints\.friction = .*: a table of law, fit, to, scale was expected"),
        ("joints.coupling", {"knee": [1, 2]}, r"joints\.coupling\.knee = \[1, 2\]: a table \{name = 1, \.\.\.\} was"),
    ],
)
def test_a_value_that_cannot_be_is_refused_by_its_key(key: str, value: Any, said: str) -> None:
    """Before a log is read."""
    with pytest.raises(MapError, match=said):
        parse_map(edited(RIGHT, {key: value}), "map.toml")


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("use.free", [50.0, 60.0], r"use\.free = \[50\.0, 60\.0\]: a stretch within the record's 0\.3 s"),
        ("use.free", [-2.0, -1.0], r"use\.free = .*a stretch within the record's 0\.3 s"),
        ("payload", {"frame": "trunk", "fit": [5.0, 6.0]}, r"payload\.fit = .*within the record's"),
        ("check.wrench", {**SENSOR, "part": [5.0, 6.0]}, r"check\.wrench\.part = .*within the record's"),
        ("check.wrench", {**SENSOR, "filter": 1e-300}, r"check\.wrench\.filter = 1e-300 Hz: a period within"),
        ("check.wrench", {**SENSOR, "filter": 100.0}, r"filter = 100 Hz: .*less than half its rate of 200 Hz"),
        ("robot.points", [], r"check\.wrench: .*robot\.points = \[\].* leave one of the two out"),
        ("observer.names", ["momentum", "momentum"], "different ones were expected"),
    ],
)
def test_a_value_outside_the_record_is_refused(key: str, value: Any, said: str, recording: Path) -> None:
    """Its length and rate are known once it is read."""
    with pytest.raises((MapError, LogError, ValueError), match=said):
        estimate(recorded(recording / "log.csv", edited(RIGHT, {key: value})))


def test_the_schema_reaches_every_table() -> None:
    """From which `make reliability` draws: keys in tables of tables and of names, too."""
    found = dict(keys())
    some = {"robot.body.mass", "use.when.trim", "known.thrust.fit.part", "joints.friction.fit", "log.time.unit"}
    assert some <= set(found)
    assert len(found) > 100
