"""Write the tables of docs/results.md, its figures, and the table of README.md."""

import re
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from support.pages import ROOT, Values, save, table
from support.pages import run as write_or_check

from aerobat_pin.aerobat import known_inputs, true_force
from aerobat_pin.experiments import Experiment, run
from aerobat_pin.forces import FORCE_AXES, r_squared
from aerobat_pin.observers import OBSERVERS, KalmanObserver
from aerobat_pin.scenario import load_scenario
from aerobat_pin.visualization import draw_all

SEEDS = (1, 2, 3, 4, 5)
GAINS = (100.0, 1000.0, 2000.0)
WINGS = [(wing, axis) for wing in ("left", "right") for axis in FORCE_AXES]
MOTOR_ONLY = "observers.torque=motor_only"  # the crank's torque is measured, those of the joints are not
SCORES = (("r2", 1.0, "{:.5f}"), ("r2_noise_free", 1.0, "{:.5f}"), ("rmse", 1e3, "{:.2f}"), ("lag_s", 1e3, "{:.2f}"))
PAPER = ("0.7448", "0.9970", "0.9991")


def scored(name: str, *settings: str) -> dict[str, Any]:
    """Fly a scenario, and return the scores of its observers."""
    scores: dict[str, Any] = run(load_scenario(name, settings)).metrics["observers"]
    return scores


def summary(experiment: Experiment) -> str:
    """Return the README's table: the paper's R2 beside ours, seed 1, observer `momentum`.

    The rows below both wings are what is left without torque sensors at the joints, which the real robot has not, with
    sensors that can be bought, and with a wrong model of the air.
    """

    def row(title: str, scores: dict[str, Any], wing: str = "left") -> list[str]:
        return [title, *(f"{(at := scores[wing][axis])['r2']:.5f} ({1e3 * at['rmse']:.2f} mN)" for axis in FORCE_AXES)]

    momentum = experiment.metrics["observers"]["momentum"]
    rows = [["paper, R2", *PAPER], *(row(f"{wing} wing, R2 (error rms)", momentum, wing) for wing in ("left", "right"))]
    three = 'observers.names=["momentum", "force_level", "kalman"]'
    alone = scored("paper", MOTOR_ONLY, three)
    rows += [row(f"left wing, motor torque alone, `{name}`", of) for name, of in alone.items()]
    noisy = scored("noisy_sensors", MOTOR_ONLY, 'observers.names=["smoother"]')["smoother"]
    rows.append(row("left wing, motor torque alone, noisy sensors, `smoother`", noisy))
    dense = scored("paper", "believed.air.density=1.47")["momentum"]
    rows.append(row("left wing, air believed 20 % too dense", dense))
    note = f"`momentum` unless named, K = 2000 1/s, seed 1; {experiment.metrics['note']}."
    return f"{table('| Fx | Fy | Fz', rows)}\n\n{note}"


def paper_rows(experiments: list[Experiment]) -> Iterator[list[str]]:
    """Yield every observer, wing and axis of `paper`: worst and best seed."""
    for name in experiments[0].estimates:
        for wing, axis in WINGS:
            scores = [one.metrics["observers"][name][wing][axis] for one in experiments]
            cells = (span([scale * score[key] for score in scores], form) for key, scale, form in SCORES)
            yield [f"`{name}`", wing, axis, *cells]


def flown(metrics: dict[str, Any], end: str, height: str, angle: str) -> list[str]:
    """Return the seed of a flight, where it ends, and the ranges of height and angles, in these forms."""
    flight = metrics["flight"]
    angles = [span(np.degrees(flight[f"{name}_range"]), angle) for name in ("pitch", "roll", "yaw")]
    place = ", ".join(end.format(x) for x in flight["position_end"])
    return [str(metrics["seed"]), place, span(flight["z_range"], height), *angles]


def flight_rows(experiments: list[Experiment]) -> Iterator[list[str]]:
    """Yield how `paper` flies, seed by seed."""
    for one in experiments:
        flight = one.metrics["flight"]
        lifts = [f"{100 * flight[f'{name}_lift_over_weight']:.0f} %" for name in ("thrusters", "aerodynamic")]
        yield [*flown(one.metrics, "{:.3f}", "{:.3f}", "{:.2f}"), *lifts, f"{flight['motor_power_mean']:.2f}"]


