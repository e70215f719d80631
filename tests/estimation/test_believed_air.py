"""Sigma_K and Sigma_Aero along a recorded motion: what nobody measured comes back, as well as the record allows."""

from typing import Any

import numpy as np
import pinocchio as pin
import pytest
import xarray as xr
from scipy.signal import savgol_filter

from aerobat_pin.aerobat.aerobat import FORCE_POINTS, Aerobat, flown_robot
from aerobat_pin.aerobat.air.believed_air import _slerp
from aerobat_pin.aerobat.flight_log import FlightLog, true_force
from aerobat_pin.aerobat.flight_record import flight_motion, flight_record, known_inputs
from aerobat_pin.aerobat.robot import AerobatRobot
from aerobat_pin.errors import AerobatError
from aerobat_pin.experiments.experiment import Experiment, run
from aerobat_pin.flight.simulate import simulate
from aerobat_pin.forces.scores import r_squared
from aerobat_pin.observers import ForceLevelObserver, MomentumObserver
from aerobat_pin.scenario import AirSection, load_scenario

SHORT = ["simulation.duration=0.3"]


def stripped(log: FlightLog, every: int = 1) -> FlightLog:
    """Keep what a motion-capture hall records: body poses, crank angle and airspeed, every so many samples."""
    kept = log.measured.isel(time=slice(None, None, every))
    measured = kept[["crank_angle", "airspeed"]].drop_vars(["interval", "q_axis", "v_axis"], errors="ignore")
    measured["pose"] = xr.DataArray(kept["q"].values[:, :7], dims=("time", "pose_axis"))
    measured.attrs = log.measured.attrs
    return FlightLog(measured)


WINDY = ["air.wind=[0.5, -1.0, 0.3]", "air.gust.amplitude=[0.0, 1.0, 1.0]", "air.gust.start=0.05"]
AIRS = [[], ["air.model=quasi_steady"], ["air.added_mass=0"], WINDY, ["air.lift_limit=1.2"]]


@pytest.mark.parametrize("settings", AIRS, ids=lambda settings: " ".join(settings) or "default")
def test_the_air_of_a_flight_comes_back_from_its_motion(settings: list[str]) -> None:
    """Against the plant's interval means, which come by its stages: a thousandth of the largest force is left."""
    scenario = load_scenario("paper", [*SHORT, *settings])
    log = simulate(scenario)
    found = known_inputs(log, flown_robot(scenario)).known
    if not settings:  # the joints tell where the crank is, so that the wings have their wake
        alone = known_inputs(FlightLog(log.measured.drop_vars("crank_angle")), flown_robot(scenario)).known
        np.testing.assert_allclose(alone["aerodynamic"], found["aerodynamic"], atol=2e-4)
    for name in ("aerodynamic", "added_mass"):
        expected = log.truth[name].values
        if name not in found:
            assert not np.any(expected)
            continue
        scale = np.max(np.abs(expected), axis=0)
        worst = np.max(np.abs(found[name] - expected), axis=0)
        assert np.all(worst[scale > 1e-3] < 1e-3 * scale[scale > 1e-3]), name


def test_pose_crank_and_airspeed_are_enough_for_the_base_wrench(paper: Experiment) -> None:
    """Six base rows of the unknown generalised force, R2 of each at least 0.99 where there is a signal of 1 mN."""
    log = stripped(paper.log)
    assert set(log.measured.data_vars) == {"pose", "crank_angle", "airspeed"}
    thrusters = paper.log.measured["known_thrusters"]
    log = FlightLog(log.measured.assign(known_thrusters=thrusters).assign_coords(interval=thrusters["interval"]))
    inputs = known_inputs(log, paper.robot, "none")
    assert inputs.source == {
        **dict.fromkeys(("q", "v", "wind", "aerodynamic", "added_mass"), "reconstructed"),
        "thrusters": "measured",
        "motor_torque": "none",
    }
    observer = MomentumObserver(paper.robot.model, gain=2000.0, rows="base")
    estimate = observer.run(inputs.time, inputs.q, inputs.v, inputs.tau, inputs.known)
    truth = paper.log.truth["unknown"].values
    scores = [r_squared(estimate.residual[:, i], truth[:, i]) for i in (0, 2)]
    moments = [1.0 - np.var(estimate.residual[:, i] - truth[:, i]) / np.var(truth[:, i]) for i in range(3, 6)]
    assert min(score for score in scores if score is not None) >= 0.99
    assert moments[1] >= 0.99


