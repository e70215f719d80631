"""Every shipped scenario flies and shows what its description says."""

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter
from support.commands import call
from support.shipped import flown

from aerobat_pin import aerobat
from aerobat_pin.experiments import run
from aerobat_pin.forces import point_label, r_squared
from aerobat_pin.scenario import load_scenario, shipped_scenarios

SHIPPED = shipped_scenarios()


def r2(name: str, observer: str, wing: str = "left") -> np.ndarray:
    """Return R2 of Fx, Fy, Fz; nan where there is no signal."""
    scores = flown(name).metrics["observers"][observer][wing]
    return np.array([np.nan if one["r2"] is None else one["r2"] for one in scores.values()])


def test_every_scenario_is_listed_with_a_line(capsys: pytest.CaptureFixture[str]) -> None:
    """`aerobat list`: name and description, which fits on a line."""
    assert call("list") == 0
    printed = capsys.readouterr().out
    assert all(name in printed for name in ("gain_noise", "aerobat_guard", "momentum", "force_level"))
    for name, description in SHIPPED.items():
        assert f"  {name:<20} {description}\n" in printed
        assert 20 < len(description) < 120
    needed = {"paper", "paper_left", "paper_open_loop", "observer_benchmark", "tumble", "gust", "impact", "guard"}
    needed |= {f"{name}_closed_loop" for name in ("paper_left", "gust", "impact", "hover")}
    assert needed | {"noisy_sensors", "model_error", "hover_start", "real_log_demo", "raw_sensors"} == set(SHIPPED)


@pytest.mark.parametrize("name", SHIPPED)
def test_every_scenario_flies_and_reports_finite_numbers(name: str) -> None:
    """Estimates everywhere finite, forces where the observers look, or a note that says where they do not."""
    experiment = flown(name)
    assert np.all(np.isfinite(experiment.drawn.measured["q"].values))
    for observer, estimate in experiment.estimates.items():
        assert np.all(np.isfinite(estimate.force))
        assert estimate.identifiability.rank == 3 * len(estimate.frames)
        for frame in estimate.frames:
            scores = experiment.metrics["observers"][observer][point_label(frame)]
            assert all(np.isfinite(one["rmse"]) for one in scores.values())
    assert "no observer looks" not in experiment.metrics["note"]
    assert not (experiment.scenario.sensors.raw and experiment.scores.advice)  # its observers have no gain


def test_no_shipped_flight_has_joints_or_efforts_that_are_misread() -> None:
    """A wrong belief of the air is no elbow of another zero, of which `model_error` and `noisy_sensors` were told."""
    joints = ("joint", "swapped joints", "effort", "known force", "mass", "late efforts")
    told = [one for name in SHIPPED for one in flown(name).metrics["warnings"] if one.startswith(joints)]
    assert told == []


def degrees(name: str, angle: str) -> np.ndarray:
    """Return the range of an angle [deg]."""
    return np.degrees(flown(name).metrics["flight"][f"{angle}_range"])


def test_a_force_on_the_left_wing_alone_drifts_the_robot_to_the_right() -> None:
    """The paper's Fig. 5: a steady shift toward negative Y while it flies on."""
    flight = flown("paper_left")
    assert -0.9 < flight.metrics["flight"]["position_end"][1] < -0.3
    y = flight.log.measured["q"].sel(q_axis="y").values
    assert y[500] > y[1000] > y[1600] > y[2000]
    for angle in ("roll", "yaw"):
        assert np.all(np.abs(degrees("paper_left", angle)) < 6.0)
    assert r2("paper_left", "force_level").min() > 0.999
    right = flight.metrics["observers"]["force_level"]["right"]
    assert all(one["r2"] is None and one["rmse"] < 1e-3 for one in right.values())


def test_the_open_loop_flight_stays_up_and_its_forces_are_found() -> None:
    """Trimmed, nothing held: bounded roll, yaw, pitch, height; what noise starts doubles in 0.44 s, 8 deg in 2 s."""
    flight = flown("paper_open_loop")
    assert flight.metrics["note"] == "free flight, nothing held"
    for angle, most in (("roll", 10.0), ("yaw", 10.0), ("pitch", 15.0)):
        assert np.all(np.abs(degrees("paper_open_loop", angle)) < most)
    assert np.max(np.abs(flight.metrics["flight"]["z_range"])) < 0.5
    decay = np.exp(-2000.0 * 1e-3)
    for i, wing in enumerate(("left", "right")):
        truth, _ = aerobat.true_force(flight.log, f"{wing}_force_point")
        filtered = lfilter([1.0 - decay], [1.0, -decay], truth, axis=0)  # the truth behind the observer's own lag
        strong = truth.std(axis=0) > 0.020
        for observer, estimate in flight.estimates.items():
            beyond = np.sqrt(np.mean((estimate.force[:, i] - filtered) ** 2, axis=0))
            assert np.all(np.where(strong, r2("paper_open_loop", observer, wing) >= 0.999, beyond < 0.5e-3))


def test_a_tumbling_robot_is_observed_as_well_as_a_flying_one() -> None:
    """It turns over, and R2 stays above 0.999 on every axis of both wings."""
    assert np.max(np.abs(degrees("tumble", "roll"))) > 90.0
    for observer in flown("tumble").estimates:
        for wing in ("left", "right"):
            assert r2("tumble", observer, wing).min() >= 0.999


