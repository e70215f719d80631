"""The size of a flight is estimated before it begins: steps, bytes of the log, seconds; too large a one is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from aerobat_pin.errors import LogError, ScenarioError, TrimError
from aerobat_pin.flight.simulate import simulate
from aerobat_pin.flight.trim import find_trim
from aerobat_pin.scenario.csv_rows import TextTable
from aerobat_pin.scenario.scenario import load_scenario


@pytest.mark.parametrize("strips", [4, 16, 40])
def test_the_log_has_the_size_that_was_estimated(strips: int) -> None:
    """To 3 %: measured and true channels together."""
    scenario = load_scenario("paper", ["simulation.duration=0.05", "simulation.dt=1e-4", f"air.strips={strips}"])
    log = simulate(scenario)
    assert log.truth is not None
    assert log.measured.nbytes + log.truth.nbytes == pytest.approx(scenario.size.log_bytes, rel=0.03)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (
            ["simulation.duration=1e7"],
            r"duration = 1e\+07 s .* 1e\+10 steps, a log of 2\.\d+e\+04 GB and about 1e\+06 s",
        ),
        (["simulation.dt=1e-12"], r"dt = 1e-12 s.*at most 2 GB and 3600 s are allowed: a shorter simulation\.duration"),
        (["simulation.dt=1e-12", "simulation.duration=1e-11"], "a longer simulation.dt"),  # the warm-up alone
        (["simulation.duration=10_000", "simulation.dt=0.02", "unknown_force.*.tick=1e-5"], r"unknown_force\.\*\.tick"),
        (["simulation.duration=1e10", "simulation.dt=1e-300"], "not a whole number of steps"),
    ],
)
def test_too_large_a_flight_is_refused_before_it_takes_memory(settings: list[str], message: str) -> None:
    """With the estimate, the limit, and the key to change; also where a copy of a good scenario is made too large."""
    with pytest.raises(ScenarioError, match=message):
        load_scenario("paper", settings)


def test_python_is_refused_as_the_command_line_is() -> None:
    """`model_copy` checks nothing."""
    good = load_scenario("paper")
    large = good.model_copy(update={"simulation": good.simulation.model_copy(update={"duration": 1e7})})
    with pytest.raises(ScenarioError, match=r"a shorter simulation\.duration"):
        simulate(large)


def test_a_search_for_trim_is_sized_too() -> None:
    """It flies hundreds of flaps, of which a scenario alone knows nothing."""
    tiny = load_scenario("paper", ["simulation.dt=1e-6", "simulation.duration=1e-3"])
    with pytest.raises(TrimError, match=r"takes some 320 flaps, about 6\.7\d+e\+03 s; at most 3600 s"):
        find_trim(tiny)


def test_a_table_of_hundreds_of_megabytes_is_refused_by_its_size(tmp_path: Path) -> None:
    """Before a byte of it becomes a number; the number of rows is estimated from its beginning."""
    with (tmp_path / "log.csv").open("wb") as file:
        file.write(50_000 * b"0,1\n")
        file.truncate(200_000_000)
    with pytest.raises(LogError, match=r"log\.csv: 200 MB, about 5e\+07 rows; at most 100 MB are read"):
        TextTable(tmp_path / "log.csv", "log", LogError)
