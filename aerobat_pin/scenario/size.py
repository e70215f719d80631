"""How large a flight would be, estimated before it begins, and the limits above which it is refused."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from aerobat_pin.errors import ScenarioError

if TYPE_CHECKING:
    from aerobat_pin.scenario.scenario import Scenario

SECONDS_PER_STEP = 1.0e-4  # measured: 30 to 200 us for 16 to 200 strips, half of it more for two observers
BYTES_PER_STEP, BYTES_PER_STRIP = 980, 72  # of a step of the log; measured with 4, 16 and 60 strips
MOST_SECONDS, MOST_BYTES = 3600.0, 2.0e9  # of one flight; the simulation takes twice the memory of its log


@dataclass(frozen=True)
class FlightSize:
    """What a flight would take: steps (warm-up included), bytes of its log, and seconds on one processor."""

    steps: float
    log_bytes: float
    seconds: float

    def __str__(self) -> str:
        return f"{self.steps:.3g} steps, a log of {self.log_bytes / 1e9:.3g} GB and about {self.seconds:.3g} s"


def flight_size(scenario: Scenario) -> FlightSize:
    """Estimate what a scenario's flight would take, from constants that were measured."""
    times, frequency = scenario.simulation, scenario.crank.frequency
    flown = times.duration / times.dt
    warm_up = scenario.air.warm_up_cycles / frequency / times.dt if frequency > 0.0 else 0.0
    ticks = sum(times.duration / force.tick for force in scenario.unknown_force)
    log_bytes = flown * (BYTES_PER_STEP + BYTES_PER_STRIP * scenario.air.strips) + 8.0 * ticks
    return FlightSize(flown + warm_up, log_bytes, SECONDS_PER_STEP * (flown + warm_up))


def check_size(scenario: Scenario) -> None:
    """Raise ScenarioError if a flight would be too large; the message has estimate, limit and what to change."""
    size, times = flight_size(scenario), scenario.simulation
    if size.log_bytes <= MOST_BYTES and size.seconds <= MOST_SECONDS:
        return
    limit = f"at most {MOST_BYTES / 1e9:g} GB and {MOST_SECONDS:g} s are allowed"
    advice = "a shorter simulation.duration or a longer simulation.dt was expected"
    if 8.0 * sum(times.duration / force.tick for force in scenario.unknown_force) > 0.5 * size.log_bytes:
        advice = "a longer unknown_force.*.tick was expected"
    what = f"simulation.duration = {times.duration:g} s in steps of simulation.dt = {times.dt:g} s"
    raise ScenarioError(f"{what}: {size}; {limit}: {advice}")
