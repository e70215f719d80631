"""One self-contained HTML page about a run: what flew, how well the forces were found, and what could be known."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from aerobat_pin.estimation import TABLE_HEADER, Scores
from aerobat_pin.experiments import Experiment
from aerobat_pin.scenario import scenario_toml
from aerobat_pin.visualization.figures.linkage_svg import animation

CAPTIONS = {
    "estimation": "Estimated against actual unknown forces. Purple boxes: what came and went of them. Blue box: what "
    "the last row shows closely.",
    "position": "Position of the body's centre of mass.",
    "states": "Shoulder and elbow, attitude, and velocity in world axes.",
    "stick_diagram": "Top view of the flight.",
    "aerodynamics": "The air's force on the whole robot, and on each strip of the wing per length, along its normal.",
    "power": "Power that motor and air give to the robot.",
    "linkage": "The linkage that drives both joints from one crank.",
}
SECTIONS = {
    "forces": "Unknown forces",
    "known": "What could be known",
    "flight": "Flight",
    "air": "Air and power",
    "linkage": "Linkage",
    "again": "To run it again",
}
TORQUES = {
    "measured": "all joint torques",
    "modelled": "of the motion alone, without the unknown force",
    "motor_only": "the crank's torque alone",
    "none": "unknown",
}
SLOWER = 10.0  # the linkage is shown turning so much slower than it flies


def report_html(experiment: Experiment, images: Mapping[str, Path]) -> str:
    """Return the page.

    Args:
        experiment: what was run.
        images: figure name -> PNG file, embedded into the page.
    """
    scenario, metrics = experiment.scenario, experiment.metrics
    title = escape(scenario.name)
    links = "".join(f'<a href="#{name}">{escape(text)}</a>' for name, text in SECTIONS.items())
    parts = {
        "forces": _forces(experiment.scores) + _picture(images, "estimation"),
        "known": _known(experiment),
        "flight": _table(_flight(experiment)) + _picture(images, "position", "states", "stick_diagram"),
        "air": _picture(images, "aerodynamics", "power"),
        "linkage": _picture(images, "linkage") + _moving(experiment),
        "again": _again(experiment),
    }
    body = "".join(f'<h2 id="{name}">{escape(SECTIONS[name])}</h2>{part}' for name, part in parts.items() if part)
    look = (resources.files("aerobat_pin") / "visualization" / "pages" / "report.css").read_text(encoding="utf-8")
    return f"""<!DOCTYPE html>
