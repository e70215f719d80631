"""Write docs/results.md, its figures and the table of README.md; `--check` compares the prose and the table."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import numpy as np
from support.pages import HOLE, ROOT, Part
from support.pages import run as write_or_check

from aerobat_pin.aerobat import known_inputs, true_force
from aerobat_pin.estimation import FORCE_AXES, r_squared
from aerobat_pin.experiments import Experiment, run
from aerobat_pin.observers import OBSERVERS, KalmanObserver
from aerobat_pin.scenario import load_scenario
from aerobat_pin.visualization import draw_all, style

PAGE, FIGURES = "docs/results.md", ROOT / "docs" / "figures"
SEEDS = (1, 2, 3, 4, 5)
GAINS = (100.0, 1000.0, 2000.0)
MOTOR_ONLY = "observers.torque=motor_only"  # the crank's torque is measured, those of the joints are not
PAPER = {"Fx": "0.7448", "Fy": "0.9970", "Fz": "0.9991"}


def paper_summary(experiment: Experiment) -> str:
    """Return the README's table: the paper's R2 beside ours, seed 1, observer `momentum`.

    The rows below both wings are what is left without torque sensors at the joints, which the real robot has not, with
    sensors that can be bought, and with a wrong model of the air.
    """

    def row(title: str, scores: dict[str, Any], wing: str = "left") -> str:
        cells = [f"{scores[wing][axis]['r2']:.5f} ({1e3 * scores[wing][axis]['rmse']:.2f} mN)" for axis in FORCE_AXES]
        return f"| {title} | {' | '.join(cells)} |"

    def flown(name: str, *settings: str) -> dict[str, Any]:
        found: dict[str, Any] = run(load_scenario(name, list(settings))).metrics["observers"]
        return found

    scores = experiment.metrics["observers"]["momentum"]
    lines = ["| | Fx | Fy | Fz |", "|---|---|---|---|", f"| paper, R2 | {' | '.join(PAPER.values())} |"]
    lines += [row(f"{wing} wing, R2 (error rms)", scores, wing) for wing in ("left", "right")]
    three = 'observers.names=["momentum", "force_level", "kalman"]'
    for name, found in flown("paper", MOTOR_ONLY, three).items():
        lines.append(row(f"left wing, motor torque alone, `{name}`", found))
    noisy = flown("noisy_sensors", MOTOR_ONLY, 'observers.names=["smoother"]')["smoother"]
    lines.append(row("left wing, motor torque alone, noisy sensors, `smoother`", noisy))
    dense = flown("paper", "believed.air.density=1.47")["momentum"]
    lines.append(row("left wing, air believed 20 % too dense", dense))
    note = f"`momentum` unless named, K = 2000 1/s, seed 1; {experiment.metrics['note']}."
    return "\n".join([*lines, "", note])


def paper_table(experiments: list[Experiment]) -> str:
    """Return every observer, wing and axis of `paper`: worst and best seed."""
    lines = [
        "| observer | wing | axis | R2 | R2 noise-free | error rms [mN] | lag [ms] |",
        "|---|---|---|---|---|---|---|",
    ]
    for name in experiments[0].estimates:
        for wing in ("left", "right"):
            for axis in FORCE_AXES:
                found = [one.metrics["observers"][name][wing][axis] for one in experiments]
                cells = [
                    _range([one["r2"] for one in found], "{:.5f}"),
                    _range([one["r2_noise_free"] for one in found], "{:.5f}"),
                    _range([1e3 * one["rmse"] for one in found], "{:.2f}"),
                    _range([1e3 * one["lag_s"] for one in found], "{:.2f}"),
                ]
                lines.append(f"| `{name}` | {wing} | {axis} | {' | '.join(cells)} |")
    return "\n".join(lines)


def flight_table(experiments: list[Experiment]) -> str:
    """Return how `paper` flies, seed by seed."""
    lines = [
        "| seed | X, Y, Z [m] | Z [m] | pitch [deg] | roll [deg] | yaw [deg] | hold lifts | air lifts | power [W] |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for one in experiments:
        flight = one.metrics["flight"]
        angles = [_span(np.degrees(flight[f"{name}_range"]), "{:.2f}") for name in ("pitch", "roll", "yaw")]
        lifts = [f"{100 * flight[f'{name}_lift_over_weight']:.0f} %" for name in ("thrusters", "aerodynamic")]
        end = ", ".join(f"{x:.3f}" for x in flight["position_end"])
        cells = [end, _span(flight["z_range"], "{:.3f}"), *angles, *lifts, f"{flight['motor_power_mean']:.2f}"]
        lines.append(f"| {one.metrics['seed']} | {' | '.join(cells)} |")
    return "\n".join(lines)


def benchmark_table(experiments: list[Experiment]) -> str:
    """Return the worst seed's R2 of `observer_benchmark` per gain, observer, wing and axis."""
    columns = [f"{wing} {axis}" for wing in ("left", "right") for axis in FORCE_AXES]
    lines = [f"| K [1/s] | observer | {' | '.join(columns)} |", "|---" * (len(columns) + 2) + "|"]
    for gain in GAINS:
        for name, kind in OBSERVERS.items():
            worst = np.ones(len(columns))
            for one in experiments:
                inputs, frames = known_inputs(one.log, one.robot), one.scenario.observers.frames
                by_gain = {"force_walk": "gain"} if issubclass(kind, KalmanObserver) else {}
                estimate = kind(one.robot.model, frames, gain, **by_gain).run(
                    inputs.time, inputs.q, inputs.v, inputs.tau, inputs.known
                )
                truth = [true_force(one.log, frame)[0] for frame in frames]
                found = [
                    r_squared(estimate.force[:, i, k], truth[i][:, k]) for i in range(len(frames)) for k in range(3)
                ]
                worst = np.minimum(worst, np.array(found, float))
            lines.append(f"| {gain:.0f} | `{name}` | {' | '.join(f'{value:.5f}' for value in worst)} |")
    return "\n".join(lines)


