"""Write the results and figures of docs/studies.md: the shipped sweeps, flown and drawn."""

import os
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter
from support.pages import ROOT, Values, run, save, table

from aerobat_pin.experiments import load_sweep, run_sweep, shipped_sweeps
from aerobat_pin.visualization import style

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
BELIEFS = {
    "believed.air.density": (1.225, "air density"),
    "believed.robot.changes.scale.body_mass": (1.0, "mass of the body"),
    "believed.robot.changes.scale.wing_mass": (1.0, "mass of the wings"),
}
AXES = ("x", "y", "z")
MARKERS = ("o", "s", "^", "D", "v")
SHADES = ("#000000", "#0072B2", "#009E73", "#E69F00", "#D55E00")
Line = tuple[str, Any, Any]  # label, x, y


def panel(axes: Any, lines: Iterable[Line], **look: Any) -> None:
    """Draw lines with a shade and a marker each."""
    for (label, x, y), shade, marker in zip(lines, SHADES, MARKERS, strict=False):
        axes.plot(x, y, color=shade, marker=marker, ms=5, label=label)
    axes.set(**look)


def named_ticks(axes: Any, ticks: Any, scale: float = 1.0) -> None:
    """Label these values [x] of a logarithmic axis, in units that are so much smaller, and no others."""
    axes.set_xticks([scale * tick for tick in ticks], [f"{scale * tick:g}" for tick in ticks])
    axes.set_xticks([], minor=True)


def morphology(grid: xr.Dataset, belief: str) -> Figure:
    """Draw heat maps of R2 per axis over wing, flight condition and elbow timing; a cell has its number."""
    r2 = grid["r2"].sel(observer="momentum", point="left", belief=belief).squeeze("seed")
    usual = r2.sel({SPEED: 3.0, FREQUENCY: 4.75, "elbow": "as built"})
    longer = r2.sel({SPAN: 1.05, CHORD: 1.0, "elbow": "as built"})
    timed = r2.sel({SPAN: 1.0, CHORD: 1.0, SPEED: 3.0})
    maps = (
        ("3 m/s, 4.75 Hz", usual, (SPAN, CHORD), ("span / as built", "chord / as built")),
        ("span 1.05", longer, (SPEED, FREQUENCY), ("airspeed [m/s]", "flapping [Hz]")),
        ("3 m/s", timed, ("elbow", FREQUENCY), ("adjustable bar", "flapping [Hz]")),
    )
    figure = Figure(figsize=(7.5, 7.4), layout="constrained")
    for row, (title, values, names, (y, x)) in zip(figure.subplots(3, 3), maps, strict=True):
        for axes, axis in zip(row, AXES, strict=True):
            cells = values.sel(axis=axis).transpose(*names)
            axes.imshow(cells, cmap="cividis", vmin=0.0, vmax=1.0, aspect="auto", origin="lower")
            for (i, k), value in np.ndenumerate(cells.values):
                text = f"{value:.4f}" if value > 0.9 else f"{value:.2f}"
                axes.text(k, i, text, ha="center", va="center", fontsize=8, color="k" if value > 0.55 else "w")
            down, right = (list(map(str, cells[name].values)) for name in names)
            axes.set_yticks(range(len(down)), down if axis == "x" else [])
            axes.set_xticks(range(len(right)), right)
            axes.grid(visible=False)
            axes.set(title=f"F{axis}, {title}", xlabel=x, ylabel=y if axis == "x" else None)
    return figure


def gain_noise(grid: xr.Dataset) -> Figure:
    """Draw what is missing to R2 = 1 over the gain, a line per noise."""
    fz = grid.sel(observer="force_level", point="left", axis="z").mean("seed")
    figure = Figure(figsize=(7.5, 3.4), layout="constrained")
    titles = {"r2_noise_free": "against the force without its noise", "r2": "with its noise"}
    for axes, (name, title) in zip(figure.subplots(1, 2), titles.items(), strict=True):
        curves = [(f"{1e3 * noise:.0f} mN", fz[GAIN], 1.0 - fz[name].sel({NOISE: noise})) for noise in fz[NOISE].values]
        panel(axes, curves, xscale="log", yscale="log", xlabel="gain K [1/s]", ylabel="1 - R2 of Fz", title=title)
    axes.legend(title="noise of the force")
    return figure


def model_error(grid: xr.Dataset) -> Figure:
    """Draw the error of each axis over each wrong belief."""
    error = 1e3 * grid["rmse"].sel(observer="force_level", point="left").squeeze("seed")
    figure = Figure(figsize=(7.5, 3.2), layout="constrained")
    for k, (axes, (key, (truth, name))) in enumerate(zip(figure.subplots(1, 3), BELIEFS.items(), strict=True)):
        wrong = 100.0 * (grid[key].values / truth - 1.0)
        for axis, marker, colour in zip(AXES, MARKERS, style.AXIS_COLOURS, strict=False):
            axes.plot(wrong, error.sel(axis=axis), marker, ms=3, color=colour, label=f"F{axis}")
        axes.set(xlabel="believed too high [%]", title=name, ylim=(0.0, None), ylabel="" if k else "error rms [mN]")
    axes.legend()
    return figure


