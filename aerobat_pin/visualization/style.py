"""One visual language for figures, report and replay: colours, fonts, sizes.

Colours after Okabe & Ito (2008), told apart by colour-blind eyes and, with the line styles, in grey. What is true is
black, what is estimated vermillion, in figures and in the replay, where nothing of the robot has these two. The
description's materials are of the same palette: bones blue, bars orange, the crank purple, membranes sky blue.
"""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BLACK, ORANGE, SKY_BLUE, GREEN = "#000000", "#E69F00", "#56B4E9", "#009E73"
YELLOW, BLUE, VERMILLION, PURPLE = "#F0E442", "#0072B2", "#D55E00", "#CC79A7"

INK = "#222222"
TRUTH = BLACK
ESTIMATES = (VERMILLION, BLUE, PURPLE, ORANGE)
AXES = (VERMILLION, GREEN, BLUE)  # x, y, z and roll, pitch, yaw
LEFT, RIGHT = BLUE, ORANGE
BARS = {"L1": PURPLE, "L2": ORANGE, "L3": BLUE, "L4": GREEN, "L5": VERMILLION, "L6": SKY_BLUE, "L7": INK}
NOISE_ZONE, STEP_ZONE = BLUE, PURPLE
CIRCULATION = (BLUE, ORANGE)  # of a wake, left behind by a wing that lifts, and that pushes down
PATH = GREEN
MUTED = "#8A8F98"
FAINT = "#C8CCD2"
LINE_STYLES = ("-", "--", ":", "-.")
FIELD = "cividis"  # colours of a field over time and span: light and dark alone tell its values

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
}
UNDATED: Any = {"png": {"Software": None}, "pdf": {"CreationDate": None}, "svg": {"Date": None}}


def rgb(colour: str) -> tuple[float, float, float]:
    """Return red, green and blue of a hexadecimal colour, from 0 to 1."""
    red, green, blue = (int(colour[i : i + 2], 16) / 255.0 for i in (1, 3, 5))
    return red, green, blue


def rendered(figure: Figure, kind: str) -> bytes:
    """Return a figure as a `png`, `pdf` or `svg` file, without a date: the same figure gives the same bytes."""
    import matplotlib as mpl

    file = io.BytesIO()
    with mpl.rc_context(RC):
        figure.savefig(file, format=kind, metadata=UNDATED[kind])
    return file.getvalue()
