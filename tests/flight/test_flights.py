"""Trim of the open-loop flight, and what must be known of the joint torques."""

import numpy as np
import pytest

from aerobat_pin.aerobat import true_force
from aerobat_pin.errors import TrimError
from aerobat_pin.experiments import Experiment, run
from aerobat_pin.flight import find_trim, simulate
from aerobat_pin.scenario import load_scenario, scenario_toml

COARSE = ("simulation.dt=4e-3", "air.strips=2")  # which a trim is found with in a third of the time


def fly(name: str, *settings: str) -> Experiment:
    return run(load_scenario(name, settings))


def r2(experiment: Experiment, observer: str, wing: str = "left") -> np.ndarray:
    """Return R2 of Fx, Fy, Fz."""
    scores = experiment.metrics["observers"][observer][wing].values()
    return np.array([one["r2"] for one in scores if isinstance(one, dict)])


def test_a_trimmed_flight_repeats_itself_every_flap() -> None:
    """Without noise and step the trimmed robot keeps its height within a body's height for 2 s, open loop."""
    # Floquet: heading and height are neutral, longitudinal motion nearly so; drooped wings roll away.
    found = find_trim(load_scenario("paper_open_loop", ["crank.frequency=6.7", "flight.pitch_deg=10"]))
    assert found.residual < 1e-8
    assert found.scenario.crank.frequency == pytest.approx(6.5007, abs=1e-3)
    assert found.scenario.robot.changes["wing"]["offset_x"] == pytest.approx(-0.08375, abs=1e-5)
    assert found.scenario.flight.yaw_deg == pytest.approx(-3.0)
    size = np.abs(found.multipliers)
    assert 1.2 < size[0] < 1.3
    np.testing.assert_allclose(size[1:3], 1.0, atol=1e-4)
    assert np.all(size[3:] < 1.0)
    assert 0.3 < found.time_to_double < 0.6
    still = [f"unknown_force.{i}.{key}=0.0" for i in range(2) for key in ("noise", "step")]
    z = simulate(load_scenario("paper_open_loop", still)).measured["q"].sel(q_axis="z").values
    assert np.ptp(z) < 0.05
    assert "offset_x" in scenario_toml(found.scenario)


def test_a_trim_in_the_wind_is_that_in_still_air_seen_from_the_ground() -> None:
    """Galilei: along y at 4 m/s into 1 m/s of wind is along x at 5 m/s in still air; nose first across it is not."""
    into = ["flight.velocity=[0.0, 4.0, 0.0]", "air.wind=[0.0, -1.0, 0.0]"]
    gust = "air.gust={amplitude = [0.0, 0.0, 1.0], start = 0.0, duration = 0.1}"
    sought = (load_scenario("paper_open_loop", [*COARSE, *settings]) for settings in ([], [*into, gust]))
    still, found = (find_trim(one).scenario for one in sought)
    assert found.crank.frequency == pytest.approx(still.crank.frequency, rel=1e-6)
    assert found.robot.changes["wing"]["offset_x"] == pytest.approx(still.robot.changes["wing"]["offset_x"], rel=1e-5)
    assert found.flight.pitch_deg == pytest.approx(still.flight.pitch_deg, rel=1e-6)
    assert found.flight.velocity == pytest.approx((0.0, 4.0, still.flight.velocity[2]), rel=1e-6)
    assert found.flight.yaw_deg == 90.0
    assert found.air.gust is not None
    with pytest.raises(TrimError, match="forces or wind of this scenario push it sideways"):
        find_trim(load_scenario("paper_open_loop", [*COARSE, "air.wind=[0.0, -1.0, 0.0]"]))


def test_a_trim_that_cannot_be_found_says_so() -> None:
    """A crank that stands has no flap, a motor's does not repeat; elastic joints; at 1 m/s nothing carries."""
    for said, settings in {
        "only a flapping flight": ["crank.frequency=0.0", "air.warm_up_cycles=0"],
        r"crank\.drive = 'motor'": ["crank.drive=motor"],
        r"plant\.elbow: only a robot with rigid joints": [*COARSE, "plant.elbow.stiffness=0.5"],
        r"no periodic flight found near 1\.00 Hz": [*COARSE, "crank.frequency=1.0", "flight.velocity=[1.0, 0.0, 0.0]"],
        r"takes some 320 flaps, about 4\.9\d+e\+03 s; at most 3600 s": [
            "simulation.dt=1e-6",
            "simulation.duration=1e-3",
        ],
    }.items():
        with pytest.raises(TrimError, match=said):
            find_trim(load_scenario("paper_open_loop", settings))


def test_what_is_known_of_the_torques_decides_what_can_be_found() -> None:
    """Measured: all. Motor only: all, when forces are projected first. None: all but the squeeze. Modelled: wrong."""
    found = {
        torque: fly("paper", f"observers.torque={torque}", "simulation.duration=0.6")
        for torque in ("measured", "modelled", "motor_only", "none")
    }
    ranks = {torque: one.metrics["observers"]["force_level"]["rank"] for torque, one in found.items()}
    assert ranks == {"measured": 6, "modelled": 6, "motor_only": 6, "none": 5}
    assert r2(found["measured"], "force_level").min() > 0.999
    assert r2(found["motor_only"], "force_level").min() > 0.999
    assert r2(found["motor_only"], "momentum")[1] < 0.5
    assert r2(found["modelled"], "force_level")[1] < 0.0
    none = r2(found["none"], "force_level")
    assert none[1] < 0.5
    assert none[[0, 2]].min() > 0.999
    # What cannot be seen: equal and opposite along the line from point to point, here straight across the robot.
    null = np.array(found["none"].metrics["observers"]["force_level"]["null_direction"])
    np.testing.assert_allclose(np.abs(null), [[0, np.sqrt(0.5), 0], [0, np.sqrt(0.5), 0]], atol=0.02)
    np.testing.assert_allclose(null[0], -null[1], atol=1e-6)
    # With the unseen part put aside, base rows alone find the forces as well.
    experiment = found["none"]
    truth = np.stack([true_force(experiment.log, frame)[0] for frame in experiment.scenario.observers.frames], axis=1)
    seen = truth[:, 0, 1] + truth[:, 1, 1]
    both = experiment.estimates["force_level"].force[:, :, 1].sum(axis=1)
    assert np.sqrt(np.mean((both - seen) ** 2)) < 3e-3


@pytest.mark.parametrize(
    ("frames", "torque"),
    [
        ("'left_force_point', 'left_distal'", "measured"),  # two points on one wing
        ("'left_force_point', 'right_force_point', 'base_link'", "motor_only"),
    ],
)
def test_what_cannot_be_told_apart_is_left_out_and_does_not_blow_up(frames: str, torque: str) -> None:
    """The null direction turns with the wing; the estimate along it stays zero, and what the points share is right."""
    settings = [f"observers.torque={torque}", f"observers.frames=[{frames}]", "simulation.duration=0.4"]
    flight = fly("paper_left", *settings, "simulation.dt=4e-3")
    true, _ = true_force(flight.log, "left_force_point")
    for estimate in flight.estimates.values():
        assert estimate.identifiability.rank < estimate.components.shape[1]
        assert np.max(np.abs(estimate.force)) < 3.0 * np.max(np.abs(true))
        if torque == "measured":
            total = estimate.force.sum(axis=1) - true
            assert np.sqrt(np.mean(total**2)) < 0.2 * true.std()
