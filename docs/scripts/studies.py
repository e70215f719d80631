"""Write docs/studies.md and its figures: the shipped sweeps, flown and drawn; `--check` compares the prose."""

from __future__ import annotations

import math
import os
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter
from support.pages import HOLE, ROOT, Part, run

from aerobat_pin.experiments import load_sweep, run_sweep, shipped_sweeps
from aerobat_pin.visualization import style

PAGE, FIGURES = "docs/studies.md", ROOT / "docs" / "figures" / "studies"
SPAN, CHORD = "robot.changes.scale.span", "robot.changes.scale.chord"
SPEED, FREQUENCY = "flight.velocity.0", "crank.frequency"
NOISE, GAIN, STEP = "unknown_force.*.noise", "observers.gain", "simulation.dt"
FILTERS = {  # of the study of sensor noise: what the line is called, whose it is
    "K = 50 1/s": {"observer": "force_level", GAIN: 50.0},
    "K = 200 1/s": {"observer": "force_level", GAIN: 200.0},
    "K = 1000 1/s": {"observer": "force_level", GAIN: 1000.0},
    "`kalman`": {"observer": "kalman", GAIN: 1000.0},
    "`smoother`": {"observer": "smoother", GAIN: 1000.0},
}
AXES = ("x", "y", "z")
MARKERS = ("o", "s", "^", "D", "v")
SHADES = ("#000000", "#0072B2", "#009E73", "#E69F00", "#D55E00")


def morphology(grid: xr.Dataset, belief: str) -> Figure:
    """Draw heat maps of R2 per axis over wing, flight condition and elbow timing."""
    r2 = grid["r2"].sel(observer="momentum", point="left", belief=belief).squeeze("seed")
    built = {SPAN: 1.0, CHORD: 1.0, "elbow": "as built"}
    usual = {SPEED: 3.0, FREQUENCY: 4.75}
    maps = [
        (
            "3 m/s, 4.75 Hz",
            r2.sel({"elbow": "as built", **usual}),
            (SPAN, CHORD),
            ("span / as built", "chord / as built"),
        ),
        ("span 1.05", r2.sel({**built, SPAN: 1.05}), (SPEED, FREQUENCY), ("airspeed [m/s]", "flapping [Hz]")),
        (
            "3 m/s",
            r2.sel({SPAN: 1.0, CHORD: 1.0, SPEED: 3.0}),
            ("elbow", FREQUENCY),
            ("adjustable bar", "flapping [Hz]"),
        ),
    ]
    figure = Figure(figsize=(7.5, 7.4), layout="constrained")
    for row, (title, values, (down, right), (y, x)) in enumerate(maps):
        for column, axis in enumerate(AXES):
            axes = figure.add_subplot(len(maps), 3, 3 * row + column + 1)
            _heat(axes, values.sel(axis=axis).transpose(down, right))
            axes.set_title(f"F{axis}, {title}")
            axes.set_xlabel(x)
            if column == 0:
                axes.set_ylabel(y)
            else:
                axes.set_yticklabels([])
    return figure


def _heat(axes: Any, values: xr.DataArray) -> None:
    """Draw one heat map, each cell with its number: readable in grey."""
    axes.imshow(values, cmap="cividis", vmin=0.0, vmax=1.0, aspect="auto", origin="lower")
    for (i, k), value in np.ndenumerate(values.values):
        text = f"{value:.4f}" if value > 0.9 else f"{value:.2f}"
        axes.text(k, i, text, ha="center", va="center", fontsize=8, color="black" if value > 0.55 else "white")
    down, right = (values[name].values for name in values.dims)
    axes.set_yticks(range(len(down)), [str(value) for value in down])
    axes.set_xticks(range(len(right)), [str(value) for value in right])
    axes.grid(visible=False)


def gain_noise(grid: xr.Dataset) -> Figure:
    """Draw what is missing to R2 = 1 over the gain, a line per noise."""
    found = grid.sel(observer="force_level", point="left", axis="z").mean("seed")
    figure = Figure(figsize=(7.5, 3.4), layout="constrained")
    for k, (name, title) in enumerate(
        (("r2_noise_free", "against the force without its noise"), ("r2", "with its noise"))
    ):
        axes = figure.add_subplot(1, 2, k + 1)
        for i, noise in enumerate(found[NOISE].values):
            label = f"{1e3 * noise:.0f} mN"
            axes.plot(
                found[GAIN], 1.0 - found[name].sel({NOISE: noise}), color=SHADES[i], marker=MARKERS[i], label=label
            )
        axes.set(xscale="log", yscale="log", xlabel="gain K [1/s]", ylabel="1 - R2 of Fz", title=title)
    axes.legend(title="noise of the force")
    return figure


