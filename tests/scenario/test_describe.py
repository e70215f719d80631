"""`aerobat describe scenario`: no key without type, unit, default and meaning, and what it says is so."""

import inspect
import re
from collections.abc import Callable
from typing import get_args

import numpy as np
import pytest
from support.commands import call

from aerobat_pin.aerobat import estimate_flight, known_inputs
from aerobat_pin.errors import AerobatError, ScenarioError
from aerobat_pin.experiments import Experiment, run
from aerobat_pin.observers import OBSERVERS, KalmanObserver
from aerobat_pin.records import Map, describe_map
from aerobat_pin.scenario import ObserverSection, Scenario, Section, describe_scenario, load_scenario
from aerobat_pin.scenario.describe import COLUMNS, _keys_below, _part_of, unit_and_meaning
from aerobat_pin.scenario.tables import sections_of


def sections(section: type[Section] = Scenario) -> dict[str, type[Section]]:
    """Return every section that a scenario may hold, by its name."""
    found = {section.__name__: section}
    for field in section.model_fields.values():
        for kind in sections_of(field.annotation).values():
            found |= sections(kind)
    return found


def inside(annotation: object) -> set[object]:
    return {annotation}.union(*(inside(one) for one in get_args(annotation))) if get_args(annotation) else {annotation}


@pytest.mark.parametrize(
    ("wanted", "first", "holds", "lines"),
    [
        ("observers.gain", "[observers]", "number > 0 [1/s], default 1000.0", 3),
        ("name", "  name", "text, required", 2),
        ("unknown_force.0.noise", "[[unknown_force]]", "number >= 0 [N]", 3),
        ("crank", "[crank]", "[crank.motor]", 31),
        ("air.gust", "[air.gust]", "amplitude", 9),
    ],
)
def test_one_table_or_key_is_described_alone(wanted: str, first: str, holds: str, lines: int) -> None:
    """A table with the tables in it, or a key below the name of its table; an index of a list may stand in it."""
    text = describe_scenario(wanted)
    assert text.startswith(first)
    assert holds in text
    assert len(text.splitlines()) <= lines
    assert all(line in describe_scenario() for line in text.splitlines())


def test_a_key_that_is_none_is_told_its_neighbours() -> None:
    """One line, with what was probably meant."""
    with pytest.raises(ScenarioError, match=r"observers\.gian: there is no such .* did you mean 'observers\.gain'"):
        describe_scenario("observers.gian")


