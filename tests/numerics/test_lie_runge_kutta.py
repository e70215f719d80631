"""The commutator-free Runge-Kutta method is of order four (at least 3.9), on a rigid body and on the plant in air."""

from itertools import pairwise

import numpy as np
import pinocchio as pin
from support.stepping import step

from aerobat_pin.aerobat import FlightLog
from aerobat_pin.flight import simulate
from aerobat_pin.scenario import load_scenario

SE3 = pin.liegroups.SE3()


def observed_orders(errors: list[float]) -> np.ndarray:
    return np.log2([coarse / fine for coarse, fine in pairwise(errors)])


def placement_error(q: np.ndarray, reference: np.ndarray) -> float:
    """Return the size of the twist that separates two placements (7,), position in m and rotation in rad."""
    return float(np.linalg.norm(SE3.difference(reference, q)))


def rigid_body() -> tuple[pin.Model, np.ndarray, np.ndarray]:
    """Return a free body with three different moments of inertia and its COM off the origin, and a start."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "body")
    inertia = pin.Inertia(0.05, np.array([0.01, -0.02, 0.015]), np.diag([2e-4, 1e-4, 2.5e-4]))
    model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
    return model, np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]), np.array([3.0, 0.5, -0.5, 4.0, -6.0, 5.0])


def fly_rigid_body(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Fly the rigid body 0.4 s under a turning wrench, in `count` steps; return placement and twist."""
    model, q, v = rigid_body()
    data = model.createData()

    def rates(time: float, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray, None]:
        phase = 20.0 * time + np.arange(6)
        wrench = np.sin(phase) * np.array([0.5] * 3 + [0.01] * 3)
        return v, pin.aba(model, data, q, v, wrench).copy(), None

    dt = 0.4 / count
    for k in range(count):
        q, v, _ = step(rates, SE3.integrate, k * dt, q, v, dt)
    return q, v


def test_order_is_four_on_a_forced_rigid_body() -> None:
    """Celledoni, Marthinsen & Owren 2003: placements and twists, gravity and a wrench that depends on time."""
    (q, v), *runs = (fly_rigid_body(count) for count in (3200, 50, 100, 200))
    for errors in ([placement_error(run[0], q) for run in runs], [float(np.linalg.norm(run[1] - v)) for run in runs]):
        assert np.all(observed_orders(errors) >= 3.9)


# Nothing that jumps or saturates: no noise, no step, and a hold that never meets its limits.
SMOOTH = [
    *(f"hold.{limit}=10.0" for limit in ("thrust_limit", "lift_limit")),
    "hold.torque_limit=[10.0, 10.0, 10.0]",
    *(f"unknown_force.{i}.{key}=0.0" for i in range(2) for key in ("noise", "step")),
    "air.warm_up_cycles=0",
    "air.wave=[{amplitude=[0.5, 0.3, -0.4], frequency=5.0}]",
    "simulation.duration=0.096",
]


def end_of(log: FlightLog) -> tuple[np.ndarray, ...]:
    """Return placement, twist, lag states and circulation at the end of a flight."""
    air = log.truth["air_state"].values[-1]
    lags = 2 * len(air) // 3
    return log.measured["q"].values[-1, :7], log.measured["v"].values[-1, :6], air[:lags], air[lags:]


def test_order_is_four_on_the_plant_with_its_air() -> None:
    """The whole flight with joints, hold, unknown force and the air's 48 states: at least 3.9 of each part."""
    reference, *runs = (
        simulate(load_scenario("paper", [*SMOOTH, f"simulation.dt={dt}"])) for dt in (6.25e-5, 2e-3, 1e-3, 5e-4)
    )
    placement, *others = end_of(reference)
    ends = [end_of(log) for log in runs]
    assert np.all(observed_orders([placement_error(end[0], placement) for end in ends]) >= 3.9)
    for i, exact in enumerate(others, start=1):
        errors = [float(np.linalg.norm(end[i] - exact)) for end in ends]
        assert np.all(observed_orders(errors) >= 3.9)
        assert errors[-1] > 1e-12 * np.linalg.norm(exact)  # still the method's error, not rounding
