"""Crank drives: a function of time, or a motor that is coupled to body, air, gravity and unknown force."""

import pickle
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from support.kernel_cases import instant

from aerobat_pin.aerobat import Aerobat, FlightLog, flown_robot, joint_table, known_inputs, load_aerobat
from aerobat_pin.errors import AerobatError, CrankError
from aerobat_pin.flight import ConstantRate, CrankDrive, Plant, RateControlledMotor, SpinUp, simulate
from aerobat_pin.flight.crank import CrankMotion, checked_motion, crank_drive
from aerobat_pin.linkage import joint_series, joints_at
from aerobat_pin.numerics import Array
from aerobat_pin.scenario import Scenario, load_scenario

START, RATE = -0.5 * np.pi, 2.0 * np.pi * 4.75
TIME = np.linspace(-0.2, 1.0, 2401)
DRIVES: dict[str, CrankDrive] = {"constant": ConstantRate(START, RATE), "spin up": SpinUp(START, RATE, 0.5)}


@pytest.mark.parametrize("drive", DRIVES.values(), ids=DRIVES)
def test_the_rate_is_the_angles_derivative_and_the_acceleration_the_rates(drive: CrankDrive) -> None:
    h = 1e-5
    time = np.concatenate([np.linspace(-0.1, -0.01, 10), np.linspace(0.01, 0.9, 200)])
    here = CrankMotion(*drive(time))
    after, before = CrankMotion(*drive(time + h)), CrankMotion(*drive(time - h))
    assert (after.angle - before.angle) / (2 * h) == pytest.approx(here.rate, rel=1e-6, abs=1e-5)
    assert (after.rate - before.rate) / (2 * h) == pytest.approx(here.acceleration, rel=1e-4, abs=0.05)
    assert CrankMotion(*drive(np.zeros(1))).angle == pytest.approx(START)
    assert checked_motion(drive, TIME).angle.shape == TIME.shape


def test_a_spin_up_rests_then_speeds_up_smoothly_then_turns_steadily() -> None:
    """Half the way of a crank that turned all along; no jump of acceleration; the peak is 15/8 of the mean."""
    drive = SpinUp(START, RATE, 0.5)
    rest, motion, late = drive(np.linspace(-1.0, 0.0, 5)), drive(TIME), drive(np.linspace(0.5, 3.0, 6))
    assert np.all(rest.angle == START)
    assert np.all(rest.rate == 0.0)
    assert late.rate == pytest.approx(RATE)
    assert late.angle == pytest.approx(START + RATE * (np.linspace(0.5, 3.0, 6) - 0.25))
    assert np.all(np.diff(motion.rate) >= -1e-12)
    assert np.max(motion.acceleration) == pytest.approx(15.0 / 8.0 * RATE / 0.5, rel=1e-5)
    assert np.max(np.abs(np.diff(motion.acceleration))) < 0.01 * np.max(motion.acceleration)


@pytest.mark.parametrize(
    ("drive", "message"),
    [
        (lambda t: (6.0 * t, 6.0), "a tuple"),
        (lambda t: 6.0 * t, "a tuple"),
        (lambda t: (6.0 * t[:-1], 6.0, 0.0), r"angle has shape \(2400,\)"),
        (lambda t: (6.0 * t, np.full_like(t, np.nan), 0.0), "rate is not finite"),
        (lambda t: (np.degrees(6.0 * t), 6.0, 0.0), "the angle changes by .* but the rate adds up to"),
        (lambda t: (6.0 * t, 6.0 / (2.0 * np.pi), 0.0), "the angle changes by .* but the rate adds up to"),
        (lambda t: (6.0 * t + t**2, 6.0 + 2.0 * t, 0.0), "the rate changes by .* but the acceleration adds up to"),
        (lambda t: (np.sin(6.0 * t), 6.0 * np.sin(6.0 * t), -36.0 * np.sin(6.0 * t)), "must be the angle's derivative"),
        (lambda t: (np.sin(6.0 * t), 6.0 * np.cos(6.0 * t), 36.0 * np.sin(6.0 * t)), "must be the rate's derivative"),
    ],
)
def test_a_drive_that_is_not_a_motion_is_refused(drive: Callable[..., Any], message: str) -> None:
    """Shapes, finiteness, and that the three quantities belong together."""
    with pytest.raises(CrankError, match=message) as caught:
        checked_motion(drive, TIME)
    assert isinstance(caught.value, AerobatError)


def test_a_drive_may_jump_in_acceleration_and_give_plain_numbers_for_what_is_constant() -> None:
    """A brake thrown in, a crank that stands, a quick swing; a rate that jumps would take an infinite torque."""
    late = np.maximum(TIME - 0.5, 0.0)
    braked = checked_motion(lambda t: (9.0 * t - 8.0 * late**2, 9.0 - 16.0 * late, np.where(t < 0.5, 0.0, -16.0)), TIME)
    assert braked.acceleration.shape == TIME.shape
    with pytest.raises(CrankError, match="must be the rate's derivative"):
        checked_motion(lambda t: (6.0 * np.minimum(t, 0.5), np.where(t < 0.5, 6.0, 0.0), 0.0), TIME)
    assert np.all(checked_motion(lambda _: (0.3, 0.0, 0.0), TIME).angle == 0.3)
    assert checked_motion(lambda t: (np.sin(40.0 * t), 40.0 * np.cos(40.0 * t), -1600.0 * np.sin(40.0 * t)), TIME)
    assert checked_motion(DRIVES["constant"], np.zeros(0)).angle.shape == (0,)


