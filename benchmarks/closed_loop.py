"""What the closed loop shows: `PYTHONPATH=tests python benchmarks/closed_loop.py [--seeds 20] [--only NAME] [--write]`.

Flies the scenarios of closed loops with several seeds and prints, as medians, every figure that the project claims of
them, each beside its bound; ends with exit code 1 where one is not reached. Times are processor times of one thread:
neighbours on the machine lengthen them, too. `--write` puts what was measured into docs/control_results.md.
"""

import argparse
import datetime
import gc
import resource
import sys
import time
import warnings
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pinocchio as pin
from closed_loop_search import PARTS
from closed_loop_search import SCENARIO as PUSHED
from matplotlib.figure import Figure
from support.pages import ROOT, fill, save, table

from aerobat_pin.aerobat import believed_robot, flown_robot
from aerobat_pin.control import AerobatEnv, Controller, loop_margins
from aerobat_pin.errors import SimulationError
from aerobat_pin.flight import ClosedLoop, Plant
from aerobat_pin.observers import euler_angles
from aerobat_pin.scenario import Scenario, load_scenario
from aerobat_pin.visualization import style

OBSERVER = ("control.integral=false",)
LAWS = {
    "PD": PARTS["pd"],
    "PD + I": PARTS["pd_i"],
    "PD + observer": OBSERVER,
    "PD + I + observer": PARTS["observer"],
    "observer without air": (*OBSERVER, "control.air=false"),
    "truth, filtered alike": (*OBSERVER, "control.source=filtered_truth"),
    "truth": (*OBSERVER, "control.source=truth"),
}
BLOW = "impact_closed_loop"
BOUNDED = 1.0  # [m]: a flight that stays within this distance of its course, and upright, is bounded
SETTLED = 0.015  # [m]
EQUAL_FLIGHTS = 10
PAGE, SECTIONS = "docs/control_results.md", ("margins", "impact", "cost", "environment")
FIRST_MINUTE = 24  # windows of 2.5 s
FIXED = tuple(range(8500))  # whose sum takes about as long as a pass of the loop


class Board:
    """The figures that were measured, with their bounds.

    Attributes:
        rows: of the table of a section.
        missed: figures that do not reach their bounds.
    """

    def __init__(self) -> None:
        self.rows: list[tuple[str, ...]] = []
        self.missed: list[str] = []

    def show(self, what: str, value: float, bound: float | None = None, unit: str = "", least: bool = False) -> None:
        """Print a figure and its bound, an upper one unless `least`."""
        good = bound is None or (value >= bound if least else value <= bound)
        text = "" if bound is None else f"{'at least' if least else 'at most'} {bound:g}{'' if good else ': MISSED'}"
        print(f"  {what:<62} {value:10.4g} {unit:<5}   {text}", flush=True)
        self.rows.append((what, f"{value:.4g}", unit, text))
        self.missed += [] if good else [what]

    def tell(self, what: str, text: str) -> None:
        """Print a line of text."""
        print(f"  {what:<24} {text}", flush=True)
        self.rows.append((what, text, "", ""))


@cache
def robots(name: str, settings: tuple[str, ...]) -> tuple[Scenario, Any, Any]:
    """Load a scenario and its robots once."""
    scenario = load_scenario(name, settings)
    return scenario, flown_robot(scenario), believed_robot(scenario)


@cache
def flight(name: str, settings: tuple[str, ...], seed: int) -> dict[str, Any]:
    """Fly a scenario; return errors about the course, rms of x, y, z and all over time, and the slew of commands."""
    scenario, robot, believed = robots(name, settings)
    simulation = scenario.simulation.model_copy(update={"seed": seed})
    scenario = scenario.model_copy(update={"simulation": simulation})
    loop, diverged = ClosedLoop(Plant(robot, scenario), Controller(scenario, believed)), False
    try:
        flown = loop.fly(simulation.count)
    except SimulationError as error:
        flown, diverged = error.kept, True
    seconds = np.arange(len(flown.q)) * simulation.dt
    course = np.array(scenario.flight.position) + np.outer(seconds, scenario.flight.velocity)
    error = np.concatenate([flown.q[:, :3] - course, euler_angles(flown.q)], axis=1)
    record = loop.record(len(flown.q) - 1)
    slew = np.diff(record.command, axis=0) / simulation.dt
    return {
        **dict(zip("xyz", np.sqrt(np.mean(error[:, :3] ** 2, axis=0)), strict=True)),
        "slew": float(np.sqrt(np.mean(slew**2))),
        "error": error,
        "bounded": not diverged and np.abs(error[:, :3]).max() < BOUNDED and np.abs(error[:, 3:]).max() < 1.2,
    }


