"""Run one experiment: simulate a scenario or take a recorded flight, estimate the forces, and score them."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from aerobat_pin.aerobat import (
    Aerobat,
    FlightLog,
    believed_robot,
    check_names,
    estimate_flight,
    flown_robot,
    true_events,
)
from aerobat_pin.control import FAILED, Controller, control_summary, course_rms
from aerobat_pin.errors import SimulationError
from aerobat_pin.estimation import Calibration, Finding, Result
from aerobat_pin.experiments.flight_summary import FlightSummary, flight_note, flight_summary, recorded_note
from aerobat_pin.flight import Simulator, log_with_motion, simulate
from aerobat_pin.forces import quantity
from aerobat_pin.numerics import ShownInNotebooks, guarded
from aerobat_pin.observers import Estimate
from aerobat_pin.scenario import Scenario, changed_keys, changes_text

NOISE_ADVICE = "a smaller observers.gain follows the sensors' noise less"
KEY_OF_MAP = re.compile(r"in a map|in the map|order = |joints\.|use\.free|log\.clock")
NO_MAP = Finding(
    "keys of a map", "note", "logs of Aerobat have none: shift, turn, scale or exchange the columns of the log instead"
)
Progress = Callable[[str, float], None]  # called with the name of the stage and the share of the stage that is done
PD_ALONE = {"integral": False, "feedforward": False}


@dataclass(frozen=True, repr=False)
class Experiment(ShownInNotebooks):
    """The results of one flight of Aerobat, simulated or recorded.

    Attributes:
        scenario: the simulated scenario; for a recorded flight, what is assumed about it (robot, air, observers).
        robot: the robot that flew; for a recorded flight, the assumed robot.
        log: the flight log.
        scores: forces and how well they match the true ones; `print` shows it as a table.
        note: a line about the flight.
        drawn: the log that figures and replay show: `log`, or for raw samples one with the true or smoothed motion.
        calibration: what free flights had shown about the belief; None without a calibration.
        flight: summary of a simulated flight; None for a recorded one.
        control: how the flight was controlled, as plain values; None if no controller flew it.
    """

    scenario: Scenario
    robot: Aerobat
    log: FlightLog
    scores: Result
    note: str
    drawn: FlightLog
    calibration: Calibration | None = None
    flight: FlightSummary | None = None
    control: Mapping[str, Any] | None = None

    @property
    def estimates(self) -> dict[str, Estimate]:
        """Observer -> estimate."""
        return self.scores.estimates

    @cached_property
    def metrics(self) -> dict[str, Any]:
        """The scores as plain values, as written to `metrics.json`."""
        return self.scores.metrics()

    @property
    def failed(self) -> str:
        """What the controller said of a flight on which it was LOST or UNSTABLE; empty of all others."""
        control = self.control
        return str(control["state_line"]) if control is not None and control["state"] in FAILED else ""

    def __repr__(self) -> str:
        robot = f"{self.robot.model.name}, {1e3 * self.robot.mass:.1f} g"
        time = self.log.time
        return (
            f"Experiment {self.scores.title}\n"
            f"  robot {robot}; {time[-1] - time[0]:.3g} s, {len(time)} samples; observers {', '.join(self.estimates)}"
        )


@guarded(simulator="free")
def run(
    scenario: Scenario,
    progress: Progress | None = None,
    robots: tuple[Aerobat, Aerobat] | None = None,
    calibration: Calibration | None = None,
    simulator: Simulator | None = None,
) -> Experiment:
    """Simulate a scenario, estimate the forces and score the estimates; no file is written.

    Args:
        scenario: the scenario to run.
        progress: called with the name of the stage and the share of the stage that is done.
        robots: the robot that flies and the robot that the observers assume; loaded from the scenario when omitted.
        calibration: what free flights showed about the scenario's belief.
        simulator: what integrates the motion in the plant's place, such as `aerobat_pin.flight.MujocoRobot`.

    Raises:
        SimulationError: the flight diverged; its attribute `kept` is the experiment until then.
        AerobatError: the scenario cannot be run, for instance because it names an unknown observer.
    """
    check_names(scenario.observers.names)
    if robots is None:
        flies = flown_robot(scenario)
        robots = flies, flies if scenario.believed_robot == scenario.robot else believed_robot(scenario)
    robot, believed = robots
    pilot = None if scenario.control is None else Controller(scenario, believed)

    def judged(log: FlightLog) -> Experiment:
        experiment = _estimated(log, believed, scenario, flight_note(scenario, robot, log), progress, calibration)
        flight, control, seed = flight_summary(log, robot.mass), None, scenario.simulation.seed
        said: list[Finding] = []
        if pilot is not None:
            said = [Finding("before the flight", "warning", line) for line in pilot.warnings]
            flight = replace(flight, rms=course_rms(scenario, log))
            control = control_summary(scenario, log, pilot).to_json()
            said += [Finding("control", "warning", control["state_line"])] * (control["state"] != "OK")
        changed = changed_keys(scenario)
        more = {**experiment.scores.more, "seed": seed, "changed": changed, "log": None, "flight": flight.to_json()}
        scores = replace(
            experiment.scores,
            title=f"{scenario.name}, seed {seed}: {experiment.note}; motor torque {scenario.observers.torque}",
            changes=changes_text(scenario.name, changed),
            advice=NOISE_ADVICE if scenario.sensors.sampled and not scenario.sensors.raw else "",
            findings=(*said, *experiment.scores.findings),
            more=more if control is None else {**more, "control": control},
        )
        return replace(experiment, robot=robot, scores=scores, flight=flight, control=control)

    try:
        flying = None if progress is None else partial(progress, "flying")
        return judged(simulate(scenario, flying, robot=robot, pilot=pilot, simulator=simulator))
    except SimulationError as error:
        if isinstance(error.kept, FlightLog):
            error.kept = judged(error.kept)
        raise


@guarded()
def run_recorded(
    log: FlightLog, belief: Scenario, progress: Progress | None = None, calibration: Calibration | None = None
) -> Experiment:
    """Estimate the forces on a recorded flight, and score the estimates if the log contains the true forces.

    Args:
        log: the recorded flight.
        belief: what is assumed about the flight (robot, air, observers), as `estimation.belief_about` returns it.
        progress: as in `run`.
        calibration: what free flights showed about this belief.

    Raises:
        AerobatError: the log or the belief lacks something that the observers need.
    """
    robot = believed_robot(belief)
    experiment = _estimated(log, robot, belief, recorded_note(log, robot), progress, calibration)
    findings = experiment.scores.findings
    if any(finding.warns and KEY_OF_MAP.search(finding.text) for finding in findings):
        findings = (*findings, NO_MAP)
    return replace(experiment, scores=replace(experiment.scores, findings=findings))


def _estimated(
    log: FlightLog,
    believed: Aerobat,
    belief: Scenario,
    note: str,
    progress: Progress | None,
    calibration: Calibration | None,
) -> Experiment:
    """Run the observers of a scenario or belief on a log, and score their estimates."""
    names = belief.observers.names

    def show(share: float) -> None:
        """Show the share of all observers that is done, each as a stage of its own."""
        at = min(int(share * len(names) + 1e-9), len(names) - 1)
        if progress is not None:
            progress(f"estimating with {names[at]}", share * len(names) - at)

    result = estimate_flight(log, believed, belief, progress and show, calibration)
    scores = replace(
        result,
        name=belief.name,
        title=f"{belief.name}: {note}; motor torque {belief.observers.torque}",
        events=tuple(true_events(log)),
        more={"log": belief.name, "torque": belief.observers.torque, "note": note},
    )
    if result.smoothed is not None:  # motion and crank angle were found with the forces
        block, crank = result.smoothed.block, result.smoothed.block.extra["crank"][0]
    else:
        assert result.record is not None
        block, crank = result.record.block(*result.record.parts[0]), None
    drawn = log_with_motion(log, block.q, block.v, crank)
    return Experiment(belief, believed, log, scores, note, drawn, calibration)


@guarded()
def beside_pd(experiment: Experiment, progress: Progress | None = None) -> Experiment:
    """Return an experiment that says how far off course its robot was, and how far PD alone would have been.

    The same flight is flown once more, in the same disturbance and with the same gains, without integral and observer;
    `metrics.json` has its errors as `pd_rms` under `control`. A flight that no controller flew is returned as it is.
    """
    section, flight, control = experiment.scenario.control, experiment.flight, experiment.control
    if section is None or flight is None or flight.rms is None or control is None:
        return experiment
    lines, alone = [f"off its course by {_off(flight.rms)} rms"], None
    if section.integral or section.feedforward:
        scenario = experiment.scenario.model_copy(update={"control": section.model_copy(update=PD_ALONE)})
        show = None if progress is None else lambda share: progress("flying with PD alone", share)
        try:
            with warnings.catch_warnings(action="ignore", category=UserWarning):  # the flight itself has said them
                pilot = Controller(scenario, believed_robot(scenario))
            log, ended = simulate(scenario, show, robot=experiment.robot, pilot=pilot), ""
        except SimulationError as error:
            if not isinstance(error.kept, FlightLog):
                return experiment
            log, ended = error.kept, f" until it is lost at {error.kept.time[-1]:.2f} s"
        alone = course_rms(scenario, log)
        lines.append(f"PD alone, in the same disturbance: {_off(alone)} rms{ended}")
    control = {**control, "pd_rms": alone}
    lines.append(_effort(control))
    scores = replace(
        experiment.scores, notes=(*experiment.scores.notes, *lines), more={**experiment.scores.more, "control": control}
    )
    return replace(experiment, scores=scores, control=control)


def _off(rms: Mapping[str, float]) -> str:
    """Return errors about the course in words: the place's as one, and the attitude's."""
    place, attitude = (
        float(np.linalg.norm([rms[axis] for axis in axes])) for axes in ("xyz", ("roll", "pitch", "yaw"))
    )
    return f"{quantity(place, 'm')} and {np.degrees(attitude):.2g} deg"


def _effort(control: Mapping[str, Any]) -> str:
    """Return the commands at a limit, and the margins of the axis that has least, in words."""
    said = f"{100.0 * control['saturated_share']:.2g} % of the commands at a limit"
    margins = {axis: margin for axis, margin in control["margins"].items() if margin["stable"]}
    if unstable := [axis for axis in control["margins"] if axis not in margins]:
        return f"{said}; unstable by its gains: {', '.join(unstable)}"
    largest = max(margins, key=lambda axis: margins[axis]["ms"])
    delays = {axis: margin["delay"] for axis, margin in margins.items() if margin["delay"] is not None}
    least = min(delays, key=lambda axis: delays[axis], default="")
    delay = f", {1e3 * delays[least]:.0f} ms more delay ({least})" if delays else ""
    return f"{said}; least margins: Ms {margins[largest]['ms']:.2f} ({largest}){delay}"