def test_a_scenario_builds_the_drive_it_names() -> None:
    """Its numbers in the drive's units; a motor stands or turns steadily before the flight."""
    assert crank_drive(load_scenario("paper")) == ConstantRate(START, RATE)
    slow = ["crank.drive=spin_up", "crank.spin_up.duration=0.3", "crank.frequency=2", "crank.start_deg=30"]
    assert crank_drive(load_scenario("paper", slow)) == SpinUp(np.radians(30.0), 4.0 * np.pi, 0.3)
    settings = [f"crank.motor.{setting}" for setting in ("start_frequency=4.75", "friction=1e-4", "lag=0.004")]
    found = crank_drive(load_scenario("paper", ["crank.drive=motor", *settings]))
    assert isinstance(found, RateControlledMotor)
    assert found == RateControlledMotor(START, RATE, RATE, 5e-5, 0.15, 0.004, 0.01, 0.1, 1e-4)
    assert found.before == ConstantRate(START, RATE)
    assert found.state == pytest.approx([START, RATE, 0.0, 0.0])


SHORT = ["simulation.duration=0.2", "air.warm_up_cycles=1", "crank.spin_up.duration=0.15"]


def scenario(drive: str, *settings: str) -> Scenario:
    kept = [setting for setting in SHORT if drive == "spin_up" or "spin_up" not in setting]
    return load_scenario("paper", [*kept, f"crank.drive={drive}", *settings])


def swing(time: Array) -> tuple[Array, Array, Array]:
    return -1.5 + 0.8 * np.sin(25.0 * time), 20.0 * np.cos(25.0 * time), -500.0 * np.sin(25.0 * time)


