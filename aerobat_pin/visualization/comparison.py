"""Set two runs side by side: what differs between their scenarios, their scores, their forces and their figures."""

from __future__ import annotations

import csv
import errno
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import matplotlib as mpl
import xarray as xr
from matplotlib.figure import Figure

from aerobat_pin.aerobat import SUM, FlightLog, true_force
from aerobat_pin.errors import LogError, content_of, plain_json
from aerobat_pin.experiments import RESULTS, read_run
from aerobat_pin.forces import one_unit, point_label, quantity
from aerobat_pin.scenario import Scenario, differing_keys, keys_text
from aerobat_pin.visualization import style
from aerobat_pin.visualization.figures.lines import fit_errors, fit_to_drawn
from aerobat_pin.visualization.replay.flight_replay import SLOW_MOTION, replay_run
from aerobat_pin.visualization.replay.moving_page import Replay
from aerobat_pin.visualization.template import fill_template

MOST_FIGURE, MOST_METRICS = 5_000_000, 5_000_000  # bytes; those of `aerobat run` have 300,000
PNG = b"\x89PNG"


@dataclass(frozen=True, repr=False)
class ComparedRun:
    """What a run's folder contains.

    Attributes:
        label: short name in tables and legends.
        estimates: forces of all observers, as in `estimate.nc`.
        scores: (observer, point, axis) -> R2, None without a signal, and root mean square error [N], of `metrics.json`.
        figures: name -> content of the PNG file.
    """

    label: str
    folder: Path
    scenario: Scenario
    log: FlightLog
    estimates: xr.Dataset
    scores: dict[tuple[str, str, str], tuple[float | None, float]]
    figures: dict[str, bytes]

    @classmethod
    def load(cls, folder: Path, label: str) -> ComparedRun:
        """Read a run's folder. Raises LogError if it is none."""
        scenario, log, estimates = read_run(folder)
        return cls(label, folder, scenario, log, estimates, _force_scores(folder / "metrics.json"), _figures(folder))

    @property
    def known(self) -> set[str]:
        """Points at which the true force is known, and all of them together."""
        return set() if self.log.truth is None else {SUM, *map(str, self.log.truth["point"].values)}


def _figures(folder: Path) -> dict[str, bytes]:
    """Return the figures of a run: name -> content of the PNG file. Raises LogError for what is none."""
    figures = {}
    for path in (folder / name for name in RESULTS if name.endswith(".png")):
        try:
            if path.parent.is_symlink():
                raise OSError(errno.ELOOP, f"{path.parent} is a link")
            figures[path.stem] = content_of(path, MOST_FIGURE)
            if not figures[path.stem].startswith(PNG):
                raise OSError(errno.EINVAL, "is no picture")
        except FileNotFoundError:
            continue
        except OSError as error:
            raise LogError(f"figure {path}: {error.strerror}; a PNG file of the run was expected") from error
    return figures


def _names_along(run: ComparedRun, dimension: str) -> list[str]:
    return [str(label) for label in run.estimates[dimension].values]


def _force_scores(path: Path) -> dict[tuple[str, str, str], tuple[float | None, float]]:
    """Read the scores of a run's forces. Raises LogError if the file has none."""
    scores = {}
    try:
        for name, points in plain_json(content_of(path, MOST_METRICS))["observers"].items():
            for point, axes in points.items():
                for axis, score in axes.items() if isinstance(axes, dict) and "Fx" in axes else ():
                    r2, rmse = score["r2"], float(score["rmse"])
                    scores[name, point, axis] = None if r2 is None else float(r2), rmse
                    if not ",".join([name, point, axis]).isprintable():
                        raise ValueError("a name that cannot be printed")
    except (OSError, ValueError, KeyError, TypeError, AttributeError, OverflowError) as error:
        raise LogError(f"metrics {path}: the scores of a run were expected") from error
    return scores


