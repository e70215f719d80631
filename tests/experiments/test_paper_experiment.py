"""The paper's experiment: the flight it shows, forces found better than it reports; names and units of results."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from support.arm import arm
from support.further import further
from support.kernel_cases import record
from support.shipped import flown

from aerobat_pin.aerobat.flight_log import true_force
from aerobat_pin.aerobat.flight_record import known_inputs
from aerobat_pin.experiments import Experiment, beside_pd, run
from aerobat_pin.experiments.write_results import estimate_dataset, estimate_table
from aerobat_pin.flight import Plant
from aerobat_pin.forces.scores import FORCE_AXES, r_squared
from aerobat_pin.observers import OBSERVERS, Application, ForceLevelObserver, KalmanObserver
from aerobat_pin.scenario import load_scenario
from aerobat_pin.visualization.result_pages import report_html


def scores(experiment: Experiment, key: str = "r2") -> dict[tuple[str, str, str], float]:
    """Return one figure of every observer, wing and axis."""
    return {
        (observer, wing, axis): experiment.metrics["observers"][observer][wing][axis][key]
        for observer in experiment.estimates
        for wing in ("left", "right")
        for axis in FORCE_AXES
    }


def test_every_axis_is_found_better_than_in_the_paper(paper: Experiment) -> None:
    """R2 against the noisy truth at K = 2000 1/s: 0.9992 or more everywhere; the paper has 0.7448, 0.9970, 0.9991."""
    for (_, _, axis), r2 in scores(paper).items():
        assert r2 >= 0.9992
        assert r2 > {"Fx": 0.7448, "Fy": 0.9970, "Fz": 0.9991}[axis]  # the paper, section IV
    for (_, _, axis), rmse in scores(paper, "rmse").items():
        assert rmse < {"Fx": 0.3e-3, "Fy": 2.0e-3, "Fz": 2.0e-3}[axis]


@pytest.mark.parametrize("seed", further(2, 3))
def test_other_seeds_tell_the_same_story(seed: int) -> None:
    """The figures are no luck of one noise sequence."""
    experiment = run(load_scenario("paper", [f"simulation.seed={seed}"]))
    assert min(scores(experiment).values()) >= 0.9992


def test_the_flight_is_the_papers(paper: Experiment) -> None:
    """Steady forward flight for two seconds, small Euler angles, a height that follows the flapping (Figs. 5, 6)."""
    flight = paper.metrics["flight"]
    x, y, _ = flight["position_end"]
    assert abs(x - 5.96) < 0.3
    assert abs(y) < 0.05
    assert max(np.abs(flight["z_range"])) < 0.15
    low, high = np.degrees(flight["pitch_range"])
    assert low > 0.0
    assert high < 11.0
    assert max(np.abs(np.degrees(flight["roll_range"]))) < 2.0
    assert max(np.abs(np.degrees(flight["yaw_range"]))) < 2.0


def test_the_flight_says_what_holds_it(paper: Experiment) -> None:
    """The hold's constant lift is 0.711 N of 0.904 N weight; the measured mean of air, hold and push is the weight."""
    assert paper.metrics["note"] == "attitude held, 79 % thruster-borne"
    flight = paper.metrics["flight"]
    weight = paper.robot.mass * 9.81
    pushed = sum(true_force(paper.log, frame)[0][:, 2].mean() for frame in ("left_force_point", "right_force_point"))
    total = flight["thrusters_lift_over_weight"] + flight["aerodynamic_lift_over_weight"] + pushed / weight
    # What is missing accelerates the robot: its mean vertical acceleration is the change of velocity over 2 s.
    assert total == pytest.approx(1.0, abs=0.02)


def test_the_unknown_force_along_the_wing_normal_has_a_small_fore_aft_part(paper: Experiment) -> None:
    """Why an error floor that spares Fy and Fz can cost Fx its R2: its part of the force is ten times smaller."""
    force, _ = true_force(paper.log, "left_force_point")
    std = force.std(axis=0)
    assert std[0] < 0.012
    assert std[1] > 0.09
    assert std[2] > 0.08


