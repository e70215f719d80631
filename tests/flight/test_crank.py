"""Crank drives: what they promise of angle, rate and acceleration; the motor's physics; wrong drives refused."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from aerobat_pin.errors import AerobatError, CrankError
from aerobat_pin.flight.crank import (
    ConstantRate,
    CrankDrive,
    CrankMotion,
    RateControlledMotor,
    SpinUp,
    WingInertia,
    checked_motion,
    crank_drive,
)
from aerobat_pin.robot.aerobat import load_aerobat
from aerobat_pin.scenario.scenario import load_scenario

START, RATE = -0.5 * np.pi, 2.0 * np.pi * 4.75
TIME = np.linspace(-0.2, 1.0, 2401)
ROBOT = load_aerobat("aerobat_guard")
WINGS = WingInertia(ROBOT)


def motor(**changes: Any) -> RateControlledMotor:
    """Return the scenario's default motor with changes."""
    values: dict[str, Any] = {
        "start": START,
        "rate": RATE,
        "start_rate": 0.0,
        "rotor_inertia": 5e-5,
        "torque_limit": 0.15,
        "lag": 0.005,
        "gain": 0.01,
        "integral_gain": 0.1,
        "wings": WINGS,
    }
    return RateControlledMotor(**(values | changes))


DRIVES: dict[str, CrankDrive] = {
    "constant": ConstantRate(START, RATE),
    "spin up": SpinUp(START, RATE, 0.5),
    "motor": motor(),
    "motor from speed": motor(start_rate=RATE),
}


@pytest.mark.parametrize("drive", DRIVES.values(), ids=DRIVES)
def test_the_rate_is_the_angles_derivative_and_the_acceleration_the_rates(drive: CrankDrive) -> None:
    """Against central differences, away from t = 0, where a motor's torque may begin with a jump in acceleration."""
    h = 1e-5
    time = np.concatenate([np.linspace(-0.1, -0.01, 10), np.linspace(0.01, 0.9, 200)])
    here = CrankMotion(*drive(time))
    after, before = CrankMotion(*drive(time + h)), CrankMotion(*drive(time - h))
    assert (after.angle - before.angle) / (2 * h) == pytest.approx(here.rate, rel=1e-6, abs=1e-5)
    assert (after.rate - before.rate) / (2 * h) == pytest.approx(here.acceleration, rel=1e-4, abs=0.05)
    assert CrankMotion(*drive(np.zeros(1))).angle == pytest.approx(START)
    assert checked_motion(drive, TIME).angle.shape == TIME.shape


def test_a_steady_crank_turns_at_all_times() -> None:
    """Before t = 0 as well, where the air warms up."""
    motion = ConstantRate(START, RATE)(TIME)
    assert np.array_equal(motion.angle, START + RATE * TIME)
    assert np.all(motion.rate == RATE)
    assert np.all(motion.acceleration == 0.0)


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


@pytest.mark.parametrize("t1", [-1.5, 0.0, 0.7, 2.5, 4.0, 40.0])
def test_the_wings_inertia_at_the_crank_is_their_kinetic_energy(t1: float) -> None:
    """I t1'^2 / 2 is Pinocchio's kinetic energy with the body still; the derivative against differences."""
    rate = 20.0
    closed = ROBOT.linkage.solve(t1, rate)
    q = ROBOT.configuration([0.0] * 6 + [1.0], closed.theta_s, closed.theta_e)
    v = ROBOT.velocity(np.zeros(6), closed.theta_s_dot, closed.theta_e_dot)
    energy = pin.computeKineticEnergy(ROBOT.model, ROBOT.model.createData(), q, v)
    inertia, slope = WINGS(np.array(t1))
    assert 0.5 * inertia * rate**2 == pytest.approx(energy, rel=1e-11)
    near = WINGS(t1 + np.array([-1e-4, 1e-4]))[0]
    assert slope == pytest.approx((near[1] - near[0]) / 2e-4, rel=1e-5, abs=1e-10)


def test_a_motor_at_its_limit_spins_a_bare_rotor_up_by_the_book() -> None:
    """While saturated: torque = limit (1 - e^(-t/lag)), rate = limit / J (t - lag (1 - e^(-t/lag)))."""
    drive = motor(rate=1e4, wings=lambda t1: (0.0 * t1, 0.0 * t1))
    time = np.linspace(0.0, 0.05, 11)
    rise = 1.0 - np.exp(-time / 0.005)
    assert drive.torque(time) == pytest.approx(0.15 * rise, rel=1e-6, abs=1e-10)
    assert drive(time).rate == pytest.approx(0.15 / 5e-5 * (time - 0.005 * rise), rel=1e-6, abs=1e-6)


