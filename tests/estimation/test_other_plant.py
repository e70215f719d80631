"""A calibration outside the package's own simulator: flights of a plant that shares no code with it."""

# Elastic wings: 23/52/50 mN are made up by the plain belief, 1/3/1 after 4 s of free flight (2026); here 1.4 s.

from dataclasses import replace

import numpy as np
from support.elsewhere import as_believed, elsewhere, seen_elsewhere
from support.mismatch import estimated, made_up, scores
from support.other_plant import fly_elsewhere

from aerobat_pin.estimation import calibrate


def test_both_plants_agree_on_rigid_bodies_in_a_vacuum() -> None:
    """A force is found within 0.3 mN of 0.3 N: momentum balances and joint torques say what M, C and g say."""

    def push(time: float) -> np.ndarray:
        return np.array([0.1, 0.2, 0.3]) * np.sin(20.0 * time)

    log, force = fly_elsewhere(0.15, push, settle=0.05, air=0.0)
    flight = seen_elsewhere((log, force), None)
    vacuum = replace(flight.inputs, known={"thrusters": flight.inputs.known["thrusters"]})
    flight = flight._replace(inputs=vacuum)
    found = estimated("force_level", flight, 1e9)
    np.testing.assert_allclose(found.force, flight.truth, atol=3e-4)
    assert found.redundancy.rms < 1e-4


def test_a_calibration_holds_on_flights_of_another_simulator() -> None:
    """1.4 seconds of free flight; then an impulse, a push and a step are found, and little is made up."""
    free = as_believed(elsewhere("nothing", 1.4)[0])
    found = calibrate([free.record()], parameters=[])
    pushed = elsewhere("contacts", 1.0)
    plain, learnt = (seen_elsewhere(pushed, one) for one in (None, found))
    before, after = (estimated("force_level", one) for one in (plain, learnt))
    assert before.redundancy.verdict == "inconsistent"
    assert after.redundancy.verdict == "consistent"
    assert scores(before, plain)[2] < 0.5
    assert scores(after, learnt)[2] > 0.97
    elsewhere_found = np.sqrt(np.mean(after.force[:, 1] ** 2, axis=0))
    assert np.all(np.sqrt(np.mean(before.force[:, 1] ** 2, axis=0)) > 0.04)
    assert np.all(elsewhere_found < [4e-3, 20e-3, 6e-3])  # the blows move the robot: Fy is worst, as in 2026
    alarms = np.array([one.alarm for one in learnt.inputs.calibration.contacts if one.frame == "left_force_point"])
    for onset, late in ((0.3, 2e-3), (0.5, 7e-3), (0.7, 2e-3)):
        assert np.any((alarms > onset) & (alarms < onset + late)), onset
    still = seen_elsewhere((free.log, np.zeros((1400, 3))), found)
    assert np.all(made_up(estimated("force_level", still)) < [3e-3, 9e-3, 3e-3])
    assert still.inputs.calibration.contacts == ()
