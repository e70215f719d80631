"""The law: nominal flight, signs, margins, readable twin, allocation; what it says before a flight that must fail."""

import copy
import pickle
import warnings
from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import lsq_linear
from support.control_twins import Law

from aerobat_pin.aerobat import AirStream, believed_robot, known_inputs, load_morphology
from aerobat_pin.control import Allocation, Controller, loop_margins, noise_slew, nominal_flight, wrong_plant_ms
from aerobat_pin.control.allocation import EVEN, PRIORITY, THRUSTER_ARM
from aerobat_pin.control.disturbance import moved, weigh
from aerobat_pin.control.nominal_wrench import OVERTONES, PITCHING, most_steering, waves
from aerobat_pin.control.sensed_channels import CHANNELS
from aerobat_pin.errors import ControlWarning, ScenarioError, ShapeError
from aerobat_pin.flight import LaggedThrust, ThrusterSet, simulate, thrusters_of
from aerobat_pin.numerics import Array
from aerobat_pin.scenario import ThrustersSection, load_scenario

ROUND = [  # gains whose products one can do in one's head
    *("control.roll=12.0", "control.pitch=12.0", "control.yaw=12.0", "control.damping=0.8", "control.smoothing=0.0"),
    *("control.lateral=2.8", "control.height=8.0", "control.forward=2.0"),
]
STEADY = ["control.lead=1.0", "control.integral=false", "control.feedforward=false", "sensors={}", *ROUND]


def controller(*settings: str) -> Controller:
    return Controller(load_scenario("paper_left_closed_loop", settings))


def sample(pilot: Controller, roll: float = 0.0, pitch: float = 0.0, yaw: float = 0.0) -> tuple[Array, Array]:
    """Return a sample on the course, turned by small angles [rad], pitch positive nose up."""
    robot = believed_robot(pilot.scenario)
    q, v = robot.q0, np.zeros(robot.model.nv)
    attitude = pin.rpy.rpyToMatrix(roll, -pitch, yaw)
    q[3:7] = pin.Quaternion(attitude).coeffs()
    v[:3] = attitude.T @ np.array(pilot.scenario.flight.velocity)
    return q, v


def begun(pilot: Controller) -> tuple[Array, Array, Array]:
    """Begin on the course, and return that sample with the wrench that is wanted there."""
    q, v = sample(pilot)
    pilot.begin(0.0, q, v, 0.0)
    return q, v, pilot.wrench(0.0, q, v, 0.0)


def test_the_nominal_wrench_is_gravity_less_air() -> None:
    """0.77 N of lift; and 6.4 mN m of pitch, since the body's centre of mass is not the robot's."""
    pilot = controller()
    nominal, weight = pilot.nominal, pilot.nominal.mass * 9.81
    assert nominal.wrench[2] == pytest.approx(weight - nominal.air[2], rel=1e-3)
    assert nominal.wrench[2] == pytest.approx(0.77, abs=0.01)
    assert nominal.wrench[4] == pytest.approx(6.4e-3, abs=0.3e-3)
    np.testing.assert_allclose(nominal.wrench[[1, 3, 5]], 0.0, atol=1e-6)
    steered = np.append(np.zeros(4), [-nominal.steering[1], 0.0])  # the crank starts at -90 degrees
    np.testing.assert_allclose(pilot.allocation.map @ pilot.trim, nominal.wrench + steered, atol=1e-6)


@pytest.mark.parametrize("axis", ["roll", "pitch", "yaw"])
def test_a_turned_body_is_turned_back_as_stiffly_as_the_scenario_says(axis: str) -> None:
    """Moment per angle is J w^2, about that axis alone but for the swing of the reference; nose up turns about -y."""
    pilot = controller(*STEADY, f"control.{axis}=10.0")
    level = begun(pilot)[2]
    angle, i = 1e-4, ("roll", "pitch", "yaw").index(axis)
    turned = pilot.wrench(0.0, *sample(pilot, **{axis: angle}), 0.0) - level
    sign = 1.0 if axis == "pitch" else -1.0
    assert turned[3 + i] == pytest.approx(sign * pilot.nominal.inertia[i] * 100.0 * angle, rel=1e-3)
    np.testing.assert_allclose(np.delete(turned[3:], i), 0.0, atol=5e-3 * abs(turned[3 + i]))


