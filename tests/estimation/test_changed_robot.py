"""A robot that has changed since a calibration on a flight day: noticed, named, corrected, beside four pushes."""

from dataclasses import replace

import numpy as np
import pytest
from support import changed_flights as flights
from support.further import further

from aerobat_pin.errors import CalibrationError
from aerobat_pin.estimation import Calibration
from aerobat_pin.forces.learnt_error import fit_learnt_error
from aerobat_pin.records import Condition

FREE_DAY = tuple((*one, "simulation.duration=2.5") for one in flights.DAY)
STEADY, LIVELY_ONE = (*flights.AT, "simulation.duration=2.5"), FREE_DAY[flights.DAY.index(flights.LIVELY)]


def seen(name: str, calibration: Calibration, *more: str) -> flights.Verdict:
    """Fly with a change, and estimate by `force_level`, and more observers."""
    settings = (*flights.PUSH, *flights.somewhere(1001), *flights.CHANGES[name].settings)
    return flights.estimated(settings, calibration, ["force_level", *more])


def test_a_robot_that_has_not_changed_is_not_called_changed() -> None:
    """Slow in speed, fast in frequency, within the calibration's range: all pushes found, deviations cautious."""
    found = flights.estimated((*flights.PUSH, *flights.somewhere(1001)), flights.learnt(*FREE_DAY))
    for name in ("kalman", "smoother"):
        assert np.all((np.array(found.nees[name]) > 0.1) & (np.array(found.nees[name]) < 1.5))
    assert np.all(np.array(found.error["force_level"]) < 4e-3)
    assert found.verdict == "unchanged"
    assert found.cause is None
    assert found.contacts[0] == flights.CONTACTS


def test_a_manoeuvre_is_right_after_a_steady_and_a_lively_flight_and_its_deviations_are_true() -> None:
    """To other sides than the lively one: 4 mN at most; squared errors .2 to 1.5 of those that filters state."""
    found = flights.estimated(("unknown_force=[]", *flights.MANOEUVRE), flights.learnt(STEADY, LIVELY_ONE))
    assert found.verdict == "unchanged"
    assert np.all(np.array(found.error["force_level"]) < 4e-3)
    for name in ("kalman", "smoother"):
        assert np.all((np.array(found.nees[name]) > 0.2) & (np.array(found.nees[name]) < 1.5))


def test_one_straight_flight_serves_a_manoeuvre() -> None:
    """It shows nothing of roll, yaw and drift, but by how much the air is wrong: 4 mN are left where it was 11."""
    found = flights.estimated(("unknown_force=[]", *flights.MANOEUVRE), flights.learnt(STEADY), ["force_level"])
    assert found.verdict == "unchanged"
    assert np.all(np.array(found.error["force_level"]) < 4e-3)


def test_a_force_that_is_too_large_by_a_share_is_so_in_every_state() -> None:
    """Air that is 30 % too weak everywhere, seen in one steady state: what is learnt holds at three times the force."""
    rng = np.random.default_rng(30)
    phase = np.linspace(0.0, 20.0 * np.pi, 4001)[1:]
    air = np.column_stack([np.cos(phase + a) + 0.3 * np.sin(3.0 * phase) + a for a in rng.uniform(0.0, 1.0, 6)])
    condition = Condition("the crank", phase, np.full((4000, 1), 2.0), {"speed": "m/s"}, np.ones(1), doubted=("air",))
    learnt_error = fit_learnt_error([condition], [0.3 * air], [{"air": air}], [1e-3], 6)
    assert learnt_error.share == pytest.approx(0.3, abs=1e-3)
    elsewhere = replace(condition, values=np.full((4000, 1), 2.7))
    assert np.allclose(learnt_error.force(elsewhere, {"air": 3.0 * air}), 0.9 * air, atol=0.02)
    with pytest.raises(CalibrationError, match="doubted has 'air': of drag some were expected"):
        learnt_error.force(elsewhere, {"drag": air})


def test_a_gust_is_noticed_where_it_is() -> None:
    """0.6 m/s from the side and below, for 0.8 of 2 s: it has no name, and deviations grow where it is."""
    found = seen("gust", flights.learnt(*FREE_DAY), "kalman")
    assert (found.verdict, found.cause) == ("changed", None)
    assert np.all(np.array(found.nees["kalman"]) < 3.0)


def test_a_slipped_encoder_is_noticed_named_and_corrected() -> None:
    """By 2 degrees, as `plant.crank_zero_deg` says; corrected, the forces are better and no push is lost."""
    found = seen("encoder 2 deg", flights.learnt(*FREE_DAY))
    better = seen("encoder 2 deg", flights.corrected(flights.learnt(*FREE_DAY)), "kalman")
    assert found.verdict == "changed"
    assert found.cause["name"] == "crank_zero"
    assert abs(found.cause["estimate"][0] + 2.0) < 3.0 * found.cause["deviation"][0] < 0.5
    assert np.max(found.error["force_level"]) > 20e-3
    assert np.max(found.nees["force_level"]) < 2.5  # as the whole effect of the cause is stated
    assert found.contacts[1] > 0
    assert np.max(better.error["force_level"]) < 8e-3
    assert np.all(np.array(better.nees["kalman"]) < 1.8)
    assert better.contacts == (flights.CONTACTS, 0)


@pytest.mark.parametrize(("name", "grams"), [("payload 10 %", 9.2), *further(("payload 3 %", 2.8))])
def test_a_payload_is_weighed_and_its_place_found(name: str, grams: float) -> None:
    """A point mass 30 mm forward and 20 mm above, which has a moment of inertia: within three deviations."""
    better = seen(name, flights.corrected(flights.learnt(*FREE_DAY)), "kalman")
    assert better.cause["name"] == "payload"
    apart = np.array(better.cause["estimate"]) - grams * np.array([1.0, 30.0, 0.0, 20.0])
    assert np.all(np.abs(apart) < 3.0 * np.array(better.cause["deviation"]))
    assert np.all(np.array(better.cause["deviation"]) < [0.2, 10.0, 10.0, 40.0])
    assert np.max(better.error["force_level"]) < 4e-3
    assert np.all(np.array(better.nees["kalman"]) < 1.8)


def test_an_elbow_that_bends_is_noticed_and_named() -> None:
    """5 rad/(N m) behind a lag of 10 ms are found within 3 %, in air that is wrong; three quarters of the error go."""
    bent = (
        *flights.PUSH,
        *flights.somewhere(1001),
        *flights.CHANGES["elbow 5 rad/(N m)"].settings,
        "simulation.duration=1.2",
    )
    free = flights.learnt(*FREE_DAY)
    found, better = (flights.estimated(bent, one, ["force_level"]) for one in (free, flights.corrected(free)))
    assert found.verdict == "changed"
    assert found.cause["name"] == "compliance"
    assert found.cause["estimate"] == pytest.approx((5.0, 0.05), rel=0.03)
    assert np.max(better.error["force_level"]) < 0.25 * np.max(found.error["force_level"])
