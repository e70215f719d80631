"""Limits of panels: by what is drawn once estimates have risen, and so that a small error is no flat line."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from aerobat_pin.visualization import style

MARGIN = 0.05  # above and below what is drawn, of its height
HIDDEN = 0.2  # of the largest error: smaller ones would be flat lines on its scale


def fit_errors(rows: Sequence[Sequence[Axes]], begin: float = -np.inf) -> None:
    """Fit rows of panels of errors; all get one scale, unless it hides those of a row."""
    sizes = [fit_to_drawn(axes, begin) for axes in rows]
    if min(sizes) > HIDDEN * max(sizes):
        style.share_limits(axis for axes in rows for axis in axes)


def fit_to_drawn(axes: Sequence[Axes], begin: float = -np.inf) -> float:
    """Give panels the limits that fit all that is drawn in them from a time [s] on; return the height of that."""
    ends = []
    for axis in axes:
        places = [line.get_xydata() for line in axis.lines]
        places += [path.vertices for band in axis.collections for path in band.get_paths() if band.get_hatch() is None]
        drawn = np.concatenate([np.empty((0, 2)), *(np.asarray(one, float) for one in places)])
        drawn = drawn[np.all(np.isfinite(drawn), axis=1)]
        late = drawn[drawn[:, 0] >= begin]
        ends += [late if len(late) else drawn] if len(drawn) else []
    if not ends:
        return 0.0
    low, high = (float(extreme(np.concatenate(ends)[:, 1])) for extreme in (np.min, np.max))
    margin = MARGIN * (high - low) or 1e-6
    for axis in axes:
        axis.set_ylim(low - margin, high + margin)
    return high - low