def test_a_gust_that_is_not_believed_is_found_as_the_load_it_makes() -> None:
    """The residual is true air less the believed one, row by row; between them the wings ring in the gust's wake."""
    experiment = flown("gust")
    assert np.isnan(r2("gust", "momentum")).all()
    believed = experiment.scenario.believed_air
    assert not any(believed.gust.amplitude)
    robot = aerobat.believed_robot(experiment.scenario)
    known = aerobat.known_inputs(experiment.log, robot, "measured", believed).known
    truth = experiment.log.truth["aerodynamic"].values + experiment.log.truth["added_mass"].values
    missed = truth - known["aerodynamic"] - known["added_mass"]
    residual = experiment.estimates["momentum"].residual
    rows = missed.std(axis=0) > 1e-4
    assert list(np.flatnonzero(rows)) == [0, 2, 4, 6, 7, 8, 9]
    error = (residual - missed).std(axis=0)[rows] / missed.std(axis=0)[rows]
    assert np.all(error < 0.03)
    force = np.abs(experiment.estimates["force_level"].force)
    assert force[:690].max() < 1e-3
    assert force[700:1100].max() > 0.1
    assert force[1500:].max() < 1e-3


def test_a_blow_on_a_wing_is_found_on_that_wing_with_its_impulse_and_its_moment() -> None:
    """3 mN s downward at 0.7 to 0.71 s: the estimate's integral within 1 %, its peak within 3 ms."""
    experiment = flown("impact")
    for observer in ("momentum", "force_level"):
        force = experiment.estimates[observer].force
        np.testing.assert_allclose(force[650:800, 0].sum(axis=0) * 1e-3, [0.0, 0.0, -3e-3], atol=3e-5)
        np.testing.assert_allclose(force[650:800, 1].sum(axis=0) * 1e-3, 0.0, atol=3e-5)
        assert abs(int(np.argmin(force[:, 0, 2])) - 705) <= 3
        assert r2("impact", observer)[2] > 0.95
    true = aerobat.true_force(experiment.log, "left_force_point")[0]
    assert true[:, 2].min() == pytest.approx(-0.3 * np.pi / 2.0, rel=0.02)


def test_sensors_that_one_can_buy_find_two_axes_of_three() -> None:
    """Of the force on either wing Fy and Fz, much better with the smoother; of Fx, a tenth of it, less than half."""
    assert "imperfect sensors: position, attitude" in flown("noisy_sensors").metrics["note"]
    for wing in ("left", "right"):
        quick, smooth = (r2("noisy_sensors", observer, wing) for observer in ("force_level", "smoother"))
        assert quick[1:].min() > 0.7
        assert smooth[1:].min() > 0.96
        assert quick[0] < 0.0 < smooth[0] < 0.5


def test_a_wrong_model_costs_what_a_right_one_does_not() -> None:
    """Same flight, same gain: with the right model every axis above 0.99; with the wrong one Fz alone."""
    right = run(load_scenario("paper", ["observers.gain=1000.0"]))
    np.testing.assert_array_equal(right.log.measured["q"], flown("model_error").log.measured["q"])
    scores = right.metrics["observers"]["force_level"]["left"]
    assert min(one["r2"] for one in scores.values()) > 0.99
    wrong = r2("model_error", "force_level")
    assert 0.9 < wrong[2] < 0.99
    assert wrong[:2].max() < 0.5


def test_a_push_on_the_guard_is_found_where_the_observers_look() -> None:
    """All three components, peak 0.1 N along its direction; the robot gives way to the left."""
    for observer in ("momentum", "force_level"):
        assert r2("guard", observer, "thruster_1").min() > 0.99
    experiment = flown("guard")
    assert np.linalg.norm(experiment.estimates["momentum"].force[:, 0], axis=1).max() == pytest.approx(0.1, rel=0.02)
    assert experiment.metrics["flight"]["position_end"][1] > 0.1


def test_a_flight_begins_in_the_hover() -> None:
    """Wings still at first, turning after half a second, the robot where it was; forces found all the way."""
    experiment = flown("hover_start")
    assert "100 % thruster-borne" in experiment.metrics["note"]
    rate = np.gradient(experiment.log.measured["crank_angle"].values, experiment.log.time)
    assert abs(rate[0]) < 0.1
    np.testing.assert_allclose(rate[600:], 2.0 * np.pi * 4.75, rtol=1e-3)
    assert np.linalg.norm(experiment.metrics["flight"]["position_end"]) < 0.15
    for observer in ("momentum", "force_level"):
        assert r2("hover_start", observer).min() > 0.99


def test_a_flight_that_went_through_a_table_is_estimated_as_the_flight_itself(tmp_path: Path) -> None:
    """Written as CSV, read and estimated with the belief of the documents: R2 moves by less than 0.01."""
    experiment = flown("real_log_demo")
    aerobat.write_csv(experiment.log, tmp_path / "hall.csv")
    log = aerobat.read_log(tmp_path / "hall.csv")
    assert log.truth is None
    settings = ["robot.changes.wing.offset_x=-0.060", "observers.gain=100"]
    settings += ["observers.smoother.sensor_noise=[0.05, 0.05, 0.3]", "observers.smoother.force_walk=0.3"]
    belief = aerobat.belief_about(log, "hall", "aerobat_guard", ["smoother"], settings)
    result = aerobat.estimate_flight(log, aerobat.believed_robot(belief), belief)
    inputs, found = result.inputs, result.estimates
    assert inputs["q"] == inputs["v"] == inputs["thrusters"] == "measured"
    assert inputs["aerodynamic"] == inputs["wind"] == "reconstructed"
    direct = r2("real_log_demo", "smoother")
    for axis in (1, 2):
        truth = aerobat.true_force(experiment.log, "left_force_point")[0][:, axis]
        score = r_squared(found["smoother"].force[:, 0, axis], truth)
        assert score > 0.9
        assert score == pytest.approx(direct[axis], abs=0.01)
