"""Names of before work for one release."""

import importlib
import subprocess
import sys

import pytest


@pytest.mark.parametrize(
    ("door", "old", "new"),
    [
        ("flight", "Flown", "Trajectory"),
        ("estimation", "Compared", "PairedEstimate"),
        ("aerobat.raw", "RawChannel", "SensorSamples"),
    ],
)
def test_a_name_of_before_works_and_warns(door: str, old: str, new: str) -> None:
    room = importlib.import_module(f"aerobat_pin.{door}")
    with pytest.warns(DeprecationWarning, match=f"{old} is called aerobat_pin.{door}.{new} now"):
        assert getattr(room, old) is getattr(room, new)
    with pytest.raises(AttributeError):
        room.nothing  # noqa: B018


@pytest.mark.parametrize(
    ("door", "name", "place"),
    [
        ("robot", "load_aerobat", "aerobat"),
        ("robot", "joint_wrench", "observers"),
        ("estimation", "r_squared", "forces"),
        ("estimation", "ForceNode", "experiments"),
        ("aerodynamics", "RobotAir", "aerobat"),
    ],
)
def test_a_name_that_moved_is_found_at_its_old_door(door: str, name: str, place: str) -> None:
    room, now = (importlib.import_module(f"aerobat_pin.{each}") for each in (door, place))
    with pytest.warns(DeprecationWarning, match=f"{door}.{name} is called aerobat_pin.{place}.{name} now"):
        assert getattr(room, name) is getattr(now, name)


@pytest.mark.parametrize(
    "script",
    [
        "import aerobat_pin.robot\naerobat_pin.robot.load_aerobat, aerobat_pin.robot.joint_wrench",
        "from aerobat_pin.robot import *\nload_aerobat, joint_wrench",
    ],
)
def test_a_room_of_before_is_found_however_it_is_imported(script: str) -> None:
    """The package had no attribute `robot`, and a star brought nothing without a word."""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert "aerobat_pin.robot.load_aerobat is called aerobat_pin.aerobat.load_aerobat now" in done.stderr
