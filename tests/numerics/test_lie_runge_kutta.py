"""The commutator-free Runge-Kutta method is of order four, on a rigid body and on the real plant with its air.

The observed order compares steps of dt and dt/2 with a fine reference: log2 of the ratio of their errors. "Fourth
order" means at least 3.9. The scheme that averages body velocities and moves along the mean once, which looks like
Runge-Kutta, is only of order two.
"""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest
from support.stepping import stage_mean, step

from aerobat_pin.aerobat.flight_log import FlightLog
from aerobat_pin.flight.simulate import simulate
from aerobat_pin.scenario.scenario import load_scenario

SE3 = pin.liegroups.SE3()
Stepper = Callable[..., tuple[np.ndarray, np.ndarray, object]]


def observed_orders(errors: list[float]) -> np.ndarray:
    return np.log2([coarse / fine for coarse, fine in pairwise(errors)])


def placement_error(q: np.ndarray, reference: np.ndarray) -> float:
    """Return the size of the twist that separates two placements (7,), position in m and rotation in rad."""
    return float(np.linalg.norm(SE3.difference(reference, q)))


def averaged_velocity_step(
    rates: Callable, retract: Callable, t: float, q: np.ndarray, y: np.ndarray, dt: float
) -> tuple[np.ndarray, np.ndarray, None]:
    """Take the tempting step: classical Runge-Kutta stages, then once along the weighted mean of body velocities."""
    k1, l1, _ = rates(t, q, y)
    k2, l2, _ = rates(t + dt / 2.0, retract(q, dt / 2.0 * k1), y + dt / 2.0 * l1)
    k3, l3, _ = rates(t + dt / 2.0, retract(q, dt / 2.0 * k2), y + dt / 2.0 * l2)
    k4, l4, _ = rates(t + dt, retract(q, dt * k3), y + dt * l3)
    return retract(q, dt * stage_mean((k1, k2, k3, k4))), y + dt * stage_mean((l1, l2, l3, l4)), None


def rigid_body() -> tuple[pin.Model, np.ndarray, np.ndarray]:
    """Return a free body with three different moments of inertia and its COM off the origin, and a start."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "body")
    inertia = pin.Inertia(0.05, np.array([0.01, -0.02, 0.015]), np.diag([2e-4, 1e-4, 2.5e-4]))
    model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
    return model, np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]), np.array([3.0, 0.5, -0.5, 4.0, -6.0, 5.0])


def fly_rigid_body(take_step: Stepper, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Fly the rigid body 0.4 s under a turning wrench, in `count` steps; return placement and twist."""
    model, q, v = rigid_body()
    data = model.createData()

    def rates(time: float, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray, None]:
        phase = 20.0 * time + np.arange(6)
        wrench = np.sin(phase) * np.array([0.5] * 3 + [0.01] * 3)
        return v, pin.aba(model, data, q, v, wrench).copy(), None

    dt = 0.4 / count
    for k in range(count):
        q, v, _ = take_step(rates, SE3.integrate, k * dt, q, v, dt)
    return q, v


@pytest.fixture(scope="module")
def rigid_reference() -> tuple[np.ndarray, np.ndarray]:
    return fly_rigid_body(step, 3200)


def test_order_is_four_on_a_forced_rigid_body(rigid_reference: tuple[np.ndarray, np.ndarray]) -> None:
    """Celledoni, Marthinsen & Owren 2003: placements and twists, gravity and a wrench that depends on time."""
    q, v = rigid_reference
    runs = [fly_rigid_body(step, count) for count in (50, 100, 200)]
    for errors in ([placement_error(run[0], q) for run in runs], [float(np.linalg.norm(run[1] - v)) for run in runs]):
        assert np.all(observed_orders(errors) >= 3.9)


