"""How fast is it? Every hot path beside the bare Pinocchio calls that it cannot do without, measured in one run.

Absolute times belong to a machine and its mood; ratios hardly do. Each round times ours and the bare calls in turn, a
few milliseconds apart, and takes the best of three of each; a figure is the median over the rounds of their ratio, with
the lowest and the highest round beside it. Nothing fails here: benchmarks inform, tests decide.

    python benchmarks/bench.py                       all of it, about a minute
    python benchmarks/bench.py --quick               a glance
    python benchmarks/bench.py --save FILE.json      keep the figures
    python benchmarks/bench.py --against REV         measure another commit (or checkout) too, in turn, five times each
"""

import argparse
import itertools
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import asdict
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from against import against
from long_paths import raw_figures, sweep_figures
from measure import Call, Figure, Part, figure, interleaved

from aerobat_pin.aerobat import FORCE_POINTS, joint_table, known_inputs, load_aerobat
from aerobat_pin.errors import MorphologyFileError
from aerobat_pin.estimation import OnlineEstimator
from aerobat_pin.flight import Plant, interval_means, simulate
from aerobat_pin.observers import Expected, ForceLevelObserver, KalmanObserver, MomentumObserver, SmootherObserver
from aerobat_pin.records import parse_map
from aerobat_pin.scenario import load_scenario

STEPS, DT = 2000, 1.0e-3  # the paper's flight: two seconds, dt in s
# Of a sample, in bare calls, before the filters learnt noise and misfit from the record: 1.5 times is allowed. Measured
# in turn with today's, walk 0.7 N/sqrt(s), exact sensors.
BEFORE_ROBUST = {"kalman": 1.73, "kalman and smoother": 2.24}
STREAM = 500  # samples of one pass through a streaming observer
GUST = "air.gust={amplitude = [0.5, 0.5, 0.5], start = 0.5, duration = 0.5}"
AIRS: dict[str, tuple[list[str], float | None]] = {  # settings and target of the right-hand side in other air
    "no added mass": (["air.added_mass=0.0"], None),
    "wind, gust, lift limit": (["air.wind=[0.5, 0.2, 0.1]", GUST, "air.lift_limit=1.5"], 3.0),
    "24 strips": (["air.strips=24"], 3.3),
    "24 strips, wind, gust, lift limit": (
        ["air.strips=24", "air.wind=[0.5, 0.2, 0.1]", GUST, "air.lift_limit=1.5"],
        3.3,
    ),
    "quasi-steady": (["air.model=quasi_steady"], None),
}
PACKAGES = ("aerobat-pinocchio", "pin", "numpy", "numba", "scipy")


def ready(*settings: str) -> tuple[Plant, np.ndarray]:
    """Return the plant of the paper's flight, and its forces held over each step."""
    scenario = load_scenario("paper", settings)
    plant = Plant(load_aerobat(scenario.robot.morphology, scenario.robot.changes), scenario)
    return plant, interval_means(plant.forces, np.arange(STEPS + 1) * DT, scenario.simulation.seed)


def right_hand_side(plant: Plant, held: np.ndarray) -> tuple[Call, Call, Call]:
    """Fly, and return calls of `Plant.evaluate`, and of bare crba and nle and integrate, along that flight."""
    edges, flown = np.arange(STEPS + 1) * DT, plant.fly(STEPS, DT, held)
    model, data = plant.model, plant.data
    states = list(zip(list(flown.q[:-1]), list(flown.v[:-1]), strict=True))
    joints, wind = list(joint_table(plant.closure(edges[:-1]))), list(plant.wind(edges[:-1]))
    noise = [np.ascontiguousarray(held[:, :, k : k + 1]) for k in range(STEPS)]
    bodies = np.concatenate([flown.v[:-1, :6], flown.air[:-1]], axis=1)
    evaluated = [(q, v, *rest) for (q, v), *rest in zip(states, joints, wind, noise, list(bodies), strict=True)]
    rate = np.empty(bodies.shape[1])
    tangents = [(q, v * DT) for q, v in states]
    crba, nle, integrate, evaluate = pin.crba, pin.nonLinearEffects, pin.integrate, plant.evaluate

    def bare_pair() -> None:
        for q, v in states:
            crba(model, data, q)
            nle(model, data, q, v)

    def bare_integrate() -> None:
        for q, way in tangents:
            integrate(model, q, way)

    def one_by_one() -> None:
        for arguments in evaluated:
            evaluate(*arguments, rate)

    return one_by_one, bare_pair, bare_integrate


