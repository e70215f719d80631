"""Write docs/observer_results.md and its figure: every observer under the same conditions; `--check` compares the prose."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from support.observer_conditions import CONDITIONS, SEEDS, TUNING, estimated, flown, worst
from support.pages import HOLE, ROOT, Part, run

from aerobat_pin.observers import OBSERVERS
from aerobat_pin.observers.kalman.kalman import SENSOR_NOISE
from aerobat_pin.visualization import style

PAGE = "docs/observer_results.md"
FILTERS = ("force_level", "second_order")  # `momentum` differs from `force_level` in the third digit


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
        figure, axes = plt.subplots(3, 2, figsize=(9.0, 7.2), sharex=True, sharey=True, layout="constrained")
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
        figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
        for axis in axes[-1]:
            axis.set_xlabel("time [s]")
        for axis in axes[:, 0]:
            axis.set_ylabel("Fz, left wing [N]")
        figure.savefig(path, dpi=110)
        plt.close(figure)


def page(exact: str, conditions: str, squeeze: str) -> str:
    """Return docs/observer_results.md around its tables."""
    return f"""# Observers compared

`make docs` writes this page. The flight is `observer_benchmark`: the 20 g robot flaps at 6 Hz and is sampled at 1 kHz, the
paper's signal pushes along all three axes of both wings, and all joint torques are measured. A cell has the R2 of
Fx / Fy / Fz, for the worse wing and the worst of seeds {SEEDS[0]} to {SEEDS[-1]}. An observer has one tuning for all conditions;
[observers.md](observers.md) says what each observer is.

## Exact model, against the noisy truth

{exact}

## What noise and a wrong belief cost, against the noise-free truth

The noise of a velocity sample is {SENSOR_NOISE[0]} m/s (linear), {SENSOR_NOISE[1]} rad/s (gyro) and {SENSOR_NOISE[2]} rad/s (joints). A filter with a gain
trades noise for lag, and no gain helps against a wrong model. `kalman` and `smoother` know how large the noise is, and that
the air may be wrong by 20 % and the mass by 5 %; they take a force for a random walk of 0.5 N per root second.
[Design note 7](design/0007-kalman.md) tells how these settings were found. Where one wing's force is small or zero, its
errors are set against the variance of the other wing's.

{conditions}

![Every observer on the paper's signal](figures/observers.png)

The figure shows Fz on the left wing around the step, with noise, wrong mass and wrong air at once, seed 1. The band is two
of the filter's own standard deviations to each side.

## What cannot be seen is not made up

With the base rows alone, as without a torque sensor, a pair of forces that squeezes the body along the line between the
wings leaves no trace. Every observer reports it.

{squeeze}
"""


def write() -> None:
    """Write the page and its figure."""
    comparison(ROOT / "docs" / "figures" / "observers.png")
    (ROOT / PAGE).write_text(page(exact_table(), condition_table(), squeeze_table()), encoding="utf-8")


def parts() -> Iterator[Part]:
    """Yield the page without its tables."""
    yield Part(PAGE, "prose", page(HOLE, HOLE, HOLE))


if __name__ == "__main__":
    run(write, parts)
