"""Observers on `observer_benchmark` under noise and wrong beliefs, one tuning for all: what the scores are."""

from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from aerobat_pin.aerobat import FORCE_POINTS, flown_robot, known_inputs, true_force
from aerobat_pin.flight import simulate
from aerobat_pin.forces import KnownInputs
from aerobat_pin.observers import OBSERVERS, Estimate
from aerobat_pin.observers.kalman.kalman import SENSOR_NOISE
from aerobat_pin.scenario import Scenario, load_scenario

SEEDS = (1, 2, 3, 4, 5)
# One tuning for every condition. A walk of 0.5 N/sqrt(s), 2.5 weights, reaches 0.15 N, the deviation of the force, in
# 90 ms, half a wingbeat. The air is believed to 20 %, the mass to 5 %; of fast errors of both, a tenth at 1 kHz.
TUNING: dict[str, dict[str, Any]] = {
    name: {"force_walk": 0.5, "known_error": {"aerodynamic": 0.2}, "mass_error": 0.05, "misfit": 0.003}
    for name in ("kalman", "smoother")
}


@dataclass(frozen=True)
class Condition:
    """What is wrong with the inputs, and how large the right wing's force is beside the left one's."""

    name: str
    noise: float = 0.0
    mass: float = 1.0
    air: float = 1.0
    share: float = 1.0


def scenario(seed: int, share: float) -> Scenario:
    """Return the benchmark with the right wing's force scaled by a share of its own."""
    given = load_scenario("observer_benchmark", [f"simulation.seed={seed}"])
    forces = []
    for force in given.unknown_force:
        if force.frame == FORCE_POINTS[1]:
            if share == 0.0:
                continue
            along = tuple(float(np.sign(share)) * x for x in force.direction)
            size = {name: abs(share) * getattr(force, name) for name in ("amplitude", "noise", "step")}
            force = force.model_copy(update={"direction": along, **size})
        forces.append(force)
    return given.model_copy(update={"unknown_force": tuple(forces)})


class Flight(NamedTuple):
    """A flight: the model, exact inputs, and the forces (m, 2, 3) with and without their noise [N]."""

    model: pin.Model
    inputs: KnownInputs
    noisy: np.ndarray
    clean: np.ndarray


@cache
def flown(seed: int, share: float) -> Flight:
    """Fly the benchmark with the right wing's force scaled by a share of its own."""
    chosen = scenario(seed, share)
    log, robot = simulate(chosen), flown_robot(chosen)
    noisy, clean = (np.stack([true_force(log, name)[i] for name in FORCE_POINTS], axis=1) for i in range(2))
    return Flight(robot.model, known_inputs(log, robot), noisy, clean)


def estimated(name: str, seed: int, condition: Condition, gain=1000.0, rows="all", tuning=TUNING) -> Estimate:
    """Run an observer on a flight whose velocities are noisy and whose belief is wrong."""
    flight = flown(seed, condition.share)
    model, inputs = flight.model.copy(), flight.inputs
    for i, inertia in enumerate(flight.model.inertias.tolist()):
        model.inertias[i] = pin.Inertia(condition.mass * inertia.mass, inertia.lever, condition.mass * inertia.inertia)
    spread = condition.noise * np.repeat(SENSOR_NOISE, [3, 3, 4])
    v = inputs.v + spread * np.random.default_rng([seed, 77]).standard_normal(inputs.v.shape)
    known = {key: values * (condition.air if key == "aerodynamic" else 1.0) for key, values in inputs.known.items()}
    observer = OBSERVERS[name](model, FORCE_POINTS, gain, rows, **tuning.get(name, {}))
    return observer.run(inputs.time, inputs.q, v, inputs.tau, known)


def worst(
    name: str, condition: Condition, gain: float = 1000.0, *, noisy: bool = False, seeds: tuple[int, ...] = SEEDS
) -> np.ndarray:
    """Return R2 (x, y, z) of the worse wing and worst seed, over the variance of the left wing's force."""
    scores = []
    for seed in seeds:
        flight = flown(seed, condition.share)
        true = flight.noisy if noisy else flight.clean
        error = estimated(name, seed, condition, gain).force - true
        scores.append(1.0 - np.mean(error**2, axis=0) / np.var(true[:, 0], axis=0))
    return np.min(np.array(scores), axis=(0, 1))
