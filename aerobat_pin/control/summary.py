"""A closed loop in numbers: its margins, from the gains alone, and how far, at which effort and how fast it flew.

Margins say, axis by axis, how much gain, delay and lag the loop bears, before any flight. Each axis is a mass or an
inertia I under thrust T and disturbance, I s^2 x = T. With the law C(s) = kp + kd s + ki / s, the observer F(s) = K /
(s + K), the lead G(s) = (1 + lag s) / (1 + lag s / lead) and the thrusters A(s) = exp(-delay s) / (1 + lag s), the
observer's answer d = F (I s^2 x - A u) and the command u = -G (C x + d) give the loop, broken at the thrusters,

    L(s) = G (C + F I s^2) / (1 - G F A_believed) . A exp(-hold s) / (I s^2)

`hold` is half a sample: a command is constant until the next one. Sideways, the robot is pushed by its own roll,
s^2 y = -g roll, and the law asks for roll_ref = (w^2 (1 + a / s) + 2 z w s) y / g, so the axis `roll` has

    C = (kp + ki / s) (1 + (w^2 (1 + a / s) + 2 z w s) / s^2) + kd s

Sensors are perfect here, and axes independent; flapping, air and limits are left out. Ms is the largest value of
1 / |1 + L|, the inverse of the Nyquist curve's distance from -1 (Astrom and Murray, Feedback Systems, section 9.3).
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aerobat_pin.aerobat import FlightLog
from aerobat_pin.control.controller import Controller, integral_shares
from aerobat_pin.control.nominal import control_of
from aerobat_pin.flight import thrusters_of
from aerobat_pin.numerics import Array, guarded
from aerobat_pin.robot import euler_angles
from aerobat_pin.scenario import Scenario

FREQUENCIES = np.geomspace(0.05, 2000.0, 20001)  # [rad/s]
Response = NDArray[np.complexfloating[Any, Any]]
Polynomials = tuple[Array, Array]  # numerator and denominator, highest power first
AXES = ("x", "y", "z", "roll", "pitch", "yaw")


@dataclass(frozen=True)
class Margins:
    """What a loop bears.

    Attributes:
        stable: whether the closed loop is stable; the other values mean little if not.
        ms: largest value of 1 / |1 + L| [-].
        phase: smallest phase margin [rad].
        delay: smallest further delay that makes the loop unstable [s]; infinite if none does.
        gain_up, gain_down: factors of the thrust between which the loop stays stable; infinite, and 0, if none ends it.
        crossover: highest frequency at which |L| is 1 [rad/s].
    """

    stable: bool
    ms: float
    phase: float
    delay: float
    gain_up: float
    gain_down: float
    crossover: float


@guarded()
def loop_margins(scenario: Scenario) -> dict[str, Margins]:
    """Return the margins of the axes roll (and sideways), pitch, yaw, height and forward of a scenario's loop.

    Raises ScenarioError if the scenario has no table `control`.
    """
    control = control_of(scenario)
    lateral = control.lateral
    feedback = control.feedforward
    by_position, by_attitude = integral_shares(control)
    found = {}
    for axis, frequency, gain in (
        ("roll", control.roll, control.moment_gain),
        ("pitch", control.pitch, control.moment_gain),
        ("yaw", control.yaw, control.moment_gain),
        ("height", control.height, control.lift_gain),
        ("forward", control.forward, control.forward_gain),
    ):
        share = by_attitude if axis in ("roll", "pitch", "yaw") else by_position
        stiffness: Polynomials = np.array([1.0, share]) * frequency**2, np.array([1.0, 0.0])
        damping: Polynomials = np.array([2.0 * control.damping * frequency, 0.0]), np.ones(1)
        if axis == "roll":
            slow = lateral**2 * by_position
            outer: Polynomials = (
                np.array([2.0 * control.damping * lateral, lateral**2, slow]),
                np.array([1.0, 0.0, 0.0, 0.0]),
            )
            stiffness = _product(stiffness, _sum((np.ones(1), np.ones(1)), outer))
        law = _sum(stiffness, damping)
        found[axis] = _margins(scenario, law, gain if feedback else 0.0)
    return found


def _margins(scenario: Scenario, law: Polynomials, gain: float) -> Margins:
    """Return the margins of an axis of unit inertia, with a law and an observer's gain [1/s], 0 for none."""
    control, real, believed = control_of(scenario), scenario.thrusters, scenario.believed_thrusters
    dt = scenario.simulation.dt if control.rate is None else 1.0 / control.rate
    lead = np.array([believed.lag, 1.0]), np.array([believed.lag / control.lead, 1.0])
    lag, model_lag = (np.ones(1), np.array([real.lag, 1.0])), (np.ones(1), np.array([believed.lag, 1.0]))
    seen = np.array([gain]), np.array([1.0, gain])
    if gain == 0.0:
        seen = np.zeros(1), np.ones(1)
    forward = _product(lead, _sum(law, _product(seen, (np.array([1.0, 0.0, 0.0]), np.ones(1)))))
    inner, inertia = _product(_product(lead, seen), model_lag), (np.ones(1), np.array([1.0, 0.0, 0.0]))
    outer = _product(_product(forward, lag), inertia)
    factor, late, told = real.factor / believed.factor, real.delay + 0.5 * dt, believed.delay

    s: Response = 1j * FREQUENCIES
    L = factor * _at(outer, s) * np.exp(-late * s) / (1.0 - _at(inner, s) * np.exp(-told * s))
    top, bottom = _product(outer, _pade(late))
    rest = _sum((np.ones(1), np.ones(1)), _product(_product((-np.ones(1), np.ones(1)), inner), _pade(told)))
    loop = np.polymul(factor * top, rest[1]), np.polymul(bottom, rest[0])
    poles = np.roots(np.polyadd(*loop))
    return _read(L, bool(np.all(poles.real < 1e-6)))


