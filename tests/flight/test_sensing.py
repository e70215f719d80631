"""Sensors in the loop show what the log of the same flight shows."""

from __future__ import annotations

import numpy as np
import pytest

from aerobat_pin.flight.sensors import Sensing, recorded
from aerobat_pin.flight.simulate import simulate
from aerobat_pin.robot.load import load_robot
from aerobat_pin.scenario.scenario import load_scenario

PERFECT = []
NOISY = ["sensors.gyro.noise=0.003", "sensors.attitude.noise=0.003", "sensors.velocity.walk=0.1"]
POOR = [
    "sensors.position.rate=90",
    "sensors.position.delay=0.012",
    "sensors.position.dropout=0.4",
    "sensors.attitude.quantum=0.01",
    "sensors.attitude.dropout=0.2",
    "sensors.velocity.rate=250",
    "sensors.velocity.delay=0.03",
    "sensors.gyro.bias=[0.1, 0.2, 0.3]",
    "sensors.joint_angle.noise=0.01",
    "sensors.joint_rate.dropout=0.5",
    "sensors.crank_angle.noise=0.02",
    "sensors.crank_angle.delay=0.004",
]


@pytest.mark.parametrize("settings", [PERFECT, NOISY, POOR], ids=["perfect", "noisy", "poor"])
def test_a_controller_sees_to_the_bit_what_the_log_shows(settings: list[str]) -> None:
    """Noise, walk, bias, quantum, rate, delay and dropout, at all samples of a flight of 0.15 s."""
    scenario = load_scenario("paper", ["simulation.duration=0.15", "simulation.seed=7", *settings])
    robot = load_robot(scenario)
    exact = simulate(scenario.model_copy(update={"sensors": load_scenario("paper").sensors}), robot=robot)
    log = recorded(exact, robot, scenario.sensors, 7)
    sensing = Sensing(robot, scenario.sensors, exact.time, 7)
    q, v = exact.measured["q"].values, exact.measured["v"].values
    crank, seen, turned = exact.measured["crank_angle"].values, [], []
    for k in range(len(q)):
        seen.append(sensing.read(k, q[k], v[k]))
        turned.append(sensing.crank(k, crank[k]))
    np.testing.assert_array_equal(turned, log.measured["crank_angle"].values)
    np.testing.assert_array_equal([one for one, _ in seen], log.measured["q"].values)
    np.testing.assert_array_equal([one for _, one in seen], log.measured["v"].values)
    assert (np.max(np.abs(log.measured["q"].values - q)) > 1e-3) == bool(settings)


def test_errors_are_drawn_anew_after_the_last_time() -> None:
    """The window of 50 samples repeats its times, not its noise."""
    scenario = load_scenario("paper", NOISY)
    robot = load_robot(scenario)
    sensing = Sensing(robot, scenario.sensors, np.arange(50) * 1e-3, 1)
    v = np.zeros(robot.model.nv)
    seen = np.array([sensing.read(k, robot.q0, v)[1][3:6] for k in range(150)])
    assert np.std(seen) == pytest.approx(0.003, rel=0.1)
    assert abs(np.corrcoef(seen[:50].ravel(), seen[50:100].ravel())[0, 1]) < 0.3
