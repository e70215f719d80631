"""Flights of `paper` seen by observers whose belief is wrong in one named way, and what that costs."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from aerobat_pin.aerobat import FORCE_POINTS, Aerobat, FlightLog, believed_robot, known_inputs, true_force
from aerobat_pin.flight import simulate
from aerobat_pin.forces import KnownInputs
from aerobat_pin.observers import OBSERVERS, Estimate
from aerobat_pin.scenario import Scenario, load_scenario

NOISY = (
    "sensors.velocity.noise=0.005",
    "sensors.gyro.noise=0.003",
    "sensors.joint_rate.noise=0.02",
    "sensors.motor_torque.noise=5e-4",
)
PUSHES = (  # on the left wing, along z: an impulse of 5 mN s, a push of 50 ms, a step of 0.1 N
    'unknown_force=[{frame="left_force_point", axes="world", direction=[0,0,1], signal="impulse", impulse=5e-3, '
    'start=0.5}, {frame="left_force_point", axes="world", direction=[0,0,1], signal="one_cosine", amplitude=0.2, '
    'start=0.9, duration=0.05}, {frame="left_force_point", axes="world", direction=[0,0,1], signal="step", '
    "height=0.1, start=1.3, end=1.7}]"
)
FLIGHTS: dict[str, tuple[str, ...]] = {"signal": (), "pushes": (PUSHES,), "no force": ("unknown_force=[]",)}


def heavier(factor: float, *joints: str) -> Callable[[pin.Model], None]:
    """Return a change of a model: the bodies of these joints, or all bodies, weigh `factor` times as much."""

    def change(model: pin.Model) -> None:
        for i, inertia in enumerate(model.inertias.tolist()):
            if not joints or model.names[i] in joints:
                model.inertias[i] = pin.Inertia(factor * inertia.mass, inertia.lever, factor * inertia.inertia)

    return change


def shifted(model: pin.Model) -> None:
    """Move the body's centre of mass 3 mm forward."""
    body = model.inertias[1]
    model.inertias[1] = pin.Inertia(body.mass, body.lever + np.array([3e-3, 0.0, 0.0]), body.inertia)


@dataclass(frozen=True)
class Mismatch:
    """A belief that is wrong: settings of the believed robot and air, of the true flight; a change of the model."""

    believed: tuple[str, ...] = ()
    true: tuple[str, ...] = ()
    change: Callable[[pin.Model], None] | None = None


MISMATCHES = {
    "exact": Mismatch(),
    "quasi-steady air": Mismatch(('believed.air.model="quasi_steady"',)),
    "24 strips": Mismatch(("believed.air.strips=24",)),
    "wing offset 5 mm": Mismatch(("believed.robot.changes.wing.offset_x=-0.055",)),
    "centre of mass 3 mm": Mismatch(change=shifted),
    "mass +5 %": Mismatch(change=heavier(1.05)),
    "air +20 %": Mismatch(("believed.air.density=1.47",)),
    "lift slope -15 %": Mismatch(("believed.air.density=1.04125", "believed.air.added_mass=1.17647")),
    "distal mass +15 %": Mismatch(change=heavier(1.15, "left_elbow", "right_elbow")),
    "joint rates 1 ms late": Mismatch(true=("sensors.joint_rate.delay=0.001",)),
    "wind 0.3 m/s": Mismatch(("believed.air.wind=[0.0,0.0,0.0]",), true=("air.wind=[0.2,0.22,0.0]",)),
}


class Seen(NamedTuple):
    """What observers get, and the noise-free force (m, 2, 3) [N] that they should find."""

    model: pin.Model
    inputs: KnownInputs
    truth: np.ndarray


@cache
def flown(flight: str, seed: int, true: tuple[str, ...]) -> tuple[FlightLog, Scenario]:
    """Fly `paper` once for every belief about it."""
    scenario = load_scenario("paper", [f"simulation.seed={seed}", *FLIGHTS[flight], *true])
    return simulate(scenario), scenario


def seen(row: str, flight: str = "signal", seed: int = 1, more: tuple[str, ...] = (), torque: Any = "measured") -> Seen:
    """Return a flight with further settings as observers with a wrong belief see it."""
    wrong = MISMATCHES[row]
    log, _ = flown(flight, seed, (*wrong.true, *more))
    scenario = load_scenario("paper", [*FLIGHTS[flight], *wrong.true, *more, *wrong.believed])
    robot: Aerobat = believed_robot(scenario)
    if wrong.change is not None:
        robot = replace(robot, model=robot.model.copy())
        wrong.change(robot.model)
    truth = np.stack([true_force(log, name)[1] for name in FORCE_POINTS], axis=1)
    return Seen(robot.model, known_inputs(log, robot, torque, scenario.believed_air), truth)


def thinned(flight: Seen, every: int) -> Seen:
    """Return a flight of which every n-th sample is recorded; known forces and truth are means in between."""
    inputs, count = flight.inputs, len(flight.inputs.tau) // every

    def mean(values: np.ndarray) -> np.ndarray:
        return values[: count * every].reshape(count, every, *values.shape[1:]).mean(axis=1)

    part = slice(0, count * every + 1, every)
    time, q, v = (each[part] for each in (inputs.time, inputs.q, inputs.v))
    known = {name: mean(values) for name, values in inputs.known.items()}
    fewer = replace(inputs, time=time, q=q, v=v, tau=mean(inputs.tau), known=known)
    return Seen(flight.model, fewer, mean(flight.truth))


def estimated(name: str, flight: Seen, gain: float = 2000.0, **settings: Any) -> Estimate:
    inputs = flight.inputs
    observer = OBSERVERS[name](flight.model, FORCE_POINTS, gain, inputs.rows, **settings)
    return observer.run(inputs.time, inputs.q, inputs.v, inputs.tau, inputs.known)


def r_squared(estimate: Estimate, flight: Seen) -> np.ndarray:
    """Return R2 (2, 3) of both wings along x, y, z against the noise-free force; infinite where there is none."""
    size = np.var(flight.truth, axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        found = 1.0 - np.mean((estimate.force - flight.truth) ** 2, axis=0) / size
    return np.where(size > 1e-6, found, np.inf)


def scores(estimate: Estimate, flight: Seen) -> np.ndarray:
    """Return R2 (3,) of the worse wing."""
    return np.min(r_squared(estimate, flight), axis=0)


def made_up(estimate: Estimate) -> np.ndarray:
    """Return the root mean square (3,) [N] of the worse wing: what is found where nothing pushes."""
    return np.sqrt(np.mean(estimate.force**2, axis=0)).max(axis=0)