def test_the_noise_of_the_two_wings_is_not_the_same(paper: Experiment) -> None:
    """Independent draws: 2000 samples of each correlate by less than four standard errors."""
    noise = (paper.log.truth["force_W"] - paper.log.truth["force_noise_free_W"]).values
    left, right = np.sign(noise[:, 0, 2]), np.sign(noise[:, 1, 2])  # normals of both wings point up alike
    assert abs(float(np.mean(left * right))) < 4.0 / np.sqrt(2000.0)


def test_a_flight_of_one_interval_is_a_result() -> None:
    """Its one effort is neither stuck nor dead."""
    experiment = run(load_scenario("paper", ["simulation.duration=0.001", "air.strips=4", "air.warm_up_cycles=1"]))
    assert len(experiment.log.time) == 2
    assert all(np.isfinite(estimate.components).all() for estimate in experiment.estimates.values())


def test_the_observers_use_the_gravity_of_the_scenario() -> None:
    """On a world of 3.7 m/s2 the forces are found as well; with 9.81 an observer would see a force of 0.56 N."""
    experiment = run(load_scenario("paper", ["flight.gravity=3.7", "simulation.duration=0.3"]))
    assert max(scores(experiment, "rmse").values()) < 3e-3


@pytest.fixture(scope="module", params=[1, *further(2)])
def benchmark(request: pytest.FixtureRequest) -> Experiment:
    settings = [f"simulation.seed={request.param}"]
    return flown("observer_benchmark") if request.param == 1 else run(load_scenario("observer_benchmark", settings))


def rerun(experiment: Experiment, gain: float) -> dict[str, np.ndarray]:
    """Estimate again from the same log with another gain; R2 (wing, axis) by observer."""
    inputs = known_inputs(experiment.log, experiment.robot)
    found = {}
    for name, kind in OBSERVERS.items():
        frames = experiment.scenario.observers.frames
        observer = kind(experiment.robot.model, frames, gain)
        estimate = observer.run(inputs.time, inputs.q, inputs.v, inputs.tau, inputs.known)
        truth = [true_force(experiment.log, frame)[0] for frame in frames]
        wings = range(len(frames))
        found[name] = np.array([[r_squared(estimate.force[:, i, k], truth[i][:, k]) for k in range(3)] for i in wings])
    return found


def test_the_benchmark_reaches_its_figures_on_every_wing_and_axis(benchmark: Experiment) -> None:
    """Exact model, noisy truth: what a correct first-order observer attains at K = 1000 and 2000 1/s."""
    slow, fast = rerun(benchmark, 1000.0), rerun(benchmark, 2000.0)
    assert slow["force_level"].min() >= 0.998
    assert slow["momentum"].min() >= 0.997
    assert fast["force_level"].min() >= 0.9995
    assert fast["momentum"].min() >= 0.9995


def test_at_low_gain_filtering_the_force_beats_filtering_the_generalised_residual(benchmark: Experiment) -> None:
    """At K = 100 1/s the wings turn faster than the filter follows: projecting first wins on every axis."""
    found = rerun(benchmark, 100.0)
    assert np.all(found["force_level"] > found["momentum"])
    assert np.ptp(found["force_level"]) < 0.005  # one lag for all, whatever the geometry