@pytest.mark.parametrize("every", [2, 5])
def test_a_slow_camera_still_gives_the_air(paper: Experiment, every: int) -> None:
    """Poses at 500 and 200 Hz: intervals are flown in finer steps, the crank in between by its cubic."""
    inputs = known_inputs(stripped(paper.log, every), paper.robot, "none")
    expected = paper.log.truth["aerodynamic"].values.reshape(-1, every, 10).mean(axis=1)
    error = inputs.known["aerodynamic"] - expected
    assert np.sqrt(np.mean(error[:, 2] ** 2)) < 0.03 * np.std(expected[:, 2])


def test_a_noisy_crank_is_mended_by_its_rate() -> None:
    """1 mrad at 1 kHz, differenced twice, drowns the force; docs/recorded.md: parabolas through 21 ms, K = 500 1/s."""
    scenario = load_scenario("paper", ["sensors.crank_angle.noise=1e-3"])
    flight, robot = simulate(scenario), flown_robot(scenario)
    measured, truth = flight.measured, true_force(flight, "left_force_point")[1]
    angle = measured["crank_angle"]
    smooth = angle.copy(data=savgol_filter(angle, 21, 2, deriv=1, delta=1e-3))
    poses = measured["q"].isel(q_axis=slice(7)).rename(q_axis="pose_axis")
    twists = measured["v"].isel(v_axis=slice(6)).rename(v_axis="twist_axis")
    bare = measured.drop_vars(["q", "v"]).assign(pose=poses, twist=twists)
    for log, expected in (
        (measured, (0.97, 0.97, 0.98)),
        (bare, (0.45, 0.14, 0.58)),
        (bare.assign(crank_rate=smooth), (0.97, 0.99, 0.99)),
    ):
        inputs = known_inputs(FlightLog(log), robot)
        observer = ForceLevelObserver(robot.model, FORCE_POINTS, gain=500.0)
        found = observer.run(inputs.time, inputs.q, inputs.v, inputs.tau, inputs.known).force[:, 0]
        scores = [r_squared(found[:, i], truth[:, i]) for i in range(3)]
        assert scores == pytest.approx(expected, abs=0.006)


def test_a_wrong_belief_is_a_model_error_and_nothing_else() -> None:
    """`believed.air.density` 20 % up raises the reconstructed force by 20 %; the flight itself is the same."""
    exact, wrong = (run(load_scenario("paper", [*SHORT, *extra])) for extra in ([], ["believed.air.density=1.47"]))
    np.testing.assert_array_equal(wrong.log.measured["q"].values, exact.log.measured["q"].values)
    airs = [AirSection.model_validate_json(one.log.measured.attrs["air"]) for one in (exact, wrong)]
    assert [air.density for air in airs] == [1.225, 1.47]
    right, off = (known_inputs(one.log, one.robot).known["aerodynamic"] for one in (exact, wrong))
    np.testing.assert_allclose(off[5:, 2], 1.2 * right[5:, 2], rtol=0.02, atol=2e-4)
    scores = [one.metrics["observers"]["force_level"]["left"]["Fz"]["r2"] for one in (exact, wrong)]
    assert scores[0] > 0.999 > 0.99 > scores[1]
    heavy = run(load_scenario("paper", [*SHORT, "believed.robot.changes.body.mass=0.085"]))
    assert heavy.robot.mass == exact.robot.mass
    assert heavy.metrics["observers"]["force_level"]["left"]["Fz"]["r2"] < scores[0]