def test_a_push_at_the_centre_of_mass_does_not_ask_for_yaw() -> None:
    """The thrusters leave its part sideways, so only a roll is wanted against it; against that upwards, a pitch."""
    pilot = controller(*ROUND, *STEADY[:2], "sensors={}", "control.lateral=0.0")
    q, v, level = begun(pilot)
    force, centre = np.array([0.0, 1e-3, 0.02]), pilot.nominal.centre
    assert centre[0] == pytest.approx(-7.5e-3, abs=1e-4)
    pilot.disturbance[:] = moved(np.append(force, np.zeros(3)), centre)
    np.testing.assert_allclose(pilot.disturbance, [*force, *np.cross(centre, force)], atol=1e-18)
    answer = pilot.wrench(0.0, q, v, 0.0) - level
    assert abs(answer[5]) < 0.01 * abs(answer[3])  # the reference swings: its axes are not quite level
    assert answer[4] == pytest.approx(0.02 * centre[0], rel=1e-6)
    roll = 1e-3 / (pilot.nominal.mass * 9.81)
    assert answer[3] == pytest.approx(pilot.nominal.inertia[0] * 144.0 * roll, rel=1e-3)


def test_margins_are_those_of_the_textbook_for_a_plain_double_integrator() -> None:
    """No lag, no delay, no observer: L = (kd s + kp) / s^2, phase margin atan(2 z wc / w), Ms from the closed form."""
    plain = ["thrusters.lag=0.0", "thrusters.delay=0.0", "control.lead=1.0", "control.lateral=0.0"]
    quick = ["simulation.dt=1e-5", "simulation.duration=0.001"]
    found = loop_margins(load_scenario("paper_left_closed_loop", [*ROUND, *STEADY[1:3], *plain, *quick]))
    w, z = 12.0, 0.8
    crossover = w * np.sqrt(2.0 * z * z + np.sqrt(4.0 * z**4 + 1.0))
    for axis in ("roll", "pitch", "yaw"):
        assert found[axis].stable
        assert found[axis].crossover == pytest.approx(crossover, rel=1e-3)
        assert found[axis].phase == pytest.approx(np.arctan(2.0 * z * crossover / w), rel=2e-3)


def test_the_shipped_loop_has_margins_with_and_without_observer() -> None:
    """Ms below 2; an observer costs phase, as the design says; slow thrusters make the loop unstable."""
    plain = "control.smoothing=0.0"
    gains = [*ROUND, plain, "control.lead=2.0", "control.moment_gain=8.0", "control.lift_gain=10.0"]
    with_it, without = (
        loop_margins(load_scenario("paper_left_closed_loop", [*gains, f"control.feedforward={on}"]))
        for on in ("true", "false")
    )
    assert all(axis.stable and axis.ms < 2.0 for axis in (*with_it.values(), *without.values()))
    assert np.degrees(without["roll"].phase) == pytest.approx(42.0, abs=3.0)
    assert np.degrees(with_it["roll"].phase) == pytest.approx(36.0, abs=3.0)
    shipped = load_scenario("paper_left_closed_loop")
    assert max(wrong_plant_ms(shipped).values()) < 2.4
    assert min(axis.delay for axis in loop_margins(shipped).values()) > 0.023
    late = ["thrusters.delay=0.06", "believed.thrusters.delay=0.001"]
    assert not loop_margins(load_scenario("paper_left_closed_loop", late))["roll"].stable


def test_the_slew_of_noise_is_that_of_the_law_and_its_lead() -> None:
    """Gyro noise alone on yaw: lead kd per sample, white, so that the change of a command has twice its variance."""
    quiet = [f"sensors.{name}.noise=0.0" for name in ("position", "attitude", "velocity")]
    off = ["control.roll=0.001", "control.pitch=0.001", "thrusters.lag=1.0", "believed.thrusters.lag=1.0"]
    pilot = controller(*ROUND, *STEADY[1:3], *quiet, *off, "control.lead=2.0", "sensors.gyro.noise=3e-3")
    moment = 2.0 * 2.0 * 0.8 * 12.0 * pilot.nominal.inertia[2] * 3e-3
    expected = np.sqrt(np.mean(pilot.allocation.free[:, 5] ** 2) * 2.0) * moment / 1e-3
    assert noise_slew(pilot) == pytest.approx(expected, rel=0.01)


