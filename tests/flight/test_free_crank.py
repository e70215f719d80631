"""A crank that a motor turns: coupled to body, air, gravity and unknown force; its energy, limits and convergence."""

import pickle
from functools import cache
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from support.kernel_cases import instant

from aerobat_pin.aerobat import FlightLog, flown_robot, joint_table, load_aerobat
from aerobat_pin.flight import Plant, RateControlledMotor, SpinUp, simulate
from aerobat_pin.linkage import joint_series, joints_at
from aerobat_pin.scenario import Scenario, load_scenario

MOTOR = ["crank.drive=motor", "crank.motor.start_frequency=4.75"]
BLOW = 0.26  # [s]: in the middle of a downstroke
EXACT = 1e-10


def blow(impulse: float, start: float = BLOW, duration: float = 0.01) -> str:
    """Return the setting of one push upward on the left wing [N s, s]."""
    push = f'signal = "impulse", impulse = {impulse}, start = {start}, duration = {duration}'
    return f'unknown_force=[{{frame = "left_force_point", {push}, direction = [0.0, 0.0, 1.0], axes = "world"}}]'


def scenario(*settings: str) -> Scenario:
    """Return the paper's scenario, short, its crank turned by a motor and its left wing pushed."""
    return load_scenario("paper", [*MOTOR, "simulation.duration=0.5", "air.warm_up_cycles=2", blow(5e-3), *settings])


@cache
def flown(*settings: str) -> FlightLog:
    """Fly `scenario`."""
    return simulate(scenario(*settings))


def rate(log: FlightLog) -> Any:
    """Return the crank's rate at the samples [rad/s]."""
    return log.truth["crank_rate"].values