def flight_figures(rounds: int) -> Iterator[Figure]:
    """Right-hand side and step, beside crba, nle and integrate on the configurations of the same flight."""
    plant, held = ready()
    evaluate, pair, integrate = right_hand_side(plant, held)
    times = interleaved(
        rounds,
        fly=(lambda: plant.fly(STEPS, DT, held), STEPS),
        pair=(pair, STEPS),
        integrate=(integrate, STEPS),
        evaluate=(evaluate, STEPS),
    )
    fly, bare, move = times["fly"], times["pair"], times["integrate"]
    yield figure("bare crba + nle", 1e6 * bare, "us")
    yield figure("bare integrate", 1e6 * move, "us")
    yield figure("flight, one step of RK4", 1e6 * fly, "us")
    yield figure("right-hand side (Plant.evaluate), over crba + nle", times["evaluate"] / bare, "x", 3.0)
    yield figure("step, over 4 (crba + nle) + 5 integrate", fly / (4 * bare + 5 * move), "x", 3.5)
    yield motor_figure(rounds)
    for name, (settings, target) in AIRS.items():
        evaluate, pair, _ = right_hand_side(*ready(*settings))
        times = interleaved(rounds, pair=(pair, STEPS), evaluate=(evaluate, STEPS))
        yield figure(f"right-hand side, {name}", times["evaluate"] / times["pair"], "x", target)


def motor_figure(rounds: int) -> Figure:
    """Compare the step with a motor's crank to the step with a prescribed one."""
    flights: dict[str, Part] = {}
    for drive in ("constant", "motor"):
        plant, held = ready(f"crank.drive={drive}")
        flights[drive] = (partial(plant.fly, STEPS, DT, held), STEPS)
    times = interleaved(rounds, **flights)
    return figure("step with a motor's crank, over a prescribed one's", times["motor"] / times["constant"], "x", 1.3)


