"""The law's kernels against a readable twin; what the nominal flight tells of the flaps; what passes the noise."""

import numpy as np
import pinocchio as pin
import pytest
from support.control_twins import Law

from aerobat_pin.aerobat import believed_robot
from aerobat_pin.control import Allocation, Controller, nominal_flight
from aerobat_pin.control.disturbance import weigh
from aerobat_pin.control.nominal_wrench import OVERTONES, PITCHING, most_steering, waves
from aerobat_pin.control.sensed_channels import CHANNELS
from aerobat_pin.errors import ShapeError
from aerobat_pin.flight import LaggedThrust
from aerobat_pin.scenario import load_scenario


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