def test_too_weak_thrusters_are_announced_before_the_flight() -> None:
    """Half the thrust is 0.70 N, the robot needs 0.77 N; with all of it nothing is said."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        controller("thrusters.factor=0.5")
    lines = [str(one.message) for one in caught if one.category is ControlWarning]
    assert any("N of lift" in line and "needs 0.77" in line and line.endswith("the robot will fall") for line in lines)
    assert controller().warnings == []


def test_a_scenario_without_a_table_control_has_no_controller() -> None:
    with pytest.raises(ScenarioError, match="no table control"):
        Controller(load_scenario("paper"))
    with pytest.raises(ScenarioError, match="has a table control, but no pilot was given"):
        simulate(load_scenario("hover_closed_loop"))


def test_a_course_in_millimetres_is_refused_at_once() -> None:
    """Its warm-up took millions of steps, and all memory."""
    with pytest.raises(ScenarioError, match=r"the wings meet air at 3e\+03 m/s in a flap: at most 100"):
        controller("flight.velocity=[3000,0,0]")


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))])
@pytest.mark.parametrize("settings", [STEADY[: -len(ROUND)], []])
def test_a_copied_controller_flies_as_it_does(settings: list[str], copied: Callable[[Controller], Controller]) -> None:
    """It flew the trim: commands were written where a copy did not look, and the air read from the original's robot."""
    pilot = controller(*settings)
    q, v, _ = begun(pilot)
    pilots = pilot, copied(pilot)
    if not settings:  # a copied observer has no sample yet
        for each in pilots:
            each.begin(0.0, q, v, 0.0)
    for k in range(8):
        q[2] += 1e-3
        one, other = (each.command(k * pilot.dt, q, v, 0.1 * k) for each in pilots)
        np.testing.assert_array_equal(one, other)
    assert not np.allclose(one, pilot.trim)
    for name in ("disturbance", "wanted", "unrealised"):
        np.testing.assert_array_equal(getattr(pilot, name), getattr(pilots[1], name))
    np.testing.assert_array_equal(pilot.thrust.mean, pilots[1].thrust.mean)
    assert str(pilot.state) == str(pilots[1].state)


@pytest.mark.parametrize(("dt", "bound"), [(1e-3, 1e-3), (1e-2, 0.03)])
def test_the_air_of_a_stream_is_that_of_the_whole_record(dt: float, bound: float) -> None:
    """Sample by sample within a thousandth of the batch reconstruction, three hundredths at 100 Hz."""
    scenario = load_scenario("paper", ["simulation.duration=0.2", f"simulation.dt={dt}"])
    log, robot = simulate(scenario), believed_robot(scenario)
    batch = known_inputs(log, robot, "none", scenario.believed_air)
    stream = AirStream(robot, scenario.believed_air, dt)
    stream.reset(0.0, batch.q[0], batch.v[0], float(log.measured["crank_angle"][0]), 2.0 * np.pi * 4.75)
    made = np.array([stream.update(*one) for one in zip(batch.time[1:], batch.q[1:], batch.v[1:], strict=True)])
    for i, name in enumerate(("aerodynamic", "added_mass")):
        known = batch.known[name]
        np.testing.assert_allclose(made[:, i, :6], known[:, :6], atol=bound * np.abs(known).max())


def test_the_air_of_a_stream_stays_finite_where_the_flight_gets_faster() -> None:
    """From 1 m/s to 8 without flaps, sinking at 0.2 m/s: an attached wing has pi rho U w S of lift, below 0.5 N."""
    scenario = load_scenario("paper", ["air.strips=32"])
    robot = believed_robot(scenario)
    stream, q, v = AirStream(robot, scenario.believed_air, 0.01), robot.q0.copy(), np.zeros(robot.model.nv)
    v[:3] = 1.0, 0.0, -0.2
    stream.reset(0.0, q, v, 0.0, 0.0)
    for k in range(1, 150):
        v[0] = min(1.0 + 0.1 * k, 8.0)
        q[0] += 0.01 * v[0]
        made = stream.update(0.01 * k, q, v)
    assert np.abs(made).max() < 0.5


