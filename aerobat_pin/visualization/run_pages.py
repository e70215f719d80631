"""Write the figures, the report and the replay of a run.

The report is one self-contained HTML page; its template is `pages/report.html`.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import matplotlib as mpl
import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure

from aerobat_pin.aerobat import TrueEvent
from aerobat_pin.experiments import TABLE_HEADER, Experiment, Progress, estimate_dataset
from aerobat_pin.observers import OBSERVERS
from aerobat_pin.scenario import Scenario, described, scenario_toml, shipped_description
from aerobat_pin.visualization import style
from aerobat_pin.visualization.figures.air import draw_aerodynamics, draw_power
from aerobat_pin.visualization.figures.control import draw_control
from aerobat_pin.visualization.figures.estimation import draw_estimation
from aerobat_pin.visualization.figures.linkage import draw_linkage, linkage_animation
from aerobat_pin.visualization.figures.paper import draw_position, draw_states, draw_stick_diagram
from aerobat_pin.visualization.replay.flight_replay import SLOW_MOTION, replay_flight
from aerobat_pin.visualization.template import fill_template

SLOWER = 10.0  # the animated linkage turns slower than the real one by this factor


def write_figures_and_pages(experiment: Experiment, folder: Path, progress: Progress | None = None) -> None:
    """Write `figures/`, `report.html` and `replay.html` into an existing folder.

    Args:
        experiment: results that `experiments.run` returned.
        folder: folder to write into.
        progress: called with the name of the stage and the share of the stage that is done.
    """
    figures = draw_all(experiment)
    (folder / "figures").mkdir()
    for i, (name, figure) in enumerate(figures.items()):
        if progress is not None:
            progress("drawing figures", i / len(figures))
        style.save_figure(figure, folder / "figures" / name)
    report = report_html(experiment, {name: folder / "figures" / f"{name}.png" for name in figures})
    (folder / "report.html").write_text(report, encoding="utf-8")
    if progress is not None:
        progress("writing the replay", 0.0)
    estimates, note = estimate_dataset(experiment.estimates), experiment.scores.note
    recording = replay_flight(experiment.robot, experiment.drawn, experiment.scenario.air, estimates, note)
    recording.subtitle, recording.report = experiment.scores.changes, "report.html"
    (folder / "replay.html").write_text(recording.html(SLOW_MOTION), encoding="utf-8")


def draw_all(experiment: Experiment) -> dict[str, Figure]:
    """Draw all figures of a run, and return name -> figure. The run's note is added to the titles of flight figures."""
    robot, log = experiment.robot, experiment.drawn
    with mpl.rc_context(style.RC):
        figures = {
            "position": draw_position(log),
            "states": draw_states(log),
            "stick_diagram": draw_stick_diagram(robot, log),
            "estimation": draw_estimation(log, experiment.estimates, _gusts(experiment.scenario)),
        }
        if log.truth is not None:
            figures |= {"aerodynamics": draw_aerodynamics(robot, log), "power": draw_power(log)}
        if log.truth is not None and "thrust" in log.truth:
            figures["control"] = draw_control(robot, experiment.scenario, log)
        for figure in figures.values():
            style.title_of(figure, f"{figure.get_suptitle()}\n{experiment.scores.note}\n{experiment.scores.changes}")
        return {**figures, "linkage": draw_linkage(robot.linkage)}


def _gusts(scenario: Scenario) -> list[TrueEvent]:
    """Return the gust of a scenario as an event of its figures; it acts at no single frame."""
    gust = scenario.air.gust
    if gust is None or not any(gust.amplitude):
        return []
    return [TrueEvent("gust", (), gust.start, gust.start + gust.duration)]


def report_html(experiment: Experiment, images: Mapping[str, Path]) -> str:
    """Return the report as HTML.

    Args:
        experiment: results of the run.
        images: figure name -> PNG file; the pictures are embedded into the page.
    """
    scenario, frequency = described(experiment.scenario), experiment.scenario.crank.frequency
    return fill_template(
        "report.html",
        scenario=scenario,
        shipped=shipped_description(scenario.name),
        toml=scenario_toml(scenario),
        robot=f"{Path(scenario.robot.morphology).stem}{' with changes' if scenario.robot.changes else ''}",
        mass=experiment.robot.mass,
        scores=experiment.scores,
        table_header=TABLE_HEADER,
        identifiability={name: estimate.identifiability for name, estimate in experiment.estimates.items()},
        observers={name: (OBSERVERS[name].__doc__ or "").split("\n")[0] for name in experiment.estimates},
        gains=_names_and_gains(scenario),
        degrees=np.degrees,
        images=images,
        linkage=Markup(linkage_animation(experiment.robot.linkage, SLOWER / frequency)) if frequency > 0.0 else None,
        slower=SLOWER,
    )


def _names_and_gains(scenario: Scenario) -> str:
    """Return the names of a scenario's observers, each with its gain if it has one."""
    section, texts = scenario.observers, []
    for name in section.names:
        with_gain = name not in ("kalman", "smoother") or section.settings(name).get("force_walk") == "gain"
        texts.append(f"{name} (gain {section.gain:g} 1/s)" if with_gain else name)
    return ", ".join(texts)
