"""One visual language for figures, report and replay: colours, fonts, sizes.

Colours after Okabe & Ito (2008), told apart by colour-blind eyes and, with the line styles, in grey.
"""

from typing import Any

INK = "#222222"
TRUTH = "#000000"
ESTIMATES = ("#D55E00", "#0072B2", "#CC79A7", "#E69F00")
AXES = ("#D55E00", "#009E73", "#0072B2")  # x, y, z and roll, pitch, yaw
LEFT, RIGHT = "#0072B2", "#E69F00"
NOISE_ZONE, STEP_ZONE = "#0072B2", "#CC79A7"
MUTED = "#8A8F98"
LINE_STYLES = ("-", "--", ":", "-.")

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
}
