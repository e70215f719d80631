"""From raw samples to forces: the joint smoother, its recursions, the causal filter, clocks, and what is refused."""

import importlib
import itertools
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
import xarray as xr
from support.own_model import own_model_errors

from aerobat_pin import aerobat
from aerobat_pin.aerobat import load_aerobat
from aerobat_pin.aerobat.raw import (
    JointEstimate,
    JointFilter,
    JointSmoother,
    RawRecord,
    find_mount,
    mounted,
    raw_record,
)
from aerobat_pin.aerobat.raw.air import AirAboutNominal, AirForces
from aerobat_pin.aerobat.raw.channels import SensorSamples, part_of, stretches
from aerobat_pin.aerobat.raw.dynamics import LinearDynamics, wings_by_crank
from aerobat_pin.aerobat.raw.layout import MOUNT_PRIOR, POSE_ERROR, TWIST_ERROR, Layout, Prior, first_prior
from aerobat_pin.aerobat.raw.linear import LinearRecord
from aerobat_pin.aerobat.raw.nominal_motion import NominalMotion, first_guess, wing_angles, wing_motion
from aerobat_pin.aerobat.raw.recursion import Filtered, SampleRows, Smoothed, filter_record, smooth_record
from aerobat_pin.aerobat.raw.results import notes_of, warnings_of
from aerobat_pin.aerobat.raw.rows import ROWS_BY_SENSOR, Sensed
from aerobat_pin.aerobat.raw.tuning import Tuning, free_logs
from aerobat_pin.errors import CalibrationError, LogError, ObserverError, ScenarioError
from aerobat_pin.estimation import calibrate, calibration_bytes, read_calibration, record_findings
from aerobat_pin.experiments import write_flight_mcap
from aerobat_pin.flight import simulate
from aerobat_pin.forces import r_squared
from aerobat_pin.linkage import joint_series
from aerobat_pin.scenario import ObserverSection, RawSection, Scenario, load_scenario

MOVING = 15
STATES = MOVING + 5
FRESH = np.array([MOVING + 2, MOVING + 4], dtype=np.intp)


def random_record(rng: np.random.Generator, m: int, each: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, SampleRows]:
    """Return a random model of m intervals with samples at every knot: F, shift, noise, and the samples."""
    F = np.zeros((m, MOVING, STATES))
    F[:, :, :MOVING] = np.eye(MOVING)
    F += 0.1 * rng.standard_normal(F.shape)
    shift, noise = 0.1 * rng.standard_normal((m, MOVING)), rng.uniform(0.1, 1.0, (m, STATES))
    h, R = rng.standard_normal(((m + 1) * each, STATES)), rng.uniform(0.2, 1.0, (m + 1) * each)
    start = (each * np.arange(m + 2)).astype(np.intp)
    e = rng.standard_normal((m + 1) * each)
    return F, shift, noise, SampleRows(start, h, e, R, np.zeros(len(e), dtype=np.intp))


def filtered_from(x: np.ndarray, P: np.ndarray, m: int, samples: int) -> Filtered:
    """Return what a filter starts from and writes to."""
    n = len(x)
    return Filtered(x, P, np.empty((samples, n)), np.empty((samples, 2)), np.empty((m + 1, n)), np.empty((m + 1, n, n)))


