"""Crank drives: angle, rate, acceleration; wrong ones refused; flights that speed up, ripple or follow a function."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from aerobat_pin.aerobat import Aerobat, FlightLog, flown_robot, known_inputs
from aerobat_pin.errors import AerobatError, CrankError, TrimError
from aerobat_pin.flight import ConstantRate, CrankDrive, Plant, RateControlledMotor, SpinUp, find_trim, simulate
from aerobat_pin.flight.crank import CrankMotion, checked_motion, crank_drive
from aerobat_pin.numerics import Array
from aerobat_pin.scenario import Scenario, load_scenario, scenario_toml

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


def joints(log: FlightLog, robot: Aerobat) -> tuple[Array, Array]:
    """Return the log's joint angles and rates (n + 1, 4)."""
    q, v = log.measured["q"].values, log.measured["v"].values
    return q[:, list(robot.idx_q)], v[:, list(robot.idx_v)]


@pytest.mark.parametrize("drive", ["constant", "spin_up", "swing"])
def test_joints_and_log_follow_the_drive(drive: str) -> None:
    """The log's crank angle is the drive's, its joints are the linkage's at that angle and rate."""
    own = drive == "swing"
    chosen = scenario("constant" if own else drive)
    robot = flown_robot(chosen)
    log = simulate(chosen, drive=swing if own else None)
    motion = swing(log.time) if own else crank_drive(chosen)(log.time)
    assert log.measured["crank_angle"].values == pytest.approx(motion[0], rel=1e-12)
    closed = robot.linkage.solve(*motion)
    angles, rates = joints(log, robot)
    assert angles == pytest.approx(np.stack([closed.theta_s, closed.theta_e] * 2, axis=-1), abs=1e-12)
    assert rates == pytest.approx(np.stack([closed.theta_s_dot, closed.theta_e_dot] * 2, axis=-1), abs=1e-9)
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


def test_only_a_steady_crank_can_be_trimmed() -> None:
    """A flap that speeds up does not repeat itself."""
    with pytest.raises(TrimError, match=r"crank\.drive = 'motor'"):
        find_trim(load_scenario("paper_open_loop", ["crank.drive=motor"]))


@pytest.mark.parametrize("drive", ["constant", "spin_up", "motor"])
def test_a_drive_survives_writing_and_reading(drive: str, tmp_path: Any) -> None:
    """The resolved scenario holds the drive's own table with every default, and no other."""
    chosen = load_scenario("paper", [f"crank.drive={drive}"])
    text = scenario_toml(chosen)
    for table in ("spin_up", "motor"):
        assert (f"[crank.{table}]" in text) == (table == drive)
    file = tmp_path / "paper.toml"  # a copy takes the name of its file
    file.write_text(text, encoding="utf-8")
    assert load_scenario(file) == chosen
    if drive == "motor":
        assert "torque_limit = 0.15" in text
