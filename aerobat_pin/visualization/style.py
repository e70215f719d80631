"""Colours, fonts and sizes of figures, report and replay.

The colours are those of Okabe & Ito (2008), which colour-blind readers can tell apart; in grey print, line styles
distinguish the curves. True forces are black and estimates vermillion; no part of the robot has these two colours. The
materials in the robot's description use the same palette: bones are blue, bars orange, the crank purple, and membranes
sky blue.
"""

from __future__ import annotations

import io
import os
import signal
import textwrap
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BLACK, ORANGE, SKY_BLUE, GREEN = "#000000", "#E69F00", "#56B4E9", "#009E73"
BLUE, VERMILLION, PURPLE = "#0072B2", "#D55E00", "#CC79A7"

INK = "#222222"
TRUTH = BLACK
ESTIMATES = (VERMILLION, BLUE, PURPLE, ORANGE)
AXIS_COLOURS = (VERMILLION, GREEN, BLUE)  # x, y, z and roll, pitch, yaw
LEFT, RIGHT = BLUE, ORANGE
BAR_COLOURS = {"L1": PURPLE, "L2": ORANGE, "L3": BLUE, "L4": GREEN, "L5": VERMILLION, "L6": SKY_BLUE, "L7": INK}
ENLARGED_ZONE, EVENT_ZONE = BLUE, PURPLE
WAKE_COLOURS = (BLUE, ORANGE)  # of the wake shed by a wing with lift, and by a wing with downforce
PATH = GREEN
MUTED = "#8A8F98"
FAINT = "#C8CCD2"
LINE_STYLES = ("-", "--", ":", "-.")
FIELD_COLOURS = "RdBu_r"  # for signed values over time and span: white is zero, red positive

LETTERS_PER_INCH = 13.5  # of a title, in the size below

RC: Any = {
    "font.size": 9,
    "axes.labelsize": 9,
    "axes.titlesize": 10,
    "axes.edgecolor": "#555555",
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": "#DDDDDD",
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "legend.fontsize": 8,
    "lines.linewidth": 1.2,
    "pdf.fonttype": 42,
    "savefig.dpi": 160,
    "svg.hashsalt": "aerobat",
    "text.parse_math": False,  # names in a stranger's log or robot can have dollar signs
}
COPIED: list[Figure] = []  # that copies of this process draw
METADATA: Any = {"png": {"Software": None}, "pdf": {"CreationDate": None}, "svg": {"Date": None}}


def rgb(colour: str) -> tuple[float, float, float]:
    """Return red, green and blue of a hexadecimal colour, from 0 to 1."""
    red, green, blue = (int(colour[i : i + 2], 16) / 255.0 for i in (1, 3, 5))
    return red, green, blue


def render_figure(figure: Figure, kind: str) -> bytes:
    """Return the content of a `png`, `pdf` or `svg` file; it has no date, so the same figure gives the same bytes."""
    import matplotlib as mpl

    file = io.BytesIO()
    with mpl.rc_context(RC):
        figure.savefig(file, format=kind, metadata=METADATA[kind])
    return file.getvalue()


def save_figure(figure: Figure, stem: Path) -> None:
    """Write a figure to the files `stem`.png and `stem`.pdf."""
    for kind, content in _rendered(figure).items():
        stem.with_suffix(f".{kind}").write_bytes(content)


def save_figures(figures: Mapping[str, Figure], folder: Path, progress: Callable[[float], None]) -> None:
    """Write figures, by name, to `<name>.png` and `<name>.pdf` in a folder; as many processes as processors draw.

    `progress` is called with the share that is written.
    """
    processes = min(len(os.sched_getaffinity(0)), len(figures))
    for done, (name, files) in enumerate(zip(figures, _drawn(list(figures.values()), processes), strict=True)):
        progress(done / len(figures))
        for kind, content in files.items():
            (folder / f"{name}.{kind}").write_bytes(content)


def _drawn(figures: list[Figure], processes: int) -> Iterator[dict[str, bytes]]:
    """Yield the files of each figure; the processes are copies of this one, so figures need not be sent to them."""
    if processes < 2:
        yield from map(_rendered, figures)
        return
    COPIED[:] = figures
    with ProcessPoolExecutor(processes, get_context("fork"), _end_by_signals) as pool:
        yield from pool.map(_rendered_copy, range(len(figures)))


def _end_by_signals() -> None:
    """Let a copy end at once: what the handlers of this process clean up is not its own."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)


def _rendered_copy(index: int) -> dict[str, bytes]:
    return _rendered(COPIED[index])


def _rendered(figure: Figure) -> dict[str, bytes]:
    """Return kind -> content of a figure as PNG and PDF, laid out once."""
    files = {"png": render_figure(figure, "png")}
    figure.set_layout_engine("none")
    return files | {"pdf": render_figure(figure, "pdf")}


def title_of(figure: Figure, title: str) -> None:
    """Set a figure's title, broken into lines that fit its width; a line break of the text stays."""
    columns = int(LETTERS_PER_INCH * figure.get_size_inches()[0])
    lines = [part for line in title.splitlines() for part in textwrap.wrap(line, columns)]
    figure.suptitle("\n".join(lines), fontsize=RC["axes.titlesize"])


def legend_on_top(axis: Axes, ncols: int) -> None:
    """Add a legend with `ncols` columns at the top, and raise the upper limit so that it does not cover the lines."""
    axis.legend(ncols=ncols, loc="upper right")
    low, high = axis.get_ylim()
    axis.set_ylim(low, high + 0.2 * (high - low))