def test_filter_and_smoother_solve_the_least_squares_of_the_whole_record() -> None:
    """States, covariances and likelihood of a random model are those of the joint Gaussian of all states."""
    rng = np.random.default_rng(4)
    n, m, each = STATES, 4, 3
    F, shift, noise, rows = random_record(rng, m, each)
    x0, root = 0.3 * rng.standard_normal(n), rng.standard_normal((n, n))
    P0 = root @ root.T / n + np.eye(n)

    # The joint Gaussian: mean and covariance of all states stacked, then conditioned on the samples.
    steps, moves = [], []
    for k in range(m):
        step = np.eye(n)
        step[:MOVING] = F[k]
        step[FRESH[0] : FRESH[1]] = 0.0
        steps.append(step)
        moves.append(np.pad(shift[k], (0, n - MOVING)))
    mean, blocks = [x0], {(0, 0): P0}
    for k in range(m):
        mean.append(steps[k] @ mean[k] + moves[k])
        for j in range(k + 1):
            blocks[k + 1, j] = steps[k] @ (blocks[k, j] if k >= j else blocks[j, k].T)
        blocks[k + 1, k + 1] = steps[k] @ blocks[k, k] @ steps[k].T + np.diag(noise[k])
    h, e, R = rows.h, rows.e, rows.R
    size = n * (m + 1)
    C, H = np.zeros((size, size)), np.zeros((len(e), size))
    for (i, j), block in blocks.items():
        C[i * n : (i + 1) * n, j * n : (j + 1) * n] = block
        C[j * n : (j + 1) * n, i * n : (i + 1) * n] = block.T
    for i in range(len(e)):
        k = i // each
        H[i, k * n : (k + 1) * n] = h[i]

    def conditioned(count: int) -> tuple[np.ndarray, np.ndarray, float]:
        G, miss = H[:count], e[:count] - H[:count] @ np.concatenate(mean)
        S = G @ C @ G.T + np.diag(R[:count])
        gain = np.linalg.solve(S, G @ C).T
        score = -0.5 * (miss @ np.linalg.solve(S, miss) + np.linalg.slogdet(S)[1])
        return np.concatenate(mean) + gain @ miss, C - gain @ G @ C, score

    made = filtered_from(x0.copy(), P0.copy(), m, len(e))
    score = filter_record(F, shift, noise, FRESH, rows, made)
    np.testing.assert_allclose(score, conditioned(len(e))[2], rtol=1e-10)
    for k in range(m + 1):
        best, spread, _ = conditioned(each * (k + 1))
        at = slice(k * n, (k + 1) * n)
        np.testing.assert_allclose(made.states[k], best[at], atol=1e-10)
        np.testing.assert_allclose(made.covariances[k], spread[at, at], atol=1e-10)
    block, knots = np.array([0, n], dtype=np.intp), (m + 1, n)
    smoothed = Smoothed(made, *map(np.empty, (knots, (m + 1, n, n), knots, knots, (m + 1, n, n))))
    smooth_record(F, FRESH, block, rows, smoothed)
    best, spread, _ = conditioned(len(e))
    np.testing.assert_allclose(smoothed.states.ravel(), best, atol=1e-10)
    for k in range(m + 1):
        at = slice(k * n, (k + 1) * n)
        np.testing.assert_allclose(smoothed.blocks[k], spread[at, at], atol=1e-10)


def test_the_adjoint_gives_the_derivative_of_the_likelihood_by_each_variance() -> None:
    """(sum l^2 - sum N) / 2 over the knots, against a difference quotient of the log-likelihood."""
    rng = np.random.default_rng(5)
    n, m, each = STATES, 6, 4
    F, shift, noise, rows = random_record(rng, m, each)
    made = filtered_from(np.empty(n), np.empty((n, n)), m, len(rows.e))

    def likelihood(added: np.ndarray) -> float:
        made.x[:], made.P[:] = 0.0, np.eye(n)
        return filter_record(F, shift, added, FRESH, rows, made)

    likelihood(noise)
    block, knots = np.array([MOVING, MOVING + 2], dtype=np.intp), (m + 1, n)
    smoothed = Smoothed(made, *map(np.empty, (knots, (0, 2, 2), knots, knots, (m + 1, 2, 2))))
    smooth_record(F, FRESH, block, rows, smoothed)
    for state in (0, MOVING - 1, MOVING, MOVING + 2, n - 1):
        step = np.zeros(n)
        step[state] = 1e-5
        slope = (likelihood(noise + step) - likelihood(noise - step)) / 2e-5
        found = 0.5 * np.sum(smoothed.pulls[1:, state] ** 2 - smoothed.informations[1:, state])
        np.testing.assert_allclose(found, slope, rtol=1e-5)
    np.testing.assert_allclose(smoothed.inside[:, 0, 0], smoothed.informations[:, MOVING])


SMALL = 1e-6


