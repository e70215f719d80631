"""Everything a person looks at after a run, into its folder: figures, report, replay."""

from __future__ import annotations

from pathlib import Path

from aerobat_pin.experiments import Experiment, Progress, estimate_dataset
from aerobat_pin.visualization.figures import paper as figures
from aerobat_pin.visualization.replay.flight_replay import SLOW_MOTION, replay_flight
from aerobat_pin.visualization.report import report_html


def write_all(experiment: Experiment, folder: Path, progress: Progress | None = None) -> None:
    """Write `figures/`, `report.html` and `replay.html` into an existing folder.

    Args:
        experiment: what `experiment.run` returned.
        folder: where to.
        progress: called with the name of the stage and the share of it that is done.
    """
    note = experiment.metrics["note"]
    drawn = figures.draw_all(experiment.robot, experiment.log, experiment.estimates, note)
    (folder / "figures").mkdir()
    for i, (name, figure) in enumerate(drawn.items()):
        if progress is not None:
            progress("drawing", i / len(drawn))
        figures.save(figure, folder / "figures" / name)
    images = {name: folder / "figures" / f"{name}.png" for name in drawn}
    page = report_html(experiment, images)
    (folder / "report.html").write_text(page, encoding="utf-8")
    estimates = estimate_dataset(experiment.estimates)
    recording = replay_flight(experiment.robot, experiment.log, experiment.scenario.air, estimates, note)
    (folder / "replay.html").write_text(recording.html(SLOW_MOTION), encoding="utf-8")