def test_averaging_body_velocities_is_only_of_order_two(rigid_reference: tuple[np.ndarray, np.ndarray]) -> None:
    """Derivation: one exponential of the mean misses the commutators [k_i, k_j], an error of dt^3 in each step."""
    runs = [fly_rigid_body(averaged_velocity_step, count) for count in (50, 100, 200, 400)]
    errors = [placement_error(q, rigid_reference[0]) for q, _ in runs]
    np.testing.assert_allclose(observed_orders(errors), 2.0, atol=0.1)
    assert 100.0 * placement_error(fly_rigid_body(step, 50)[0], rigid_reference[0]) < errors[0]


# Nothing that jumps or saturates: no noise, no step, and a hold that never meets its limits.
SMOOTH = [
    *(f"hold.{limit}=10.0" for limit in ("thrust_limit", "lift_limit")),
    "hold.torque_limit=[10.0, 10.0, 10.0]",
    *(f"unknown_force.{i}.{key}=0.0" for i in range(2) for key in ("noise", "step")),
    "air.warm_up_cycles=0",
    "simulation.duration=0.096",
]


def fly_plant(dt: float) -> FlightLog:
    return simulate(load_scenario("paper", [*SMOOTH, f"simulation.dt={dt}"]))


def end_of(log: FlightLog) -> tuple[np.ndarray, ...]:
    """Return placement, twist, lag states and circulation at the end of a flight."""
    air = log.truth["air_state"].values[-1]
    lags = 2 * len(air) // 3
    return log.measured["q"].values[-1, :7], log.measured["v"].values[-1, :6], air[:lags], air[lags:]


def test_order_is_four_on_the_plant_with_its_air() -> None:
    """Derivation: the whole flight with joints, hold, unknown force and the 48 states of the air, from still air on.

    Halving the step twice, the order of base placement, base twist, lag states and circulation is at least 3.9 each.
    """
    reference, *runs = (fly_plant(dt) for dt in (6.25e-5, 2e-3, 1e-3, 5e-4))
    placement, *others = end_of(reference)
    ends = [end_of(log) for log in runs]
    assert np.all(observed_orders([placement_error(end[0], placement) for end in ends]) >= 3.9)
    for i, exact in enumerate(others, start=1):
        errors = [float(np.linalg.norm(end[i] - exact)) for end in ends]
        assert np.all(observed_orders(errors) >= 3.9)
        assert errors[-1] > 1e-12 * np.linalg.norm(exact)  # still the method's error, not rounding


def test_the_logged_configuration_moves_with_the_logged_velocity() -> None:
    """Kinematics: log(q_k^-1 q_k+1) / dt is the mean twist, which the trapezoid of v gives up to a dt^2 error.

    One wing alone is pushed, so that the body rolls and yaws too; every axis shrinks fourfold at each halving.
    """
    one_sided = [*SMOOTH, "simulation.duration=0.05", "unknown_force.1.amplitude=0.0", "unknown_force.0.axes=body"]
    miss = []
    for dt in (1e-3, 5e-4, 2.5e-4):
        log = simulate(load_scenario("paper", [*one_sided, f"simulation.dt={dt}"]))
        q, v = log.measured["q"].values[:, :7], log.measured["v"].values[:, :6]
        moved = np.array([SE3.difference(a, b) for a, b in pairwise(q)]) / dt
        miss.append(np.mean(np.abs(moved - 0.5 * (v[1:] + v[:-1])), axis=0))
    for coarse, fine in pairwise(miss):
        np.testing.assert_allclose(fine / coarse, 0.25, atol=0.002)
    assert np.max(miss[0]) < 1e-4  # m/s and rad/s, at 1 ms


def test_stage_outputs_average_to_the_change_of_the_vector_state() -> None:
    """Derivation: an output equal to y' has, as its stage mean, exactly (y1 - y0) / dt."""

    def rates(time: float, q: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        y_dot = np.array([y[1], -np.sin(y[0]) + time])
        return np.zeros(6), y_dot, y_dot

    q, y, dt = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]), np.array([1.0, 0.5]), 0.1
    _, y_next, outputs = step(rates, SE3.integrate, 0.2, q, y, dt)
    np.testing.assert_allclose(stage_mean(outputs), (y_next - y) / dt, atol=1e-14)