def observer_figures(rounds: int) -> Iterator[Figure]:
    """Observers on the paper's flight, streaming and in batch, beside the three Pinocchio calls of one sample."""
    scenario = load_scenario("paper")
    log = simulate(scenario)
    robot = load_aerobat(scenario.robot.morphology, scenario.robot.changes)
    model, inputs = robot.model, known_inputs(log, robot)
    instants, configurations, velocities, torque = inputs.time, inputs.q, inputs.v, inputs.tau
    aerodynamic = np.ascontiguousarray(inputs.known["aerodynamic"])
    data = model.createData()
    samples = list(zip(list(configurations), list(velocities), strict=True))
    known = [{"aerodynamic": row} for row in aerodynamic]
    crba, coriolis, gravity = pin.crba, pin.computeCoriolisMatrix, pin.computeGeneralizedGravity

    def bare(count: int) -> Part:
        chosen = samples[:count]

        def call() -> None:
            for q, v in chosen:
                crba(model, data, q)
                coriolis(model, data, q, v)
                gravity(model, data, q)

        return call, count

    def stream(observer: Any, with_known: bool) -> Part:
        columns = [instants[1:].tolist(), configurations[1:], velocities[1:], torque, *([known] if with_known else [])]
        rows = list(zip(*columns, strict=True))[:STREAM]

        def call() -> None:
            observer.reset(*samples[0], float(instants[0]))
            update = observer.update
            for row in rows:
                update(*row)

        return call, STREAM

    def batch(observer: Any, channels: dict[str, Any] | None = None) -> Part:
        arguments = (instants, configurations, velocities, torque, channels)
        return (lambda: observer.run(*arguments)), len(instants)

    kinds = {
        "momentum, no points": (MomentumObserver(model), 1.5, 1.4),
        "momentum, two points": (MomentumObserver(model, FORCE_POINTS), 1.7, None),
        "force_level, two points": (ForceLevelObserver(model, FORCE_POINTS), 1.7, None),
    }
    parts = {f"{kind}{more}": stream(one[0], bool(more)) for kind, one in kinds.items() for more in ("", ", one known")}
    rows = np.full(model.nv, 0.01)
    expecting = ForceLevelObserver(model, FORCE_POINTS, expected=Expected(np.full(6, 0.2), rows, rows, rows))
    parts["expected"] = stream(expecting, False)
    times = interleaved(4 * rounds, bare=bare(STREAM), **parts)
    yield figure("bare crba + Coriolis + gravity", 1e6 * times["bare"], "us")
    for kind, (_, target, _) in kinds.items():
        yield figure(f"update, {kind}", times[kind] / times["bare"], "x", target)
        yield figure(f"update, {kind}, one known", times[f"{kind}, one known"] / times["bare"], "x")
    above = 1e6 * (times["expected"] - times["force_level, two points"])
    yield figure("update, force_level, two points, sizes expected, over any size", above, "us", 8.0)
    parts = {kind: batch(one[0]) for kind, one in kinds.items()}
    parts["momentum, no points, one known"] = batch(kinds["momentum, no points"][0], {"aerodynamic": aerodynamic})
    times = interleaved(rounds, bare=bare(len(samples)), **parts, expected=batch(expecting))
    above = 1e6 * (times["expected"] - times["force_level, two points"])
    yield figure("batch per sample, force_level, two points, sizes expected, over any size", above, "us", 50.0)
    for kind in parts:
        limit = kinds[kind][2] if kind in kinds else None
        yield figure(f"batch per sample, {kind}", times[kind] / times["bare"], "x", limit)
    doubts = {"known_error": {"aerodynamic": 0.2}, "mass_error": 0.05}
    doubtful = SmootherObserver(model, FORCE_POINTS, force_walk=0.7, **doubts)
    parts = {
        "kalman": batch(KalmanObserver(model, FORCE_POINTS, force_walk=0.7)),
        "kalman and smoother": batch(SmootherObserver(model, FORCE_POINTS, force_walk=0.7)),
        "kalman and smoother, mass and air in doubt": batch(doubtful, {"aerodynamic": aerodynamic}),
    }
    times = interleaved(rounds, bare=bare(len(samples)), **parts)
    for kind in parts:
        goal = 3.0 if kind == "kalman and smoother" else None
        yield figure(f"batch per sample over Pinocchio's, {kind}", 1e6 * (times[kind] - times["bare"]), "us", goal)
        if kind in BEFORE_ROBUST:
            limit = 1.5 * BEFORE_ROBUST[kind]
            yield figure(f"batch per sample, {kind}", times[kind] / times["bare"], "x", limit)


def stream_figures(rounds: int) -> Iterator[Figure]:
    """An estimate of a stream: a quadruped's seven channels pushed by name, processor time."""
    sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
    from support.walking_log import table, table_map, urdf, walk

    rows = [(float(row["t"]), row) for row in table(walk()).to_dict("records")]
    names = ("force_level", "momentum", "second_order", "super_twisting")
    with tempfile.TemporaryDirectory() as name:
        (folder := Path(name)).joinpath("quadruped.urdf").write_text(urdf(), encoding="utf-8")
        values = {key: part for key, part in table_map(folder / "quadruped.urdf").items() if key != "check"}
        streams = [
            OnlineEstimator(parse_map(values | {"observer": {"names": names[:count], "gain": 500.0}}, "-"), folder)
            for count in (1, len(names))
        ]
    taken = np.empty((3 * rounds, len(streams)))
    for turn in range(len(taken)):
        for k, stream in enumerate(streams):
            stream.reset()
            begin = time.process_time()
            for stamp, row in rows:
                stream.push(stamp, row)
            taken[turn, k] = 1e6 * (time.process_time() - begin) / len(rows)
    yield figure("stream, an estimate of twelve joints, one observer", taken[:, 0], "us", 60.0)
    further = (taken[:, 1] - taken[:, 0]) / (len(names) - 1)
    yield figure("stream, each further observer", further, "us", 30.0)


