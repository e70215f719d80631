"""The page that plays a scene: meshcat's viewer, a legend, and controls of our own. One file, no network."""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from importlib import resources

from aerobat_pin.numerics import Array

SPEEDS = (0.02, 0.05, 0.1, 0.25, 0.5, 1.0)  # of real time: a flap is too fast to be watched


@dataclass(frozen=True)
class Key:
    """A line of the legend. The shape of its mark is `bar`, `line`, `grid` or none."""

    shape: str
    colour: str
    text: str
    opacity: float = 1.0


@dataclass(frozen=True)
class Zone:
    """A stretch of time [s] in which something happens."""

    start: float
    end: float
    label: str
    colour: str


def player_html(
    commands: Sequence[bytes],
    title: str,
    keys: Sequence[Key],
    zones: Sequence[Zone],
    time: Array,
    rate: float,
    sheet: tuple[int, float] | None = None,
) -> str:
    """Return the page.

    Args:
        commands: of a scene whose animation begins at 0.
        title: a line about what is seen.
        keys: the legend.
        zones: marked on the time bar.
        time: (m,) of the keyframes as people count it [s].
        rate: at which the page starts to play, of real time.
        sheet: triangles between two rows of the node `world/air/sheet`, and how long each is seen [s].
    """
    start, end = float(time[0]), float(time[-1])
    data = {
        "commands": [base64.b64encode(command).decode("ascii") for command in commands],
        "start": start,
        "rate": rate,
        "step": (end - start) / (len(time) - 1),
        "times": [round(float(one) - start, 6) for one in time],
        "sheet": None if sheet is None else {"faces": sheet[0], "lasting": sheet[1]},
    }
    legend = "".join(f"<div>{_mark(key)}{escape(key.text)}</div>" for key in keys)
    marks = "".join(
        f'<b title="{escape(zone.label)}" style="background:{zone.colour};'
        f'left:{_percent(zone.start, start, end)};right:{_percent(start + end - zone.end, start, end)}"></b>'
        for zone in zones
    )
    speeds = "".join(f'<button data-rate="{one:g}">{one:g}&times;</button>' for one in sorted({*SPEEDS, rate}))
    page = (resources.files("aerobat_pin") / "visualization" / "pages" / "player.html").read_text(encoding="utf-8")
    viewer = (resources.files("meshcat") / "viewer" / "dist" / "main.min.js").read_text(encoding="utf-8")
    parts = {
        "title": escape(title),
        "legend": legend,
        "zones": marks,
        "speeds": speeds,
        "scene": json.dumps(data).replace("<", "\\u003c"),
        "meshcat": viewer,
    }
    return re.sub(r"@(\w+)@", lambda found: parts[found[1]], page)


def _mark(key: Key) -> str:
    look = f"background:{key.colour};opacity:{key.opacity:g}"
    return f'<i class="{key.shape}" style="{look}"></i>' if key.shape else ""


def _percent(value: float, start: float, end: float) -> str:
    return f"{100.0 * min(max((value - start) / (end - start), 0.0), 1.0):.2f}%"
