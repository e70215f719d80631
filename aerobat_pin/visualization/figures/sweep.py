"""Draw what each quantity that a sweep varies does to the errors: the default picture of a sweep."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator

from aerobat_pin.experiments import Effect
from aerobat_pin.numerics import Array
from aerobat_pin.visualization import style

ABREAST = 2
DECADE = 10.0  # ratio of the largest to the least value beyond which the axis is logarithmic


def draw_sweep(effects: Sequence[Effect], title: str) -> Figure:
    """Draw a panel for each quantity: median errors as lines, their range over all other runs as bars."""
    with mpl.rc_context(style.RC):
        rows = -(-max(len(effects), 1) // ABREAST)
        figure = Figure(figsize=(8.0, 2.9 * rows + 0.6), layout="constrained")
        style.title_of(figure, title)
        panels = figure.subplots(rows, ABREAST, squeeze=False).ravel()
        for panel, effect in zip(panels, effects, strict=False):
            at = np.arange(len(effect.labels), dtype=float) if effect.values is None else effect.values
            for i, (what, errors) in enumerate(effect.errors.items()):
                middle, low, high = errors.T
                line, colour = style.LINE_STYLES[i % 4], style.ESTIMATES[i % 4]
                bars = np.array([middle - low, high - middle])
                panel.errorbar(at, middle, bars, fmt=f"o{line}", ms=3.5, capsize=3, lw=1.0, color=colour, label=what)
            panel.set(
                xlabel=effect.name, ylabel="error, rms", yscale="log" if _far(effect.errors.values()) else "linear"
            )
            if effect.values is None:
                panel.set_xticks(at, effect.labels)
            elif _far([effect.values]):
                panel.set_xscale("log")
                panel.set_xticks(at, effect.labels)
                panel.xaxis.set_minor_locator(NullLocator())
            if panel.get_yscale() == "log":
                panel.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
                panel.yaxis.set_minor_locator(NullLocator())
                panel.yaxis.set_major_formatter("{x:g}")
        for panel in panels[len(effects) :]:
            panel.set_visible(False)
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def _far(values: Iterable[Array]) -> bool:
    """Whether positive numbers differ so much that a logarithmic axis shows them better."""
    all_of_them = np.concatenate([part[np.isfinite(part)].ravel() for part in values])
    return len(all_of_them) > 1 and 0.0 < DECADE * float(all_of_them.min()) <= float(all_of_them.max())
