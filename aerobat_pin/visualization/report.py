"""Write the report of a run, one self-contained HTML page: robot, scenario, scores, identifiability and figures.

The template of the page is `pages/report.html`; this module collects its values.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from markupsafe import Markup

from aerobat_pin.estimation import TABLE_HEADER
from aerobat_pin.experiments import Experiment
from aerobat_pin.observers import OBSERVERS
from aerobat_pin.scenario import Scenario, described, scenario_toml, shipped_description
from aerobat_pin.visualization.figures.linkage_svg import linkage_animation
from aerobat_pin.visualization.template import fill_template

SLOWER = 10.0  # the animated linkage turns slower than the real one by this factor


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
