"""What a loop bears, axis by axis, from the gains alone: margins, wrong plants, and what the sensors' noise costs.

Each axis is a mass or an inertia I under thrust T and disturbance, I s^2 x = T. With the law C(s) = kp + kd s + ki / s,
the observer F(s) = K / (s + K), the lead G(s) = (1 + lag s) / (1 + lag s / lead), times the smoothing S(s) = 1 / (1 + s
/ smoothing) upwards, and the thrusters A(s) = exp(-delay s) / (1 + lag s), the observer's answer d = F (I s^2 x - A u)
and the command u = -G (C x + d) give the loop, broken at the thrusters,

    L(s) = G (C + F I s^2) / (1 - G F A_believed) . A exp(-hold s) / (I s^2)

`hold` is half a sample: a command is constant until the next one. Sideways, the robot is pushed by its own roll, s^2 y
= -b g roll, b = 1 if the lift is as believed; the law asks for S (w^2 (1 + a / s) + 2 z w s) y / g, and the observer of
the sideways force sees the rest, F_y (s^2 y + g roll). So the axis `roll` has

    C = (kp + ki / s) (1 + S (b (w^2 (1 + a / s) + 2 z w s) / s^2 - F_y (1 - b))) + kd s

Sensors are perfect here, and axes independent; flapping, air, limits and the bias of the velocity, which keeps still
with perfect sensors, are left out. Ms is the largest value of 1 / |1 + L|, the inverse of the Nyquist curve's distance
from -1 (Astrom and Murray, Feedback Systems, section 9.3).

Noise of deviation s in samples dt apart makes commands u = H n, whose change from one to the next has the variance
s^2 dt / pi times the integral of |H(jw)|^2 |1 - exp(-jw dt)|^2 over w up to pi / dt.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aerobat_pin.control.controller import Controller, integral_shares
from aerobat_pin.control.disturbance import observer_gains, sample_variance
from aerobat_pin.control.nominal_wrench import control_of
from aerobat_pin.numerics import guarded
from aerobat_pin.scenario import Scenario, ThrustersSection

FREQUENCIES = np.geomspace(0.05, 2000.0, 2001)  # [rad/s]
Response = NDArray[np.complexfloating[Any, Any]]
LAW_AXES = ("forward", "lateral", "height", "roll", "pitch", "yaw")  # of the law
JUDGED_AXES = ("roll", "pitch", "yaw", "height", "forward")  # sideways, the robot is pushed by its roll
WRONG_PLANTS = {  # name -> change of the real thrusters, and b
    "lag 70 ms": ({"lag": 0.070}, 1.0),
    "thrust x0.7": ({"factor": 0.7}, 1.0),
    "thrust x1.4": ({"factor": 1.4}, 1.0),
    "bank x0.8": ({}, 0.8),
}


@dataclass(frozen=True)
class TransferFunction:
    """A ratio of polynomials of s."""

    numerator: np.poly1d
    denominator: np.poly1d

    def __mul__(self, other: TransferFunction) -> TransferFunction:
        """Connect two in series."""
        return TransferFunction(self.numerator * other.numerator, self.denominator * other.denominator)

    def __add__(self, other: TransferFunction) -> TransferFunction:
        """Connect two in parallel."""
        total = self.numerator * other.denominator + other.numerator * self.denominator
        return TransferFunction(total, self.denominator * other.denominator)

    def __call__(self, s: Response) -> Response:
        """Return the values (n,) at complex frequencies s (n,)."""
        return np.asarray(self.numerator(s) / self.denominator(s))


def ratio(numerator: ArrayLike, denominator: ArrayLike = 1.0) -> TransferFunction:
    """Return a transfer function by its coefficients, highest power first."""
    return TransferFunction(np.poly1d(numerator), np.poly1d(denominator))


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
    return {axis: _margins(scenario, axis) for axis in JUDGED_AXES}


@guarded()
def wrong_plant_ms(scenario: Scenario) -> dict[str, float]:
    """Return the largest Ms of all axes on plants that differ from the believed one, `WRONG_PLANTS`; inf: unstable.

    Raises ScenarioError if the scenario has no table `control`.
    """
    worst = {}
    for name, (changes, bank) in WRONG_PLANTS.items():
        changes = {
            key: value * scenario.thrusters.factor if key == "factor" else value for key, value in changes.items()
        }
        thrusters = scenario.thrusters.model_copy(update=changes)
        margins = [_margins(scenario, axis, bank, thrusters) for axis in JUDGED_AXES]
        worst[name] = max(margin.ms if margin.stable else float("inf") for margin in margins)
    return worst


@guarded()
def noise_slew(pilot: Controller) -> float:
    """Return the rms rate of change of a controller's commands that the believed noise of its sensors makes [N/s].

    It is taken over all thrusters, with the observer in full, and without limits and without the steering.
    """
    scenario, nominal, dt = pilot.scenario, pilot.nominal, pilot.dt
    sensors = scenario.believed_sensors
    place, speed, angle, rate = (
        float(np.mean(sample_variance(sensor, dt)[0]))
        for sensor in (sensors.position, sensors.velocity, sensors.attitude, sensors.gyro)
    )
    w = np.linspace(0.0, np.pi / dt, 4001)[1:]
    s: Response = 1j * w
    changes = np.abs(1.0 - np.exp(-s * dt)) ** 2
    inertia, variance = np.append([nominal.mass] * 3, nominal.inertia), np.zeros(6)
    for i, axis in enumerate(LAW_AXES):
        parts = LoopParts(scenario, axis, 1.0)
        answer = parts.lead(s) / (1.0 - (parts.lead * parts.observer)(s) * parts.model_lag(s))
        by_place = answer * parts.stiffness(s)
        by_rate = answer * (parts.damping(s) / s + parts.observer(s) * s)
        first, second = (place, speed) if i < 3 else (angle, rate)
        spread = first * np.abs(by_place) ** 2 + second * np.abs(by_rate) ** 2
        if axis == "roll":  # the way over the bank
            bank = by_place * parts.smoothing(s) / scenario.flight.gravity
            side = LoopParts(scenario, "lateral", 1.0)
            spread += place * np.abs(bank * side.stiffness(s)) ** 2
            spread += speed * np.abs(bank * (side.damping(s) / s + side.observer(s) * s)) ** 2
        if axis != "lateral":
            variance[i] = inertia[i] ** 2 * np.mean(spread * changes)
    spread_of_thrusts = pilot.allocation.free**2 @ variance
    return float(np.sqrt(np.mean(spread_of_thrusts)) / dt)


class LoopParts:
    """The transfer functions of an axis of unit inertia; b is how much of its lift the robot has when it banks."""

    def __init__(self, scenario: Scenario, axis: str, b: float) -> None:
        control, believed = control_of(scenario), scenario.believed_thrusters
        i = LAW_AXES.index(axis)
        self.smoothing = ratio(1.0)
        if control.smoothing > 0.0:
            self.smoothing = ratio(1.0, [1.0 / control.smoothing, 1.0])
        self.lead = ratio([believed.lag, 1.0], [believed.lag / control.lead, 1.0])
        if axis == "height":
            self.lead *= self.smoothing
        self.model_lag = ratio(1.0, [believed.lag, 1.0])
        gain = float(observer_gains(control)[i]) if control.feedforward else 0.0
        self.observer = ratio(gain, [1.0, gain]) if gain > 0.0 else ratio(0.0)
        w, z = control.frequencies[i], float(np.broadcast_to(control.damping, 6)[i])
        share = float(integral_shares(control)[i])
        self.stiffness = ratio([w**2, share * w**2], [1.0, 0.0]) if share != 0.0 else ratio(w**2)
        self.damping = ratio([2.0 * z * w, 0.0])
        self.law = self.stiffness + self.damping
        if axis == "roll":
            side = LoopParts(scenario, "lateral", 1.0)
            way = ratio(b, [1.0, 0.0, 0.0]) * side.law
            if b != 1.0:
                way += ratio(b - 1.0) * side.observer
            self.law = self.stiffness * (ratio(1.0) + self.smoothing * way) + self.damping


def _margins(scenario: Scenario, axis: str, b: float = 1.0, real: ThrustersSection | None = None) -> Margins:
    """Return the margins of an axis; b as in `LoopParts`; with other real thrusters than the scenario's, if given."""
    control, real, believed = control_of(scenario), real or scenario.thrusters, scenario.believed_thrusters
    parts = LoopParts(scenario, axis, b)
    dt = scenario.simulation.dt if control.rate is None else 1.0 / control.rate
    forward = parts.lead * (parts.law + parts.observer * ratio([1.0, 0.0, 0.0]))
    inner = parts.lead * parts.observer * parts.model_lag
    outer = forward * ratio(1.0, [real.lag, 1.0]) * ratio(1.0, [1.0, 0.0, 0.0])  # lag, and a unit of inertia
    factor, late, assumed = real.factor / believed.factor, real.delay + 0.5 * dt, believed.delay

    s: Response = 1j * FREQUENCIES
    L = factor * outer(s) * np.exp(-late * s) / (1.0 - inner(s) * np.exp(-assumed * s))
    opened, closed = outer * _pade(late), ratio(1.0) + ratio([-1.0]) * inner * _pade(assumed)
    poles = (factor * opened.numerator * closed.denominator + opened.denominator * closed.numerator).roots
    return _margins_of(L, bool(np.all(poles.real < 1e-6)))