def absolute_figures(rounds: int) -> Iterator[Figure]:
    """What a caller waits for, in this process, with everything compiled and imported."""
    scenario = load_scenario("paper")
    robot = load_aerobat(scenario.robot.morphology, scenario.robot.changes)
    lengths = itertools.count(6.6e-3, 1e-7)  # of a bar, each once: a linkage that was seen before is remembered

    def change() -> None:
        made = robot.with_changes({"linkage": {"L3b": next(lengths)}, "scale": {"span": 1.05, "chord": 0.95}})
        assert made.visual_model.ngeoms > made.collision_model.ngeoms

    def refuse() -> None:
        with suppress(MorphologyFileError):
            robot.with_changes({"linkage": {"L3b": 4e-3}})

    times = interleaved(
        max(3, rounds // 2),
        simulate=(lambda: simulate(scenario), 1),
        load=(load_aerobat, 1),
        change=(change, 1),
        refuse=(refuse, 1),
        plant=(lambda: Plant(robot, scenario), 1),
    )
    yield figure("simulate the paper's 2 s, warm", 1e3 * times["simulate"], "ms", 80.0)
    yield figure("load_aerobat()", 1e3 * times["load"], "ms")
    yield figure("robot.with_changes(...), with its geometry", 1e3 * times["change"], "ms", 50.0)
    yield figure("a linkage that cannot turn refused, with what would do", 1e3 * times["refuse"], "ms")
    yield figure("Plant(robot, scenario), air warmed up", 1e3 * times["plant"], "ms")


def process_figures(count: int) -> Iterator[Figure]:
    """Whole processes, from start to exit, caches warm."""
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONDONTWRITEBYTECODE"}
    program = [sys.executable, "-m", "aerobat_pin"]
    with tempfile.TemporaryDirectory() as folder:
        commands = {
            "python -c pass": ([sys.executable, "-c", "pass"], None),
            "python -c 'import aerobat_pin'": ([sys.executable, "-c", "import aerobat_pin"], None),
            "aerobat --help": ([*program, "--help"], 200.0),
            "aerobat list": ([*program, "list"], None),
            "aerobat run paper --no-report": (
                [*program, "run", "paper", "--no-report", "--force", "--out", folder],
                1500.0,
            ),
        }
        for name, (command, target) in commands.items():
            taken = np.empty(count + 1)
            for k in range(count + 1):
                start = time.perf_counter()
                subprocess.run(command, env=environment, check=True, capture_output=True)
                taken[k] = 1e3 * (time.perf_counter() - start)
            yield figure(name, taken[1:], "ms", target)  # the first one fills the caches


def machine() -> dict[str, str]:
    """Return what a reader must know to judge absolute times."""
    here = {"python": platform.python_version(), "machine": platform.machine(), "cores": str(os.cpu_count())}
    return here | {name: metadata.version(name) for name in PACKAGES}


def table_lines(figures: list[Figure]) -> Iterator[str]:
    """Lay the figures out."""
    yield f"{'':<58} {'median':>9}    {'min .. max':>18}  {'target':>8}"
    for one in figures:
        between = f"{one.low:.2f} .. {one.high:.2f}"
        goal = "" if one.target is None else f"{one.target:8.1f}  {'met' if one.value <= one.target else 'MISSED'}"
        yield f"{one.name:<58} {one.value:9.2f} {one.unit:<2} {between:>18}  {goal}".rstrip()


def main() -> None:
    """Measure, print, and save or compare as asked."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--quick", action="store_true", help="fewer rounds, and each process only once")
    parser.add_argument("--save", type=Path, metavar="FILE.json", help="write the figures to a file")
    parser.add_argument("--against", metavar="REV", help="compare with another commit or checkout, run by run")
    chosen = parser.parse_args()
    if chosen.against:
        print("\n".join(against(chosen.against, ["--quick"] if chosen.quick else [])))
        return
    rounds, runs = (3, 1) if chosen.quick else (15, 5)
    conditions = machine()
    print(", ".join(f"{name} {value}" for name, value in conditions.items()), flush=True)
    paths = (flight_figures, observer_figures, stream_figures, raw_figures, absolute_figures, sweep_figures)
    figures = [*itertools.chain.from_iterable(path(rounds) for path in paths), *process_figures(runs)]
    print("\n".join(table_lines(figures)))
    if chosen.save:
        saved = {"machine": conditions, "figures": [asdict(one) for one in figures]}
        chosen.save.write_text(json.dumps(saved, indent=2) + "\n", encoding="utf-8")
        print(f"\nsaved to {chosen.save}")


if __name__ == "__main__":
    main()