def margins(board: Board, seeds: Sequence[int]) -> None:
    """Margins from the gains, and flights with other thrust, delay and lag than believed."""
    for law in ("PD", "PD + I", "PD + observer", "PD + I + observer"):
        found = loop_margins(load_scenario(PUSHED, LAWS[law]))
        roll = found["roll"]
        board.tell(
            law,
            f"roll: phase {np.degrees(roll.phase):.0f} deg, delay {1e3 * roll.delay:.0f} ms, "
            f"thrust x{roll.gain_down:.2f} to x{roll.gain_up:.0f}, Ms {roll.ms:.2f}",
        )
    board.show("Ms, worst axis", max(axis.ms for axis in loop_margins(load_scenario(PUSHED)).values()), 2.0)
    longer = "simulation.duration=5.0"
    for what, setting, belief in (
        ("thrust x0.6", "thrusters.factor=0.6", "believed.thrusters.factor=1.0"),
        ("thrust x0.7", "thrusters.factor=0.7", "believed.thrusters.factor=1.0"),
        ("thrust x3", "thrusters.factor=3.0", "believed.thrusters.factor=1.0"),
        ("20 ms of delay", "thrusters.delay=0.02", "believed.thrusters.delay=0.001"),
        ("lag of 30 ms", "thrusters.lag=0.03", "believed.thrusters.lag=0.045"),
        ("lag of 100 ms", "thrusters.lag=0.1", "believed.thrusters.lag=0.045"),
        ("law at 100 Hz", "control.rate=100.0", longer),
        ("gyro bias of 20 mrad/s", "sensors.gyro.bias=[0.02, 0.02, 0.02]", longer),
        ("a third of the samples lost", "sensors.position.dropout=0.33", "sensors.gyro.dropout=0.33"),
    ):
        for law in ("PD", "PD + I + observer"):
            settings = (*LAWS[law], setting, belief, *(() if belief == longer else (longer,)))
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                good = [flight(PUSHED, settings, seed)["bounded"] for seed in seeds]
            board.show(f"{what}, {law}: share of flights bounded for 5 s", np.mean(good), 1.0, least=True)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        weak = ("thrusters.factor=0.5", "believed.thrusters.factor=1.0", longer)
        fell = not flight(PUSHED, weak, seeds[0])["bounded"]
    said = str(caught[0].message) if caught else "nothing"
    board.tell("thrust x0.5", f"{'falls' if fell else 'flies'}; said before: {said}")
    if not (fell and caught):
        board.missed.append("thrust x0.5 falls and says so before")


def impact(board: Board, seeds: Sequence[int]) -> None:
    """A blow of 25 mN s on the left wing: when is the body within 15 mm of its course for good?"""
    for law in LAWS:
        out = [np.flatnonzero(off_course(law, seed) > SETTLED) for seed in seeds]
        after = [one[-1] * 1e-3 - 0.7 if len(one) else 0.0 for one in out]
        board.show(f"{law}: settled after", np.median(after), unit="s")


def off_course(law: str, seed: int) -> np.ndarray:
    """Return the distances from the course [m] of a flight with the blow, sideways and upwards, each millisecond."""
    return np.linalg.norm(flight(BLOW, LAWS[law], seed)["error"][:, 1:3], axis=1)


def blow(seed: int) -> Figure:
    """Draw the distances from the course after the blow, by PD and with an observer."""
    figure = Figure(figsize=(6.5, 2.8), layout="constrained")
    axis = figure.subplots()
    for law, colour, line in (("PD", style.MUTED, "--"), ("PD + I + observer", style.BLUE, "-")):
        away = 1e3 * off_course(law, seed)
        axis.plot(1e-3 * np.arange(len(away)), away, line, color=colour, label=law)
    axis.axhline(1e3 * SETTLED, color=style.INK, linestyle=":", linewidth=0.9, label="settled below")
    axis.axvline(0.7, color=style.FAINT, linewidth=0.9)
    axis.set(xlabel="time [s]; the blow is at 0.7 s", ylabel="off the course, sideways\nand upwards [mm]")
    axis.set_ylim(0.0, None)
    style.legend_on_top(axis, ncols=3)
    return figure