def torque_table() -> str:
    """Return R2 of `paper` and `observer_benchmark` for each knowledge of the joint torques, seed 1, left wing."""
    lines = ["| scenario | torque | rank | observer | Fx | Fy | Fz |", "|---|---|---|---|---|---|---|"]
    for name in ("paper", "observer_benchmark"):
        for torque in ("measured", "modelled", "motor_only", "none"):
            observers = run(load_scenario(name, [f"observers.torque={torque}"])).metrics["observers"]
            for observer, scores in observers.items():
                cells = " | ".join(f"{scores['left'][axis]['r2']:.4f}" for axis in FORCE_AXES)
                lines.append(f"| `{name}` | {torque} | {scores['rank']} | `{observer}` | {cells} |")
    return "\n".join(lines)


def flights_table() -> str:
    """Return how the other flights end and how well their forces are found by `force_level`, seed by seed."""
    lines = [
        "| scenario | seed | X, Y, Z [m] | Z [m] | pitch [deg] | roll [deg] | yaw [deg] | lowest R2 | Fx error rms [mN] |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for name, seed in [(name, seed) for name in ("paper_left", "paper_open_loop", "tumble") for seed in SEEDS]:
        metrics = run(load_scenario(name, [f"simulation.seed={seed}"])).metrics
        flight, scores = metrics["flight"], metrics["observers"]["force_level"]
        angles = [_span(np.degrees(flight[f"{angle}_range"]), "{:.1f}") for angle in ("pitch", "roll", "yaw")]
        axes = [scores[wing][axis] for wing in ("left", "right") for axis in FORCE_AXES]
        worst = min(one["r2"] for one in axes if one["r2"] is not None)
        fx = max(1e3 * scores[wing]["Fx"]["rmse"] for wing in ("left", "right"))
        end = ", ".join(f"{x:.2f}" for x in flight["position_end"])
        cells = [end, _span(flight["z_range"], "{:.2f}"), *angles, f"{worst:.5f}", f"{fx:.2f}"]
        lines.append(f"| `{name}` | {seed} | {' | '.join(cells)} |")
    return "\n".join(lines)


def page(note: str, gain: str, paper: str, flight: str, benchmark: str, flights: str, torque: str) -> str:
    """Return docs/results.md around its tables."""
    return f"""# Results

`make docs` writes this page; every number comes from the runs that it makes. Ranges are over seeds {SEEDS[0]} to {SEEDS[-1]} unless a
section says otherwise.

## `paper`: {note}, K = {gain} 1/s

The paper reports R2 of {", ".join(PAPER.values())} for Fx, Fy and Fz, against the noisy truth. Against the
noise-free truth R2 is lower: at this gain the observer follows the noise, which then counts as its error.

{paper}

![Estimated against actual forces](figures/estimation.png)

{flight}

"Attitude held, 79 % thruster-borne" means that an ideal hold, which stands for the guard's thrusters of the laboratory,
keeps attitude and height, and that its constant lift is 79 % of the weight. The height loop takes part of that lift back:
"hold lifts" and "air lifts" are means over the flight, and the unknown forces carry the rest. An independent simulator,
also with added mass, ended this flight at X 5.96 m with pitch from 2.3 to 7.7 deg.

![Position](figures/position.png)
![Joint angles, attitude and velocity](figures/states.png)
![Top view](figures/stick_diagram.png)

## `observer_benchmark`: exact model, noisy truth, worst of five seeds

{benchmark}

`kalman` and `smoother` follow the gain here (`force_walk = "gain"`); as they come, they do not heed it.

At K = 100 1/s `force_level` loses by the filter's lag alone. `momentum` also loses because the wings turn while its filter
remembers older samples; see [design note 3](design/0003-the-unknown-force-and-the-flight.md).

## The other flights

{flights}

In `paper_left` the unknown force pushes on the left wing alone, and the robot drifts to the right, as in the paper's
figure. `paper_open_loop` flies without a hold, in the trim that `aerobat trim` found, on a tail and a fin that the real
robot does not have; it keeps its height within 6 cm, and its roll and yaw within 9 deg. Drooped wings are laterally
unstable: what the noise of the two wings starts doubles every 0.45 s, by the Floquet multipliers of the trim, and only a
hold stops it. `tumble` has no fin, and its force pushes to the left.

## What must be known of the joint torques

Seed 1, left wing.

{torque}

* **measured**: all joint torques are known. They contain the reaction to the unknown force, because the linkage holds the
  joints whatever pushes. Two point forces are six unknowns, and the rows have rank six.
* **modelled**: the torque that the prescribed motion would take without the unknown force, which is how the paper's text
  describes its `u_m`. The joint rows then claim that nothing pushes, which is wrong, and the estimate is a compromise
  between them and the base rows. The rank is six all the same: it tells what the equations can decide, not whether they
  are true.
* **motor_only**: the crank's torque alone. It gives the power of all joints, one true row beside the six of the base, and
  the rank is six again. `force_level` uses that row without loss. `momentum` filters all ten rows first, and the directions
  that a crank sensor leaves open change within the memory of its filter.
* **none**: the base rows alone, with rank five. A pair of equal and opposite forces along the line between the two points
  leaves no trace in them, and the estimate sets that part to zero. Little is lost where the true forces have no such part
  (`observer_benchmark`, where both wings' forces are alike). Where they have (`paper`, whose wing normals lean toward each
  other), Fy is lost.

A pattern of forces that leaves no trace is left out of the estimate, and the observers report it.

## The linkage

![The Kinetic Sculpture](figures/linkage.png)
"""


def _range(values: list[float], form: str) -> str:
    return _span((min(values), max(values)), form)


def _span(bounds: tuple[float, float], form: str) -> str:
    return f"{form.format(bounds[0])} .. {form.format(bounds[1])}"


def write() -> None:
    """Run everything, rewrite the page and the table in README.md."""
    paper = [run(load_scenario("paper", [f"simulation.seed={seed}"])) for seed in SEEDS]
    benchmark = [run(load_scenario("observer_benchmark", [f"simulation.seed={seed}"])) for seed in SEEDS]
    first = paper[0]
    text = page(
        first.metrics["note"],
        f"{first.scenario.observers.gain:.0f}",
        paper_table(paper),
        flight_table(paper),
        benchmark_table(benchmark),
        flights_table(),
        torque_table(),
    )
    drawn = draw_all(first)
    for name in re.findall(r"figures/(\w+)\.png", text):
        style.save_figure(drawn[name], FIGURES / name)
        (FIGURES / f"{name}.pdf").unlink()
    (ROOT / PAGE).write_text(text, encoding="utf-8")
    readme = ROOT / "README.md"
    whole = re.sub(
        r"<!-- results:.*?<!-- /results -->", lambda _: readme_block(first), readme.read_text("utf-8"), flags=re.S
    )
    readme.write_text(whole, encoding="utf-8")


def readme_block(experiment: Experiment) -> str:
    """Return what stands in README.md between its two marks, marks included."""
    return f"<!-- results: written by docs/scripts/results.py -->\n{paper_summary(experiment)}\n<!-- /results -->"


def parts() -> Iterator[Part]:
    """Yield the page without its tables, and the table of README.md."""
    yield Part(PAGE, "prose", page(*[HOLE] * 7))
    yield Part("README.md", "results", readme_block(run(load_scenario("paper"))))


if __name__ == "__main__":
    write_or_check(write, parts)