@pytest.mark.parametrize(
    "settings",
    [
        ("control.feedforward=false", "flight.yaw_deg=30.0", "flight.velocity=[2.6, 1.5, 0.1]"),
        ("control.pitch_deg=1.0", "control.rate=500.0"),
        ("control.integral=false", "crank.frequency=0.0", "thrusters.delay=0.004", "flight.velocity=[1.0, 0.0, 0.0]"),
    ],
    ids=["turned course", "pitched", "gliding"],
)
def test_the_law_is_its_readable_twin(settings: tuple[str, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    """Sixty samples on both sides of all limits: wrench, commands and what is left, with their memory of the past."""
    rng = np.random.default_rng(3)
    monkeypatch.setattr("aerobat_pin.control.sensed.REACH", dict.fromkeys(CHANNELS, (np.inf, 0.0, 0.0)))
    for name in ("SLACK", "UNKNOWN_SPIN"):  # no attitude at random belies its gyro
        monkeypatch.setattr(f"aerobat_pin.control.sensed.{name}", np.inf)
    pilot = Controller(load_scenario("paper_left_closed_loop", settings))
    twin, robot, allocation = Law(pilot), believed_robot(pilot.scenario), Allocation(pilot.thrusters)
    pilot.begin(0.0, robot.q0, np.zeros(robot.model.nv), 0.4)
    acts = pilot.control.feedforward
    left = np.zeros(6)
    for k in range(60):
        q, v, since = robot.q0.copy(), 0.2 * rng.standard_normal(robot.model.nv), k * pilot.dt
        q[:3] = np.array(pilot.scenario.flight.velocity) * since + 0.05 * rng.standard_normal(3)
        q[3:7] = pin.Quaternion(pin.exp3(0.3 * rng.standard_normal(3))).coeffs() * rng.choice([-1.0, 1.0])
        pilot.disturbance[:] = rng.standard_normal(6) * [0.02, 0.1, 0.2, 5e-3, 5e-3, 5e-3]
        crank = rng.uniform(0.0, 7.0)
        pilot._observer = None
        expected = twin.wrench(since, q, v, crank, acts * pilot.disturbance, left)
        command = pilot.command(since, q, v, crank)
        wanted = twin.wanted(expected, crank)
        np.testing.assert_allclose(pilot.wanted, wanted, rtol=0.0, atol=1e-12 * max(1.0, np.abs(wanted).max()))
        np.testing.assert_allclose(command, allocation.thrusts(wanted), atol=1e-6)
        left = allocation.unrealised(wanted, command)
        np.testing.assert_allclose(pilot.unrealised, left, atol=1e-6)


def test_the_swing_is_that_of_the_flaps_and_pitch_is_steered_against() -> None:
    """At 3 Hz all pitching with the crank is; at 4.75 Hz what leaves the thrusters room. The body heaves by 5 mm."""
    slow, fast = (load_scenario("hover_closed_loop", [f"crank.frequency={rate}"]) for rate in (3.0, 4.75))
    robot = believed_robot(fast)
    nominal = nominal_flight(slow, robot)
    assert np.hypot(*nominal.swing[:2, 7]) < 1e-4
    assert np.hypot(*nominal.steering) < 0.5 * most_steering(slow, robot, nominal.wrench)
    nominal = nominal_flight(fast, robot)
    assert np.hypot(*nominal.steering) == pytest.approx(most_steering(fast, robot, nominal.wrench), rel=1e-3)
    assert 2e-3 < np.hypot(*nominal.swing[:2, 7]) < 8e-3
    assert np.hypot(*nominal.swing[:2, 2]) == pytest.approx(4.9e-3, abs=0.3e-3)
    for wave in range(OVERTONES):
        rate = 2.0 * np.pi * 4.75 * (wave + 1)
        (cosine, sine), (its_cosine, its_sine) = nominal.swing[2 * wave : 2 * wave + 2, [2, 5]].T
        np.testing.assert_allclose([its_cosine, its_sine], [rate * sine, -rate * cosine], atol=2e-3)


def test_the_steering_is_made_in_time() -> None:
    """Through delay and lag of the believed thrusters, the moment about pitch is the wanted one at the wanted time."""
    pilot = Controller(load_scenario("hover_closed_loop", ["thrusters.delay=0.003"]))
    nominal, dt, rate = pilot.nominal, pilot.dt, 2.0 * np.pi * 4.75
    thrust = LaggedThrust(pilot.thrusters, pilot.scenario.believed_thrusters, dt, pilot.trim)
    law, made, meant = pilot._law, [], []
    for k in range(600):
        crank = rate * k * dt
        wrench = nominal.wrench.copy()
        wrench[PITCHING] += law.steering @ [np.cos(crank), np.sin(crank)]
        made.append(thrust.advance(pilot.allocation.thrusts(wrench))[PITCHING])
        meant.append(nominal.wrench[PITCHING] + nominal.steering @ waves(np.array([crank + 0.5 * rate * dt]))[0, :2])
    np.testing.assert_allclose(made[300:], meant[300:], atol=0.02 * np.hypot(*nominal.steering))


def test_a_sample_of_another_robot_is_refused() -> None:
    """Kernels do not look at shapes; what calls them does."""
    pilot = Controller(load_scenario("hover_closed_loop", ["air.strips=4"]))
    robot = believed_robot(pilot.scenario)
    q, v = robot.q0, np.zeros(robot.model.nv)
    pilot.begin(0.0, q, v, 0.0)
    with pytest.raises(ShapeError, match="were expected"):
        pilot.command(0.0, q[:7], v, 0.0)
    with pytest.raises(ShapeError, match="command has shape"):
        pilot.thrust.advance(np.zeros(4))


GAIN, DT, DEVIATION = 10.0, 1e-3, 0.02  # [1/s], [s], of the momentum's samples [N s]
FOLLOW = np.full(6, 1.0 - np.exp(-GAIN * DT))


def test_white_noise_of_the_momentum_leaves_the_stated_variance() -> None:
    """K^2 s / (s + K)^2 of white noise of density s^2 dt has the variance s^2 K^3 dt / 4, by Parseval's theorem."""
    momentum = np.random.default_rng(0).normal(scale=DEVIATION, size=(100_000, 6))
    slow, seen, state, smooth = np.zeros(6), np.zeros(6), np.zeros(6), []
    for sample in momentum:
        slow += FOLLOW * (sample - slow)
        seen[:] = GAIN * (sample - slow)  # the residual of a momentum observer
        weigh(seen, FOLLOW, np.zeros(6), state, np.empty(6))
        smooth.append(state.copy())
    np.testing.assert_allclose(np.var(smooth), DEVIATION**2 * GAIN**3 * DT / 4.0, rtol=0.05)


def test_a_push_counts_by_what_its_size_says_of_noise() -> None:
    """x^2 / (x^2 + variance) of what stays x; nothing of nothing."""
    state, counted, pushes = np.zeros(6), np.empty(6), np.array([0.0, 0.1, 0.2, 0.4, 2.0, -2.0])
    for _ in range(3000):
        weigh(pushes, FOLLOW, np.full(6, 0.04), state, counted)
    np.testing.assert_allclose(counted, pushes**3 / (pushes**2 + 0.04), rtol=1e-6)


LIFT = 0.77  # [N] that the guarded robot's nominal flight needs


def guard() -> ThrusterSet:
    return thrusters_of(load_morphology("aerobat_guard"))


def test_the_map_is_what_six_pushes_at_six_places_do() -> None:
    """Each column by hand: force along the direction, moment of the place, reaction of the propeller."""
    found, shape = guard(), load_morphology("aerobat_guard")
    assert found.names == tuple(f"thruster_{i}" for i in range(1, 7))
    for column, one in zip(found.map.T, shape.thrusters, strict=True):
        (x, y, z), (a, b, c) = one.position, one.direction
        moment = np.array([y * c - z * b, z * a - x * c, x * b - y * a]) + one.torque / one.thrust * np.array([a, b, c])
        np.testing.assert_allclose(column, [a, b, c, *moment], rtol=0.0, atol=1e-15)
    with pytest.raises(ScenarioError, match="has no thrusters"):
        thrusters_of(load_morphology("aerobat"))


def test_the_six_balance_yaw_where_they_lift_the_robot() -> None:
    """1 to 4 turn the nose right by 12 mN m, 5 and 6 by up to 56 mN m left; with the other sense it would fall."""
    found = guard()
    yaw = found.map[5] * found.limit
    assert np.sum(yaw[:4]) * LIFT / 1.4 == pytest.approx(-12.3e-3, abs=0.1e-3)
    assert np.sum(yaw[4:]) == pytest.approx(56e-3, abs=1e-3)
    allocation = Allocation(found)
    thrust = allocation.thrusts(np.array([0.0, 0.0, LIFT, 0.0, 0.0, 0.0]))
    np.testing.assert_allclose(found.map @ thrust, [0.0, 0.0, LIFT, 0.0, 0.0, 0.0], atol=1e-6)
    assert np.all(thrust > 0.0)
    assert np.linalg.matrix_rank(found.map) == 5
    reversed_sense = found.map.copy()
    reversed_sense[:, 4:] *= -1.0
    wrong = Allocation(ThrusterSet(found.names, reversed_sense, found.limit))
    level = np.array([0.0, 0.0, LIFT, 0.0, 0.0, 0.0])
    assert abs(wrong.unrealised(level, wrong.thrusts(level))[5]) > 10e-3


def test_limited_thrusts_are_those_of_scipys_bounded_least_squares() -> None:
    """Three hundred wrenches, most of them out of reach, against scipy's solver for the same weighted problem."""
    found, rng = guard(), np.random.default_rng(2)
    allocation = Allocation(found)
    weight = np.array(list(PRIORITY.values())) / np.array([1.0, 1.0, 1.0, *[THRUSTER_ARM] * 3])
    weighted = weight[:, None] * found.map
    even = np.sqrt(EVEN * np.sum(weighted**2)) * np.eye(6)
    stacked, limited = np.vstack([weighted, even]), 0
    for _ in range(300):
        wrench = rng.normal(0.0, 1.0, 6) * [0.05, 0.1, 0.4, 0.06, 0.05, 0.02] + [0.0, 0.0, LIFT, 0.0, 0.0, 0.0]
        thrust = allocation.thrusts(wrench)
        reach = np.sort([np.minimum(found.map, 0.0) @ found.limit, np.maximum(found.map, 0.0) @ found.limit], axis=0)
        target = np.append(weight * np.clip(wrench, *reach), np.zeros(6))
        best = lsq_linear(stacked, target, (0.0, found.limit), method="bvls", tol=1e-14)
        assert np.all(thrust >= 0.0)
        assert np.all(thrust <= found.limit)
        miss = np.linalg.norm(stacked @ thrust - target)
        assert miss <= np.linalg.norm(best.fun) * (1.0 + 1e-7) + 1e-9
        limited += int(np.any((thrust == 0.0) | (thrust == found.limit)))
    assert 100 < limited < 300


def test_roll_and_pitch_come_before_yaw_and_yaw_before_lift() -> None:
    """Too much of everything keeps most of its roll; too much lift is made rather than yaw."""
    allocation = Allocation(guard())
    wrench = np.array([0.2, 0.0, 1.4, 0.06, 0.0, 0.06])
    left = np.abs(allocation.unrealised(wrench, allocation.thrusts(wrench)) / [0.2, 1.0, 1.4, 0.06, 1.0, 0.06])
    assert left[3] < 0.1
    assert left[3] < min(left[2], left[5])
    assert left[0] > max(left[2], left[5])
    light = np.array([0.0, 0.0, 0.05, 0.01, 0.01, 0.0])
    left = allocation.unrealised(light, allocation.thrusts(light))
    assert np.all(np.abs(left[3:]) < 0.2e-3)
    assert left[2] < -0.05


def test_a_thrust_follows_its_command_late_and_slowly() -> None:
    """A step of the command: nothing for the delay, then 1 - exp(-t / lag); means are exact integrals."""
    section, dt = ThrustersSection(lag=0.045, delay=0.003, factor=0.8), 1e-3
    found = guard()
    thrust = LaggedThrust(found, section, dt, np.zeros(6))
    command = np.array([0.1, 0.2, 0.3, 9.0, -1.0, 0.05])
    kept = np.clip(command, 0.0, found.limit)
    for k in range(200):
        wrench = thrust.advance(command)
        t = np.array([k, k + 1]) * dt - 0.003
        t = np.maximum(t, 0.0)
        integral = kept * ((t[1] + 0.045 * np.exp(-t[1] / 0.045)) - (t[0] + 0.045 * np.exp(-t[0] / 0.045)))
        np.testing.assert_allclose(thrust.mean, 0.8 * integral / dt, rtol=0.0, atol=1e-12)
        np.testing.assert_allclose(wrench, found.map @ thrust.mean, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(thrust.thrust, kept, rtol=0.02)
