"""Write docs/observer_results.md and its figure: every observer on `observer_benchmark`, under the same conditions."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib.pyplot as plt
import numpy as np
import pinocchio as pin

from aerobat_pin.estimation import KnownInputs, known_inputs, true_force
from aerobat_pin.flight import simulate
from aerobat_pin.observers import OBSERVERS, Estimate
from aerobat_pin.observers.kalman.kalman import SENSOR_NOISE
from aerobat_pin.robot import FORCE_POINTS, load_robot
from aerobat_pin.scenario import Scenario, load_scenario
from aerobat_pin.visualization import style

SEEDS = (1, 2, 3, 4, 5)
FILTERS = ("force_level", "second_order")  # `momentum` differs from `force_level` in the third digit
# One tuning for every condition. 0.7 N/sqrt(s) is 0.15 N, the force's standard deviation, in 46 ms, about a quarter of a
# wingbeat. The rest is how good the belief is said to be: air to 20 %, mass to 5 %.
TUNING: dict[str, dict[str, Any]] = {
    name: {"force_walk": 0.7, "known_error": {"aerodynamic": 0.2}, "mass_error": 0.05}
    for name in ("kalman", "smoother")
}


@dataclass(frozen=True)
class Condition:
    """What is wrong with the inputs, and how large the right wing's force is beside the left one's."""

    name: str
    noise: float = 0.0
    mass: float = 1.0
    air: float = 1.0
    share: float = 1.0


CONDITIONS = (
    Condition("exact"),
    Condition("velocity noise", noise=1.0),
    Condition("mass +5 %", mass=1.05),
    Condition("air +20 %", air=1.2),
    Condition("all three", noise=1.0, mass=1.05, air=1.2),
    Condition("all three, left wing only", noise=1.0, mass=1.05, air=1.2, share=0.0),
    Condition("all three, right = -0.5 left", noise=1.0, mass=1.05, air=1.2, share=-0.5),
)


def scenario(seed: int, share: float) -> Scenario:
    """Return the benchmark with the right wing's force scaled by a share of its own."""
    given = load_scenario("observer_benchmark", [f"simulation.seed={seed}"])
    forces = []
    for force in given.unknown_force:
        if force.frame == FORCE_POINTS[1]:
            if share == 0.0:
                continue
            along = tuple(float(np.sign(share)) * x for x in force.direction)
            size = {name: abs(share) * getattr(force, name) for name in ("amplitude", "noise", "step")}
            force = force.model_copy(update={"direction": along, **size})
        forces.append(force)
    return given.model_copy(update={"unknown_force": tuple(forces)})


class Flight(NamedTuple):
    """A flight: the model, exact inputs, and the forces (m, 2, 3) with and without their noise [N]."""

    model: pin.Model
    inputs: KnownInputs
    noisy: np.ndarray
    clean: np.ndarray


@cache
def flown(seed: int, share: float) -> Flight:
    """Fly the benchmark with the right wing's force scaled by a share of its own."""
    chosen = scenario(seed, share)
    log, robot = simulate(chosen), load_robot(chosen)
    noisy, clean = (np.stack([true_force(log, name)[i] for name in FORCE_POINTS], axis=1) for i in range(2))
    return Flight(robot.model, known_inputs(log, robot), noisy, clean)


def estimated(
    name: str,
    seed: int,
    condition: Condition,
    gain: float = 1000.0,
    rows: Any = "all",
    tuning: dict[str, dict[str, Any]] = TUNING,
) -> Estimate:
    """Run an observer on a flight whose velocities are noisy and whose belief is wrong."""
    flight = flown(seed, condition.share)
    model, inputs = flight.model.copy(), flight.inputs
    for i, inertia in enumerate(flight.model.inertias.tolist()):
        model.inertias[i] = pin.Inertia(condition.mass * inertia.mass, inertia.lever, condition.mass * inertia.inertia)
    spread = condition.noise * np.repeat(SENSOR_NOISE, [3, 3, 4])
    v = inputs.v + spread * np.random.default_rng([seed, 77]).standard_normal(inputs.v.shape)
    known = {key: values * (condition.air if key == "aerodynamic" else 1.0) for key, values in inputs.known.items()}
    observer = OBSERVERS[name](model, FORCE_POINTS, gain, rows, **tuning.get(name, {}))
    return observer.run(inputs.time, inputs.q, v, inputs.tau, known)


def worst(name: str, condition: Condition, gain: float = 1000.0, *, noisy: bool = False) -> np.ndarray:
    """Return R2 (x, y, z) of the worse wing and worst seed against the noise-free or the noisy truth.

    Errors of both wings are set against the variance of the left one's force: the right one's may be small or none.
    """
    scores = []
    for seed in SEEDS:
        flight = flown(seed, condition.share)
        true = flight.noisy if noisy else flight.clean
        error = estimated(name, seed, condition, gain).force - true
        scores.append(1.0 - np.mean(error**2, axis=0) / np.var(true[:, 0], axis=0))
    return np.min(np.array(scores), axis=(0, 1))


def cells(values: np.ndarray) -> str:
    """Write three R2."""
    return " / ".join(f"{value:.4f}" if value > 0.99 else f"{value:.2f}" for value in values)


