"""How well a closed loop kept its course, in lines to read, beside what PD alone would have done."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from aerobat_pin.aerobat import FlightLog
from aerobat_pin.control import Controller, course_rms
from aerobat_pin.errors import SimulationError
from aerobat_pin.estimation import quantity
from aerobat_pin.experiments.experiment import Experiment, Progress
from aerobat_pin.flight import simulate
from aerobat_pin.numerics import guarded
from aerobat_pin.robot import believed_robot

PD_ALONE = {"integral": False, "feedforward": False}


@guarded()
def beside_pd(made: Experiment, progress: Progress | None = None) -> Experiment:
    """Return an experiment that says how far off course its robot was, and how far PD alone would have been.

    The same flight is flown once more, in the same disturbance and with the same gains, without integral and observer;
    `metrics.json` has its errors as `pd_rms` under `control`. A flight that no controller flew is returned as it is.

    Args:
        made: the experiment.
        progress: called with the name of the stage and the share of the stage that is done.
    """
    section, flight, control = made.scenario.control, made.flight, made.control
    if section is None or flight is None or flight.rms is None or control is None:
        return made
    lines, alone = [f"off its course by {_off(flight.rms)} rms"], None
    if section.integral or section.feedforward:
        scenario = made.scenario.model_copy(update={"control": section.model_copy(update=PD_ALONE)})
        show = None if progress is None else lambda share: progress("flying with PD alone", share)
        try:
            with warnings.catch_warnings(action="ignore", category=UserWarning):  # the flight itself has said them
                pilot = Controller(scenario, believed_robot(scenario))
            log, ended = simulate(scenario, show, robot=made.robot, pilot=pilot), ""
        except SimulationError as error:
            if not isinstance(error.kept, FlightLog):
                return made
            log, ended = error.kept, f" until it is lost at {error.kept.time[-1]:.2f} s"
        alone = course_rms(scenario, log)
        lines.append(f"PD alone, in the same disturbance: {_off(alone)} rms{ended}")
    control = {**control, "pd_rms": alone}
    lines.append(_effort(control))
    scores = replace(made.scores, notes=(*made.scores.notes, *lines), more={**made.scores.more, "control": control})
    return replace(made, scores=scores, control=control)


def _off(rms: Mapping[str, float]) -> str:
    """Return errors about the course in words: the place's as one, and the attitude's."""
    place, attitude = (
        float(np.linalg.norm([rms[axis] for axis in axes])) for axes in ("xyz", ("roll", "pitch", "yaw"))
    )
    return f"{quantity(place, 'm')} and {np.degrees(attitude):.2g} deg"


def _effort(control: Mapping[str, Any]) -> str:
    """Return the commands at a limit, and the margins of the axis that has least, in words."""
    said = f"{100.0 * control['saturated_share']:.2g} % of the commands at a limit"
    margins = {axis: one for axis, one in control["margins"].items() if one["stable"]}
    if len(margins) < len(control["margins"]):
        return f"{said}; unstable by its gains: {', '.join(control['margins'].keys() - margins.keys())}"
    largest = max(margins, key=lambda axis: margins[axis]["ms"])
    delays = {axis: one["delay"] for axis, one in margins.items() if one["delay"] is not None}
    least = min(delays, key=lambda axis: delays[axis], default="")
    delay = f", {1e3 * delays[least]:.0f} ms more delay ({least})" if delays else ""
    return f"{said}; least margins: Ms {margins[largest]['ms']:.2f} ({largest}){delay}"
