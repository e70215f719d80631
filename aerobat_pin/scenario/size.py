"""How large a flight would be, estimated before it begins, and the limits above which it is refused."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from aerobat_pin.errors import ScenarioError
from aerobat_pin.scenario.tables import AirSection, CrankSection, SimulationSection
from aerobat_pin.scenario.unknown_forces import UnknownForce

SECONDS_PER_STEP = 1.0e-4  # measured: 30 to 200 us for 16 to 200 strips, half of it more for two observers
BYTES_PER_STEP, BYTES_PER_STRIP = 980, 72  # of a step of the log; measured with 4, 16 and 60 strips
MOST_SECONDS, LARGEST_LOG = 3600.0, 2.0e9  # of one flight; the simulation takes twice the memory of its log


@dataclass(frozen=True)
class FlightSize:
    """What a flight would take: steps (warm-up included), bytes of its log, and seconds on one processor."""

    steps: float
    log_bytes: float
    seconds: float

    def __str__(self) -> str:
        return f"{self.steps:.3g} steps, a log of {self.log_bytes / 1e9:.3g} GB and about {self.seconds:.3g} s"


def flight_size(
    times: SimulationSection, crank: CrankSection, air: AirSection, forces: Sequence[UnknownForce]
) -> FlightSize:
    """Estimate what a flight with these tables of a scenario would take, from constants that were measured."""
    flown = times.duration / times.dt
    warm_up = air.warm_up_cycles / crank.frequency / times.dt if crank.frequency > 0.0 else 0.0
    ticks = sum(times.duration / force.tick for force in forces)
    log_bytes = flown * (BYTES_PER_STEP + BYTES_PER_STRIP * air.strips) + 8.0 * ticks
    return FlightSize(flown + warm_up, log_bytes, SECONDS_PER_STEP * (flown + warm_up))


def check_size(size: FlightSize, times: SimulationSection, forces: Sequence[UnknownForce]) -> None:
    """Raise ScenarioError if a flight is too large; the message has the estimate, the limit and what to change."""
    if size.log_bytes <= LARGEST_LOG and size.seconds <= MOST_SECONDS:
        return
    limit = f"at most {LARGEST_LOG / 1e9:g} GB and {MOST_SECONDS:g} s are allowed"
    advice = "a shorter simulation.duration or a longer simulation.dt was expected"
    if 8.0 * sum(times.duration / force.tick for force in forces) > 0.5 * size.log_bytes:
        advice = "a longer unknown_force.*.tick was expected"
    what = f"simulation.duration = {times.duration:g} s in steps of simulation.dt = {times.dt:g} s"
    raise ScenarioError(f"{what}: {size}; {limit}: {advice}")