def _read(L: Response, stable: bool) -> Margins:
    """Read margins off the frequency response of a loop."""
    size, angle = np.abs(L), np.unwrap(np.angle(L))
    crossing = np.flatnonzero(np.diff(np.sign(size - 1.0)))
    turned = np.remainder(angle[crossing], 2.0 * np.pi)  # of -180 deg is pi
    phases = turned - np.pi
    delays = np.remainder(phases, 2.0 * np.pi) / FREQUENCIES[crossing]
    across = np.flatnonzero(np.diff(np.floor((angle - np.pi) / (2.0 * np.pi))))
    factors = 1.0 / size[across]
    return Margins(
        stable=stable,
        ms=float(np.max(1.0 / np.abs(1.0 + L))),
        phase=float(np.min(np.abs(phases))) if len(phases) else float("inf"),
        delay=float(np.min(delays)) if len(delays) else float("inf"),
        gain_up=float(np.min(factors[factors > 1.0], initial=np.inf)),
        gain_down=float(np.max(factors[factors < 1.0], initial=0.0)),
        crossover=float(FREQUENCIES[crossing[-1]]) if len(crossing) else 0.0,
    )


def _product(a: Polynomials, b: Polynomials) -> Polynomials:
    return np.polymul(a[0], b[0]), np.polymul(a[1], b[1])


def _sum(a: Polynomials, b: Polynomials) -> Polynomials:
    return np.polyadd(np.polymul(a[0], b[1]), np.polymul(b[0], a[1])), np.polymul(a[1], b[1])


def _at(a: Polynomials, s: Response) -> Response:
    return np.asarray(np.polyval(a[0], s) / np.polyval(a[1], s))


def _pade(delay: float) -> Polynomials:
    """Return the Pade approximation of exp(-delay s) of order three, good far beyond any crossover here."""
    terms = np.array([1.0 / 120.0, 0.1, 0.5, 1.0]) * delay ** np.array([3, 2, 1, 0])
    return terms * np.array([-1.0, 1.0, -1.0, 1.0]), terms


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
    """

    slew_rms: float
    saturated_share: float
    unrealised_rms: dict[str, float]
    seen_rms: tuple[float, ...]
    loop_p50_s: float
    loop_p99_s: float
    loop_worst_s: float
    margins: dict[str, Margins]

    def to_json(self) -> dict[str, Any]:
        """Return the entry as plain values."""
        margins = {
            axis: {key: value if np.isfinite(value) else None for key, value in asdict(found).items()}
            for axis, found in self.margins.items()
        }
        return {**asdict(self), "seen_rms": list(self.seen_rms), "margins": margins}


@guarded()
def control_summary(scenario: Scenario, log: FlightLog, pilot: Controller) -> ControlSummary:
    """Summarise how a flight was controlled."""
    assert log.truth is not None
    command, unrealised = log.measured["thruster_command"].values, log.truth["unrealised_wrench"].values
    limit = thrusters_of(pilot.morphology).limit
    steps = np.diff(command, axis=0) / scenario.simulation.dt
    times = pilot.loop_times[: len(command)]
    left = dict(zip(("lift", "roll", "pitch", "yaw"), _rms(unrealised[:, 2:]).tolist(), strict=True))
    return ControlSummary(
        slew_rms=float(np.sqrt(np.mean(steps**2))) if len(steps) else 0.0,
        saturated_share=float(np.mean((command <= 0.0) | (command >= limit))),
        unrealised_rms=left,
        seen_rms=tuple(_rms(log.truth["seen_disturbance"].values).tolist()),
        loop_p50_s=float(np.median(times)),
        loop_p99_s=float(np.percentile(times, 99.0)),
        loop_worst_s=float(np.max(times)),
        margins=loop_margins(scenario),
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
    rms = _rms(np.concatenate([q[:, :3] - course, angles], axis=1))
    return dict(zip(AXES, rms.tolist(), strict=True))


def _rms(values: Array) -> Array:
    return np.asarray(np.sqrt(np.mean(values**2, axis=0)))
