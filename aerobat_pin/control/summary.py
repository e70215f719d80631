"""A closed loop in numbers: its margins, from the gains alone, and how far, at which effort and how fast it flew."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from aerobat_pin.aerobat import FlightLog
from aerobat_pin.control.controller import Controller
from aerobat_pin.control.margins import Margins, loop_margins, noise_slew, wrong_plant_ms
from aerobat_pin.control.monitor import AXES, LoopState
from aerobat_pin.control.nominal_wrench import control_of
from aerobat_pin.flight import thrusters_of
from aerobat_pin.forces import column_rms
from aerobat_pin.numerics import guarded
from aerobat_pin.observers import euler_angles
from aerobat_pin.scenario import Scenario


@dataclass(frozen=True)
class ControlSummary:
    """The entry `control` of `metrics.json`.

    Attributes:
        slew_rms: root mean square of the commands' rate of change, over time and thrusters [N/s].
        saturated_share: share of all commands that are at a limit.
        unrealised_rms: of what the limits left of the wanted wrench: lift [N]; roll, pitch, yaw [N m].
        seen_rms: of the disturbance that the controller saw: three forces [N], three moments [N m], body axes.
        loop_p50_s, loop_p99_s: processor time from a sample to its command [s], median and 99th percentile.
        loop_worst_s: the longest [s].
        margins: axis -> its margins, computed from the gains; infinite ones are None.
        wrong_plant_ms: wrong plant -> largest Ms of all axes on it, see `control.wrong_plant_ms`; None: unstable.
        noise_slew: what the sensors' noise alone makes of `slew_rms`, computed from the gains [N/s].
        said: what the controller said of its flight; written as `state`, `state_since`, `state_line`, `unused_samples`.
    """

    slew_rms: float
    saturated_share: float
    unrealised_rms: dict[str, float]
    seen_rms: tuple[float, ...]
    loop_p50_s: float
    loop_p99_s: float
    loop_worst_s: float
    margins: dict[str, Margins]
    wrong_plant_ms: dict[str, float]
    noise_slew: float
    said: LoopState

    def to_json(self) -> dict[str, Any]:
        """Return the entry as plain values."""
        margins = {
            axis: {key: value if np.isfinite(value) else None for key, value in asdict(margin).items()}
            for axis, margin in self.margins.items()
        }
        said = self.said
        state = {"state": said.word, "state_since": said.since, "state_line": said.line, "unused_samples": said.unused}
        wrong = {name: ms if np.isfinite(ms) else None for name, ms in self.wrong_plant_ms.items()}
        values = {key: value for key, value in asdict(self).items() if key != "said"}
        return {**values, "seen_rms": list(self.seen_rms), "margins": margins, "wrong_plant_ms": wrong, **state}


@guarded()
def control_summary(scenario: Scenario, log: FlightLog, pilot: Controller) -> ControlSummary:
    """Summarise how a flight was controlled."""
    assert log.truth is not None
    command, unrealised = log.measured["thruster_command"].values, log.truth["unrealised_wrench"].values
    limit = thrusters_of(pilot.morphology).limit
    steps = np.diff(command, axis=0) / scenario.simulation.dt
    times = pilot.loop_times[: len(command)]
    unrealised_rms = dict(zip(("lift", "roll", "pitch", "yaw"), column_rms(unrealised[:, 2:]).tolist(), strict=True))
    return ControlSummary(
        slew_rms=float(np.sqrt(np.mean(steps**2))) if len(steps) else 0.0,
        saturated_share=float(np.mean((command <= 0.0) | (command >= limit))),
        unrealised_rms=unrealised_rms,
        seen_rms=tuple(column_rms(log.truth["seen_disturbance"].values).tolist()),
        loop_p50_s=float(np.median(times)),
        loop_p99_s=float(np.percentile(times, 99.0)),
        loop_worst_s=float(np.max(times)),
        margins=loop_margins(scenario),
        wrong_plant_ms=wrong_plant_ms(scenario),
        noise_slew=noise_slew(pilot),
        said=pilot.state,
    )


@guarded()
def course_rms(scenario: Scenario, log: FlightLog) -> dict[str, float]:
    """Return the root mean square of a flight's errors about its course: x, y, z [m], roll, pitch, yaw [rad].

    The course is that of a controller: start, velocity and heading of the table `flight`, the pitch of `control`, no
    roll. Pitch is positive nose up. The true motion counts, where a log has it. Raises ScenarioError if the scenario
    has no such table.
    """
    control = control_of(scenario)
    source = log.measured if log.truth is None or "q" not in log.truth else log.truth
    q, flight = source["q"].values, scenario.flight
    course = np.array(flight.position) + log.time[:, None] * np.array(flight.velocity)
    angles = euler_angles(q) - np.radians([0.0, control.pitch_deg, flight.yaw_deg])
    angles = np.remainder(angles + np.pi, 2.0 * np.pi) - np.pi
    rms = column_rms(np.concatenate([q[:, :3] - course, angles], axis=1))
    return dict(zip(AXES, rms.tolist(), strict=True))