def model_error(grid: xr.Dataset) -> Figure:
    """Draw the error of each axis over each wrong belief."""
    found = grid["rmse"].sel(observer="force_level", point="left").squeeze("seed")
    beliefs = {
        "believed.air.density": (1.225, "air density"),
        "believed.robot.changes.scale.body_mass": (1.0, "mass of the body"),
        "believed.robot.changes.scale.wing_mass": (1.0, "mass of the wings"),
    }
    figure = Figure(figsize=(7.5, 3.2), layout="constrained")
    for k, (key, (truth, name)) in enumerate(beliefs.items()):
        axes = figure.add_subplot(1, 3, k + 1)
        for i, axis in enumerate(AXES):
            wrong = 100.0 * (grid[key].values / truth - 1.0)
            axes.plot(
                wrong, 1e3 * found.sel(axis=axis), MARKERS[i], ms=3, color=style.AXIS_COLOURS[i], label=f"F{axis}"
            )
        axes.set(xlabel="believed too high [%]", title=name, ylim=(0.0, None))
        if k == 0:
            axes.set_ylabel("error rms [mN]")
    axes.legend()
    return figure


def sample_rate(grid: xr.Dataset) -> Figure:
    """Draw what is missing to R2 = 1, and the lag, over the sample time."""
    found = grid.sel(observer="force_level", point="left", axis="z").mean("seed")
    figure = Figure(figsize=(7.5, 3.2), layout="constrained")
    parts = (
        (1.0 - found["r2_noise_free"], "1 - R2 of Fz, noise-free", "log"),
        (1e3 * found["lag_s"], "lag [ms]", "linear"),
    )
    for k, (values, label, scale) in enumerate(parts):
        axes = figure.add_subplot(1, 2, k + 1)
        for i, gain in enumerate(found[GAIN].values):
            line = values.sel({GAIN: gain})
            axes.plot(1e3 * found[STEP], line, color=SHADES[i], marker=MARKERS[i], label=f"K = {gain:.0f} 1/s")
        axes.set(xscale="log", yscale=scale, xlabel="sample time [ms]", ylabel=label)
        axes.set_xticks(1e3 * found[STEP].values, [f"{1e3 * step:g}" for step in found[STEP].values])
        axes.set_xticks([], minor=True)
        if scale == "log":
            axes.set(ylim=(1e-3, 1e-1))
            axes.set_yticks([1e-3, 1e-2, 1e-1])
            axes.yaxis.set_minor_formatter(NullFormatter())
    axes.legend()
    return figure


def sensor_noise(grid: xr.Dataset) -> Figure:
    """Draw what is missing to R2 = 1 over the noise of the sensors, an axis of the force each."""
    found = 1.0 - grid["r2_noise_free"].sel(point="left").mean("seed")
    figure = Figure(figsize=(7.5, 3.4), layout="constrained")
    for k, axis in enumerate(AXES):
        axes = figure.add_subplot(1, 3, k + 1)
        for i, (label, chosen) in enumerate(FILTERS.items()):
            line = found.sel(chosen).sel(axis=axis)
            axes.plot(found["noise"], line, color=SHADES[i], marker=MARKERS[i], ms=5, label=label.strip("`"))
        axes.axhline(1.0, color=style.INK, linestyle="--")
        axes.set(xscale="log", yscale="log", ylim=(2e-3, 30.0), xlabel="noise / reference", title=f"F{axis}")
        axes.set_xticks([1e-3, 1e-2, 1e-1, 1.0], ["0.001", "0.01", "0.1", "1"])
        axes.set_xticks([], minor=True)
        if k == 0:
            axes.set_ylabel("1 - R2, noise-free truth")
            axes.text(1e-3, 1.1, "R2 = 0", fontsize=8)
        else:
            axes.set_yticklabels([])
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=len(FILTERS))
    return figure


def noise_table(grid: xr.Dataset, least: float) -> str:
    """Return the most noise tried that leaves so much R2, filter by filter."""
    found = grid["r2_noise_free"].sel(point="left").mean("seed")
    rows = ["| filter | Fx | Fy | Fz |", "|---|---|---|---|"]
    for label, chosen in FILTERS.items():
        enough = found["noise"].where(found.sel(chosen) >= least).max("noise")
        cells = (float(enough.sel(axis=axis)) for axis in AXES)
        rows.append(f"| {label} | {' | '.join('none' if np.isnan(cell) else f'{cell:.1g}' for cell in cells)} |")
    return "\n".join(rows)


FOUND = (
    "lowest known",
    "five percent more span",
    "best gains",
    "noise that leaves 0.9",
    "kalman",
    "smoother",
    "worst tenth",
)


