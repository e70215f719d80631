"""Names of before work for one release."""

import importlib

import pytest


@pytest.mark.parametrize(
    ("door", "old", "new"),
    [
        ("flight", "Flown", "Trajectory"),
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
        ("aerodynamics", "RobotAir", "aerobat"),
    ],
)
def test_a_name_that_moved_is_found_at_its_old_door(door: str, name: str, place: str) -> None:
    room, now = (importlib.import_module(f"aerobat_pin.{each}") for each in (door, place))
    with pytest.warns(DeprecationWarning, match=f"{door}.{name} is called aerobat_pin.{place}.{name} now"):
        assert getattr(room, name) is getattr(now, name)