def exact_table() -> str:
    """Return R2 against the noisy truth for the exact model, per gain."""
    lines = ["| observer | K = 1000 1/s | K = 2000 1/s |", "|---|---|---|"]
    for name in ("momentum", "force_level", "second_order", "super_twisting"):
        found = [cells(worst(name, CONDITIONS[0], gain, noisy=True)) for gain in (1000.0, 2000.0)]
        lines.append(f"| `{name}` | {' | '.join(found)} |")
    return "\n".join(lines)


def condition_table() -> str:
    """Return R2 against the noise-free truth, per condition and observer."""
    columns = [(name, gain) for name in FILTERS for gain in (200.0, 1000.0)] + [(name, 1000.0) for name in TUNING]
    titles = [f"`{name}`, K = {gain:.0f}" if name in FILTERS else f"`{name}`" for name, gain in columns]
    lines = [f"| condition | {' | '.join(titles)} |", "|---" * (len(columns) + 1) + "|"]
    for condition in CONDITIONS:
        found = [cells(worst(name, condition, gain)) for name, gain in columns]
        lines.append(f"| {condition.name} | {' | '.join(found)} |")
    return "\n".join(lines)


def squeeze_table() -> str:
    """Return what each observer says of the squeeze when the base rows alone are believed, seed 1."""
    lines = ["| observer | rank | cannot be seen | deviation of the left Fy [N] |", "|---|---|---|---|"]
    for name in OBSERVERS:
        found = estimated(name, 1, CONDITIONS[1], rows="base")
        what = found.identifiability
        at = what.components.index("left_force_point.Fy")
        own = found.standard_deviation
        deviation = "infinite" if own is None else f"{np.median(own[:, at]):.1f}"
        lines.append(f"| `{name}` | {what.rank} | {'; '.join(what.describe())} | {deviation} |")
    return "\n".join(lines)


def comparison(path: Path) -> None:
    """Draw every observer on the paper's signal, with everything wrong, left wing along z."""
    condition, part = CONDITIONS[4], slice(900, 1200)
    time, truth = flown(1, 1.0).inputs.time[:-1], flown(1, 1.0).clean[:, 0, 2]
    with plt.rc_context(style.RC):
        figure, axes = plt.subplots(3, 2, figsize=(9.0, 7.2), sharex=True, sharey=True)
        for axis, name in zip(axes.flat, OBSERVERS, strict=True):
            found = estimated(name, 1, condition)
            axis.plot(time[part], truth[part], color=style.TRUTH, linewidth=1.6, label="true, noise-free")
            axis.plot(time[part], found.force[part, 0, 2], color=style.ESTIMATES[1], linewidth=0.9, label="estimated")
            if found.standard_deviation is not None:
                sure = 2.0 * found.standard_deviation[part, 2]
                middle = found.force[part, 0, 2]
                axis.fill_between(
                    time[part], middle - sure, middle + sure, color=style.ESTIMATES[1], alpha=0.2, linewidth=0.0
                )
            score = 1.0 - np.mean((found.force[:, 0, 2] - truth) ** 2) / np.var(truth)
            axis.set_title(f"{name}: R2 {score:.3f}")
            axis.set_ylim(-0.6, 0.6)
        axes[0, 0].legend(loc="lower left")
        for axis in axes[-1]:
            axis.set_xlabel("time [s]")
        for axis in axes[:, 0]:
            axis.set_ylabel("Fz, left wing [N]")
        figure.tight_layout()
        figure.savefig(path, dpi=110)
        plt.close(figure)


def write(docs: Path) -> None:
    """Write the page and its figure."""
    comparison(docs / "figures" / "observers.png")
    (docs / "observer_results.md").write_text(
        f"""# Observers compared

Written by `make docs`. `observer_benchmark`: the 20 g robot at 6 Hz and 1 kHz, the paper's signal on all three axes of both
wings, all joint torques measured. R2 of Fx / Fy / Fz, worse wing, worst of seeds {SEEDS[0]} to {SEEDS[-1]}, one tuning for all.
[observers.md](observers.md) says what each observer is.

## Exact model, against the noisy truth

{exact_table()}

## What noise and a wrong belief cost, against the noise-free truth

Velocity noise is {SENSOR_NOISE[0]} m/s, {SENSOR_NOISE[1]} rad/s and {SENSOR_NOISE[2]} rad/s a sample (linear, gyro, joints). A filter with a gain
trades noise for lag, and nothing helps it against a wrong belief. `kalman` and `smoother` are told the noise,
that the air may be wrong by 20 % and the mass by 5 %, and that a force walks 0.7 N in a root second;
[design note 7](design/0007-kalman.md) has the trail to these settings. Where one wing's force is small or none, its errors
are set against the other's variance.

{condition_table()}

![Every observer on the paper's signal](figures/observers.png)

Left wing along z, everything wrong at once, seed 1, around the step. The band is two of the filter's own standard
deviations.

## What cannot be seen is not made up

Base rows alone, as without a torque sensor: a pair of forces that squeezes the body along the line between the wings leaves
no trace.

{squeeze_table()}
""",
        encoding="utf-8",
    )


if __name__ == "__main__":
    write(Path(__file__).resolve().parents[1])