def _margins_of(L: Response, stable: bool) -> Margins:
    """Read margins off the frequency response of a loop."""
    size, angle = np.abs(L), np.unwrap(np.angle(L))
    crossing = np.flatnonzero(np.diff(np.sign(size - 1.0)))
    steps = np.log(size[crossing + 1]) - np.log(size[crossing])
    share = -np.log(size[crossing]) / steps  # of the way to the next frequency, where |L| is 1
    at_one = FREQUENCIES[crossing] * (FREQUENCIES[crossing + 1] / FREQUENCIES[crossing]) ** share
    turned = np.remainder(angle[crossing] + share * np.diff(angle)[crossing], 2.0 * np.pi)  # of -180 deg is pi
    phases = turned - np.pi
    delays = np.remainder(phases, 2.0 * np.pi) / at_one
    across = np.flatnonzero(np.diff(np.floor((angle - np.pi) / (2.0 * np.pi))))
    factors = 1.0 / size[across]
    return Margins(
        stable=stable,
        ms=float(np.max(1.0 / np.abs(1.0 + L))),
        phase=float(np.min(np.abs(phases))) if len(phases) else float("inf"),
        delay=float(np.min(delays)) if len(delays) else float("inf"),
        gain_up=float(np.min(factors[factors > 1.0], initial=np.inf)),
        gain_down=float(np.max(factors[factors < 1.0], initial=0.0)),
        crossover=float(at_one[-1]) if len(crossing) else 0.0,
    )


def _pade(delay: float) -> TransferFunction:
    """Return the Pade approximation of exp(-delay s) of order three, good far beyond any crossover here."""
    terms = np.array([1.0 / 120.0, 0.1, 0.5, 1.0]) * delay ** np.array([3, 2, 1, 0])
    return ratio(terms * np.array([-1.0, 1.0, -1.0, 1.0]), terms)
