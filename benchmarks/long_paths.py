"""What long paths cost: a sweep beside its flights, and what processes bring; raw samples, smoothed and filtered."""

import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from measure import Figure, figure, interleaved

from aerobat_pin.aerobat import FORCE_POINTS, believed_robot, estimate_flight, flight_channels, flown_robot
from aerobat_pin.aerobat.raw import JointFilter, JointSmoother, raw_record
from aerobat_pin.experiments.sweep.plan import outcome_of
from aerobat_pin.experiments.sweep.run_sweep import in_this_process, on_this_machine
from aerobat_pin.flight import Plant, interval_means, simulate
from aerobat_pin.scenario import RawSection, load_scenario

FILTERED = 300  # samples of one pass through the filter
GIVEN = RawSection(
    walk=(0.005, 0.05, 0.01), bend=(3.0, 25.0, 25.0), white=(1e-3, 8e-3, 7e-3), alike=(5.0, 0.2, 5.0), crank_jerk=1.0
)


def sweep_figures(rounds: int) -> Iterator[Figure]:
    """What a run of a sweep takes beside its flight and its observers, and what a second process brings."""
    scenario = load_scenario("paper", ["simulation.duration=1.0"])
    robot = flown_robot(scenario)
    log = simulate(scenario, robot=robot)
    edges = np.arange(scenario.simulation.count + 1) * scenario.simulation.dt

    def fly() -> None:
        plant = Plant(robot, scenario)
        held = interval_means(plant.forces, edges, scenario.simulation.seed)
        plant.fly(scenario.simulation.count, scenario.simulation.dt, held)

    times = interleaved(
        rounds,
        fly=(fly, 1),
        estimate=(lambda: estimate_flight(log, robot, scenario), 1),
        whole=(lambda: outcome_of(scenario), 1),
    )
    yield figure("1 s of flight", 1e3 * times["fly"], "ms")
    yield figure("its air reconstructed, two observers", 1e3 * times["estimate"], "ms")
    beside = times["whole"] - times["fly"] - times["estimate"]
    yield figure("run of a sweep, beside these two", 1e3 * beside, "ms", 20.0)
    runs = {k: scenario for k in range(200)}
    list(on_this_machine(dict.fromkeys(range(4), scenario), 2))  # starts the processes
    gains = np.empty(max(2, rounds // 5))
    for k in range(len(gains)):
        start = time.perf_counter()
        list(in_this_process(runs))
        middle = time.perf_counter()
        list(on_this_machine(runs, 2))
        gains[k] = (middle - start) / (time.perf_counter() - middle)
    yield figure("200 runs of 1 s, two processes faster than one by", gains, "x")


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