def benchmark_rows(experiments: list[Experiment]) -> Iterator[list[str]]:
    """Yield the worst seed's R2 of `observer_benchmark` per gain, observer, wing and axis."""
    flights = [(one, known_inputs(one.log, one.robot), one.scenario.observers.frames) for one in experiments]
    for gain in GAINS:
        for name, kind in OBSERVERS.items():
            by_gain = {"force_walk": "gain"} if issubclass(kind, KalmanObserver) else {}
            scores = []
            for one, inputs, frames in flights:
                observer = kind(one.robot.model, frames, gain, **by_gain)
                force = observer.run(inputs.time, inputs.q, inputs.v, inputs.tau, inputs.known).force
                truth = np.stack([true_force(one.log, frame)[0] for frame in frames], axis=1)
                scores.append([r_squared(force[:, i, k], truth[:, i, k]) for i in range(len(frames)) for k in range(3)])
            yield [f"{gain:.0f}", f"`{name}`", *(f"{value:.5f}" for value in np.min(np.array(scores, float), axis=0))]


def torque_rows() -> Iterator[list[str]]:
    """Yield R2 of `paper` and `observer_benchmark` for each knowledge of the joint torques, seed 1, left wing."""
    for name in ("paper", "observer_benchmark"):
        for torque in ("measured", "modelled", "motor_only", "none"):
            for observer, scores in scored(name, f"observers.torque={torque}").items():
                r2 = [f"{scores['left'][axis]['r2']:.4f}" for axis in FORCE_AXES]
                yield [f"`{name}`", torque, str(scores["rank"]), f"`{observer}`", *r2]


def other_rows() -> Iterator[list[str]]:
    """Yield how the other flights end and how well their forces are found by `force_level`, seed by seed."""
    for name in ("paper_left", "paper_open_loop", "tumble"):
        for seed in SEEDS:
            metrics = run(load_scenario(name, [f"simulation.seed={seed}"])).metrics
            scores = metrics["observers"]["force_level"]
            worst = min(r2 for wing, axis in WINGS if (r2 := scores[wing][axis]["r2"]) is not None)
            fx = max(1e3 * scores[wing]["Fx"]["rmse"] for wing in ("left", "right"))
            yield [f"`{name}`", *flown(metrics, "{:.2f}", "{:.2f}", "{:.1f}"), f"{worst:.5f}", f"{fx:.2f}"]


def span(values: Iterable[float], form: str) -> str:
    """Return the smallest and the largest value."""
    return f"{form.format(min(values))} .. {form.format(max(values))}"


def quick() -> Values:
    """Return the table of README.md."""
    return {"README.md": {"results": summary(run(load_scenario("paper")))}}


def find() -> Values:
    """Run everything, and draw the figures of the first flight."""
    names = ("paper", "observer_benchmark")
    paper, benchmark = ([run(load_scenario(name, [f"simulation.seed={k}"])) for k in SEEDS] for name in names)
    drawn = draw_all(paper[0])
    shown = re.findall(r"figures/(\w+)\.png", (ROOT / "docs" / "results.md").read_text("utf-8"))
    save({name: drawn[name] for name in shown}, ROOT / "docs" / "figures")
    wings = " | ".join(f"{wing} {axis}" for wing, axis in WINGS)
    angles = "X, Y, Z [m] | Z [m] | pitch [deg] | roll [deg] | yaw [deg]"
    observers = "observer | wing | axis | R2 | R2 noise-free | error rms [mN] | lag [ms]"
    tables = {
        "paper": table(observers, paper_rows(paper)),
        "flight": table(f"seed | {angles} | hold lifts | air lifts | power [W]", flight_rows(paper)),
        "benchmark": table(f"K [1/s] | observer | {wings}", benchmark_rows(benchmark)),
        "flights": table(f"scenario | seed | {angles} | lowest R2 | Fx error rms [mN]", other_rows()),
        "torque": table("scenario | torque | rank | observer | Fx | Fy | Fz", torque_rows()),
    }
    return {"docs/results.md": tables}


if __name__ == "__main__":
    write_or_check(find, quick)