<html lang="en">
<head><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>Aerobat: {title}</title><style>{look}</style></head>
<body><main>
<h1>{title}</h1>
<p>{escape(scenario.description)}</p>
<p class="note">{escape(metrics["note"])}; motor torque {escape(metrics["torque"])}; seed {metrics["seed"]}</p>
{_table(_what_was_run(experiment))}
<nav>{links}</nav>
{body}
</main></body></html>
"""


def _what_was_run(experiment: Experiment) -> list[tuple[str, str]]:
    scenario = experiment.scenario
    changed = " with changes" if scenario.robot.changes else ""
    wind = "" if not any(scenario.air.wind) else f", wind {scenario.air.wind} m/s"
    names = ", ".join(scenario.observers.names)
    return [
        ("robot", f"{Path(scenario.robot.morphology).stem}{changed}, {1e3 * experiment.robot.mass:.1f} g"),
        ("crank", f"{scenario.crank.drive}, {scenario.crank.frequency:g} Hz"),
        ("air", f"{scenario.air.model.replace('_', ' ')}, added mass times {scenario.air.added_mass:g}{wind}"),
        ("flight", f"{scenario.simulation.duration:g} s in steps of {1e3 * scenario.simulation.dt:g} ms"),
        ("observers", f"{names}; gain {scenario.observers.gain:g} 1/s"),
    ]


def _flight(experiment: Experiment) -> list[tuple[str, str]]:
    flight = experiment.metrics["flight"]
    facts = [
        ("position at the end", ", ".join(f"{x:.3f}" for x in flight["position_end"]) + " m"),
        ("height", f"{flight['z_range'][0]:.3f} .. {flight['z_range'][1]:.3f} m"),
    ]
    for name in ("roll", "pitch", "yaw"):
        low, high = np.degrees(flight[f"{name}_range"])
        facts.append((name, f"{low:.2f} .. {high:.2f} deg"))
    for key, label in (("thrusters", "mean lift of the hold"), ("aerodynamic", "mean lift of the air")):
        if f"{key}_lift_over_weight" in flight:
            facts.append((label, f"{100 * flight[f'{key}_lift_over_weight']:.0f} % of the weight"))
    if "motor_power_mean" in flight:
        facts.append(("mean motor power", f"{flight['motor_power_mean']:.2f} W"))
    return facts


def _forces(scores: Scores) -> str:
    return _grid(TABLE_HEADER, list(scores.rows()), text=3) + (
        '<p class="soft">R2 against the true force with its noise, and against its noise-free part. The lag is the '
        "delay of the noise-free force that fits the estimate best.</p>"
    )


def _known(experiment: Experiment) -> str:
    """Say which inputs there were, and which force components the equations could tell apart."""
    metrics = experiment.metrics
    rows = []
    for name, estimate in experiment.estimates.items():
        found = estimate.identifiability
        condition = _number(metrics["observers"][name]["condition"], "{:.0f}", "infinite")
        values = ", ".join(f"{value:.3g}" for value in found.singular_values)
        rows.append((name, f"{found.rank} of {len(found.components)}", condition, values))
    blind = [f"<b>{escape(name)}</b>: {escape(one)}" for name in metrics["observers"] for one in _unseen(metrics, name)]
    words = (
        "<p>Patterns of forces that leave no trace, and are left out of the estimate whatever the truth:</p><ul>"
        + "".join(f"<li>{one}</li>" for one in blind)
        + "</ul>"
        if blind
        else "<p>Every pattern of forces leaves a trace.</p>"
    )
    inputs = [
        (name, f"{source}: {TORQUES[source]}" if name == "motor_torque" else source)
        for name, source in metrics["inputs"].items()
    ]
    return (
        _grid(("observer", "rank", "condition", "singular values, N per N"), rows, text=1)
        + words
        + '<p class="soft">At the worst configuration of the flight. Moments count as forces at a lever of 50 mm.</p>'
        + "<h3>Inputs of the observers</h3>"
        + _table(inputs)
    )


def _unseen(metrics: Mapping[str, Any], name: str) -> Sequence[str]:
    found: Sequence[str] = metrics["observers"][name]["unseen"]
    return found


def _moving(experiment: Experiment) -> str:
    frequency = experiment.scenario.crank.frequency
    if frequency <= 0.0:
        return ""
    picture = animation(experiment.robot.linkage, SLOWER / frequency)
    return f"<figure>{picture}<figcaption>The same, {SLOWER:g} times slower than it flies.</figcaption></figure>"


def _again(experiment: Experiment) -> str:
    return (
        "<p>With the same packages this scenario, saved as a file, gives the same numbers: "
        "<code>aerobat run FILE</code>.</p>"
        + _table([("seed", str(experiment.metrics["seed"])), *experiment.metrics["versions"].items()])
        + f"<details><summary>scenario.toml</summary><pre>{escape(scenario_toml(experiment.scenario))}</pre></details>"
    )


def _table(rows: Iterable[tuple[str, str]]) -> str:
    lines = (
        f'<tr><td class="text soft">{escape(name)}</td><td class="text">{escape(value)}</td></tr>'
        for name, value in rows
    )
    return f'<div class="scroll"><table>{"".join(lines)}</table></div>'


def _grid(head: Sequence[str], rows: Iterable[Sequence[str]], text: int) -> str:
    """Return a table whose first columns are text."""

    def line(kind: str, cells: Sequence[str]) -> str:
        looks = [' class="text"' if i < text else "" for i in range(len(cells))]
        return "<tr>" + "".join(f"<{kind}{a}>{escape(b)}</{kind}>" for a, b in zip(looks, cells, strict=True)) + "</tr>"

    return f'<div class="scroll"><table>{line("th", head)}{"".join(line("td", row) for row in rows)}</table></div>'


def _number(value: float | None, form: str, otherwise: str) -> str:
    return otherwise if value is None else form.format(value)


def _picture(images: Mapping[str, Path], *names: str) -> str:
    made = ""
    for name in names:
        if name in images:
            data = base64.b64encode(images[name].read_bytes()).decode("ascii")
            caption = escape(CAPTIONS[name])
            made += (
                f'<figure><img alt="{caption}" src="data:image/png;base64,{data}">'
                f"<figcaption>{caption}</figcaption></figure>"
            )
    return made