def test_measured_joints_win_over_the_crank_and_the_crank_over_differences(paper: Experiment) -> None:
    """Each quantity says where it comes from; a torque at the crank is spread with its power."""
    robot, log = paper.robot, stripped(paper.log)
    closed = flight_motion(log, robot, AirSection())
    np.testing.assert_allclose(closed.q[:, 7:], paper.log.measured["q"].values[:, 7:], atol=1e-9)
    np.testing.assert_allclose(closed.v[1:-1, 6:], paper.log.measured["v"].values[1:-1, 6:], atol=2e-3)
    order = ["left_shoulder", "left_elbow", "right_shoulder", "right_elbow"]
    joints = xr.DataArray(paper.log.measured["q"].values[:, list(robot.idx_q)] + 0.1, dims=("time", "joint"))
    measured = log.measured.assign(joint_angle=joints).assign_coords(joint=order)
    found = flight_motion(FlightLog(measured), robot, AirSection())
    record = flight_record(FlightLog(measured), AerobatRobot.of(robot))
    assert record.block(*record.parts[0]).source["q"] == "measured"
    np.testing.assert_allclose(found.q[:, 7:], closed.q[:, 7:] + 0.1, atol=1e-9)
    alone = flight_motion(FlightLog(measured.drop_vars("crank_angle")), robot, AirSection())
    np.testing.assert_allclose(alone.v[1:-1, 6:], closed.v[1:-1, 6:], atol=2.0)


def test_what_a_log_cannot_give_is_refused_by_name(paper: Experiment) -> None:
    """No joints and no crank; a torque that nobody recorded; a gap through which nothing can be flown."""
    robot: Aerobat = paper.robot
    log = stripped(paper.log)

    def refused(message: str, measured: Any, torque: Any = "none") -> None:
        with pytest.raises(AerobatError, match=message):
            known_inputs(FlightLog(measured), robot, torque)

    refused("neither joints nor crank_angle", log.measured.drop_vars("crank_angle"))
    refused("no channel named motor_torque or joint_torque: torque = measured needs it", log.measured, "measured")
    refused("or crank_torque: torque = motor_only", log.measured, "motor_only")
    refused("torque = 'guessed': one of measured", log.measured, "guessed")
    for torque in ("modelled", "motor_only"):
        refused("no channel named crank_angle", paper.log.measured.drop_vars("crank_angle"), torque)
    millimetres = log.measured.assign(pose=log.measured["pose"] * [1e3, 1e3, 1e3, 1, 1, 1, 1])
    refused(r"the wings meet air at \d+ m/s at t = .*metres", millimetres)
    late = log.measured.assign_coords(time=np.where(log.time > 1.0, log.time + 1.0, log.time))
    refused(r"1 s without a sample after t = 1 s.*cut the log there", late)


def test_repeated_stamps_cost_nothing_and_turning_is_even() -> None:
    """An interval of no length has no force; half way between two attitudes lies Pinocchio's own interpolation."""
    rng = np.random.default_rng(4)
    start, end = (np.array([pin.Quaternion(pin.exp3(rng.normal(size=3))).coeffs() for _ in range(20)]) for _ in "ab")
    share = rng.uniform(size=(20, 1))
    for i, found in enumerate(_slerp(start, end, share)):
        a, b = (pin.Quaternion(one[i]).matrix() for one in (start, end))
        expected = a @ pin.exp3(share[i, 0] * pin.log3(a.T @ b))
        np.testing.assert_allclose(pin.Quaternion(found).matrix(), expected, atol=1e-9)
    scenario = load_scenario("paper", ["simulation.duration=0.02"])
    log, robot = simulate(scenario), flown_robot(scenario)
    twice = np.sort(np.append(np.arange(21), 10))
    measured = log.measured.drop_dims("interval").isel(time=twice)
    inputs = known_inputs(FlightLog(measured), robot, "none")
    once = known_inputs(FlightLog(log.measured.drop_dims("interval")), robot, "none")
    assert not np.any(inputs.known["aerodynamic"][10])
    np.testing.assert_allclose(np.delete(inputs.known["aerodynamic"], 10, axis=0), once.known["aerodynamic"], atol=1e-6)
