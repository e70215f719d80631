"""Tune the three laws of the closed loop by one search, to the same limits.

    python benchmarks/closed_loop_search.py pd_i

No flight is flown: what is minimised is a geometric mean over the disturbances of `STEPS`, each a step or a
short push on one axis of the linear model of `aerobat_pin.control.margins`, of the rms error in the `HORIZON` after
its begin; and of the error sideways that the sensors' noise makes. So what `closed_loop_fair.py` flies is new to all
laws: its disturbances, flapping, limits of the thrusters and the air's answer. The three laws share limits (`room`),
disturbances, the gains forward, where thrusters hardly push, and the bias of the velocity.

The search is sequential quadratic programming in the logarithms of all other gains (SLSQP of SciPy), in rounds: none
goes farther than `FARTHEST`, and of its way only what is within the limits is kept; the last one gains less than
`LEAST`. It begins with the gains in `closed_loop_gains.json`, and with `--starts` others about them. The best stay
there, so it goes on where it was stopped (and a run for the observer's law replaces its kept gains), and it takes
minutes. What each start ends at is printed: where they agree there is one optimum.

Which gains are kept, and why, stands in docs/design/0015-control.md.
"""

import argparse
import copy
import json
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize

from aerobat_pin.control import Controller, loop_margins, noise_slew, wrong_plant_ms
from aerobat_pin.control.disturbance import sample_variance
from aerobat_pin.control.margins import LoopParts, Response, at
from aerobat_pin.scenario import Scenario, load_scenario

