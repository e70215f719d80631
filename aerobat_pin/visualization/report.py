"""One self-contained HTML page about a run: what flew, how well the forces were estimated, and what could be known."""

from __future__ import annotations

import base64
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from markupsafe import Markup

from aerobat_pin.estimation import TABLE_HEADER
from aerobat_pin.experiments import Experiment
from aerobat_pin.scenario import scenario_toml
from aerobat_pin.visualization.figures.linkage_svg import linkage_animation
from aerobat_pin.visualization.template import fill

TORQUE_MEANINGS = {
    "measured": "all joint torques",
    "modelled": "of the motion alone, without the unknown force",
    "motor_only": "the crank's torque alone",
    "none": "unknown",
}
SLOWER = 10.0  # the animated linkage turns so much slower than it flies


def report_html(experiment: Experiment, images: Mapping[str, Path]) -> str:
    """Return the page.

    Args:
        experiment: what was run.
        images: figure name -> PNG file, embedded into the page.
    """
    scenario, scores, frequency = experiment.scenario, experiment.scores, experiment.scenario.crank.frequency
    return fill(
        "report.html",
        scenario=scenario,
        scores=scores,
        setup=list(_setup(experiment)),
        table_header=TABLE_HEADER,
        knowledge=list(_knowledge(experiment)),
        inputs=[
            (name, f"{source}: {TORQUE_MEANINGS[source]}" if name == "motor_torque" else source)
            for name, source in scores.inputs.items()
        ],
        flight=list(_flight(experiment)),
        linkage=Markup(linkage_animation(experiment.robot.linkage, SLOWER / frequency)) if frequency > 0.0 else None,
        slower=f"{SLOWER:g}",
        toml=scenario_toml(scenario),
        images={name: base64.b64encode(file.read_bytes()).decode("ascii") for name, file in images.items()},
    )


def _setup(experiment: Experiment) -> Iterator[tuple[str, str]]:
    """Give what was run: label and text."""
    scenario = experiment.scenario
    changed = " with changes" if scenario.robot.changes else ""
    wind = f", wind {scenario.air.wind} m/s" if any(scenario.air.wind) else ""
    yield "robot", f"{Path(scenario.robot.morphology).stem}{changed}, {1e3 * experiment.robot.mass:.1f} g"
    yield "crank", f"{scenario.crank.drive}, {scenario.crank.frequency:g} Hz"
    yield "air", f"{scenario.air.model.replace('_', ' ')}, added mass times {scenario.air.added_mass:g}{wind}"
    yield "flight", f"{scenario.simulation.duration:g} s in steps of {1e3 * scenario.simulation.dt:g} ms"
    yield "observers", f"{', '.join(scenario.observers.names)}; gain {scenario.observers.gain:g} 1/s"


def _knowledge(experiment: Experiment) -> Iterator[tuple[str, ...]]:
    """Give per observer how many force components its equations tell apart: cells of a row."""
    for name, estimate in experiment.estimates.items():
        found, condition = estimate.identifiability, experiment.scores.observers[name].condition
        values = ", ".join(f"{value:.3g}" for value in found.singular_values)
        rank = f"{found.rank} of {len(found.components)}"
        yield name, rank, "infinite" if condition is None else f"{condition:.0f}", values


def _flight(experiment: Experiment) -> Iterator[tuple[str, str]]:
    """Give what the flight was like: label and text."""
    flight = experiment.scores.flight
    if flight is None:
        return
    yield "position at the end", ", ".join(f"{x:.3f}" for x in flight.position_end) + " m"
    yield "height", "{:.3f} .. {:.3f} m".format(*flight.z_range)
    for name, angles in (("roll", flight.roll_range), ("pitch", flight.pitch_range), ("yaw", flight.yaw_range)):
        yield name, "{:.2f} .. {:.2f} deg".format(*np.degrees(angles))
    for source, share in (("hold", flight.thrusters_lift_over_weight), ("air", flight.aerodynamic_lift_over_weight)):
        if share is not None:
            yield f"mean lift of the {source}", f"{100 * share:.0f} % of the weight"
    if flight.motor_power_mean is not None:
        yield "mean motor power", f"{flight.motor_power_mean:.2f} W"