@pytest.mark.parametrize(("root", "describe"), [(Scenario, describe_scenario), (Map, describe_map)])
def test_every_key_is_described_alone_and_no_other_is_offered(
    root: type[Section], describe: Callable[[], str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also those of tables whose titles fill more than a line; a word with which a line begins is no key."""
    offered: list[str] = []
    monkeypatch.setattr("aerobat_pin.scenario.describe.did_you_mean", lambda _, known: offered.extend(known) or "")
    text, there = describe(), set()
    for key in _keys_below(root, ""):
        assert f"  {key.rpartition('.')[2]} " in _part_of(text, key, "")
        parts = key.replace(".*", "").split(".")
        there |= {".".join(parts[: k + 1]) for k in range(len(parts))}
    with pytest.raises(ScenarioError):
        _part_of(text, "nothing", "")
    assert set(offered) <= there


@pytest.mark.parametrize("name", sections())
def test_every_key_has_a_meaning_and_every_number_a_unit(name: str) -> None:
    """In brackets; [-] for a pure number. Tables of the scenario are told by their section's own sentence."""
    section = sections()[name]
    assert section.__doc__
    for key, field in section.model_fields.items():
        unit, meaning = unit_and_meaning(field.description or "")
        tables = sections_of(field.annotation)
        assert meaning or (tables and all(one.__doc__ for one in tables.values())), f"{name}.{key}: no description"
        if float in inside(field.annotation):
            assert unit, f"{name}.{key}: no unit"


def test_the_text_names_every_key_of_every_section_under_its_table(capsys: pytest.CaptureFixture[str]) -> None:
    """Printed by the command line, no line longer than the terminal."""
    assert call("describe", "scenario") == 0
    text = capsys.readouterr().out
    assert text == describe_scenario()
    assert max(map(len, text.splitlines())) <= COLUMNS
    for name, section in sections().items():
        for key, field in section.model_fields.items():
            if field.description or not sections_of(field.annotation):
                assert re.search(rf"^  {key} +\S", text, re.MULTILINE), f"{name}.{key}"
    for title in ("[crank.motor]", "[air.gust]", '[[unknown_force]] with signal = "step"', "[observers.smoother]"):
        assert title in text


@pytest.mark.parametrize(
    ("lines"),
    [
        "  density         number > 0 [kg/m3], default 1.225\n                  of the air",
        "  strips          whole number >= 2, <= 200, default 16\n                  strips over the full span",
        "  lift_limit      number > 0 [-], may be left out\n",
        "  attitude_stiffness  3 numbers >= 0 [N m/rad], required\n                      roll, pitch, yaw",
        '  drive      "constant" or "spin_up" or "motor", default "constant"\n',
        "  dropout  number >= 0, < 1 [-], default 0.0\n",
        "  phase_deg  number [deg], default 0.0\n             at t = 0",
        "  name         text, required\n",
        '  names           list of texts, default ["momentum", "force_level"]\n',
    ],
)
def test_a_key_is_told_with_type_bounds_unit_and_default(lines: str) -> None:
    assert lines in describe_scenario()


def test_keys_that_all_signals_share_are_told_once_unless_a_signal_has_its_own() -> None:
    """The paper's signal is noisy by default, the others are not."""
    text = describe_scenario()
    assert len(re.findall(r"^  direction ", text, re.MULTILINE)) == 1
    assert len(re.findall(r"^  noise +number >= 0 \[N\]", text, re.MULTILINE)) == 2


@pytest.mark.parametrize("name", OBSERVERS)
def test_the_table_of_an_observer_has_its_arguments_and_their_defaults(name: str) -> None:
    """One key per keyword of the constructor but `expected`; an empty table changes nothing. Without any, no table."""
    arguments = inspect.signature(OBSERVERS[name]).parameters.values()
    defaults = {one.name: one.default for one in arguments if one.kind is inspect.Parameter.KEYWORD_ONLY}
    assert (name in ObserverSection.model_fields) == bool(defaults)
    defaults.pop("expected", None)  # of an estimate, which knows the log; not of a scenario
    section = getattr(ObserverSection.model_validate({name: {}}), name) if name in ObserverSection.model_fields else ()
    assert {key: value or None if key == "known_error" else value for key, value in section} == defaults


def with_kalman(*settings: str) -> Scenario:
    """Return the paper's scenario with the Kalman filter and its settings."""
    given = ["observers.names=['kalman']", *(f"observers.kalman.{one}" for one in settings)]
    return load_scenario("paper", given)


def test_the_settings_of_a_scenario_reach_the_observer(paper: Experiment) -> None:
    """The same estimate as from the observer built by hand with these arguments, and another than without them."""
    settings = {"force_walk": 0.7, "known_error": {"aerodynamic": 0.2}, "mass_error": 0.05}
    scenario = with_kalman("force_walk=0.7", "known_error.aerodynamic=0.2", "mass_error=0.05")
    found = estimate_flight(paper.log, paper.robot, scenario).estimates
    inputs = known_inputs(paper.log, paper.robot, "measured", scenario.believed_air)
    by_hand = KalmanObserver(
        paper.robot.model, scenario.observers.frames, scenario.observers.gain, inputs.rows, **settings
    ).run(inputs.time, inputs.q, inputs.v, inputs.tau, inputs.known)
    np.testing.assert_array_equal(found["kalman"].force, by_hand.force)
    plain = estimate_flight(paper.log, paper.robot, with_kalman()).estimates["kalman"]
    assert np.max(np.abs(plain.force - by_hand.force)) > 1e-3


def test_a_known_force_that_there_is_not_is_named() -> None:
    """By the observer, which knows what it is fed."""
    short = ["simulation.duration=0.05", "air.warm_up_cycles=1"]
    settings = [*short, "observers.names=['kalman']", "observers.kalman.known_error.wings=0.1"]
    with pytest.raises(AerobatError, match="names 'wings': the known forces are aerodynamic, added_mass, thrusters"):
        run(load_scenario("paper", settings))