def results(grids: dict[str, xr.Dataset]) -> dict[str, str]:
    """Return what the page says that only the sweeps' results tell, by the names of `FOUND`."""
    known, built = (
        grids["morphology"]["r2"].sel(observer="momentum", point="left", belief=name) for name in ("known", "as built")
    )
    usual = built.sel({SPAN: 1.05, CHORD: 1.0, "elbow": "as built", SPEED: 3.0, FREQUENCY: 4.75}).squeeze("seed")
    gains = grids["gain_noise"]["r2_noise_free"].sel(observer="force_level", point="left", axis="z").mean("seed")
    noises = [float(noise) for noise in gains[NOISE].values if noise > 0.0]
    best = [f"| {1e3 * noise:.0f} mN | {float(gains.sel({NOISE: noise}).idxmax(GAIN)):.0f} 1/s |" for noise in noises]
    drawn = grids["model_error"]["r2"].sel(observer="force_level", point="left").squeeze("seed")
    noisy = grids["sensor_noise"]["r2_noise_free"].sel(point="left", noise=1.0, axis=["y", "z"]).mean("seed")
    kalman, smoother = (
        " and ".join(f"{float(r2):.2f}" for r2 in noisy.sel(FILTERS[f"`{name}`"])) for name in ("kalman", "smoother")
    )
    texts = (
        f"{float(known.min()):.4f}",
        ", ".join(f"{float(usual.sel(axis=axis)):.2f}" for axis in AXES),
        "\n".join(best),
        noise_table(grids["sensor_noise"], 0.9),
        kalman,
        smoother,
        ", ".join(f"{float(drawn.sel(axis=axis).quantile(0.1)):.2f}" for axis in AXES),
    )
    return dict(zip(FOUND, texts, strict=True))


