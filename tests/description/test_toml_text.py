"""TOML from strangers: limits are checked before parsing, strings and comments do not count, messages name lines."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from aerobat_description.morphology import Morphology
from aerobat_description.reading import MorphologyError
from aerobat_description.toml_text import LARGEST_TOML, TomlError, toml_file, toml_values
from aerobat_pin.errors import ScenarioError, SweepError
from aerobat_pin.experiments import load_sweep
from aerobat_pin.scenario.scenario import load_scenario
from aerobat_pin.scenario.toml import parsed_value, with_settings

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
def test_all_three_doors_refuse_the_same_files(
    read: Callable[[str | Path], object], error: type[Exception], tmp_path: Path
) -> None:
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
    with pytest.raises(
        ScenarioError, match=r"simulation\.dt = '9+\.\.\. \(5002 characters\): input should be a valid number"
    ):
        load_scenario("paper", ["simulation.dt=" + 5000 * "9"])


def test_names_that_make_file_names_are_short() -> None:
    """Of scenarios and robots; file systems take 255 bytes."""
    with pytest.raises(ScenarioError, match=r"name = '.*at most 200 characters"):
        load_scenario("paper", ["name=" + 300 * "n"])
    with pytest.raises(MorphologyError, match=r"name = '.*100 at most"):
        Morphology.load("aerobat", {"name": 51 * "²"})