def test_moments_are_not_called_newtons_in_the_files_of_an_estimate(tmp_path: Path) -> None:
    """A wrench in frame axes beside a force along a line: text and NetCDF hold every component with its own unit."""
    model, _ = arm()
    elbow = model.names[3]
    there = [Application("tool", "wrench", "frame"), Application(elbow, direction=(0.0, 1.0, 0.0))]
    time, q, v, tau, known = record(model)
    both = [kind(model, there).run(time, q, v, tau, known) for kind in (ForceLevelObserver, KalmanObserver)]
    estimates = {one.observer: one for one in both}
    header, *rows = estimate_table(estimates, time[1:]).splitlines()
    table = dict(zip(header.split(","), np.array([row.split(",") for row in rows], float).T, strict=True))
    estimate_dataset(estimates).to_netcdf(tmp_path / "estimate.nc", engine="h5netcdf")
    found = xr.load_dataset(tmp_path / "estimate.nc", engine="h5netcdf")
    assert "force_W" not in found
    labels = [f"tool.{name}'" for name in ("Fx", "Fy", "Fz", "Mx", "My", "Mz")] + [f"{elbow}.along"]
    units = ["N"] * 3 + ["N m"] * 3 + ["N"]
    assert found["component"].values.tolist() == labels
    assert found["unit"].values.tolist() == units
    assert found["components"].attrs["units"] == "N, N m"
    for label, unit in zip(labels, units, strict=True):
        for one in both:
            one_label = {"observer": one.observer, "component": label}
            np.testing.assert_allclose(table[f"{one.observer}.{label} [{unit}]"], one.component(label), rtol=1e-8)
            np.testing.assert_array_equal(found["components"].sel(one_label), one.component(label))
        deviation = found["standard_deviation"].sel(observer="kalman", component=label)
        np.testing.assert_allclose(table[f"kalman.{label} deviation [{unit}]"], deviation, rtol=1e-8)
    assert np.all(np.isnan(found["standard_deviation"].sel(observer="force_level")))
    assert not any("force_level" in name and "deviation" in name for name in table)


def test_objects_show_themselves_in_a_few_lines(paper: Experiment, paper_plant: Plant) -> None:
    """Robot, linkage, air, plant and log: what it is, how large, which channels."""
    closure = paper.robot.linkage.solve(np.linspace(0.0, 1.0, 5))
    shown = {
        "Aerobat": (paper.robot, "92.1 g"),
        "Closure": (closure, "5 crank angles, t1 0.0 .. 57.3 deg"),
        "LiftingLine": (paper_plant.air.line, "16 strips"),
        "RobotAir": (paper_plant.air, "lifting_line"),
        "Plant": (paper_plant, "left_force_point"),
        "FlightLog": (paper.log, "2001 samples from 0 to 2 s"),
    }
    for name, (thing, part) in shown.items():
        text = repr(thing)
        assert text.startswith(f"{name}(")
        assert part in text
        assert text.count("\n") < 5
        assert len(text) < 600
    assert repr(paper.robot.linkage.solve(np.zeros(0))) == "Closure(no crank angle)"
    html = paper.log._repr_html_()
    assert "<td>crank_angle</td>" in html
    assert "<td>absolute crank angle t1</td>" in html


def test_a_closed_loop_says_how_far_off_it_was_and_pd_alone(paper: Experiment) -> None:
    """In metres and degrees, with saturation and margins; PD flies the same blow with the same noise."""
    short, *pd_alone = "simulation.duration=0.9", "control.feedforward=false", "control.integral=false"
    made = beside_pd(run(load_scenario("impact_closed_loop", [short])))
    alone = run(load_scenario("impact_closed_loop", [short, *pd_alone]))
    assert made.metrics["control"]["pd_rms"] == alone.flight.rms
    own, pd, effort = made.scores.notes
    assert own.startswith("off its course by ")
    assert own.endswith(" deg rms")
    assert pd.startswith("PD alone, in the same disturbance: ")
    assert "% of the commands at a limit; least margins: Ms 1." in effort
    assert "ms more delay (" in effort
    for line in made.scores.notes:
        assert line in repr(made.scores)
    assert "the same with PD alone, rms" in report_html(made, {})
    assert "no true force to compare with" in repr(made.scores)
    assert "no signal" not in repr(made.scores)
    assert beside_pd(alone).metrics["control"]["pd_rms"] is None
    assert beside_pd(paper) is paper, "a flight without a controller"
