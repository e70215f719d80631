"""What a scenario changes of the shipped one whose name it carries, and that every result says so."""

from __future__ import annotations

from typing import Any

import pytest

from aerobat_pin.scenario import (
    changed_keys,
    changes_text,
    described,
    load_scenario,
    parse_scenario,
    shipped_scenarios,
)


@pytest.mark.parametrize(
    ("settings", "changed"),
    [
        ([], {}),
        (["believed.air.density=1.47"], {"believed.air.density": 1.47}),
        (["unknown_force.*.noise=0.5"], {"unknown_force.0.noise": 0.5, "unknown_force.1.noise": 0.5}),
        (["sensors.gyro.noise=0.05", "observers.gain=50"], {"sensors.gyro.noise": [0.05], "observers.gain": 50.0}),
        (["air.wind=[1,0,0]"], {"air.wind": [1.0, 0.0, 0.0]}),
        (['observers.names=["kalman"]'], {"observers.names": ["kalman"]}),
        (["simulation.seed=1"], {}),  # as it is
        (["name=mine", "simulation.seed=7"], {}),  # another scenario: nothing that it could be taken for
    ],
)
def test_what_differs_from_the_shipped_scenario_is_named(settings: list[str], changed: dict[str, Any]) -> None:
    """Dotted keys as `--set` takes them, with the new values; defaults of a new table stay out."""
    assert changed_keys(load_scenario("paper", settings)) == changed


def test_what_is_taken_away_is_named_too() -> None:
    """A hold that is gone is null; a list of another length is one value."""
    values = load_scenario("paper").model_dump(exclude_none=True)
    del values["hold"]
    values["unknown_force"] = values["unknown_force"][:1]
    changed = changed_keys(parse_scenario(values, "mine"))
    assert changed["hold"] is None
    assert [force["frame"] for force in changed["unknown_force"]] == ["left_force_point"]
    assert set(changed) == {"hold", "unknown_force"}
    assert changes_text("paper", changed).startswith("changed from paper: hold = none, unknown_force = [{frame = left")


@pytest.mark.parametrize("name", shipped_scenarios())
def test_a_shipped_scenario_changes_nothing(name: str) -> None:
    """Not even after it was written with all its defaults."""
    assert changed_keys(load_scenario(name)) == {}
    assert changes_text(name, {}) == ""


def test_a_description_does_not_contradict_its_scenario() -> None:
    """That of a shipped scenario goes when a key changes and comes back with it; the user's own stays."""
    paper = load_scenario("paper")
    short = described(load_scenario("paper", ["simulation.duration=0.5"]))
    assert short.description == "changed from paper: simulation.duration = 0.5"
    longer = short.model_copy(update={"simulation": paper.simulation.model_copy(update={"duration": 3.0})})
    assert described(longer).description == "changed from paper: simulation.duration = 3"
    assert described(short.model_copy(update={"simulation": paper.simulation})) == paper == described(paper)
    own = load_scenario("paper", ["description=mine", "simulation.duration=0.5"])
    assert described(own) == own
    assert "2 s, noise" not in repr(short)


def test_a_long_list_of_changes_stays_a_line() -> None:
    """Eight of them, and how many more; six digits of a number."""
    text = changes_text("paper", {f"key{i}": 1.0 / 3.0 for i in range(10)})
    assert text.startswith("changed from paper: key0 = 0.333333, key1")
    assert text.endswith("key7 = 0.333333, and 2 more")
