"""One self-contained HTML page about a run: what flew, how well the forces were found, and the figures."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from aerobat_pin.scenario import Scenario, scenario_toml

CAPTIONS = {
    "estimation": "Estimated against actual unknown forces. Magenta: the step, 1 s to 1.6 s. Blue: a stretch of noise, "
    "shown close in the last row.",
    "position": "Position of the body's centre of mass.",
    "states": "Shoulder and elbow, attitude, and velocity in world axes.",
    "stick_diagram": "Top view of the flight.",
    "linkage": "The linkage that drives both joints from one crank.",
}
PAGE_STYLE = """
:root { color-scheme: light; }
body { font: 16px/1.55 system-ui, sans-serif; color: #222; background: #fafafa; margin: 0; }
main { max-width: 60rem; margin: 0 auto; padding: 2rem 1.25rem 4rem; }
h1 { margin: 0 0 .25rem; } h2 { margin: 2.5rem 0 .75rem; }
.note { display: inline-block; background: #fff3d6; border: 1px solid #e6c777; border-radius: .4rem;
  padding: .2rem .7rem; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
th, td { padding: .3rem .8rem; text-align: right; border-bottom: 1px solid #ddd; }
th:first-child, td:first-child, .text { text-align: left; }
figure { margin: 1.5rem 0; } figure img { max-width: 100%; background: white; border: 1px solid #ddd; }
figcaption { color: #555; } pre { background: #f0f0f0; padding: 1rem; overflow-x: auto; font-size: .85rem; }
.scroll { overflow-x: auto; }
"""


def report_html(metrics: Mapping[str, Any], scenario: Scenario, images: Mapping[str, Path]) -> str:
    """Return the page.

    Args:
        metrics: content of `metrics.json`.
        scenario: the resolved scenario.
        images: figure name -> PNG file, embedded into the page.
    """
    flight = metrics["flight"]
    degrees = {name: np.degrees(flight[f"{name}_range"]) for name in ("roll", "pitch", "yaw")}
    end = flight["position_end"]
    facts = [
        ("robot", scenario.robot.morphology),
        ("position at the end", f"{end[0]:.3f}, {end[1]:.3f}, {end[2]:.3f} m"),
        ("height", f"{flight['z_range'][0]:.3f} .. {flight['z_range'][1]:.3f} m"),
        *((name, f"{low:.2f} .. {high:.2f} deg") for name, (low, high) in degrees.items()),
    ]
    for key, label in (
        ("thrusters", "mean lift of the hold in flight"),
        ("aerodynamic", "mean lift of the air in flight"),
    ):
        if f"{key}_lift_over_weight" in flight:
            facts.append((label, f"{100 * flight[f'{key}_lift_over_weight']:.0f} % of the weight"))
    if "motor_power_mean" in flight:
        facts.append(("mean motor power", f"{flight['motor_power_mean']:.2f} W"))
    rows = "".join(f"<tr><td>{escape(name)}</td><td class=text>{escape(value)}</td></tr>" for name, value in facts)
    pictures = "".join(_picture(name, images[name]) for name in CAPTIONS if name in images)
    versions = ", ".join(f"{name} {version}" for name, version in metrics["versions"].items())
    return f"""<!DOCTYPE html>
<html lang="en">
<head><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>Aerobat: {escape(scenario.name)}</title><style>{PAGE_STYLE}</style></head>
<body><main>
<h1>{escape(scenario.name)}</h1>
<p>{escape(scenario.description)}</p>
<p class="note">{escape(metrics["note"])}; motor torque {escape(metrics["torque"])}; seed {metrics["seed"]}</p>
<h2>Unknown forces</h2>
<div class="scroll">{_scores(metrics["observers"])}</div>
<p>R2 against the true force with its noise, and against its noise-free part. The lag is the delay of the noise-free
force that fits the estimate best. Rank counts the force components that can be told apart.</p>
<h2>Flight</h2><table>{rows}</table>
<h2>Figures</h2>{pictures}
<h2>Scenario</h2><pre>{escape(scenario_toml(scenario))}</pre>
<p>{escape(versions)}</p>
</main></body></html>
"""


def _scores(observers: Mapping[str, Any]) -> str:
    head = (
        "<tr><th>observer</th><th>wing</th><th>axis</th><th>R2</th><th>R2 noise-free</th><th>error rms</th><th>lag</th>"
    )
    lines = [head + "<th>rank</th><th>condition</th></tr>"]
    for name, scores in observers.items():
        for wing in (key for key, value in scores.items() if isinstance(value, dict)):
            for axis, one in scores[wing].items():
                cells = [
                    _number(one["r2"], "{:.5f}", "no signal"),
                    _number(one["r2_noise_free"], "{:.5f}", "no signal"),
                    f"{1e3 * one['rmse']:.2f} mN",
                    _number(one["lag_s"] and 1e3 * one["lag_s"], "{:.2f} ms", "-"),
                    str(scores["rank"]),
                    _number(scores["condition"], "{:.0f}", "infinite"),
                ]
                names = "".join(f"<td class=text>{escape(text)}</td>" for text in (name, wing, axis))
                lines.append("<tr>" + names + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>")
    hidden = {name: scores["null_direction"] for name, scores in observers.items() if scores["null_direction"]}
    unseen = "".join(
        f"<p class=text><b>{escape(name)} cannot see</b> forces along "
        + ", ".join(f"({x:.2f}, {y:.2f}, {z:.2f})" for x, y, z in pattern)
        + " on the points in turn: that part of its estimate is zero, whatever the truth.</p>"
        for name, pattern in hidden.items()
    )
    return "<table>" + "".join(lines) + "</table>" + unseen


def _number(value: float | None, form: str, otherwise: str) -> str:
    return otherwise if value is None else form.format(value)


def _picture(name: str, path: Path) -> str:
    data = base64.b64encode(path.read_bytes()).decode("ascii")
    caption = escape(CAPTIONS[name])
    return (
        f'<figure><img alt="{caption}" src="data:image/png;base64,{data}"><figcaption>{caption}</figcaption></figure>'
    )
