"""Robots whose parts do not fit are refused on load, by key, value and rule; TOML from strangers, before parsing."""

import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pytest
from support.readers import URDF

from aerobat_description.morphology import Morphology
from aerobat_description.reading import BUILT_IN, MorphologyError
from aerobat_description.toml_text import LARGEST_TOML, TomlError, toml_file, toml_values
from aerobat_pin.aerobat import load_aerobat
from aerobat_pin.errors import MorphologyFileError, ScenarioError, SweepError
from aerobat_pin.experiments import load_sweep
from aerobat_pin.scenario import load_scenario, with_settings
from aerobat_pin.scenario.toml import parsed_value

EDGES = {"proximal_leading_edge": [0.0635, 0.07, 0.0765], "proximal_trailing_edge": [-0.0956, -0.1, -0.111]}


def thruster(name: str) -> dict[str, Any]:
    return {"name": name, "position": [0.1, 0.0, 0.0], "direction": [0.0, 0.0, 1.0], "thrust": 0.1}


def test_the_names_that_are_taken_are_those_of_the_tree() -> None:
    """Links and joints of the committed URDF, and the two that Pinocchio adds to its model."""
    root = ET.parse(URDF["aerobat"]).getroot()
    tree = {str(one.get("name")) for kind in ("link", "joint") for one in root.findall(kind)}
    model = load_aerobat().model
    assert tree | set(model.names) | {frame.name for frame in model.frames} == BUILT_IN


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (("a", "a"), r"thrusters\[1\]\.name = 'a': another link"),
        (("a", "b", "a_fixed"), r"thrusters\[2\]\.name = 'a_fixed': another link"),
        (("a_fixed", "a"), r"thrusters\[1\]\.name = 'a': another link"),
        (("",), r"thrusters\[0\]\.name = '': letters, digits, _ and - only"),
        (("a b",), r"thrusters\[0\]\.name = 'a b': letters"),
    ],
)
def test_thrusters_have_plain_names_of_their_own(names: tuple[str, ...], message: str) -> None:
    with pytest.raises(MorphologyError, match=message):
        Morphology.load("aerobat", {"thrusters": [thruster(name) for name in names]})
    load_aerobat("aerobat", {"thrusters": [thruster("a"), thruster("b")]})


EDGE, STARTS = [0.2, 0.0807, 0.118, 0.101], "it starts where the proximal one ends, at"
STATIONS, REAR = r"wing\.proximal_stations", [-0.0956, -0.112]
GUARD = {"radius": [0.1, 0.3], "centre": 0.0, "tube": 0.3}
FLAT = {"proximal_trailing_edge": [-0.1, 0.0765], "distal_trailing_edge": [0.0765, 0.0807, 0.118, 0.101]}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"wing": {"proximal_stations": [0, 0.1]}}, rf"{STATIONS} = \(0\.0, 0\.1\): the last one is at the elbow"),
        ({"wing": {"proximal_stations": [0, 0.046]}}, rf"{STATIONS} = .*, 0\.04879 m .*, to 5 %"),
        ({"wing": {"distal_leading_edge": EDGE}}, rf"wing\.distal_leading_edge = \(0\.2, .*\): {STARTS} 0\.0765 m"),
        ({"wing": {"proximal_trailing_edge": REAR}}, rf"wing\.distal_trailing_edge = .*: {STARTS} -0\.112 m"),
        ({"wing": {"minimum_chord": 3.0}}, r"wing\.minimum_chord = 3\.0: the wing's largest chord is 0\.1957 m"),
        ({"wing": {"force_point": [0.0, -0.01, 0.0]}}, r"wing\.force_point = .* x is -0\.115 to"),
        ({"wing": {"force_point": [0.0, 0.14, 0.0]}}, r"wing\.force_point = .*: .* y 0 to 0\.132 m"),
        ({"wing": {"force_point": [0.0, 0.1, 0.07]}}, r"wing\.force_point = .*: .* z is within half of that"),
        ({"wing": {"offset_x": 1.0}}, r"wing\.offset_x = 1\.0: it is not larger than the span, 0\.403 m"),
        ({"guard": GUARD}, r"guard\.tube = 0\.3: it is smaller than the ring's half axes, 0\.1 m at least"),
        ({"scale": {"span": -1.0}}, r"scale\.span = -1\.0: it must be positive"),
        ({"scale": {"spam": 1.0}}, r"unknown key 'scale\.spam'; did you mean 'span'"),
        ({"body": {"com": [0.0, 0.01, 0.0]}}, r"body\.com = .*: base_link has its origin at the centre of mass"),
        ({"body": {"inertia": [2e-4, 1e-4, 2e-4, 1e-6, 0, 0]}}, r"body\.inertia = .*: left and right mirror"),
        ({"body": {"inertia": [2e-2, 1e-2, 2.1e-2, 0, 0, 0]}}, r"body\.inertia = .*: a radius of gyration of 0\.819 m"),
        ({"tail": {"position": [-0.1, 0.01, 0.0]}}, r"tail\.position = .*: left and right mirror each other"),
        ({"distal": {"com": [0.0, -0.05, 0.0]}}, r"distal\.com = .*: the centre of mass lies within the panel"),
        ({"wing": FLAT}, r"distal_leading_edge.*has no area"),
        ({"thrusters": 3}, r"thrusters = 3: a list of tables"),
        ({"thrusters": [{"name": "a"}]}, r"missing key 'thrusters\[0\]\.position'"),
    ],
)
def test_a_change_that_no_robot_can_have_is_refused_by_key_value_and_rule(changes: Any, message: str) -> None:
    """Planform against linkage and itself, force point, wing, guard, scales, symmetry, thrusters; at both doors."""
    with pytest.raises(MorphologyFileError, match=message):
        load_aerobat("aerobat").with_changes(changes)
    with pytest.raises(MorphologyFileError, match=message):
        load_aerobat("aerobat", changes)


