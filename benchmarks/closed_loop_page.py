"""What `closed_loop` measured: figures beside their bounds, printed, and written into `docs/control_results.md`."""

from __future__ import annotations

import datetime
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from aerobat_pin.visualization import style

TITLES = {
    "fair": "Three laws, within the same limits",
    "margins": "Margins, and other thrusters than believed",
    "impact": "A blow of 25 mN s on the left wing",
    "cost": "Time and memory of the loop",
    "environment": "The environment",
}
PREFACE = """# What the closed loop shows

`python benchmarks/closed_loop_fair.py --page docs/control_results.md` writes the first section, `python
benchmarks/closed_loop.py --page docs/control_results.md` the others; [control.md](control.md) says what flies. Medians
over seeds. Angles and distances are root mean squares about the course over a whole flight of 2 to 3 s.

The loop's times were taken on two cores that others used, too. Between its steps a sum of fixed numbers and the bare
calls of Pinocchio were timed: where their 99th percentiles are as many times their medians as the loop's, the machine
was interrupted. Step by step, the least of ten equal flights shows what the loop itself takes. A blow of 10 ms is over
before an observer sees it: the robot settles as soon as without. At 0.6 of the believed thrust, thrusters make 1 % more
lift than the nominal flight needs: the observer's law spends that on moments, and sinks; at 0.7 it flies. Shares of
bounded flights, the blow and times were measured before `control.height` was raised from 10.927 to 11.4.
"""


class Board:
    """The figures that were measured, with their bounds."""

    def __init__(self, page: Path | None = None) -> None:
        self.figures = None if page is None else page.parent / "figures"
        self.missed: list[str] = []
        self.lines: list[str] = []

    def section(self, name: str, seeds: int) -> None:
        """Begin a section."""
        print(f"\n== {name}, {seeds} seeds")
        told = f"Measured on {datetime.date.today()}; {seeds} seeds where noise counts."
        self.lines = [TITLES[name], "", told, "", "| | measured | unit | bound |", "|---|---|---|---|"]

    def show(self, what: str, value: float, bound: float | None = None, unit: str = "", least: bool = False) -> None:
        """Print a figure and its bound, an upper one unless `least`."""
        good = bound is None or (value >= bound if least else value <= bound)
        text = "" if bound is None else f"{'at least' if least else 'at most'} {bound:g}{'' if good else ': MISSED'}"
        print(f"  {what:<62} {value:10.4g} {unit:<5}   {text}", flush=True)
        self.lines.append(f"| {what} | {value:.4g} | {unit} | {text} |")
        if not good:
            self.missed.append(what)

    def tell(self, what: str, text: str) -> None:
        """Print a line of text."""
        print(f"  {what:<24} {text}", flush=True)
        self.lines.append(f"| {what} | {text} | | |")

    def write(self, page: Path, name: str) -> None:
        """Put the section into a page, after the last one that comes before it; the others stay."""
        parts = page.read_text().split("\n## ") if page.exists() else [PREFACE]
        found = {part.splitlines()[0]: part.rstrip("\n") for part in parts[1:]}
        found[TITLES[name]] = "\n".join(self.lines)
        sections = [f"\n\n## {found[title]}" for title in TITLES.values() if title in found]
        page.write_text(PREFACE.rstrip("\n") + "".join(sections) + "\n")


def draw_blow(away: dict[str, np.ndarray], settled: float, folder: Path) -> None:
    """Draw the distances (n,) from the course [mm] of several laws, a sample each millisecond, and the bound."""
    with mpl.rc_context(style.RC):
        figure = Figure(figsize=(6.5, 2.8), layout="constrained")
        axis = figure.subplots()
        for (law, values), colour, line in zip(away.items(), (style.MUTED, style.BLUE), ("--", "-"), strict=True):
            axis.plot(1e-3 * np.arange(len(values)), values, line, color=colour, label=law)
        axis.axhline(settled, color=style.INK, linestyle=":", linewidth=0.9, label="settled below")
        axis.axvline(0.7, color=style.FAINT, linewidth=0.9)
        axis.set_xlabel("time [s]; the blow is at 0.7 s")
        axis.set_ylabel("off the course, sideways\nand upwards [mm]")
        axis.set_ylim(0.0, None)
        style.legend_on_top(axis, ncols=3)
        folder.mkdir(exist_ok=True)
        figure.savefig(folder / "control_blow.png", dpi=150)