def sample_rate(grid: xr.Dataset) -> Figure:
    """Draw what is missing to R2 = 1, and the lag, over the sample time."""
    fz = grid.sel(observer="force_level", point="left", axis="z").mean("seed")
    figure = Figure(figsize=(7.5, 3.2), layout="constrained")
    missing, late = figure.subplots(1, 2)
    for axes, values, label in (
        (missing, 1.0 - fz["r2_noise_free"], "1 - R2 of Fz, noise-free"),
        (late, 1e3 * fz["lag_s"], "lag [ms]"),
    ):
        curves = [(f"K = {gain:.0f} 1/s", 1e3 * fz[STEP], values.sel({GAIN: gain})) for gain in fz[GAIN].values]
        panel(axes, curves, xscale="log", xlabel="sample time [ms]", ylabel=label)
        named_ticks(axes, fz[STEP].values, 1e3)
    missing.set(yscale="log", ylim=(1e-3, 1e-1), yticks=[1e-3, 1e-2, 1e-1])
    missing.yaxis.set_minor_formatter(NullFormatter())
    late.legend()
    return figure


def sensor_noise(grid: xr.Dataset) -> Figure:
    """Draw what is missing to R2 = 1 over the noise of the sensors, an axis of the force each."""
    missing = 1.0 - grid["r2_noise_free"].sel(point="left").mean("seed")
    figure = Figure(figsize=(7.5, 3.4), layout="constrained")
    for axes, axis in zip(figure.subplots(1, 3, sharey=True), AXES, strict=True):
        curves = [(label.strip("`"), missing["noise"], missing.sel(of).sel(axis=axis)) for label, of in FILTERS.items()]
        panel(axes, curves, xscale="log", yscale="log", ylim=(2e-3, 30.0), xlabel="noise / reference", title=f"F{axis}")
        axes.axhline(1.0, color=style.INK, linestyle="--")
        named_ticks(axes, [1e-3, 1e-2, 1e-1, 1.0])
    figure.axes[0].set_ylabel("1 - R2, noise-free truth")
    figure.axes[0].text(1e-3, 1.1, "R2 = 0", fontsize=8)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=len(FILTERS))
    return figure


def noise_rows(r2: xr.DataArray, least: float) -> Iterator[list[str]]:
    """Yield the most noise tried that leaves so much R2, filter by filter."""
    for label, chosen in FILTERS.items():
        enough = r2["noise"].where(r2.sel(chosen) >= least).max("noise")
        cells = (float(enough.sel(axis=axis)) for axis in AXES)
        yield [label, *("none" if np.isnan(cell) else f"{cell:.1g}" for cell in cells)]


def results(grids: dict[str, xr.Dataset]) -> dict[str, str]:
    """Return what the page says that only the sweeps' results tell."""
    wings = grids["morphology"]["r2"].sel(observer="momentum", point="left")
    known, built = (wings.sel(belief=name) for name in ("known", "as built"))
    usual = built.sel({SPAN: 1.05, CHORD: 1.0, "elbow": "as built", SPEED: 3.0, FREQUENCY: 4.75}).squeeze("seed")
    gains = grids["gain_noise"]["r2_noise_free"].sel(observer="force_level", point="left", axis="z").mean("seed")
    best = [
        (f"{1e3 * noise:.0f} mN", f"{float(gains.sel({NOISE: noise}).idxmax(GAIN)):.0f} 1/s")
        for noise in gains[NOISE].values
        if noise > 0.0
    ]
    drawn = grids["model_error"]["r2"].sel(observer="force_level", point="left").squeeze("seed")
    noisy = grids["sensor_noise"]["r2_noise_free"].sel(point="left").mean("seed")
    reference = noisy.sel(noise=1.0, axis=["y", "z"])
    return {
        "lowest known": f"{float(known.min()):.4f}",
        "five percent more span": ", ".join(f"{float(usual.sel(axis=axis)):.2f}" for axis in AXES),
        "best gains": table("noise | best gain tried", best),
        "noise that leaves 0.9": table("filter | Fx | Fy | Fz", noise_rows(noisy, 0.9)),
        "worst tenth": ", ".join(f"{float(drawn.sel(axis=axis).quantile(0.1)):.2f}" for axis in AXES),
    } | {
        name: " and ".join(f"{float(r2):.2f}" for r2 in reference.sel(FILTERS[f"`{name}`"]))
        for name in ("kalman", "smoother")
    }


def find() -> Values:
    """Fly the shipped sweeps and draw them."""
    with tempfile.TemporaryDirectory() as work:
        jobs = len(os.sched_getaffinity(0))
        grids = {name: run_sweep(load_sweep(name), Path(work) / name, jobs=jobs) for name in shipped_sweeps()}
    figures = {"morphology_known": "known", "morphology_as_built": "as built"}
    drawn = {name: morphology(grids["morphology"], belief) for name, belief in figures.items()}
    for draw in (gain_noise, model_error, sample_rate, sensor_noise):
        drawn[draw.__name__] = draw(grids[draw.__name__])
    save(drawn, ROOT / "docs" / "figures" / "studies")
    return {"docs/studies.md": results(grids)}


if __name__ == "__main__":
    run(find)
