"""Names of before work for one release."""

import importlib
import subprocess
import sys

import pytest


@pytest.mark.parametrize(
    ("door", "old", "place", "new"),
    [
        ("flight", "Flown", "flight", "Trajectory"),
        ("estimation", "Compared", "estimation", "PairedEstimate"),
        ("aerobat.raw", "RawChannel", "aerobat.raw", "SensorSamples"),
        ("robot", "load_aerobat", "aerobat", "load_aerobat"),
        ("estimation", "r_squared", "forces", "r_squared"),
        ("estimation", "ForceNode", "experiments", "ForceNode"),
        ("aerodynamics", "RobotAir", "aerobat", "RobotAir"),
    ],
)
def test_a_name_of_before_works_and_warns(door: str, old: str, place: str, new: str) -> None:
    """Of what is called otherwise, and of what has moved."""
    room, now = (importlib.import_module(f"aerobat_pin.{each}") for each in (door, place))
    with pytest.warns(DeprecationWarning, match=f"{old} is called aerobat_pin.{place}.{new} now"):
        assert getattr(room, old) is getattr(now, new)
    with pytest.raises(AttributeError):
        room.nothing  # noqa: B018


def test_a_room_of_before_is_found_however_it_is_imported() -> None:
    """The package had no attribute `robot`, and a star brought nothing without a word."""
    script = (
        "import aerobat_pin.robot\naerobat_pin.robot.load_aerobat, aerobat_pin.robot.joint_wrench\n"
        "from aerobat_pin.robot import *\nload_aerobat, joint_wrench"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stderr.count("aerobat_pin.robot.load_aerobat is called aerobat_pin.aerobat.load_aerobat now") == 2