@pytest.mark.parametrize("changes", [{}, {"linkage": {"L5a": 0.0179}}])
def test_the_series_are_the_closed_linkage(changes: dict[str, Any]) -> None:
    """Angles and both derivatives at any crank angle, several turns away too; bars longer and shorter as well."""
    linkage = load_aerobat("aerobat", changes).linkage
    series, found = joint_series(linkage), np.empty((3, 2))
    for t1 in np.random.default_rng(1).uniform(-30.0, 30.0, 50):
        joints_at(series, t1, found)
        closed = linkage.solve(t1)
        np.testing.assert_allclose(found[0], [closed.theta_s, closed.theta_e], rtol=0.0, atol=1e-12)
        np.testing.assert_allclose(found[1], [closed.dtheta_s, closed.dtheta_e], rtol=0.0, atol=1e-11)
        np.testing.assert_allclose(found[2], [closed.d2theta_s, closed.d2theta_e], rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("seed", range(2))
def test_the_cranks_acceleration_is_the_one_at_which_its_torques_balance(seed: int) -> None:
    """In wind, held, pushed: rotor t1'' = torque - friction - sum of g' u_m, u_m from prescribed joints."""
    # The torque that prescribed joints need is linear in their acceleration: two evaluations give t1''.
    chosen = scenario("air.wind=[0.5, 0.3, -0.2]", "crank.motor.friction=2e-4")
    plant = Plant(flown_robot(chosen), chosen)
    robot, motor = plant.robot, plant.fields.motor
    q, v, _, air, held = instant(plant, seed)
    t1, speed, torque, integral = crank = np.array([0.7 + 1.3 * seed, 20.0 + 5.0 * seed, 0.05, 0.1])

    def joints(acceleration: float) -> Any:
        return joint_table(robot.linkage.solve(np.array([t1]), speed, acceleration))[0]

    q, v = robot.configuration(q[:7], *joints(0.0)[0]), robot.velocity(v[:6], *joints(0.0)[1])
    closed = robot.linkage.solve(t1)
    slopes = robot.velocity(np.zeros(6), closed.dtheta_s, closed.dtheta_e)

    def missing(acceleration: float) -> float:
        needed = plant.rates(q, v, joints(acceleration), air, held)[2].motor[0]
        return float(torque - motor.friction * speed - needed @ slopes - motor.rotor_inertia * acceleration)

    expected = 1e3 * missing(0.0) / (missing(0.0) - missing(1e3))
    state, found = np.concatenate([v[:6], air, crank]), joints(0.0)
    rates = np.empty_like(state)
    plant.evaluate(q, v, found, plant.wind(np.zeros(1))[0], held[:, :, None].copy(), state, rates)
    assert rates[-3] == pytest.approx(expected, rel=EXACT)
    np.testing.assert_allclose(found, joints(expected), rtol=1e-9)
    body, air_rate, forces = plant.rates(q, v, joints(expected), air, held)
    np.testing.assert_allclose(rates[:6], body, rtol=0.0, atol=EXACT * np.max(np.abs(body)))
    np.testing.assert_allclose(rates[6:-4], air_rate, rtol=0.0, atol=EXACT * np.max(np.abs(air_rate)))
    assert plant.fields.forces.crank_torque == pytest.approx(forces.motor[0] @ slopes, rel=1e-9)
    order = 0.01 * (2.0 * np.pi * 4.75 - speed) + 0.1 * integral
    assert rates[-4] == speed
    assert rates[-2] == pytest.approx((order - torque) / 0.005)
    assert rates[-1] == pytest.approx(2.0 * np.pi * 4.75 - speed)


def test_a_plant_with_a_motor_also_evaluates_joints_that_are_prescribed() -> None:
    """`rates` without a crank's state: as the plant of a steady crank, to the last bit."""
    free, steady = (Plant(flown_robot(one), one) for one in (scenario(), scenario("crank={drive='constant'}")))
    arguments = instant(free, 3)
    for one, other in zip(free.rates(*arguments)[:2], steady.rates(*arguments)[:2], strict=True):
        np.testing.assert_array_equal(one, other)


def test_the_linkage_stays_closed_and_the_log_tells_the_crank() -> None:
    """Joints are the linkage's at the crank's angle and rate; the torque that passes to the linkage is the joints'."""
    log, robot = flown(), flown_robot(scenario())
    angle, truth = log.measured["crank_angle"].values, log.truth
    closed = robot.linkage.solve(angle, rate(log))
    q, v = (log.measured[name].values for name in ("q", "v"))
    angles, rates = q[:, list(robot.idx_q)], v[:, list(robot.idx_v)]
    np.testing.assert_allclose(angles, np.stack([closed.theta_s, closed.theta_e] * 2, axis=-1), rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(rates, np.stack([closed.theta_s_dot, closed.theta_e_dot] * 2, -1), rtol=0.0, atol=1e-9)
    assert angle[0] == np.radians(-90.0)
    assert np.diff(angle) == pytest.approx(0.5e-3 * (rate(log)[1:] + rate(log)[:-1]), abs=1e-5)
    halfway = robot.linkage.solve(0.5 * (angle[1:] + angle[:-1]))
    left, right = (log.measured["motor_torque"].values[:, list(robot.idx_v[i : i + 2])].T for i in (0, 2))
    torque = halfway.crank_torque(*left) + halfway.crank_torque(*right)
    assert truth["crank_torque"].values == pytest.approx(torque, abs=0.01 * np.max(np.abs(torque)))
    assert np.max(np.abs(truth["drive_torque"])) <= 0.15
    assert "crank_rate" not in simulate(scenario("crank={drive='constant'}", "simulation.duration=0.01")).truth


def test_a_short_blow_changes_the_cranks_rate_by_its_impulse() -> None:
    """0.1 ms: (T^T M T + rotor)^-1 T^T J^T p, by Pinocchio's M and J and the closed linkage; without added mass."""
    settings = ["air.added_mass=0.0", "simulation.dt=1e-4", "simulation.duration=0.2601"]
    struck, calm = (flown(*settings, blow(impulse, BLOW, 1e-4)) for impulse in (5e-3, 0.0))
    robot = flown_robot(scenario())
    q, data = calm.measured["q"].values[2600], robot.model.createData()
    closed = robot.linkage.solve(calm.measured["crank_angle"].values[2600])
    T = np.eye(10, 7)
    T[6:, 6] = robot.velocity(np.zeros(6), closed.dtheta_s, closed.dtheta_e)[6:]
    M = T.T @ pin.crba(robot.model, data, q) @ T
    M[6, 6] += 5e-5
    frame = robot.model.getFrameId("left_force_point")
    J = pin.computeFrameJacobian(robot.model, data, q, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
    expected = np.linalg.solve(M, T.T @ J[2] * 5e-3)
    assert abs(expected[6]) > 1.0
    assert rate(struck)[-1] - rate(calm)[-1] == pytest.approx(expected[6], rel=0.02)


def test_the_books_of_energy_close() -> None:
    """Kinetic, potential and rotor energy change by the work of motor, air, hold, blow, friction: 1e-6 of motor's."""
    chosen = scenario("crank.motor.friction=1e-4")
    log, robot = flown("crank.motor.friction=1e-4"), flown_robot(chosen)
    data, truth, dt = robot.model.createData(), log.truth, chosen.simulation.dt
    states = zip(log.measured["q"].values, log.measured["v"].values, strict=True)
    energy = np.array([pin.computeMechanicalEnergy(robot.model, data, q, v) for q, v in states])
    energy += 0.5 * 5e-5 * rate(log) ** 2
    given = sum(truth[f"{who}_power"].values for who in ("drive", "air", "thruster", "unknown"))
    work = dt * np.cumsum(given - truth["friction_power"].values)
    motor = dt * np.sum(truth["drive_power"].values)
    assert abs(dt * np.sum(truth["unknown_power"].values)) > 1e-3 * motor
    assert dt * np.sum(truth["friction_power"].values) > 0.1 * motor
    assert np.max(np.abs(energy[1:] - energy[0] - work)) < 1e-6 * motor
    # The rotor takes the rest: what the motor gives, less friction, passes to the joints or stays in the rotor.
    rest = dt * np.sum((truth["drive_power"] - truth["friction_power"] - truth["motor_power"]).values)
    assert 0.5 * 5e-5 * (rate(log)[-1] ** 2 - rate(log)[0] ** 2) == pytest.approx(rest, abs=1e-6 * motor)


def test_a_stiff_motor_flies_the_prescribed_flight() -> None:
    """The heavier the rotor, the nearer: the distance falls with its inertia, from a hundredth down to rounding."""
    steady = simulate(scenario("crank={drive='constant'}"))

    def gap(inertia: float, name: str) -> float:
        log = flown(f"crank.motor.rotor_inertia={inertia}")
        return float(np.max(np.abs(log.measured[name].values - steady.measured[name].values)))

    for name in ("q", "motor_torque"):
        assert gap(10.0, name) == pytest.approx(0.1 * gap(1.0, name), rel=0.02)
        assert gap(1e9, name) < 1e-9
    assert 1e-3 < gap(1.0, "q") < 0.1


def test_a_stiff_controller_keeps_the_rate() -> None:
    """Gain instead of inertia: a hundred times the gain, a twentieth of the ripple, through a blow."""
    stiff = ["crank.motor.gain=1.0", "crank.motor.lag=5e-4", "crank.motor.torque_limit=10", "simulation.dt=1e-4"]
    ripples = [np.ptp(rate(flown(*settings))[-1000:]) for settings in ((), stiff)]
    assert ripples[1] < 0.05 * ripples[0]


def test_the_torque_keeps_its_limit_and_the_rate_does_not_overshoot_after_it() -> None:
    """From rest: long at the limit, the integral does not wind up."""
    constants = {"start_frequency": 0.0, "rotor_inertia": 1e-3, "gain": 0.1, "integral_gain": 1.0}
    settings = [f"crank.motor.{name}={value}" for name, value in constants.items()]
    log = flown(*settings, "simulation.duration=1.5", blow(0.0))
    torque, turned = log.truth["drive_torque"].values, rate(log) / (2.0 * np.pi)
    assert np.max(np.abs(torque)) <= 0.15
    assert np.sum(torque > 0.1499) > 100
    assert np.max(turned) < 1.1 * 4.75
    assert np.mean(turned[-400:]) == pytest.approx(4.75, rel=0.03)


def test_the_flight_converges_with_order_four() -> None:
    """Base, air and crank together: halving the step divides the error by 16; the hold keeps off its limits."""
    wide = ["hold.torque_limit=[9, 9, 9]", "hold.thrust_limit=9", "hold.lift_limit=9", "simulation.duration=0.1"]
    ends = []
    for dt in (1e-3, 5e-4, 2.5e-4):
        log = flown(*wide, f"simulation.dt={dt}", blow(0.0))
        ends.append(np.concatenate([log.measured["q"].values[-1], [rate(log)[-1]]]))
    coarse, fine = np.abs(ends[0] - ends[1]), np.abs(ends[1] - ends[2])
    moved = coarse > 1e-9
    assert np.sum(moved) >= 3
    assert np.all(coarse[moved] > 2.0**3.5 * fine[moved])
    assert np.log2(coarse[-1] / fine[-1]) == pytest.approx(4.0, abs=0.3)


def test_a_motor_of_ones_own_replaces_the_scenarios_drive() -> None:
    """Given to the plant, pickled with it, and overruled by a function of time."""
    chosen = scenario("crank={drive='constant'}", "simulation.duration=0.02")
    motor = RateControlledMotor(-1.0, 30.0, 25.0, 1e-4, 0.2, 0.004, 0.02, 0.0, 0.0)
    plant = Plant(flown_robot(chosen), chosen, motor)
    again = pickle.loads(pickle.dumps(plant))
    assert again.drive == motor
    log = simulate(chosen, drive=motor)
    assert rate(log)[0] == 25.0
    assert log.measured["crank_angle"].values[0] == -1.0
    replaced = simulate(scenario("simulation.duration=0.02"), drive=SpinUp(-1.0, 30.0, 0.5))
    assert "crank_rate" not in replaced.truth
