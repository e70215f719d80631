"""A robot with a force of its own, as a user would write it: the drone of the example, and what it gets for that."""

import importlib.util
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from aerobat_pin.errors import CalibrationError, ObserverError
from aerobat_pin.estimation import calibrate, estimate
from aerobat_pin.experiments import check_record
from aerobat_pin.observers import MomentumObserver
from aerobat_pin.records import Record

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "13_a_force_of_your_own.py"


@pytest.fixture(scope="module")
def example() -> ModuleType:
    """The example as a module."""
    found = importlib.util.spec_from_file_location("a_force_of_your_own", EXAMPLE)
    module = sys.modules[found.name] = importlib.util.module_from_spec(found)
    found.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def flights(example: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> tuple[Record, Record]:
    """The flight of a plain drone, and of one that knows its drag."""
    first, second = example.records(tmp_path_factory.mktemp("drone"))
    return first, second


def test_what_the_robot_knows_is_no_unknown_force(example: ModuleType, flights: tuple[Record, Record]) -> None:
    """By the closed form: m a = thrust + weight + drag + push, whose samples the table holds exactly."""
    plain, dragged = (estimate(record).estimates["force_level"].force[:, 0] for record in flights)
    table = example.flight()
    speed = table[["vx", "vy"]].to_numpy() * table[["r1", "r2"]].sum(axis=1).to_numpy()[:, None]
    drag = -example.DRAG * 0.5 * (speed[1:] + speed[:-1])
    assert np.max(np.abs(dragged[100:580])) < 2e-3
    np.testing.assert_allclose(dragged[640:780].mean(axis=0), example.PUSH, atol=2e-3)
    assert np.max(np.abs((plain - dragged)[100:, :2] - drag[100:])) < 0.2 * np.max(np.abs(drag))  # behind the filter


def test_a_known_force_is_found_again_in_the_flight(flights: tuple[Record, Record]) -> None:
    """At the body, along every axis."""
    checks = check_record(flights[1])
    assert [check.axis for check in checks] == ["x", "y", "z"]
    assert all(check.ok for check in checks), "\n".join(map(str, checks))


def test_observers_by_name_and_of_ones_own_run_side_by_side(flights: tuple[Record, Record]) -> None:
    """Both, each under its name; two of one name are refused."""
    record = flights[1]
    own = MomentumObserver(record.robot.model, ["body"], 40.0)
    assert sorted(estimate(record, ["force_level", own]).estimates) == ["force_level", "momentum"]
    with pytest.raises(ObserverError, match=r"\['momentum', 'momentum'\]: different ones were expected"):
        estimate(record, ["momentum", own])


def test_a_calibration_identifies_what_the_robot_knows_of_itself(
    example: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A drag that is believed 30 % too large comes back from a flight without push, and nothing is left."""
    monkeypatch.setattr(example, "PUSH", np.zeros(3))
    _, record = example.records(tmp_path)
    wrong = replace(record, robot=record.robot.changed({"drag": 0.3}))
    found = calibrate([wrong], parameters=["drag"])
    assert found.changes["drag"] == pytest.approx(1.0 / 1.3 - 1.0, abs=2e-3)
    without, bar = found.error_bar["body.Fx"]
    assert bar < 0.05 * without
    with pytest.raises(CalibrationError, match="parameters has 'luck': of drag some were expected"):
        calibrate([wrong], parameters=["luck"])