def test_a_motor_ends_at_its_rate_against_a_load_and_gives_the_loads_torque() -> None:
    """The integral takes the load over: no miss of the rate is left, and torque is load."""
    drive = motor(wings=lambda t1: (0.0 * t1, 0.0 * t1), load=lambda t1: np.full_like(t1, 0.06))
    late = np.array([2.0, 2.5])
    assert drive(late).rate == pytest.approx(RATE, rel=1e-6)
    assert drive.torque(late) == pytest.approx(0.06, rel=1e-5)


def test_a_motor_that_was_long_at_its_limit_does_not_overshoot() -> None:
    """The integral does not wind up in 0.3 s at the limit: 2 % over the rate, where plain integration makes 74 %."""
    drive = motor(torque_limit=0.005, wings=lambda t1: (0.0 * t1, 0.0 * t1))
    rate = drive(np.linspace(0.0, 2.0, 401)).rate
    assert rate[50] < 0.9 * RATE
    assert rate[-1] == pytest.approx(RATE, rel=1e-4)
    assert np.max(rate) < 1.03 * RATE


def test_the_motors_work_is_the_kinetic_energy_it_makes() -> None:
    """Power balance of rotor, wings and load: d/dt (I t1'^2 / 2) = (torque - load) t1', integrated."""
    drive = motor(load=lambda t1: 0.02 * (1.0 + np.sin(t1)))
    time = np.linspace(0.0, 0.6, 6001)
    motion, torque = drive(time), drive.torque(time)
    energy = 0.5 * (5e-5 + WINGS(motion.angle)[0]) * motion.rate**2
    power = (torque - 0.02 * (1.0 + np.sin(motion.angle))) * motion.rate
    work = np.cumsum(0.5 * (power[1:] + power[:-1]) * np.diff(time))
    assert work == pytest.approx(energy[1:] - energy[0], rel=0.0, abs=1e-5 * np.max(energy))


def test_the_wings_make_the_rate_ripple_and_a_stronger_controller_smooths_it() -> None:
    """Mean rate as ordered; more gain, less ripple; the torque never passes its limit."""
    time = np.linspace(1.0, 1.0 + 3.0 / 4.75, 601)
    weak, strong = motor(), motor(gain=0.1, lag=0.001)
    ripples = [np.ptp(drive(time).rate) for drive in (weak, strong)]
    assert ripples[1] < 0.3 * ripples[0]
    for drive in (weak, strong):
        assert np.mean(drive(time).rate) == pytest.approx(RATE, rel=0.05)
        assert np.max(np.abs(drive.torque(TIME))) <= 0.15
    tight = motor(torque_limit=0.02)
    assert np.max(np.abs(tight.torque(TIME))) <= 0.02
    assert tight(np.array([0.03])).rate < weak(np.array([0.03])).rate


def test_a_motor_that_turns_at_the_start_turned_steadily_before() -> None:
    """So the air warms up about flapping wings."""
    motion = motor(start_rate=RATE)(np.array([-0.2, -0.1]))
    assert motion.angle == pytest.approx(START + RATE * np.array([-0.2, -0.1]))
    assert np.all(motion.rate == RATE)
    assert np.all(motion.acceleration == 0.0)


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
    """Its numbers in the drive's units; the motor turns the robot's own wings."""
    constant = crank_drive(ROBOT, load_scenario("paper"))
    assert constant == ConstantRate(START, RATE)
    slow = ["crank.drive=spin_up", "crank.spin_up.duration=0.3", "crank.frequency=2", "crank.start_deg=30"]
    assert crank_drive(ROBOT, load_scenario("paper", slow)) == SpinUp(np.radians(30.0), 4.0 * np.pi, 0.3)
    found = crank_drive(ROBOT, load_scenario("paper", ["crank.drive=motor", "crank.motor.start_frequency=4.75"]))
    time = np.linspace(-0.1, 0.4, 11)
    for mine, theirs in zip(found(time), motor(start_rate=RATE)(time), strict=True):
        assert mine == pytest.approx(theirs, rel=1e-12, abs=1e-9)