def test_what_just_fits_is_a_robot() -> None:
    """Values at their bounds; the chord at most the largest one, the force point on a corner of the panel."""
    wing = Morphology.load("aerobat").wing
    at = (min(wing.distal_trailing_edge), wing.distal_stations[-1], 0.0)
    made = Morphology.load("aerobat", {"wing": {"minimum_chord": 0.195, "force_point": at, "offset_x": -0.4}})
    assert made.force_point == at
    Morphology.load("aerobat", {"wing": {"proximal_stations": [0.0, 0.047]}})


def test_the_proximal_stations_follow_the_elbow_unless_they_are_said() -> None:
    """A humerus 1.2 times as long carries a panel stretched alike, whose middle stays in the middle."""
    robot = Morphology.load("aerobat", {"wing": {"proximal_stations": [0.0, 0.03, 0.05], **EDGES}})
    longer = {"linkage": {"L3a": 1.2 * robot.linkage.L3a}}
    made = robot.with_changes(longer)
    stretch = math.hypot(*made.elbow) / math.hypot(*robot.elbow)
    assert stretch > 1.15
    assert made.wing.proximal_stations == pytest.approx([0.0, 0.03 * stretch, 0.05 * stretch], rel=1e-14)
    own = {**longer, "wing": {"proximal_stations": [0.0, 0.04, 0.059]}}
    assert robot.with_changes(own).wing.proximal_stations == (0.0, 0.04, 0.059)
    with pytest.raises(MorphologyError, match=r"wing\.proximal_stations = .*: the last one is at the elbow"):
        robot.with_changes({**longer, "wing": {"proximal_stations": [0.0, 0.03, 0.05]}})


DEEP, WORD = "line 2: more than 32 levels", "line 2: a word of"
REFUSED = {
    "a = " + 9000 * "[": DEEP,
    "a = " + 9000 * "[" + 9000 * "]": DEEP,
    "a = " + 9000 * "{b = " + "1" + 9000 * "}": DEEP,
    "[" + ".".join(9000 * "a") + "]": DEEP,
    9000 * '"a". ' + "a = 1": DEEP,
    "a = ['''b''''', \"\"\"c\"\"\"\"," + 9000 * "[": DEEP,
    "a = " + 5000 * "9": f"{WORD} 5000",
    "a = 0x" + 5000 * "f": f"{WORD} 5002",
    "a = 0." + 5000 * "1": f"{WORD} 5000",
    300 * "k" + " = 1": f"{WORD} 300",
    'a = "b\\u0000"': "line 2: a text with the character U\\+0000",
    "² = 1": "not valid TOML: Invalid statement",
    "a = 1979-02-31": "not valid TOML: Invalid date",
    "a = '''": "not valid TOML",
    'a = "' + 200_000 * '\\"': "not valid TOML",
    "#" + LARGEST_TOML * "x": "1000009 .*: at most 1000000 were expected",
}
ALLOWED = {
    "a = '" + 300 * "[" + "'": 300 * "[",
    'a = """' + 300 * "[.\n" + '"""': 300 * "[.\n",
    "a = 1 # " + 300 * "[" + 300 * "x": 1,
    "a = [" + 3000 * "1.5, " + "]": 3000 * [1.5],
    'a = "\\\\u0000"': "\\u0000",
}