def cost(board: Board, seconds: float) -> None:
    """Time of the loop over a minute of flight, beside the bare calls of Pinocchio in it; memory over ten minutes."""
    scenario, robot, believed = robots(PUSHED, ())
    plant, pilot = Plant(robot, scenario), Controller(scenario, believed)
    loop = ClosedLoop(plant, pilot, endless=True)
    count, window = round(seconds / scenario.simulation.dt), scenario.simulation.count
    times, used = [], []
    first = min(count, FIRST_MINUTE * window)
    (bare, fixed), data = np.zeros((2, first)), believed.model.createData()  # timed between the loop's own steps
    gc.collect()
    gc.freeze()
    for k in range(count):
        loop.step()
        if k < first:
            bare[k], fixed[k] = took(bare_calls, believed.model, data, loop.q, loop.v), took(sum, FIXED)
        if (k + 1) % window == 0:
            if len(times) < FIRST_MINUTE:  # more would grow the memory that is measured
                times.append(pilot.loop_times.copy())
            used.append(resident())
    every = 1e6 * np.concatenate(times)[10:]
    least_bare = float(np.median(np.reshape(bare, (EQUAL_FLIGHTS, -1)).min(axis=0)))
    board.show("loop: median", np.median(every), unit="us")
    board.show("loop: 99th percentile", np.percentile(every, 99.0), 100.0, "us")
    board.show("loop: worst of the first minute", np.max(every), unit="us")
    for what, found in (("a sum of fixed numbers", fixed), ("bare calls of Pinocchio", bare)):
        board.show(f"{what}, in the same minute: median", np.median(found), unit="us")
        board.show("  99th percentile", np.percentile(found, 99.0), unit="us")
        board.show("  that, of its median", np.percentile(found, 99.0) / np.median(found))
    board.show("loop: 99th percentile, of its median", np.percentile(every, 99.0) / np.median(every))
    least = []
    for _ in range(EQUAL_FLIGHTS):  # the same numbers in each, so what differs between them is the machine
        again = Controller(scenario, believed)
        ClosedLoop(Plant(robot, scenario), again).fly(window)
        least.append(again.loop_times)
    quiet = 1e6 * np.min(least, axis=0)[10:]
    board.show(f"the same, least of {EQUAL_FLIGHTS} equal flights, step by step: median", np.median(quiet), unit="us")
    board.show("  its 99th percentile", np.percentile(quiet, 99.0), 100.0, "us")
    board.show("  its largest", np.max(quiet), unit="us")
    board.show("loop: median, of its bare calls", np.median(every) / np.median(bare), 15.0)
    share = float(np.percentile(quiet, 99.0)) / least_bare
    board.show("loop: 99th percentile of the least, of the least bare calls", share, 15.0)
    minute = round(60.0 / (window * scenario.simulation.dt))
    grown = float(np.median(used[-minute:]) - np.median(used[:minute]))
    board.show(f"memory: last minute less first one of {seconds:.0f} s of flight, medians", grown, 2.0, "MB")
    board.show("memory: largest of all windows less the first minute's", max(used) - max(used[:minute]), unit="MB")
    slope = float(np.polyfit(np.arange(len(used)) / minute, used, 1)[0])
    board.show("memory: growth, straight line through all windows", 1e3 * slope, unit="kB/min")


def resident() -> float:
    """Return the memory that this process occupies now [MB]."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() / 1e6


def bare_calls(model: Any, data: Any, q: np.ndarray, v: np.ndarray) -> None:
    """Make the loop's calls of Pinocchio: M, C and g of the observer, and twice the air's motion."""
    pin.crba(model, data, q)
    pin.computeCoriolisMatrix(model, data, q, v)
    pin.computeGeneralizedGravity(model, data, q)
    pin.nonLinearEffects(model, data, q, v)
    pin.nonLinearEffects(model, data, q, v)


def took(call: Callable[..., Any], *arguments: Any) -> float:
    """Return the processor time of a call [us]."""
    begun = time.thread_time()
    call(*arguments)
    return 1e6 * (time.thread_time() - begun)


def environment(board: Board, processes: int) -> None:
    """Control steps of 10 ms per second: on one core, and over processes."""
    env = AerobatEnv()
    env.reset(seed=1)
    begun = time.thread_time()
    for _ in range(2000):
        terminated, truncated = env.step(env.neutral)[2:4]
        if terminated or truncated:
            env.reset()
    board.show("environment: control steps a second, one core", 2000 / (time.thread_time() - begun), 3000.0, least=True)
    from gymnasium.vector import AsyncVectorEnv, AutoresetMode

    many = AsyncVectorEnv([AerobatEnv] * processes, autoreset_mode=AutoresetMode.NEXT_STEP)
    many.reset(seed=1)
    actions, begun = np.tile(env.neutral, (processes, 1)), time.perf_counter()
    for _ in range(500):
        many.step(actions)
    rate = 500 * processes / (time.perf_counter() - begun)
    board.show(f"environment: steps a second, {processes} processes, by the clock", rate)
    many.close()


def main() -> int:
    """Measure what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--minutes", type=float, default=10.0, help="of the flight that shows the memory")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--only", nargs="*", default=SECTIONS, choices=SECTIONS)
    parser.add_argument("--write", action="store_true", help=f"write what was measured into {PAGE}")
    options = parser.parse_args()
    board, seeds = Board(), range(1, options.seeds + 1)
    for name in options.only:
        print(f"\n== {name}, {options.seeds} seeds")
        board.rows = []
        if name == "cost":
            cost(board, 60.0 * options.minutes)
        elif name == "environment":
            environment(board, options.processes)
        else:
            {"margins": margins, "impact": impact}[name](board, seeds)
        if options.write:
            told = f"Measured on {datetime.date.today()}; {options.seeds} seeds where noise counts."
            fill(PAGE, {name: f"{told}\n\n{table('| measured | unit | bound', board.rows)}"})
        if options.write and name == "impact":
            with mpl.rc_context(style.RC):
                save({"control_blow": blow(seeds[0])}, ROOT / "docs" / "figures")
    print("\nmissed: " + (", ".join(board.missed) or "nothing"))
    return 1 if board.missed else 0


if __name__ == "__main__":
    sys.exit(main())