def test_an_accelerometer_feels_what_its_row_says() -> None:
    """Random motions of the body, changed a little at the middle of each interval; exact to second order."""
    rng, m, layout = np.random.default_rng(2), 3, Layout(2, mount=True)
    draw = rng.standard_normal
    none, time = np.zeros((m, 0)), np.arange(m + 1.0)
    A, push, x = draw((m, 6, layout.size)), SMALL * draw((m, 6)), SMALL * draw(layout.size)
    A[:, :, layout.mount_at] = 0.0  # where a sensor sits moves nothing
    ad_half, half, up = draw((m, 6, 6)), np.full((m, 1, 1), 0.5), draw((m, 3))
    here = LinearDynamics(none, none, A, push, none, none, none, half, ad_half, draw((m, 6)), draw((m, 6)), up)
    da = push + A @ x
    twist, pose = x[TWIST_ERROR] + 0.5 * da, ad_half @ x[POSE_ERROR] + 0.5 * x[TWIST_ERROR]
    there = here._replace(
        acceleration=0.0 * A,
        push=0.0 * push,
        middle_twist=here.middle_twist + twist,
        middle_acceleration=here.middle_acceleration + da,
        up=np.array([pin.exp3(-turn) @ one for turn, one in zip(pose[:, 3:], up, strict=True)]),
    )
    place, turn, mount = draw(3), pin.exp3(draw(3)), x[layout.mount_at]
    still = NominalMotion(time, none, none, none, none)
    k, middles, values = np.arange(m), time[:-1] + 0.5, draw((m, 3))

    def rows(d: LinearDynamics, place: np.ndarray, turn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        sensor = SensorSamples("accelerometer", middles, values, 1.0, place, turn)
        h, e, _ = ROWS_BY_SENSOR["accelerometer"](Sensed(sensor, layout, still, d, "none", k, middles, values))
        return h, e

    h, before = rows(here, place, turn)
    _, after = rows(there, place + mount[:3], turn @ pin.exp3(mount[3:]))
    np.testing.assert_allclose(before - after, h @ x - x[layout.accelerometer_bias], atol=1e3 * SMALL**2)


def test_joints_move_with_the_crank_as_their_derivatives_say() -> None:
    """Angles, rates and accelerations of the joints by those of the crank: difference quotients, to 1e-5."""
    series, crank = joint_series(load_aerobat().linkage), np.array([[0.7], [40.0], [900.0]])

    def joints(crank: np.ndarray) -> np.ndarray:
        return np.stack(wing_motion(wing_angles(series, crank[0]), *crank[1:, :, None]), axis=1).ravel()

    found = wings_by_crank(wing_angles(series, crank[0]), *crank[1:, :, None])[0]
    for column, step in enumerate((1e-5, 1e-3, 1e-3)):
        ahead, behind = (crank + sign * step * np.eye(3)[:, column : column + 1] for sign in (1.0, -1.0))
        slope = (joints(ahead) - joints(behind)) / (2.0 * step)
        np.testing.assert_allclose(found[:, column], slope, atol=1e-5 * np.abs(slope).max())


FRAMES = ("left_force_point", "right_force_point")
GIVEN = RawSection(
    walk=(0.005, 0.05, 0.01), bend=(3.0, 25.0, 25.0), white=(1e-3, 8e-3, 7e-3), alike=(5.0, 0.2, 5.0), crank_jerk=1.0
)  # as likelihood finds them
FREE = RawSection(walk=0.02, bend=0.1, white=1e-3, alike=1.0, crank_jerk=1.0)
SHORT = ("simulation.duration=0.9", "unknown_force.*.step_start=0.6")


@cache
def flight(*settings: str) -> tuple[aerobat.FlightLog, aerobat.Aerobat]:
    """Return the log of `raw_sensors` with settings, and its robot."""
    scenario = load_scenario("raw_sensors", [*SHORT, *settings])
    return simulate(scenario), aerobat.believed_robot(scenario)


def raw(log: aerobat.FlightLog, robot: aerobat.Aerobat, section: RawSection = GIVEN, torque="measured") -> RawRecord:
    """Return the raw samples of a flight."""
    return raw_record(log.time, aerobat.flight_channels(log, robot), robot, torque, section)


def smoother_of(robot: aerobat.Aerobat, section: RawSection) -> JointSmoother:
    """Return a smoother for flights of `raw_sensors`."""
    return JointSmoother(robot, load_scenario("raw_sensors").believed_air, FRAMES, section)


@cache
def smoothed(torque: str, *settings: str) -> tuple[JointSmoother, RawRecord, JointEstimate]:
    """Return smoother, record and estimate of a flight, with given walks."""
    log, robot = flight(*settings)
    record, smoother = raw(log, robot, torque=torque), smoother_of(robot, GIVEN)
    return smoother, record, smoother.run(record)


def truth(log: aerobat.FlightLog) -> np.ndarray:
    """Return the true forces without noise (m, 2, 3)."""
    points = [str(point) for point in log.truth["point"].values]
    return log.truth["force_noise_free_W"].values[:, [points.index(frame) for frame in FRAMES]]


def worst_r2(force: np.ndarray, true: np.ndarray) -> np.ndarray:
    """Return R2 of Fx, Fy, Fz of the worse wing."""
    pairs = ((force[:, i, k].copy(), true[:, i, k].copy()) for k in range(3) for i in range(2))
    return np.reshape([r_squared(*pair) or 0.0 for pair in pairs], (3, 2)).min(axis=1)


def test_forces_motion_and_biases_are_found_with_an_accelerometer() -> None:
    """R2 of the worse wing; velocity to 2 mm/s where splines miss 40; biases as the sensors have them."""
    log, _ = flight()
    _, _, found = smoothed("measured")
    assert found.settled
    assert np.all(worst_r2(found.force, truth(log)) > [0.95, 0.99, 0.99])
    error = found.nominal.twist - log.truth["v"].values[:, :6]
    assert np.sqrt(np.mean(error[:, :3] ** 2)) < 2e-3
    np.testing.assert_allclose(found.bias[:3], [0.002, -0.002, 0.002], atol=2e-3)  # yaw: 130 poses of 3 mrad
    np.testing.assert_allclose(found.bias[3:], [0.05, -0.05, 0.05], atol=0.01)
    assert not any(one.sure for one in found.offsets)
    assert all(0.7 < ratio < 1.3 for ratio in found.nis.values())


def test_deviations_cover_the_errors() -> None:
    """On the shipped flight: normalised error squared from .2 to 1.5, mean deviation at most twice the rms error."""
    log, _ = flight()
    _, _, found = smoothed("measured")
    error = (found.force - truth(log)).reshape(len(found.force), -1)
    nees = np.einsum("ki,kij,kj->k", error, np.linalg.inv(found.force_covariance), error) / error.shape[1]
    assert np.linalg.eigvalsh(found.force_covariance).min() > 0.0
    stated = np.sqrt(np.einsum("kii->ki", found.force_covariance)).mean(axis=0)
    assert 0.2 < np.mean(nees) < 1.5
    assert np.all(stated < 2.0 * np.sqrt(np.mean(error**2, axis=0)))


def test_motion_capture_may_begin_later_and_lose_the_robot_for_a_while() -> None:
    """From 0.1 s on, and not from 0.4 to 0.6 s: the other sensors carry the motion through, and forces are as good."""
    log, robot = flight()
    at = log.measured["mocap_time"].values
    seen = np.flatnonzero((at > 0.1) & ((at < 0.4) | (at > 0.6)))
    found = smoother_of(robot, GIVEN).run(raw(aerobat.FlightLog(log.measured.isel(mocap_time=seen)), robot))
    assert found.settled
    assert np.all(worst_r2(found.force, truth(log)) > [0.95, 0.99, 0.99])


def test_the_likelihood_finds_the_noise_the_step_and_what_the_wings_have_in_common() -> None:
    """Of each force: 10 mN of noise, 0.15 N at 0.6 s, both wings alike along z and mirrored along y."""
    (log, robot), settings = flight(), RawSection(offset_error=0.0)
    found = smoother_of(robot, settings).run(raw(log, robot, settings))
    assert found.jumps == pytest.approx([0.601])
    assert np.linalg.norm(found.tuning.white) == pytest.approx(0.01, rel=0.15)
    assert found.tuning.alike[1] < 0.4
    assert found.tuning.alike[2] > 2.5
    assert any("jump at 0.601 s" in note for note in notes_of(found))
    assert not np.any(free_logs(settings, points=1)[9:12])  # one force has nothing in common with others


def test_without_an_accelerometer_and_with_the_motor_alone() -> None:
    """Less is known, and less is found: Fy and Fz."""
    log, _ = flight("sensors.accelerometer=none")
    _, _, found = smoothed("motor_only", "sensors.accelerometer=none")
    assert np.all(worst_r2(found.force, truth(log))[1:] > 0.97)


def linearised() -> tuple[LinearRecord, Prior, Tuning]:
    """Return 0.3 s of the flight, linearised about their smoothed motion."""
    smoother, record, found = smoothed("measured")
    motion = found.nominal
    prior = first_prior(smoother.layout, first_guess(record), smoother.weight, GIVEN)
    air, no_jumps = smoother.air.fly(motion), np.zeros(len(found.force))
    linear = smoother.linear(record, motion, air, found.force, smoother.layout, no_jumps)
    return linear, prior, found.tuning


def test_deviations_are_true_on_truths_of_the_own_model() -> None:
    """Filter and smoother on drawn truths: normalised error squared 1, coverage of 95 %, each within 5 %."""
    linear, prior, tuning = linearised()
    drawn = [own_model_errors(linear, prior, tuning, np.random.default_rng(seed)) for seed in range(4)]
    for name in ("filter", "smoother"):
        assert np.mean([one[f"{name}_nees"] for one in drawn]) == pytest.approx(1.0, abs=0.06)
        assert np.mean([np.abs(one[f"{name}_z"]) < 1.96 for one in drawn]) == pytest.approx(0.95, abs=0.02)


def test_dynamics_are_the_derivative_of_what_they_linearise() -> None:
    """A small error of pose and twist changes the acceleration under air and forces as its rows say."""
    smoother, record, found = smoothed("measured")
    part, rng = found.nominal.part(100, 110), np.random.default_rng(3)
    known, force = record.known[100:110], found.force[100:110]
    air = smoother.air.fly(part)
    held = AirForces(air.force, air.added_mass, np.zeros_like(air.by_twist))  # not moved with the motion below
    x = np.zeros((11, 15))
    x[:, :12] = 1e-5 * rng.standard_normal(12)  # the same error at both ends of every interval
    state = np.zeros(smoother.layout.size)
    state[:12] = x[0, :12]

    def accelerations(motion: NominalMotion) -> tuple[np.ndarray, np.ndarray]:
        made = smoother.dynamics(motion, held, known, force)
        rows = made.acceleration
        white = rows[:, :, smoother.layout.white]
        return made.push + np.einsum("kij,kj->ki", white, force.reshape(10, -1)), rows @ state

    (here, change), (there, _) = accelerations(part), accelerations(part.moved(x))
    np.testing.assert_allclose(there - here, change, atol=0.02 * np.abs(change).max())


def with_raw(section: RawSection, *settings: str) -> Scenario:
    """Return the scenario `raw_sensors` with settings of raw samples."""
    scenario = load_scenario("raw_sensors", [*settings, *SHORT])
    return scenario.model_copy(update={"observers": scenario.observers.model_copy(update={"raw": section})})


def test_a_late_gyro_is_named_and_not_corrected_in_silence() -> None:
    """One millisecond: found within 0.4 ms; applied on request only, then for the causal filter, too."""
    _, _, found = smoothed("measured", "sensors.gyro.delay=0.001")
    [late] = [one for one in found.offsets if one.sure]
    assert late.sensor == "gyro"
    assert late.seconds == pytest.approx(1e-3, abs=4e-4)
    log, robot = flight("sensors.gyro.delay=0.001")
    asked = with_raw(GIVEN.model_copy(update={"apply_offsets": True}), 'observers.names=["smoother", "kalman"]')
    mended = aerobat.estimate_flight(log, robot, asked).estimates
    forces = (found.force, mended["smoother"].force, mended["kalman"].force[100:])
    before, after, filtered = (worst_r2(force, truth(log)[-len(force) :])[0] for force in forces)
    assert before < 0.9 < min(after, filtered)
    for lines, told in (
        (warnings_of(found), "; not applied: observers.raw.apply_offsets"),
        (mended["smoother"].warnings, "; applied: observers.raw.apply_offsets"),
    ):
        [line] = [line for line in lines if line.startswith("late channel: gyro is ")]
        assert line.endswith(told)


@cache
def followed() -> tuple[JointFilter, list[Any]]:
    """Return a causal filter, and what it finds in the first 0.65 s."""
    smoother, record, found = smoothed("measured")
    stream = JointFilter(smoother, found.tuning, record.channels, "measured")
    return stream, stream.run(RawRecord(record.time[:651], record.channels, record.known[:650], "measured"))


def test_the_causal_filter_takes_one_set_of_samples_after_the_other() -> None:
    """It starts with the eighth pose, then follows the forces; late and unknown samples are refused."""
    (log, _), (_, record, _), (stream, samples) = flight(), smoothed("measured"), followed()
    first = next(k for k, sample in enumerate(samples) if sample is not None)
    assert record.time[first] == pytest.approx(0.07, abs=2e-3)
    force = np.array([sample.force for sample in samples[101:401] if sample is not None])
    assert np.all(worst_r2(force, truth(log)[100:400])[1:] > 0.97)
    with pytest.raises(ObserverError, match="no sensor 'sonar'"):
        stream.update(0.651, {"sonar": [1.0]})
    with pytest.raises(ObserverError, match=r"gyro is stamped 0\.3 s"):
        stream.update(0.651, {"gyro": (0.3, [0.0, 0.0, 0.0])})
    with pytest.raises(ObserverError, match="a later one was expected"):
        stream.update(0.3, {})


def test_what_a_caller_does_after_an_update_does_not_move_the_causal_filter() -> None:
    """He writes into the arrays that he gave, and smooths; what is no number is refused, and nothing of it is taken."""

    class Reused(JointFilter):
        def update(self, time: float, samples: Any, known: Any = None) -> Any:
            given = {name: (stamp, values.copy()) for name, (stamp, values) in samples.items()}
            lost = np.full_like(known, np.nan)
            with pytest.raises(ObserverError, match="known: 10 finite numbers"):
                super().update(time, given, lost)
            lost[:] = known
            found = super().update(time, given, lost)
            for array in (lost, *(values for _, values in given.values())):
                array[:] = 1.0
            if self.started and time > 0.0895:
                self.smoother.air.fly(motion)
            return found

    (smoother, record, found), (_, samples) = smoothed("measured"), followed()
    motion = found.nominal.part(300, 310)
    stream = Reused(smoother, found.tuning, record.channels, "measured")
    last = stream.run(RawRecord(record.time[:101], record.channels, record.known[:100], "measured"))[-1]
    np.testing.assert_array_equal(last.force, samples[100].force)


@pytest.mark.parametrize(("sensor", "missed"), [("crank", (0.0, 0.1)), ("orientation", (0.015, 0.045))])
def test_the_causal_filter_waits_for_what_begins_late_or_is_lost(sensor: str, missed: tuple[float, float]) -> None:
    """For an encoder; for attitudes of a marker whose position was seen all the time."""
    smoother, record, found = smoothed("measured")
    one = record.channels[sensor]
    seen = (one.time < missed[0]) | (one.time > missed[1])
    channels = {**record.channels, sensor: replace(one, time=one.time[seen], values=one.values[seen])}
    stream = JointFilter(smoother, found.tuning, channels, "measured")
    samples = stream.run(RawRecord(record.time[:121], channels, record.known[:120], "measured"))
    assert next(k for k, sample in enumerate(samples) if sample is not None) == (110 if sensor == "crank" else 100)


def test_the_air_of_the_causal_filter_stays_finite_where_the_flight_gets_faster() -> None:
    """From 1 m/s without flaps to 8 m/s, sinking at 0.2 m/s: an attached wing has pi rho U w S of lift, below 0.5 N."""
    scenario = load_scenario("paper", ["air.strips=32"])
    air, crank = AirAboutNominal(load_aerobat(), scenario.believed_air), np.zeros((2, 3))

    def motion(k: int) -> NominalMotion:
        twist = np.zeros((2, 6))
        twist[:, 0], twist[:, 2] = np.minimum(1.0 + 0.1 * np.array([k, k + 1]), 8.0), -0.2
        return NominalMotion(0.01 * np.array([k, k + 1]), np.tile(np.eye(3), (2, 1, 1)), np.zeros((2, 3)), twist, crank)

    air.begin(motion(0))
    assert max(np.abs(air.go_on(motion(k)).force).max() for k in range(1, 150)) < 0.5


def test_samples_of_the_first_instant_count_in_unix_time() -> None:
    """Its doubles are 2.4e-7 s apart: the causal filter started with the ninth pose."""
    smoother, record, found = smoothed("measured")
    late = record.shifted(dict.fromkeys(record.channels, -1.7e9))
    late = replace(late, time=record.time[:81] + 1.7e9, known=record.known[:80])
    samples = JointFilter(smoother, found.tuning, late.channels, "measured").run(late)
    assert next(k for k, sample in enumerate(samples) if sample is not None) == 70
    motion, still = first_guess(late), np.zeros((80, 2, 3))
    linear = smoother.linear(late, motion, smoother.air.fly(motion), still, smoother.layout, np.zeros(80))
    assert linear.rows.start[1] == 17  # pose, inertial unit, encoder and torques


def test_the_causal_filter_lets_a_force_jump() -> None:
    """The step of 0.15 N at 0.6 s is there after 3 ms, within 20 mN."""
    (log, _), (_, record, _), (_, samples) = flight(), smoothed("measured"), followed()
    at = int(np.searchsorted(record.time, 0.6025))
    last = samples[at + 1]
    np.testing.assert_allclose(last.force, truth(log)[at], atol=0.02)
    assert np.abs(truth(log)[at] - truth(log)[at - 5]).max() > 0.1


@pytest.mark.parametrize(("by", "begin", "start"), [(40, 0, 110), (10, 55, 140)])
def test_poses_may_come_late_to_the_causal_filter(by: int, begin: int, start: int) -> None:
    """By so many ms: carried along its motion they say it at once; poses given twice or before the first are left."""
    smoother, record, found = smoothed("measured")
    stream, waiting = JointFilter(smoother, found.tuning, record.channels, "measured"), []
    found_at: dict[int, Any] = {}
    for k in range(start + 181):
        samples = {}
        for name, channel in record.channels.items():
            use = (channel.time <= record.time[k] + 1e-9) & (channel.time > record.time[max(k - 1, 0)] + 1e-9 * (k > 0))
            if np.any(use | ((k == 0) & (channel.time <= 1e-9))):
                at = int(np.flatnonzero(channel.time <= record.time[k] + 1e-9)[-1])
                samples[name] = float(channel.time[at]), channel.values[at]
        waiting.append({name: samples.pop(name) for name in ("position", "orientation") if name in samples})
        if k < begin:
            continue
        if k > max(begin, by) and k % 10 == 1:
            with pytest.raises(ObserverError, match="position is stamped"):
                stream.update(float(record.time[k]), samples | waiting[-2 - by])
        samples |= waiting[-1 - by] if k >= by else {}
        found_at[k] = stream.update(float(record.time[k]), samples, record.known[max(k - 1, 0)])
    assert next(k for k, sample in found_at.items() if sample is not None) == start
    late, last = found_at[k], followed()[1][k]
    np.testing.assert_allclose(late.placement[:3], last.placement[:3], atol=1e-3)
    np.testing.assert_allclose(late.twist[:3], last.twist[:3], atol=5e-3)
    np.testing.assert_allclose(late.force, last.force, atol=0.01)
    with pytest.raises(ObserverError, match="position is stamped"):
        stream.update(0.001 * (k + 1), {"position": (0.001 * k - 0.1, np.zeros(3))})


def test_long_records_are_smoothed_in_parts_that_overlap_and_leave_no_gap() -> None:
    """Whatever the length, a part has at most 5.6 s; the parts' kept knots follow each other."""
    for seconds in (3.0, 5.4, 5.7, 20.0):
        time = np.arange(0.0, seconds + 5e-4, 1e-3)
        parts = list(stretches(time))
        assert all(time[part.stop] - time[part.start] < 5.7 for part in parts)
        assert (parts[0].first, parts[-1].last) == (0, len(time) - 1)
        for one, other in itertools.pairwise(parts):
            assert one.last == other.first
            assert one.next == other.start < other.first
        assert (len(parts) > 1) == (seconds > 5.6)
        at, sensor = 0.5 * (time[1:] + time[:-1]), SensorSamples("gyro", time, time, 1.0, np.zeros(3), np.eye(3))
        channels = {"gyro": sensor, "torque": replace(sensor, time=at, values=at)}
        record = RawRecord(time, channels, np.zeros((len(at), 10)), "measured")
        for part in parts[1:]:  # the prior of the first knot has seen what follows it up to the next
            used = part_of(record, part.start, part.stop).channels
            assert [used[name].time[0] for name in used] == [time[part.start + 1], at[part.start + 1]]


@pytest.mark.parametrize("sensor", ["orientation", "accelerometer"])
def test_a_part_of_a_long_record_may_lack_all_samples_of_a_sensor(sensor: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Attitudes were a traceback, and samples that are not there "nan times as far from their prediction"."""
    (log, robot), (_, record, _) = flight(), smoothed("measured")  # whole: others use it, too
    for name, seconds in (("LONGEST_STRETCH", 0.4), ("LATE_PART", 0.06), ("EARLY_PART", 0.03)):
        monkeypatch.setattr(f"aerobat_pin.aerobat.raw.channels.{name}", seconds)
    one = record.channels[sensor]
    late = replace(one, time=one.time[one.time > 0.45], values=one.values[one.time > 0.45])
    smoother = smoother_of(robot, GIVEN.model_copy(update={"offset_error": 0.0}))
    found = smoother.run(replace(record, channels={**record.channels, sensor: late}))
    assert warnings_of(found) == []
    assert np.all(worst_r2(found.force, truth(log))[1:] > 0.98)


def test_a_window_keeps_nothing_of_its_covariances() -> None:
    """Else the memory of a long record would grow by some 100 MB for each window."""
    smoother, record, found = smoothed("measured")
    part = part_of(record, 0, 200)
    prior = first_prior(smoother.layout, found.nominal, smoother.weight, GIVEN)
    solved = smoother.solve(part, found.nominal.part(0, 200), prior, found.tuning)
    kept = solved.kept(next(stretches(part.time)))
    for values in (kept.force, kept.force_covariance, kept.innovation):
        whole = values if values.base is None else values.base
        assert whole.nbytes < 40 * 8 * len(part.time)


def test_the_place_and_turn_of_the_accelerometer_are_learnt_from_a_free_flight() -> None:
    """Within 1 mm and .3 degrees, kept in the file of a calibration, and Fx is what it is with the true ones."""
    where = ("sensors.accelerometer.place=[0.005,0,0]", "sensors.accelerometer.turn_deg=[0.5,0.5,0.5]")

    def unaware(*settings: str) -> tuple[aerobat.FlightLog, aerobat.Aerobat]:
        log, robot = flight(*where, *settings)
        place = log.measured["accelerometer"].assign_attrs(place=[0.0] * 3, turn_deg=[0.0] * 3)
        return aerobat.FlightLog(log.measured.assign(accelerometer=place), log.truth), robot

    log, robot = unaware("unknown_force=[]", "flight.angular_velocity=[6,0,6]")
    air = load_scenario("raw_sensors").believed_air
    believed = replace(aerobat.AerobatRobot.of(robot, air), raw=FREE)
    free = aerobat.free_record(log, believed, ObserverSection(frames=FRAMES), "free")
    learnt = calibrate([free])
    with TemporaryDirectory() as folder:
        file = Path(folder, "hall.nc")
        file.write_bytes(calibration_bytes(learnt))
        again = read_calibration(file)
    mount = again.believed(believed).mount
    np.testing.assert_allclose(mount.place, [0.005, 0.0, 0.0], atol=1e-3)
    true = pin.rpy.rpyToMatrix(*np.radians([0.5] * 3))
    assert np.all(np.abs(np.degrees(pin.log3(true.T @ mount.turn))) < 0.3)
    pushed, robot = unaware()
    smoother = smoother_of(robot, GIVEN.model_copy(update={"offset_error": 0.0}))
    found = smoother.run(mounted(raw(pushed, robot), mount))
    _, _, exact = smoothed("measured")
    assert worst_r2(found.force, truth(pushed))[0] > worst_r2(exact.force, truth(flight()[0]))[0] - 0.01
    with pytest.raises(CalibrationError, match="'mass' cannot be learnt from these records: only accelerometer_place"):
        calibrate([free], parameters=["mass"])
    bent = replace(again, extras={**again.extras, "accelerometer_turn": 2.0 * mount.turn})
    with pytest.raises(CalibrationError, match="a rotation matrix was expected"):
        bent.applied(free)


def test_flights_that_do_not_show_a_place_do_not_show_it_together(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is expected beforehand, which the estimate of each has, counts once."""
    monkeypatch.setattr(importlib.import_module("aerobat_pin.aerobat.raw.find_mount"), "ROUNDS", 1)
    (log, robot), air = flight(), load_scenario("raw_sensors").believed_air
    record = part_of(raw(log, robot, FREE), 0, 120)
    one, three = (find_mount([record] * n, robot, air, FRAMES, FREE).covariance for n in (1, 3))
    before = np.diag(np.square(MOUNT_PRIOR) ** -1.0)
    wanted = np.linalg.inv(before + 3.0 * (np.linalg.inv(one) - before))
    np.testing.assert_allclose(np.sqrt(np.diag(three)), np.sqrt(np.diag(wanted)), rtol=0.02)


def test_without_torque_the_split_between_the_wings_is_refused() -> None:
    scenario = with_raw(GIVEN, "observers.torque=none", 'observers.names=["smoother"]')
    log, robot = flight()
    result = aerobat.estimate_flight(log, robot, scenario)
    estimate = result.estimates["smoother"]
    assert estimate.frames == ("sum",)
    assert estimate.force.shape[1:] == (1, 3)
    total = truth(log).sum(axis=1)
    assert (r_squared(estimate.force[:, 0, 2].copy(), total[:, 2].copy()) or 0.0) > 0.98
    assert (result.observers["smoother"].points["sum"]["Fz"].r2 or 0.0) > 0.98
    assert any("split" in line for line in estimate.warnings)


def test_what_raw_samples_do_not_allow_is_refused_in_a_line() -> None:
    """Observers that need q and v, no frame, a missing encoder, a torque that is not there, a time that comes twice."""
    log, robot = flight()
    twice = log.time.copy()
    twice[300] = twice[299]
    with pytest.raises(LogError, match=r"time, sample 300 = 0\.299 s: time must be finite and rise"):
        aerobat.FlightLog(log.measured.drop_dims("interval").assign_coords(time=twice))
    with pytest.raises(ScenarioError, match="momentum needs q and v, and the log has raw samples"):
        aerobat.estimate_flight(log, robot, load_scenario("raw_sensors", ['observers.names=["momentum"]']))
    pointless = with_raw(GIVEN, "observers.frames=[]", 'observers.names=["smoother"]')
    with pytest.raises(ScenarioError, match=r"observers\.frames = \[\]: raw samples show forces at frames"):
        aerobat.estimate_flight(log, robot, pointless)
    blind = aerobat.FlightLog(log.measured.drop_vars(["encoder", "encoder_time"]), log.truth)
    with pytest.raises(LogError, match="no channel named encoder"):
        raw(blind, robot)
    limp = aerobat.FlightLog(log.measured.drop_vars(["joint_torque_sample", "torque_time"]), log.truth)
    with pytest.raises(LogError, match="no channel named joint_torque_sample"):
        raw(limp, robot)
    with pytest.raises(ScenarioError, match="only a raw log has this sensor"):
        load_scenario("raw_sensors", ["sensors.motion_capture=none"])


def test_misread_and_held_samples_are_named() -> None:
    """By checks of recordings, which find these in raw samples, too; nothing on a clean flight."""
    log, robot = flight()

    def warned(flown: aerobat.FlightLog) -> list[str]:
        seen_by = aerobat.AerobatRobot.of(robot, load_scenario("raw_sensors").believed_air)
        found = record_findings(aerobat.flight_record(flown, seen_by))
        return [str(one) for one in found if one.verdict in ("warning", "refused")]

    def changed(name: str, values: np.ndarray) -> str:
        data = log.measured[name]
        made = aerobat.FlightLog(log.measured.assign({name: (data.dims, values, data.attrs)}))
        return " | ".join(warned(made))

    seen, gyro = log.measured["mocap_quaternion"].values, log.measured["gyro"].values
    assert warned(log) == []
    assert "seem to be w, x, y, z, body to world" in changed("mocap_quaternion", seen[:, [3, 0, 1, 2]])
    assert "held channel: gyro changes only 100 times" in changed("gyro", gyro[(np.arange(len(gyro)) // 10) * 10])
    slow, at = np.arange(0, len(gyro), 10), np.arange(len(gyro))
    lines = np.column_stack([np.interp(at, slow, column[slow]) for column in gyro.T])
    assert "interpolated channel" in changed("gyro", lines)


def test_a_run_of_raw_sensors_becomes_mcap(tmp_path: Path) -> None:
    """By its true motion, as its log has no pose; it was refused."""
    reader = pytest.importorskip("rosbags.highlevel")
    log, robot = flight()
    none = xr.Dataset(coords={"observer": np.array([], str), "point": np.array([], str)})
    write_flight_mcap(robot.model, log, none, tmp_path / "raw.mcap")
    with reader.AnyReader([tmp_path / "raw.mcap"]) as bag:
        counts = {link.topic: link.msgcount for link in bag.connections}
    assert counts["/pose"] == counts["/joint_states"] == len(log.time) - 1
