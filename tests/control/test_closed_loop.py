"""Flights that the controller flies: shorter ones than those of `benchmarks/closed_loop.py`, with looser bounds."""

import gc
import tracemalloc
from functools import cache
from typing import Any

import numpy as np
import pytest
from support.further import further

from aerobat_pin.control import Controller
from aerobat_pin.experiments import Experiment, run
from aerobat_pin.flight import simulate
from aerobat_pin.scenario import load_scenario

SHORT = ("simulation.duration=1.4", 'observers.names=["momentum"]')
PD = ("control.feedforward=false", "control.integral=false")
PD_I = ("control.feedforward=false",)


@cache
def flown(name: str, *settings: str) -> Experiment:
    return run(load_scenario(f"{name}_closed_loop", [*SHORT, *settings]))


def rms(name: str, *settings: str) -> dict[str, float]:
    found: dict[str, float] = flown(name, *settings).metrics["flight"]["rms"]
    return found


def test_the_observer_takes_more_than_half_of_a_steady_push() -> None:
    """Against the same PD at most 0.45 of its drift, against integral action at most 0.75; pitch and yaw no worse."""
    best, pd, pd_i = rms("paper_left"), rms("paper_left", *PD), rms("paper_left", *PD_I)
    assert best["y"] < 0.026
    assert best["y"] < 0.45 * pd["y"]
    assert best["y"] < 0.75 * pd_i["y"]
    assert best["pitch"] < pd["pitch"]
    assert best["yaw"] < pd["yaw"]


def test_the_observer_does_as_well_as_the_truth_behind_the_same_filter() -> None:
    """What is left is lag and authority, not estimation: within 8 %; unfiltered is hardly better."""
    alone = ("control.integral=false",)
    seen = rms("paper_left", *alone)["y"]
    assert seen == pytest.approx(rms("paper_left", *alone, "control.source=filtered_truth")["y"], rel=0.08)
    assert rms("paper_left", *alone, "control.source=truth")["y"] < 1.08 * seen


def test_an_upward_gust_does_not_turn_the_robot() -> None:
    """Hardly any lift is wanted then; yaw stays below a fifteenth of a degree, and z is better than without."""
    up = ("air.gust.amplitude=[0.0, 0.0, 1.5]",)
    best, pd = rms("gust", *up), rms("gust", *up, *PD)
    assert best["z"] < 0.85 * pd["z"]
    assert best["yaw"] < np.radians(1.0 / 15.0)


def test_a_calm_flight_pays_little_for_the_observer() -> None:
    """Attitude and height within 5 %, sideways below 1.5 mm; flaps alone would pitch it by 1.3 degrees."""
    calm, pd = rms("paper_left", "unknown_force=[]"), rms("paper_left", "unknown_force=[]", *PD)
    assert calm["pitch"] < np.radians(1.0)
    assert calm["y"] < 1.5e-3
    assert calm["z"] < 1.05 * pd["z"]
    assert calm["pitch"] < 1.05 * pd["pitch"]


def test_metrics_log_and_note_tell_of_the_loop() -> None:
    """Effort, limits and times in the metrics; commands in the log; the modelled thrust is the known force."""
    found = flown("paper_left")
    control, log = found.metrics["control"], found.log
    assert 10.0 < control["slew_rms"] < 50.0
    assert 0.0 <= control["saturated_share"] < 0.5
    assert 0.0 < control["loop_p50_s"] <= control["loop_p99_s"] <= control["loop_worst_s"]
    assert max(axis["ms"] for axis in control["margins"].values()) < 2.0
    assert found.metrics["note"].startswith("closed loop: PD + integral + feedforward; imperfect")
    command = log.measured["thruster_command"].values
    assert command.shape == (1400, 6)
    assert np.all(command >= 0.0)
    np.testing.assert_allclose(log.measured["known_thrusters"][:, :6], log.truth["thruster_wrench"].values, atol=1e-15)


def test_a_log_keeps_little_more_than_its_channels() -> None:
    """Bytes a sample that stay after a closed loop, without a garbage collection: below 1.3 times those of the log."""
    gc.disable()
    try:
        kept = {}
        for count in (50, 450):
            scenario = load_scenario("hover_closed_loop", [f"simulation.duration={count * 1e-3}"])
            pilot = Controller(scenario)
            tracemalloc.start()
            log = simulate(scenario, pilot=pilot)
            kept[count] = tracemalloc.get_traced_memory()[0]
            tracemalloc.stop()
    finally:
        gc.enable()
        tracemalloc.stop()
    size = sum(part.nbytes for part in {**log.measured.variables, **log.truth.variables}.values())
    assert (kept[450] - kept[50]) / 400 < 1.3 * size / 450


def test_a_wrong_belief_about_the_thrusters_is_what_the_observer_is_told() -> None:
    """Real thrusters push 0.9 of the command: known is the modelled wrench, true the smaller one."""
    log = flown("hover", "thrusters.factor=0.9", "believed.thrusters.factor=1.0", "simulation.duration=0.5").log
    modelled, real = log.measured["known_thrusters"].values[:, 2], log.truth["thruster_wrench"].values[:, 2]
    np.testing.assert_allclose(real, 0.9 * modelled, rtol=1e-9)


@pytest.mark.parametrize(
    "settings",
    [
        ("control.rate=100.0",),
        *further(
            (("thrusters.factor=0.7", "believed.thrusters.factor=1.0"),),
            (("thrusters.delay=0.02", "believed.thrusters.delay=0.001"),),
            (("thrusters.factor=3.0", "believed.thrusters.factor=1.0"),),
            (("thrusters.lag=0.03", "believed.thrusters.lag=0.045"),),
            (("thrusters.lag=0.1", "believed.thrusters.lag=0.045"),),
        ),
    ],
    ids=["100 Hz", "x0.7", "20 ms late", "x3", "30 ms of lag", "100 ms of lag"],
)
def test_what_the_margins_allow_flies(settings: tuple[str, ...]) -> None:
    """Weaker and stronger, later and slower thrusters than believed, and a slow law."""
    found: Any = rms("paper_left", *settings)
    assert max(found["x"], found["y"], found["z"]) < 0.2
    assert max(found["roll"], found["pitch"], found["yaw"]) < 0.4
