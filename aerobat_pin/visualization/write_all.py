"""Write everything that a person looks at after a run: figures, report, replay."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

from aerobat_pin.experiments import Experiment, Progress, estimate_dataset
from aerobat_pin.visualization import style
from aerobat_pin.visualization.figures.air import draw_aerodynamics, draw_power
from aerobat_pin.visualization.figures.linkage import draw_linkage
from aerobat_pin.visualization.figures.paper import draw_estimation, draw_position, draw_states, draw_stick_diagram
from aerobat_pin.visualization.replay.flight_replay import SLOW_MOTION, replay_flight
from aerobat_pin.visualization.report import report_html


def write_figures_and_pages(experiment: Experiment, folder: Path, progress: Progress | None = None) -> None:
    """Write `figures/`, `report.html` and `replay.html` into an existing folder.

    Args:
        experiment: what `experiments.run` returned.
        folder: where to.
        progress: called with the name of the stage and the share of it that is done.
    """
    figures = draw_all(experiment)
    (folder / "figures").mkdir()
    for i, (name, figure) in enumerate(figures.items()):
        if progress is not None:
            progress("drawing", i / len(figures))
        style.save_figure(figure, folder / "figures" / name)
    report = report_html(experiment, {name: folder / "figures" / f"{name}.png" for name in figures})
    (folder / "report.html").write_text(report, encoding="utf-8")
    estimates, note = estimate_dataset(experiment.estimates), experiment.scores.note
    recording = replay_flight(experiment.robot, experiment.log, experiment.scenario.air, estimates, note)
    (folder / "replay.html").write_text(recording.html(SLOW_MOTION), encoding="utf-8")


def draw_all(experiment: Experiment) -> dict[str, Figure]:
    """Draw every figure of a run: name -> figure. The title of each that shows the flight ends with the run's note."""
    robot, log = experiment.robot, experiment.log
    with mpl.rc_context(style.RC):
        figures = {
            "position": draw_position(log),
            "states": draw_states(log),
            "stick_diagram": draw_stick_diagram(robot, log),
            "estimation": draw_estimation(log, experiment.estimates),
        }
        if log.truth is not None:
            figures |= {"aerodynamics": draw_aerodynamics(robot, log), "power": draw_power(log)}
        for figure in figures.values():
            title = f"{figure.get_suptitle()}\n{experiment.scores.note}"
            figure.suptitle(title, fontsize=style.RC["axes.titlesize"])
        return {**figures, "linkage": draw_linkage(robot.linkage)}