@dataclass(frozen=True, repr=False)
class RunComparison:
    """Two runs side by side; `print` shows what differs and the scores, `write` writes tables, figures and a page."""

    FILES: ClassVar = ("comparison.html", "comparison.csv", "forces.png", "forces.pdf", "replay.html")
    first: ComparedRun
    second: ComparedRun

    @property
    def differences(self) -> dict[str, Any]:
        """Dotted key -> value in the second run's scenario, of all that differs from the first one's."""
        return differing_keys(self.first.scenario, self.second.scenario)

    @property
    def header(self) -> tuple[str, ...]:
        """Names of the columns of the table of scores."""
        a, b = self.first.label, self.second.label
        return "observer", "point", "axis", f"R2 {a}", f"R2 {b}", f"error rms {a}", f"error rms {b}"

    @property
    def shared(self) -> list[tuple[str, str, str]]:
        """Observer, point and axis of the scores that both runs have."""
        return [key for key in self.first.scores if key in self.second.scores]

    def rows(self) -> Iterator[tuple[str, ...]]:
        """Yield the rows of the table with the columns of `header`: the scores that both runs have."""
        say = one_unit(run.scores[key][1] for run in (self.first, self.second) for key in self.shared)
        for key in self.shared:
            pair = self.first.scores[key], self.second.scores[key]
            r2 = ("no signal" if score[0] is None else f"{score[0]:.5f}" for score in pair)
            yield *key, *r2, *(say(score[1], "N") for score in pair)

    @property
    def verdict(self) -> str:
        """One sentence on the first observer that both runs have: how far it is off the true force in each."""
        if not self.shared:
            return "No observer's forces are compared with their truth in both."
        name = self.shared[0][0]
        keys = [key for key in self.shared if key[0] == name]
        count, runs = len({point for _, point, _ in keys}), (self.first, self.second)
        squares = [sum(run.scores[key][1] ** 2 for key in keys) / count for run in runs]
        sizes = [f"{quantity(square**0.5, 'N')} rms in {run.label}" for square, run in zip(squares, runs, strict=True)]
        times = f", {(squares[1] / squares[0]) ** 0.5:.2g} times as much" if squares[0] > 0.0 else ""
        return f"{name} is off the true force by {sizes[0]} and by {sizes[1]}{times}."

    @property
    def missing(self) -> list[str]:
        """Why a curve or a row is not there: lines of text."""
        lines, runs = [], (self.first, self.second)
        for run, other in (runs, runs[::-1]):
            drawn, *others = _names_along(run, "observer")
            lines += [f"{run.label}: {drawn} is drawn, its first observer, and not {', '.join(others)}"] * bool(others)
            for name in ("observer", "point"):
                if alone := sorted(set(_names_along(run, name)) - set(_names_along(other, name))):
                    lines.append(f"{run.label} alone has the {name} {', '.join(alone)}: nothing to set beside it")
            if blind := [point_label(point) for point in _names_along(run, "point") if point not in run.known]:
                why = "is not known" if run.log.truth is None else "is none"
                lines.append(
                    f"{run.label}: the true force at {', '.join(blind)} {why}, so it and its error are not drawn"
                )
        return lines

    def __repr__(self) -> str:
        a, b = self.first, self.second
        lines = [f"{run.label}: {run.folder}" for run in (a, b)]
        lines.append(f"in {b.label}: {keys_text(self.differences)}" if self.differences else "the scenarios are equal")
        for name, point, axis, *numbers in (self.header, *self.rows()):
            lines.append(f"{name:<12} {point:<12} {axis:<4} " + " ".join(f"{number:>14}" for number in numbers))
        return "\n".join([self.verdict, *lines, *self.missing])

    def draw(self) -> Figure:
        """Draw true and estimated forces of both runs and the errors, a column for each point that both estimate."""
        runs = (self.first, self.second)
        points = [point for point in _names_along(self.first, "point") if point in _names_along(self.second, "point")]
        if not points:
            raise LogError(f"{self.first.folder} and {self.second.folder}: forces at the same points were expected")
        names = [_names_along(run, "observer")[0] for run in runs]
        with mpl.rc_context(style.RC):
            figure = Figure(figsize=(max(6.5, 4.2 * len(points)), 7.4), layout="constrained")
            grid = figure.subplots(6, len(points), sharex=True, squeeze=False, height_ratios=(2, 1) * 3)
            for column, point in enumerate(points):
                grid[0][column].set_title(point_label(point))
                for k, axis in enumerate("xyz"):
                    force, error = grid[2 * k][column], grid[2 * k + 1][column]
                    force.set_ylabel(f"$F_{axis}$ [N]", parse_math=True)
                    error.set_ylabel("error [mN]")
                    for run, name, colour, line in zip(runs, names, style.ESTIMATES, ("-", "--"), strict=False):
                        middle = 0.5 * (run.log.time[1:] + run.log.time[:-1])
                        values = run.estimates["force_W"].sel(observer=name, point=point).values[:, k]
                        force.plot(middle, values, line, color=colour, lw=0.9, label=f"{run.label}: {name}", zorder=2)
                        if point in run.known:
                            truth = true_force(run.log, point)[0][:, k]
                            force.plot(middle, truth, color=style.TRUTH, lw=1.8, label="actual", zorder=1)
                            error.plot(middle, 1e3 * (values - truth), line, color=colour, lw=0.7)
                grid[-1][column].set_xlabel("time [s]")
            for k in range(3):
                fit_to_drawn(grid[2 * k])
            fit_errors([grid[2 * k + 1] for k in range(3)])
            style.title_of(figure, f"Unknown forces, {runs[0].label} and {runs[1].label}: world axes, interval means")
            curves = {str(line.get_label()): line for axis in grid[0] for line in axis.lines}
            figure.legend(curves.values(), curves.keys(), loc="outside lower center", ncols=3)
        return figure

    def write(self, folder: Path) -> None:
        """Write `comparison.html`, `comparison.csv`, the figure of the forces and a replay of both into a folder."""
        style.save_figure(self.draw(), folder / "forces")
        with (folder / "comparison.csv").open("w", encoding="utf-8", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows((self.header, *self.rows()))
        first, second = self.first.figures, self.second.figures
        labels = self.first.label, self.second.label
        page = fill_template(
            "comparison.html",
            comparison=self,
            labels=labels,
            differences=keys_text(self.differences),
            forces=folder / "forces.png",
            figures={name: (first[name], second[name]) for name in first if name in second},
        )
        (folder / "comparison.html").write_text(page, encoding="utf-8")
        flights = side_by_side(replay_run(self.first.folder), replay_run(self.second.folder), labels, SLOW_MOTION)
        (folder / "replay.html").write_text(flights, encoding="utf-8")


def compare_runs(first: Path, second: Path) -> RunComparison:
    """Read the folders of two runs. Raises LogError if one is none, or if they share no point of a force."""
    names = [Path(os.path.realpath(folder)).name for folder in (first, second)]  # of links in a circle, too
    labels = names if names[0] != names[1] else ["first", "second"]
    return RunComparison(
        *(ComparedRun.load(folder, label) for folder, label in zip((first, second), labels, strict=True))
    )


def side_by_side(first: Replay, second: Replay, labels: tuple[str, str], rate: float) -> str:
    """Return a page that plays two recordings from their beginnings on; the shorter one waits at its end.

    They share a clock, a camera and the coarser scale of their arrows; a title begins with its label. The page starts
    to play at `rate`, in multiples of real time.
    """
    both = first, second
    scale = max(replay.newtons_per_centimetre for replay in both)
    for replay, label in zip(both, labels, strict=True):
        replay.scale = scale
        replay.title = replay.title if replay.title.startswith(f"{label}:") else f"{label}: {replay.title}"
    longer = max(both, key=lambda replay: replay.duration)
    return fill_template(
        "side_by_side.html",
        labels=labels,
        pages=[replay.html(rate) for replay in both],
        start=float(longer.time[0]),
        duration=longer.duration,
        step=longer.duration / (len(longer.time) - 1),
        rate=rate,
    )
