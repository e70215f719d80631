"""What raw samples cost: the joint smoother on the flight of `raw_sensors`, and its causal filter for each sample."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from measure import Figure, figure, interleaved

from aerobat_pin.aerobat import flight_channels
from aerobat_pin.aerobat.raw import JointFilter, JointSmoother, raw_record
from aerobat_pin.flight import simulate
from aerobat_pin.robot import FORCE_POINTS, believed_robot
from aerobat_pin.scenario import RawSection, load_scenario

FILTERED = 300  # samples of one pass through the filter
GIVEN = RawSection(
    walk=(0.005, 0.05, 0.01), bend=(3.0, 25.0, 25.0), white=(1e-3, 8e-3, 7e-3), alike=(5.0, 0.2, 5.0), crank_jerk=1.0
)


def raw_figures(rounds: int) -> Iterator[Figure]:
    """Two seconds of flight with given walks and with their choice by likelihood; the filter's cost for each sample."""
    scenario = load_scenario("raw_sensors")
    log, robot = simulate(scenario), believed_robot(scenario)
    record = raw_record(log.time, flight_channels(log, robot), robot, "measured", GIVEN)
    known, chosen = (JointSmoother(robot, scenario.believed_air, FORCE_POINTS, one) for one in (GIVEN, RawSection()))
    tuning = known.run(record).tuning
    short = replace(record, time=record.time[: FILTERED + 1], known=record.known[:FILTERED])

    def stream() -> None:
        JointFilter(known, tuning, record.channels, "measured").run(short)

    times = interleaved(
        max(2, rounds // 5),
        given=(lambda: known.run(record), 1),
        chosen=(lambda: chosen.run(record), 1),
        stream=(stream, FILTERED),
    )
    yield figure("raw samples, 2 s smoothed, walks given", times["given"], "s", 2.0)
    yield figure("raw samples, 2 s smoothed, walks by likelihood", times["chosen"], "s", 8.0)
    yield figure("raw samples, causal filter, each sample (its start too)", 1e3 * times["stream"], "ms")
