"""Write the figures, the report and the replay of a result.

The report is one self-contained HTML page; its template is `pages/report.html`.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import matplotlib as mpl
import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure

from aerobat_pin.estimation import Result, versions
from aerobat_pin.experiments import Experiment, Progress, map_toml, read_map
from aerobat_pin.forces import one_unit
from aerobat_pin.observers import OBSERVERS
from aerobat_pin.records import TrueEvent
from aerobat_pin.scenario import Scenario, described, scenario_toml, shipped_description
from aerobat_pin.visualization import style
from aerobat_pin.visualization.figures.estimation import draw_estimation
from aerobat_pin.visualization.figures.flight import draw_flight
from aerobat_pin.visualization.figures.linkage import draw_linkage, linkage_animation
from aerobat_pin.visualization.figures.record import draw_contacts, draw_motion, draw_unexplained, unexplained_limit
from aerobat_pin.visualization.replay.flight_replay import replay_result
from aerobat_pin.visualization.template import fill_template

SLOWER = 10.0  # the animated linkage turns slower than the real one by this factor


def write_figures_and_pages(outcome: Experiment | Result, folder: Path, progress: Progress | None = None) -> None:
    """Write `figures/`, `report.html` and `replay.html` into an existing folder.

    Progress is called with the name of the stage and the share of the stage that is done.
    """
    show = progress or (lambda stage, share: None)
    show("laying out figures", 0.0)
    figures = draw_all(outcome)
    (folder / "figures").mkdir()
    style.save_figures(figures, folder / "figures", lambda share: show("drawing figures", share))
    report = report_html(outcome, {name: folder / "figures" / f"{name}.png" for name in figures})
    (folder / "report.html").write_text(report, encoding="utf-8")
    show("writing the replay", 0.0)
    recording = replay_result(outcome)
    recording.report = "report.html"
    (folder / "replay.html").write_text(recording.html(recording.rate), encoding="utf-8")


def draw_all(outcome: Experiment | Result) -> dict[str, Figure]:
    """Draw all figures: name -> figure. The note about a flight of Aerobat is added to the titles of its figures."""
    with mpl.rc_context(style.RC):
        if isinstance(outcome, Result):
            figures = {"estimation": draw_estimation(outcome)}
            if outcome.record is not None:
                figures["motion"] = draw_motion(outcome.record)
            if any(len(stance.onset) for stances in outcome.stances.values() for stance in stances):
                figures["contacts"] = draw_contacts(outcome)
            return {**figures, **_unexplained(outcome)}
        figures = {
            **draw_flight(outcome.robot, outcome.scenario, outcome.drawn),
            "estimation": draw_estimation(outcome.scores, _gusts(outcome.scenario)),
            **_unexplained(outcome.scores),
        }
        for figure in figures.values():
            style.title_of(figure, f"{figure.get_suptitle()}\n{outcome.note}\n{outcome.scores.changes}")
        return {**figures, "linkage": draw_linkage(outcome.robot.linkage)}


def _unexplained(result: Result) -> dict[str, Figure]:
    """Return the figure of what no force explains, if there is any redundancy."""
    redundant = any(estimate.redundancy.redundant > 0 for estimate in result.stored.values())
    return {"unexplained": draw_unexplained(result)} if redundant else {}


def _gusts(scenario: Scenario) -> list[TrueEvent]:
    """Return the gust of a scenario as an event of its figures; it acts at no single frame."""
    gust = scenario.air.gust
    if gust is None or not any(gust.amplitude):
        return []
    return [TrueEvent("gust", (), gust.start, gust.start + gust.duration)]


def report_html(outcome: Experiment | Result, images: Mapping[str, Path]) -> str:
    """Return the report as HTML; pictures, figure name -> PNG file, are embedded into the page."""
    flown = outcome if isinstance(outcome, Experiment) else None
    result = outcome.scores if isinstance(outcome, Experiment) else outcome
    linkage = None
    if flown is not None and flown.flight is not None and flown.scenario.crank.frequency > 0.0:
        linkage = Markup(linkage_animation(flown.robot.linkage, SLOWER / flown.scenario.crank.frequency))
    scenario = None if flown is None else described(flown.scenario)
    judged = [scores.redundancy for scores in result.observers.values()]
    return fill_template(
        "report.html",
        result=result,
        flown=flown,
        scenario=scenario,
        shipped="" if scenario is None else shipped_description(scenario.name),
        repeated=map_toml(result) if scenario is None else scenario_toml(scenario),
        shape="" if scenario is None else Path(scenario.robot.morphology).stem,
        gains=_names_and_gains(outcome),
        say=one_unit(size for check in judged for size in (check.rms, check.sensors, check.belief, check.allowed)),
        words={name: (OBSERVERS[name].__doc__ or "").split("\n")[0] for name in result.stored},
        versions=versions(),
        degrees=np.degrees,
        images=images,
        limit=unexplained_limit(result, next(iter(result.stored)))[1],
        linkage=linkage,
        slower=SLOWER,
    )


def _names_and_gains(outcome: Experiment | Result) -> str:
    """Return the names of the observers, each with its gain if it has one."""
    section = outcome.scenario.observers if isinstance(outcome, Experiment) else read_map(outcome).observer
    texts = []
    for name in section.names:
        with_gain = name not in ("kalman", "smoother") or section.settings(name).get("force_walk") == "gain"
        texts.append(f"{name} (gain {section.gain:g} 1/s)" if with_gain else name)
    return ", ".join(texts)
