"""Rewrite the figures and numbers of README.md and docs/: `make docs`, or `python docs/regenerate.py`."""

from __future__ import annotations

import re
from pathlib import Path

import frames
import lifting_line
import numpy as np
import observer_study
import screenshots
import studies

from aerobat_pin.estimation import FORCE_AXES, known_inputs, r_squared, true_force
from aerobat_pin.experiments import Experiment, run
from aerobat_pin.observers import OBSERVERS
from aerobat_pin.scenario import load_scenario
from aerobat_pin.visualization.figures import paper as figures

DOCS = Path(__file__).resolve().parents[1]
SEEDS = (1, 2, 3, 4, 5)
GAINS = (100.0, 1000.0, 2000.0)
PAPER = {"Fx": "0.7448", "Fy": "0.9970", "Fz": "0.9991"}


def paper_summary(experiment: Experiment) -> str:
    """Return the README's table: the paper's R2 beside ours, seed 1, observer `momentum`."""
    scores = experiment.metrics["observers"]["momentum"]
    lines = ["| | Fx | Fy | Fz |", "|---|---|---|---|", f"| paper, R2 | {' | '.join(PAPER.values())} |"]
    for wing in ("left", "right"):
        cells = [f"{scores[wing][axis]['r2']:.5f} ({1e3 * scores[wing][axis]['rmse']:.2f} mN)" for axis in FORCE_AXES]
        lines.append(f"| {wing} wing, R2 (error rms) | {' | '.join(cells)} |")
    note = f"`momentum`, K = 2000 1/s, seed 1; {experiment.metrics['note']}."
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
                estimate = kind(one.robot.model, frames, gain).run(
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


def results_page(paper: list[Experiment], benchmark: list[Experiment]) -> str:
    """Return docs/results.md."""
    return f"""# Results

Written by `make docs`; every number comes from the runs it makes. Where nothing else is said, ranges are over seeds
{SEEDS[0]} to {SEEDS[-1]}.

## `paper`: {paper[0].metrics["note"]}, K = {paper[0].scenario.observers.gain:.0f} 1/s

The paper reports R2 of {", ".join(PAPER.values())} for Fx, Fy and Fz, against the noisy truth. R2 against the
noise-free truth is lower at this gain, because an observer that follows the noise is wrong by the noise.

{paper_table(paper)}

![Estimated against actual forces](figures/estimation.png)

{flight_table(paper)}

"79 % thruster-borne" is the hold's constant lift over the weight. The height loop takes some of it back: the table has
the mean over the flight and what the air lifts; the unknown forces lift the rest. An independent simulator, also with
added mass, ended this flight at X 5.96 m with pitch from 2.3 to 7.7 deg.

![Position](figures/position.png)
![Joint angles, attitude and velocity](figures/states.png)
![Top view](figures/stick_diagram.png)

## `observer_benchmark`: exact model, noisy truth, worst of five seeds

{benchmark_table(benchmark)}

At K = 100 1/s `force_level` shows the filter's lag alone. `momentum` adds the turning of the wings within the filter's
memory; see [design note 3](design/0003-the-unknown-force-and-the-flight.md).

## The other flights

{flights_table()}

`paper_left` pushes on the left wing alone: it drifts to the right, as the paper's figure does. `paper_open_loop` flies
without any hold, trimmed by `aerobat trim`, on a tail and a fin that the robot does not have; the dive after 1 s is the
step. Its roll and yaw stay within 6 deg for the scenario's own seed and not for all: drooped wings are laterally unstable,
what the noise of the two wings starts doubles every 0.48 s (the trim's Floquet multipliers), and a hold is what it takes to
stop that. `tumble` has no fin and is pushed to the left.

## What must be known of the joint torques

Seed 1, left wing.

{torque_table()}

* **measured**: all joint torques. They contain the reaction to the unknown force, since the linkage holds the joints
  whatever pushes; with them two point forces are six unknowns against rows of rank six.
* **modelled**: the torque that the prescribed motion takes without the unknown force, as the paper's text describes its
  `u_m`. The joint rows then say "nothing pushes here", which is wrong, and the estimate is pulled between them and the base
  rows. Rank six, and yet wrong: rank tells what the equations could decide, not whether they are true.
* **motor_only**: the crank's torque. The power of all joints is one true row beside the six of the base: rank six again.
  `force_level` uses it without loss. `momentum` filters the ten rows first, and what a crank sensor leaves open rotates
  between them while the filter remembers.
* **none**: base rows alone, rank five. An equal and opposite pair along the line between the points leaves no trace; the
  estimate has that part at zero. Where the true forces have none of it (`observer_benchmark`, both wings alike), little is
  lost; where they have (`paper`, whose normals lean toward each other), Fy is lost.

Whenever some pattern of forces leaves no trace, the observers leave it out of the estimate and report it.

## The linkage

![The Kinetic Sculpture](figures/linkage.png)
"""


def _range(values: list[float], form: str) -> str:
    return _span((min(values), max(values)), form)


def _span(bounds: tuple[float, float], form: str) -> str:
    return f"{form.format(bounds[0])} .. {form.format(bounds[1])}"


def main() -> None:
    """Run everything and rewrite the files."""
    lifting_line.write(DOCS)
    screenshots.main()
    studies.write(DOCS)
    paper = [run(load_scenario("paper", [f"simulation.seed={seed}"])) for seed in SEEDS]
    benchmark = [run(load_scenario("observer_benchmark", [f"simulation.seed={seed}"])) for seed in SEEDS]
    page = results_page(paper, benchmark)
    drawn = figures.draw_all(paper[0].robot, paper[0].log, paper[0].estimates, paper[0].metrics["note"])
    for name in re.findall(r"figures/(\w+)\.png", page):
        figures.save(drawn[name], DOCS / "figures" / name)
        (DOCS / "figures" / f"{name}.pdf").unlink()
    frames.main()
    observer_study.write(DOCS)
    (DOCS / "results.md").write_text(page, encoding="utf-8")
    readme = DOCS.parent / "README.md"
    block = f"<!-- results: written by docs/regenerate.py -->\n{paper_summary(paper[0])}\n<!-- /results -->"
    text = re.sub(r"<!-- results:.*?<!-- /results -->", lambda _: block, readme.read_text(encoding="utf-8"), flags=re.S)
    readme.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