def closed_rates(log: FlightLog, robot: Aerobat, *motion: Array) -> Array:
    """Check that a log's joints are the linkage's in a motion of the crank; return the rates of all four (n + 1, 4)."""
    closed = robot.linkage.solve(*motion)
    angles, rates = log.measured["q"].values[:, list(robot.idx_q)], log.measured["v"].values[:, list(robot.idx_v)]
    np.testing.assert_allclose(angles, np.stack([closed.theta_s, closed.theta_e] * 2, axis=-1), rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(rates, np.stack([closed.theta_s_dot, closed.theta_e_dot] * 2, -1), rtol=0.0, atol=1e-9)
    return rates


@pytest.mark.parametrize("drive", ["constant", "spin_up", "swing"])
def test_joints_and_log_follow_the_drive(drive: str) -> None:
    """The log's crank angle is the drive's, its joints are the linkage's at that angle and rate."""
    own = drive == "swing"
    chosen = scenario("constant" if own else drive)
    robot = flown_robot(chosen)
    log = simulate(chosen, drive=swing if own else None)
    motion = swing(log.time) if own else crank_drive(chosen)(log.time)
    assert log.measured["crank_angle"].values == pytest.approx(motion[0], rel=1e-12)
    rates = closed_rates(log, robot, *motion)
    if drive == "spin_up":
        assert np.all(rates[0] == 0.0)
        assert np.max(np.abs(rates[-1])) > 5.0


def test_the_air_about_resting_wings_warms_up_without_a_history_of_flapping() -> None:
    """A crank that starts at rest stood before: the air has settled, but for the old wake's last traces."""
    kept = ["crank.frequency=1.0", "air.warm_up_cycles=2"]
    rest = Plant(flown_robot(scenario("spin_up")), scenario("spin_up", *kept)).initial.air
    longer = Plant(flown_robot(scenario("spin_up")), scenario("spin_up", *kept, "air.warm_up_cycles=6")).initial.air
    flapping = Plant(flown_robot(scenario("constant")), scenario("constant", *kept)).initial.air
    assert np.max(np.abs(rest)) > 0.01
    assert np.max(np.abs(rest - longer)) < 0.05 * np.max(np.abs(rest))
    assert np.max(np.abs(rest - flapping)) > 0.1 * np.max(np.abs(rest))


@pytest.mark.parametrize("drive", ["spin_up", "motor"])
def test_the_modelled_torque_knows_the_cranks_acceleration(drive: str) -> None:
    """Without unknown forces it is the measured torque, but for the sampling; the crank accelerates all along."""
    still = [f"unknown_force.{i}.{key}=0" for i in (0, 1) for key in ("amplitude", "noise", "step")]
    chosen = scenario(drive, *still, "crank.motor.start_frequency=4.75" if drive == "motor" else "crank.start_deg=10")
    robot, log = flown_robot(chosen), simulate(chosen)
    measured, modelled = (known_inputs(log, robot, torque).tau[2:] for torque in ("measured", "modelled"))
    assert np.max(np.abs(measured)) > 5e-3
    assert modelled == pytest.approx(measured, rel=0.0, abs=0.01 * np.max(np.abs(measured)))


def test_a_drive_of_ones_own_that_is_no_motion_is_refused_before_flying() -> None:
    """Degrees where radians were expected; and a function that does not reach back to the warm-up."""
    with pytest.raises(CrankError, match="must be the angle's derivative"):
        simulate(scenario("constant"), drive=lambda t: (360.0 * 4.75 * t, 2.0 * np.pi * 4.75, 0.0))
    with (
        np.errstate(invalid="ignore"),
        pytest.raises(CrankError, match=r"from t = -0.2105\d* to 0 s; times before t = 0 are needed"),
    ):
        simulate(scenario("constant"), drive=lambda t: (30.0 * np.sqrt(t), 0.0, 0.0))


MOTOR = ["crank.drive=motor", "crank.motor.start_frequency=4.75"]
BLOW = 0.26  # [s]: in the middle of a downstroke
EXACT = 1e-10


def blow(impulse: float, start: float = BLOW, duration: float = 0.01) -> str:
    """Return the setting of one push upward on the left wing [N s, s]."""
    push = f'signal = "impulse", impulse = {impulse}, start = {start}, duration = {duration}'
    return f'unknown_force=[{{frame = "left_force_point", {push}, direction = [0.0, 0.0, 1.0], axes = "world"}}]'


def motored(*settings: str) -> Scenario:
    """Return the paper's scenario, short, its crank turned by a motor and its left wing pushed."""
    return load_scenario("paper", [*MOTOR, "simulation.duration=0.5", "air.warm_up_cycles=2", blow(5e-3), *settings])


@cache
def flown(*settings: str) -> FlightLog:
    """Fly `motored`."""
    return simulate(motored(*settings))


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
    chosen = motored("air.wind=[0.5, 0.3, -0.2]", "crank.motor.friction=2e-4")
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
    free, steady = (Plant(flown_robot(one), one) for one in (motored(), motored("crank={drive='constant'}")))
    arguments = instant(free, 3)
    for one, other in zip(free.rates(*arguments)[:2], steady.rates(*arguments)[:2], strict=True):
        np.testing.assert_array_equal(one, other)


def test_the_linkage_stays_closed_and_the_log_tells_the_crank() -> None:
    """Joints are the linkage's at the crank's angle and rate; the torque that passes to the linkage is the joints'."""
    log, robot = flown(), flown_robot(motored())
    angle, truth = log.measured["crank_angle"].values, log.truth
    closed_rates(log, robot, angle, rate(log))
    assert angle[0] == np.radians(-90.0)
    assert np.diff(angle) == pytest.approx(0.5e-3 * (rate(log)[1:] + rate(log)[:-1]), abs=1e-5)
    halfway = robot.linkage.solve(0.5 * (angle[1:] + angle[:-1]))
    left, right = (log.measured["motor_torque"].values[:, list(robot.idx_v[i : i + 2])].T for i in (0, 2))
    torque = halfway.crank_torque(*left) + halfway.crank_torque(*right)
    assert truth["crank_torque"].values == pytest.approx(torque, abs=0.01 * np.max(np.abs(torque)))
    assert np.max(np.abs(truth["drive_torque"])) <= 0.15
    assert "crank_rate" not in simulate(motored("crank={drive='constant'}", "simulation.duration=0.01")).truth


def test_a_short_blow_changes_the_cranks_rate_by_its_impulse() -> None:
    """0.1 ms: (T^T M T + rotor)^-1 T^T J^T p, by Pinocchio's M and J and the closed linkage; without added mass."""
    settings = ["air.added_mass=0.0", "simulation.dt=1e-4", "simulation.duration=0.2601"]
    struck, calm = (flown(*settings, blow(impulse, BLOW, 1e-4)) for impulse in (5e-3, 0.0))
    robot = flown_robot(motored())
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
    chosen = motored("crank.motor.friction=1e-4")
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
    steady = simulate(motored("crank={drive='constant'}"))

    def gap(inertia: float, name: str) -> float:
        log = flown(f"crank.motor.rotor_inertia={inertia}")
        return float(np.max(np.abs(log.measured[name].values - steady.measured[name].values)))

    for name in ("q", "motor_torque"):
        assert gap(10.0, name) == pytest.approx(0.1 * gap(1.0, name), rel=0.02)
        assert gap(1e9, name) < 1e-9
    assert 1e-3 < gap(1.0, "q") < 0.1


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
    chosen = motored("crank={drive='constant'}", "simulation.duration=0.02")
    motor = RateControlledMotor(-1.0, 30.0, 25.0, 1e-4, 0.2, 0.004, 0.02, 0.0, 0.0)
    plant = Plant(flown_robot(chosen), chosen, motor)
    again = pickle.loads(pickle.dumps(plant))
    assert again.drive == motor
    log = simulate(chosen, drive=motor)
    assert rate(log)[0] == 25.0
    assert log.measured["crank_angle"].values[0] == -1.0
    replaced = simulate(motored("simulation.duration=0.02"), drive=SpinUp(-1.0, 30.0, 0.5))
    assert "crank_rate" not in replaced.truth
