"""Replay two flights side by side: one clock, one camera and one scale of arrows for both."""

from __future__ import annotations

from aerobat_pin.visualization.replay.page import SPEEDS
from aerobat_pin.visualization.replay.recording import Recording
from aerobat_pin.visualization.template import fill_template


def side_by_side(first: Recording, second: Recording, labels: tuple[str, str], rate: float) -> str:
    """Return a page that plays two recordings from their beginnings on; the shorter one waits at its end.

    Args:
        first: a recording; the scale of the arrows becomes the coarser one of both, and its
            title begins with its label.
        second: another one.
        labels: a name of each.
        rate: speed at which the page starts to play, in multiples of real time.
    """
    both = first, second
    scale = max(one.newtons_per_centimetre for one in both)
    for one, label in zip(both, labels, strict=True):
        one.scale, one.title = scale, f"{label}: {one.title}"
    longer = max(both, key=lambda one: one.duration)
    return fill_template(
        "side_by_side.html",
        labels=labels,
        pages=[one.html(rate) for one in both],
        start=float(longer.time[0]),
        duration=longer.duration,
        step=longer.duration / (len(longer.time) - 1),
        speeds=[f"{speed:g}" for speed in sorted({*SPEEDS, rate})],
        rate=rate,
    )
