"""Names of before work for one release."""

import importlib

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
    with pytest.warns(DeprecationWarning, match=f"{old} is called {new} now"):
        assert getattr(room, old) is getattr(room, new)
    with pytest.raises(AttributeError):
        room.nothing  # noqa: B018
