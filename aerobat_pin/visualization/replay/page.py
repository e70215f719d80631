"""Build the page that plays a scene: meshcat's viewer, a legend, and a time bar with controls.

The page is a single HTML file that needs no network.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources

from markupsafe import Markup

from aerobat_pin.numerics import Array
from aerobat_pin.visualization.style import TRUTH
from aerobat_pin.visualization.template import base64_text, fill_template

SPEEDS = (0.02, 0.05, 0.1, 0.25, 0.5, 1.0)  # offered speeds relative to real time, in which flaps are hard to see


@dataclass(frozen=True)
class LegendLine:
    """A line of the legend. The shape of its mark is `bar`, `line`, `grid`, or empty for no mark.

    With `choices`, pairs of a node below `world/force` and its name, the line lets people choose which one is shown.
    """

    shape: str
    colour: str
    text: str
    opacity: float = 1.0
    choices: Sequence[tuple[str, str]] = ()


@dataclass(frozen=True)
class Zone:
    """A stretch of time, from `start` to `end` [s], that is marked on the time bar with a label."""

    start: float
    end: float
    label: str
    colour: str


def replay_page(
    commands: Sequence[bytes],
    title: str,
    legend: Sequence[LegendLine],
    zones: Sequence[Zone],
    time: Array,
    rate: float,
    sheet: tuple[int, float] | None = None,
    subtitle: str = "",
    report: str = "",
) -> str:
    """Return the page as HTML.

    Args:
        commands: meshcat commands that draw the scene, with an animation that begins at time 0.
        title: a line about what is shown.
        legend: lines of the legend.
        zones: stretches of time to mark on the time bar.
        time: (m,) times of the keyframes, as the page's clock shows them [s].
        rate: speed at which the page starts to play, in multiples of real time.
        sheet: for the trailing sheet at the node `world/air/sheet`, the number of triangles between two of its rows,
            and how long each row is shown [s]; None without a sheet.
        subtitle: another line below the title; empty for none.
        report: address of the report that belongs to the flight; empty for none.
    """
    start, end = float(time[0]), float(time[-1])
    return fill_template(
        "replay.html",
        title=title,
        subtitle=subtitle,
        report=report,
        truth=TRUTH,
        legend=legend,
        zones=zones,
        start=start,
        end=end,
        speeds=[f"{speed:g}" for speed in sorted({*SPEEDS, rate})],
        scene={
            "commands": [base64_text(command) for command in commands],
            "start": start,
            "truth": TRUTH,
            "rate": rate,
            "step": (end - start) / (len(time) - 1),
            "times": [round(value - start, 6) for value in time.tolist()],
            "sheet": None if sheet is None else {"faces": sheet[0], "lasting": sheet[1]},
        },
        meshcat=viewer_script(),
    )


def viewer_script() -> Markup:
    """Return meshcat's viewer as installed, behind a comment with the notices of all that was built into it."""
    folder = resources.files("meshcat") / "viewer"
    notices = ["meshcat\n\n" + (folder / "LICENSE").read_text(encoding="utf-8")]
    parts = folder / "dist" / "main.min.js.THIRD_PARTY_LICENSES.json"
    if parts.is_file():
        for part in json.loads(parts.read_text(encoding="utf-8")):
            notices.append(f"{part['name']} {part['version']}: {part['license']}\n\n{part['licenseText'] or ''}")
    said = "\n\n".join(notices).replace("*/", "* /").replace("</", "< /")
    return Markup(f"/*\n{said}\n*/\n") + Markup((folder / "dist" / "main.min.js").read_text(encoding="utf-8"))