def page(found: Mapping[str, str]) -> str:
    """Return docs/studies.md around the results of the sweeps."""
    sweeps = {name: load_sweep(name) for name in shipped_sweeps()}
    runs = {name: math.prod(sweep.shape) for name, sweep in sweeps.items()}
    tried = sweeps["sensor_noise"].file
    noise = {name: tried.factors["noise"].of[f"sensors.{name}.noise"] for name in ("velocity", "gyro", "joint_rate")}
    return f"""# Studies

`make docs` writes this page and flies the sweeps that it shows. Each sweep is a file of a few lines in
[`aerobat_pin/experiments/sweep/shipped`](../aerobat_pin/experiments/sweep/shipped). `aerobat sweep NAME` flies it again; to
change it, copy the file.

```sh
aerobat sweep morphology                        # all processors; a minute on two
aerobat sweep mine.toml --jobs 4 --out runs/mine
aerobat sweep mine.toml --cluster tcp://10.0.0.1:8786
```

After an interruption, whatever its reason, the same command goes on: every finished run is on the disk, and none is flown
twice. A run that fails stands in the tables with its reason. `results.nc` is one grid whose dimensions are what was varied;
`results.csv` has a row for each run. The command prints median and range of the errors at each value of what was varied, and
draws them as `sweep.png`.

```python
import xarray as xr

grid = xr.load_dataset("runs/morphology/results.nc")
grid["r2"].sel({{"crank.frequency": 4.75, "observer": "momentum", "axis": "z"}})
```

## A sweep file

| table or key | makes |
|---|---|
| `name` | required: the name of the sweep, and of its folder below `runs/` |
| `description` | optional: a line that says what the sweep is for |
| `base` | the scenario that every run starts from: a shipped name, or a file beside this one |
| `[set]` | dotted keys that every run changes in it |
| `[ranges]` | a dimension for each dotted key: a list, or `{{from = 50, to = 3200, count = 7, spacing = "log"}}` |
| `[factors.NAME]` | a dimension NAME that scales several keys together: `values` is a list or range of factors, and `[factors.NAME.of]` has the value of each key at a factor of 1 |
| `[variants.NAME]` | a dimension NAME of named sets of dotted keys |
| `[draws]` | the dimension `draw`: `count` random draws, with a `seed` of their own, of the keys in `[draws.values]`, each `{{distribution = "uniform", low, high}}`, `log_uniform`, or `{{distribution = "normal", mean, deviation}}` |
| `seeds` | the dimension `seed`: how many seeds, counted up from that of the base scenario |

```toml
# mine.toml
name = "mine"
description = "gain against noise, 2 x 3 x 2 runs"
base = "paper"
seeds = 2
[ranges]
"observers.gain" = {{from = 200, to = 2000, count = 3, spacing = "log"}}
"unknown_force.*.noise" = [0.01, 0.03]
```

The runs are all combinations of the dimensions, and every combination has the same draws. In a key, a number is a place in
a list (`flight.velocity.0`) and a `*` is every place (`unknown_force.*.noise`). What the observers *believe* is varied like
any other key.

On a cluster the workers must have the same versions installed, and must see your own morphology files under the same path.
Start each worker with one thread: flights that share a processor slow each other down.

## Wing morphology and flight condition

`morphology` has {runs["morphology"]} runs of 1 s at K = 1000 1/s. The figures show R2 against the noisy truth, on the left wing. An
observer that knows the wings finds the forces on all of them, in every flight condition: the lowest R2 is {found["lowest known"]}.

![R2 where the robot is known](figures/studies/morphology_known.png)

An observer that believes every wing to be as built does not. Span and chord change masses and air forces together: 5 % more
span leaves an R2 of {found["five percent more span"]} for Fx, Fy, Fz at 3 m/s and 4.75 Hz. Fx and Fy are lost first, because they are small
beside the forces of inertia and air. The elbow's timing costs less, because the joints are measured and only the motion
between two samples is wrong.

![R2 where the robot is believed to be as built](figures/studies/morphology_as_built.png)

## Gain against the noise of the force

`gain_noise` has {runs["gain_noise"]} runs of 2 s. The noise here is a part of the force. Against the noisy truth more gain is always
better; against the noise-free truth there is a best gain, which falls as the noise grows.

| noise | best gain tried |
|---|---|
{found["best gains"]}

![1 - R2 over the gain](figures/studies/gain_noise.png)

## Noise of the sensors

`sensor_noise` has {runs["sensor_noise"]} runs of 2 s. Every velocity sample is noisy; the reference is {noise["velocity"]} m/s (linear), {noise["gyro"]} rad/s (gyro) and
{noise["joint_rate"]} rad/s (joints), and the scenario `noisy_sensors` has a quarter to two fifths of it. Positions and angles are exact.
`force_level` is tried with three gains. `kalman` and `smoother` have no gain; they know how large the noise is, and take a
force for a random walk of {tried.set["observers.kalman.force_walk"]} N per root second. The most noise tried that leaves an R2 of 0.9, over the reference:

{found["noise that leaves 0.9"]}

Where there is little noise, a filter with a gain is limited by its lag; where there is more, by the noise, which it lets
through nearly in proportion to K. The two observers that weigh noise against lag reach an R2 of {found["kalman"]} (`kalman`) and
{found["smoother"]} (`smoother`) for Fy and Fz at the reference. Fx is a fourteenth of Fy and is lost first. All axes share one random
walk, which is too quick for Fx: there a filter with a gain can do better.

![1 - R2 over the noise of the sensors](figures/studies/sensor_noise.png)

## What a wrong belief costs

`model_error` has {runs["model_error"]} runs of 2 s, in which the believed air density, body mass and wing mass are drawn with standard
deviations of 5, 2 and 5 %. One belief in ten leaves an R2 below {found["worst tenth"]} for Fx, Fy, Fz. The error of Fz follows the
believed mass of the wings, because flapping accelerates it; every wrong belief adds to the error of Fy.

![Error over wrong beliefs](figures/studies/model_error.png)

## Sample rate

`sample_rate` has {runs["sample_rate"]} runs of 2 s. The observers filter exactly between samples, so a longer sample time does not disturb
them. The truth is the mean over an interval, and over a longer interval its noise averages out. What a longer sample time
costs is resolution in time and, with more strips or at a higher speed, the stability of the air's states.

![1 - R2 and lag over the sample time](figures/studies/sample_rate.png)
"""


def write() -> None:
    """Fly the shipped sweeps, draw them, and write the page."""
    FIGURES.mkdir(parents=True, exist_ok=True)
    grids = {}
    with tempfile.TemporaryDirectory() as work:
        for name in shipped_sweeps():
            grids[name] = run_sweep(load_sweep(name), Path(work) / name, jobs=len(os.sched_getaffinity(0)))
    draw(grids, FIGURES)
    (ROOT / PAGE).write_text(page(results(grids)), encoding="utf-8")


def parts() -> Iterator[Part]:
    """Yield the page without the results of the sweeps."""
    yield Part(PAGE, "prose", page(dict.fromkeys(FOUND, HOLE)))


def draw(grids: dict[str, xr.Dataset], folder: Path) -> None:
    """Draw every figure."""
    with mpl.rc_context(style.RC):
        figures = {
            "morphology_known": morphology(grids["morphology"], "known"),
            "morphology_as_built": morphology(grids["morphology"], "as built"),
            "gain_noise": gain_noise(grids["gain_noise"]),
            "model_error": model_error(grids["model_error"]),
            "sample_rate": sample_rate(grids["sample_rate"]),
            "sensor_noise": sensor_noise(grids["sensor_noise"]),
        }
        for name, figure in figures.items():
            figure.savefig(folder / f"{name}.png", metadata={"Software": None})


if __name__ == "__main__":
    run(write, parts)