@pytest.mark.parametrize("text", REFUSED, ids=lambda text: text[:24])
def test_text_beyond_a_limit_is_refused_with_its_line(text: str) -> None:
    """No RecursionError, no refusal by Python's limit of digits, and no search that takes longer than the text."""
    with pytest.raises(TomlError, match=REFUSED[text]):
        toml_values("# first\n" + text)


@pytest.mark.parametrize("text", ALLOWED, ids=lambda text: text[:24])
def test_strings_comments_and_long_lists_are_free(text: str) -> None:
    """Only what the parser would nest counts."""
    assert toml_values(text) == {"a": ALLOWED[text]}


@pytest.mark.parametrize(
    ("read", "error"), [(load_scenario, ScenarioError), (load_sweep, SweepError), (Morphology.load, MorphologyError)]
)
def test_three_doors_refuse_alike(read: Callable[[str | Path], object], error: type[Exception], tmp_path: Path) -> None:
    """The message names the file; a name that no file can have is the name of no file."""
    file = tmp_path / "deep.toml"
    file.write_text("a = " + 9000 * "[")
    with pytest.raises(error, match=r"deep\.toml: line 1: more than 32 levels"):
        read(file)
    file.write_bytes(b"name = '\xe9'")
    with pytest.raises(error, match=r"deep\.toml: cannot be read: 'utf-8' .* UTF-8 was expected"):
        read(file)
    for name in (300 * "n", "a\0b"):
        with pytest.raises(error, match=r"no (scenario|sweep|morphology)"):
            read(name)


def test_a_fifo_is_no_file(tmp_path: Path) -> None:
    """It would be waited for without an end."""
    os.mkfifo(tmp_path / "pipe.toml")
    with pytest.raises(TomlError, match="there is no such file"):
        toml_file(tmp_path / "pipe.toml")


def test_the_mark_at_the_start_of_a_file_from_windows_is_no_mistake(tmp_path: Path) -> None:
    """Editors there begin UTF-8 with U+FEFF."""
    (tmp_path / "a.toml").write_bytes("a = 1\r\n".encode("utf-8-sig"))
    assert toml_file(tmp_path / "a.toml") == {"a": 1}


def test_settings_have_the_same_limits() -> None:
    """What is no TOML stays text; a key has 32 parts at most; "²" is no index, though Python takes it for a digit."""
    assert parsed_value(9000 * "[") == 9000 * "["
    assert parsed_value(5000 * "9") == 5000 * "9"
    with pytest.raises(ScenarioError, match="9001 parts of a dotted key: at most 32"):
        with_settings({}, [9000 * "a." + "a=1"])
    with pytest.raises(ScenarioError, match="'²' is not an index"):
        with_settings({"unknown_force": [{}]}, ["unknown_force.².noise=1"])
    said = r"simulation\.dt = '9+\.\.\. \(5002 characters\): input should be a valid number"
    with pytest.raises(ScenarioError, match=said):
        load_scenario("paper", ["simulation.dt=" + 5000 * "9"])


def test_names_that_make_file_names_are_short() -> None:
    """Of scenarios and robots; file systems take 255 bytes."""
    with pytest.raises(ScenarioError, match=r"name = '.*at most 200 characters"):
        load_scenario("paper", ["name=" + 300 * "n"])
    with pytest.raises(MorphologyError, match=r"name = '.*100 at most"):
        Morphology.load("aerobat", {"name": 51 * "²"})
