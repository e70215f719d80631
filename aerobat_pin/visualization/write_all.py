"""Write the figures, the report and the replay of a run."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

from aerobat_pin.estimation import TrueEvent
from aerobat_pin.experiments import Experiment, Progress, estimate_dataset
from aerobat_pin.scenario import Scenario
from aerobat_pin.visualization import style
from aerobat_pin.visualization.figures.air import draw_aerodynamics, draw_power
from aerobat_pin.visualization.figures.control import draw_control
from aerobat_pin.visualization.figures.estimation import draw_estimation
from aerobat_pin.visualization.figures.linkage import draw_linkage
from aerobat_pin.visualization.figures.paper import draw_position, draw_states, draw_stick_diagram
from aerobat_pin.visualization.replay.flight_replay import SLOW_MOTION, replay_flight
from aerobat_pin.visualization.report import report_html


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