GAINS = Path(__file__).with_name("closed_loop_gains.json")
MOST_MS, LEAST_DELAY, MOST_SLEW = 2.4, 0.023, 27.0  # on wrong plants; of any axis [s]; by sensors' noise [N/s]
LATE = 0.03  # [s]: the velocity may be late, as a wrong plant, too
SINES = {9.4248: 31.5, 15.708: 8.58}  # [rad/s] 1.5 and 2.5 Hz: y [mm] that 1 m/s2 sideways may make with PD + I
SCENARIO = "paper_left_closed_loop"
PARTS = {
    "pd": ("control.feedforward=false", "control.integral=false"),
    "pd_i": ("control.feedforward=false",),
    "observer": (),
}
CAUTION = 2e-3  # of the logarithms of the limits: gains are rounded to three digits
SCATTER = 0.15  # of the logarithms of the starts: their standard deviation
FARTHEST = 0.2  # in a round, of the logarithms of gains
ROUNDS, LEAST = 12, 1e-3  # of the logarithm of the cost
MOST_GAIN = 30.0  # [1/s]: an observer that is as fast as the flaps answers what is believed wrongly of them
HORIZON = 2.0  # [s]
STEPS = (  # axis that is pushed, axis that is to stay, for how long [s], weight
    ("lateral", "lateral", np.inf, 1.0),
    ("lateral", "lateral", 0.3, 1.0),
    ("lateral", "lateral", 0.1, 1.0),
    ("roll", "lateral", np.inf, 1.0),
    ("height", "height", np.inf, 1.0),
    ("height", "height", 0.3, 1.0),
    ("pitch", "pitch", np.inf, 0.5),
    ("yaw", "yaw", np.inf, 0.5),
)
SECONDS, SAMPLES, DECAY = 12.0, 4096, 0.7  # of the numerical Laplace inversion; DECAY [1/s] takes what wraps around
S: Response = DECAY + 2j * np.pi * np.arange(SAMPLES // 2 + 1) / SECONDS
NOISE_FREQUENCIES = np.geomspace(0.3, 300.0, 400)  # [rad/s]
NOISE_WEIGHT = 1.0
TIME = np.arange(SAMPLES) * SECONDS / SAMPLES


def settings_of(law: str, gains: dict[str, Any]) -> tuple[str, ...]:
    """Return the settings of a law with these gains."""
    return (*PARTS[law], *(f"control.{key}={value}" for key, value in gains.items()))


def with_gains(scenario: Scenario, gains: dict[str, Any]) -> Scenario:
    """Return a scenario with other gains, unchecked."""
    values = {key: tuple(value) if isinstance(value, list) else value for key, value in gains.items()}
    return scenario.model_copy(update={"control": scenario.control.model_copy(update=values)})


def room(pilot: Controller, scenario: Scenario) -> np.ndarray:
    """Return logarithms of what is left to each limit, of delay, slew and Ms; -1 each where the loop is unstable."""
    margins = loop_margins(scenario).values()
    wrong = list(wrong_plant_ms(scenario).values())
    sideways = Responses(scenario, "lateral", 1j * NOISE_FREQUENCIES)
    prompt, late = (sideways.with_late_velocity(delay) for delay in (0.0, LATE))
    turns = [np.unwrap(np.angle(one)) for one in (prompt, late)]  # Nyquist: as many turns, or an unstable pole more
    turned = abs(np.subtract(*[one[-1] - one[0] for one in turns])) > np.pi
    by_integral = scenario.control.integral and not scenario.control.feedforward
    most = SINES if by_integral else {}
    if not all(one.stable for one in margins) or not np.all(np.isfinite(wrong)) or turned:
        return np.full(len(margins) + 2 + len(most) + len(wrong), -1.0)
    wrong.append(1.0 / np.min(np.abs(late)))
    other = copy.copy(pilot)
    other.scenario = scenario
    delays = [min(one.delay, 1.0) / LEAST_DELAY for one in margins]
    there = Responses(scenario, "lateral", 1j * np.array([*most])).of_side()
    sines = np.array([*most.values()]) / np.abs(1e3 * there)
    return np.log([*delays, MOST_SLEW / noise_slew(other), *(MOST_MS / ms for ms in wrong), *sines])


class Responses:
    """Transfer functions of a scenario's linear model at complex frequencies s (n,).

    On an axis of its own, s^2 x (1 + L) = d. Sideways, with Q = G A / (1 - G F A_believed), R the stiffness of roll
    times the smoothing, and w^2 (1 + a / s), 2 z w, F_y of the sideways axis, the roll phi has

        phi (s^2 + Q (C + F s^2)) = d_roll + Q R ((w^2 (1 + a / s) + 2 z w s) / s^2 + F_y) d_y / g
        s^2 y = d_y - g phi

    and likewise for the noise of a sensor in the place of d.
    """

    def __init__(self, scenario: Scenario, axis: str, s: Response) -> None:
        """Evaluate an axis: lateral, height, pitch or yaw."""
        thrusters, dt = scenario.thrusters, scenario.simulation.dt
        parts = LoopParts(scenario, "roll" if axis == "lateral" else axis, 1.0)
        lead, self.seen = at(parts.lead, s), at(parts.observer, s)
        late, told = thrusters.delay + 0.5 * dt, scenario.believed_thrusters.delay
        A = np.exp(-late * s) / (1.0 + thrusters.lag * s)
        self.Q = lead * A / (1.0 - lead * self.seen * at(parts.model_lag, s) * np.exp(-told * s))
        self.loop = s**2 + self.Q * (at(parts.law, s) + self.seen * s**2)
        self.stiff, self.damping, self.s = at(parts.stiffness, s), at(parts.damping, s) / s, s
        self.R, self.scenario = self.stiff * at(parts.smoothing, s), scenario
        side = LoopParts(scenario, "lateral", 1.0)
        self.side_stiff, self.side_damping = at(side.stiffness, s), at(side.damping, s) / s
        self.side_seen, self.g = at(side.observer, s), scenario.flight.gravity

    def of_roll(self) -> Response:
        """Return y by an angular acceleration of roll, the axis being lateral [m s2]."""
        return -self.g / self.loop / self.s**2

    def of_side(self) -> Response:
        """Return y by an acceleration sideways [s2]."""
        law = self.side_stiff / self.s**2 + self.side_damping / self.s + self.side_seen
        return (1.0 - self.Q * self.R * law / self.loop) / self.s**2

    def of_noise(self) -> list[Response]:
        """Return y by the noise of position, velocity, attitude and gyro."""
        s, beta, per_g = self.s, self.scenario.control.bias, self.R / self.g
        by_place = beta**2 / (s + beta) ** 2 if self.scenario.control.integral and beta > 0.0 else 0.0 * s
        terms = (
            -per_g * (self.side_stiff + self.side_damping * by_place * s),
            -per_g * (self.side_damping * (1.0 - by_place) + self.side_seen * s),
            self.stiff - self.R * self.side_seen,
            self.damping + self.seen * s,
        )
        return [self.g * self.Q * term / self.loop / s**2 for term in terms]

    def with_late_velocity(self, delay: float) -> Response:
        """Return 1 + L of roll where nobody knows that the velocity is late [s]."""
        s, beta, late = self.s, self.scenario.control.bias * self.scenario.control.integral, np.exp(-delay * self.s)
        used = late + (beta / (s + beta)) ** 2 * (1.0 - late)  # of the true velocity, by law and observer
        more = self.R * (self.side_damping / s + self.side_seen) * (used - 1.0)
        return (self.loop + self.Q * more) / s**2


def errors(scenario: Scenario) -> list[float]:
    """Return what is to be small: rms errors after each of `STEPS`, then that of y by the sensors' noise [m]."""
    found = []
    for pushed, kept, lasts, _ in STEPS:
        there = Responses(scenario, kept, S)
        of = {"roll": there.of_roll, "lateral": there.of_side}.get(pushed, lambda there=there: 1.0 / there.loop)
        push = (1.0 if lasts == np.inf else 1.0 - np.exp(-lasts * S)) / S
        x = np.exp(DECAY * TIME) * np.fft.irfft(of() * push) * SAMPLES / SECONDS
        found.append(float(np.sqrt(np.mean(x[TIME <= HORIZON] ** 2))))
    sensors, dt = scenario.believed_sensors, scenario.simulation.dt
    of_noise, variance = Responses(scenario, "lateral", 1j * NOISE_FREQUENCIES).of_noise(), 0.0
    for one, name in zip(of_noise, ("position", "velocity", "attitude", "gyro"), strict=True):
        density = sample_variance(getattr(sensors, name), dt)[0][0] * dt
        variance += np.trapezoid(density * np.abs(one) ** 2, NOISE_FREQUENCIES) / np.pi
    return [*found, float(np.sqrt(variance))]


def cost(scenario: Scenario) -> float:
    """Return the weighted geometric mean of the errors."""
    weights = [*(weight for *_, weight in STEPS), NOISE_WEIGHT]
    return float(np.exp(np.average(np.log(errors(scenario)), weights=weights)))


def free_gains(gains: dict[str, Any]) -> list[tuple[str, int]]:
    """Return key and place of the gains that are looked for."""
    shared = ("forward", "forward_gain", "bias")
    first = {key: int(key in ("damping", "position_integral")) for key in gains if key not in shared}
    return [(key, i) for key, begin in first.items() for i in range(begin, np.size(gains[key]))]


def changed(gains: dict[str, Any], free: list[tuple[str, int]], x: np.ndarray, digits: int = 9) -> dict[str, Any]:
    """Return gains whose free ones are multiplied by exp(x)."""
    new = {key: list(value) if isinstance(value, list) else [value] for key, value in gains.items()}
    for (key, i), one in zip(free, x, strict=True):
        new[key][i] = round(float(new[key][i] * np.exp(one)), digits)
    return {key: value if isinstance(gains[key], list) else value[0] for key, value in new.items()}


def main() -> None:
    """Search from each start."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("law", choices=list(PARTS))
    parser.add_argument("--starts", type=int, default=4)
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    law, rng = options.law, np.random.default_rng(1)
    base = load_scenario(SCENARIO, PARTS[law])
    pilot, gains = Controller(base), json.loads(GAINS.read_text())[law]["gains"]
    best, free = np.inf, free_gains(gains)
    most = np.log([MOST_GAIN / np.atleast_1d(gains[key])[i] for key, i in free])

    def at_gains(x: np.ndarray) -> Scenario:
        return with_gains(base, changed(gains, free, x))

    def left(x: np.ndarray) -> np.ndarray:
        return room(pilot, at_gains(x)) - CAUTION

    def aim(x: np.ndarray) -> float:
        return float(np.log(cost(at_gains(x))))

    for start in range(options.starts + 1):
        x = np.zeros(len(free)) if start == 0 else SCATTER * rng.standard_normal(len(free))
        for _ in range(ROUNDS):
            bounds = list(zip(x - FARTHEST, np.minimum(x + FARTHEST, most), strict=True))
            limits = {"type": "ineq", "fun": left}
            settings = {"maxiter": 20, "ftol": 1e-4, "eps": 1e-3}
            way = minimize(aim, x, method="SLSQP", bounds=bounds, constraints=limits, options=settings).x - x
            share = 1.0
            while share > 1e-3 and left(x + share * way).min() < -0.5 * CAUTION:
                share *= 0.9
            gained = aim(x) - aim(x + share * way)
            x = x + share * way
            if gained < LEAST:
                break
        tuned = changed(gains, free, x, digits=3)
        value, fits = cost(with_gains(base, tuned)), room(pilot, with_gains(base, tuned)).min() >= 0.0
        where = "within" if fits else "beyond"
        print(f"{law}, start {start}: {1e3 * value:.4f}, {where} the limits, {tuned}", flush=True)
        if fits and value < best:
            best, known = value, json.loads(GAINS.read_text())
            known[law] = {"gains": tuned, "cost": value}
            GAINS.write_text(json.dumps(known, indent=1) + "\n")


if __name__ == "__main__":
    main()
