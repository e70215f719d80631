"""The shed wake: Kelvin's sum, trailing vortices, and where the air carries it."""

from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest
from support.further import further
from support.shed_wake import AIRSPEED, FREQUENCY, STEPS, flap_robot, impulse_lift, rectangle_wake, wake_at

from aerobat_pin.aerobat import FlightLog, flown_robot
from aerobat_pin.aerodynamics import Stroke
from aerobat_pin.errors import LogError
from aerobat_pin.flight import Wake, simulate, wake_of
from aerobat_pin.scenario import AirSection, load_scenario

STILL = [f"unknown_force.{i}.{key}=0.0" for i in range(2) for key in ("amplitude", "noise", "step")]
WINDY = ["air.wind=[0.5, -0.2, 0.1]", "air.gust={amplitude = [0.0, 1.0, 0.5], start = 0.1, duration = 0.2}"]


@pytest.fixture(scope="module", params=[(), tuple(WINDY)], ids=["still air", "wind and gust"])
def flown(request: pytest.FixtureRequest) -> tuple[FlightLog, Wake]:
    """Return three flaps of the paper's robot without unknown forces, and their wake."""
    scenario = load_scenario("paper", [*STILL, *request.param, "simulation.duration=0.632"])
    log = simulate(scenario)
    return log, wake_of(log, flown_robot(scenario), scenario.air)


def test_what_is_bound_and_what_was_shed_add_up_to_the_start(flown: tuple[FlightLog, Wake]) -> None:
    """Kelvin: per strip, bound plus all shed circulation never changes. Bound from the lifting line's own states."""
    log, wake = flown
    states = log.truth["air_state"].values[:-1]
    bound = states[:, 2 * wake.bound.shape[1] :]
    np.testing.assert_allclose(wake.bound, bound, atol=1e-15)
    start = np.tile(bound[0], (len(bound) - 1, 1))
    np.testing.assert_allclose(bound[1:] + np.cumsum(wake.shed, axis=0), start, atol=1e-14)


def test_trailing_vortices_cancel_and_follow_the_slope_of_the_bound_circulation(flown: tuple[FlightLog, Wake]) -> None:
    """Their sum is nil; their mean over whole flaps is minus the spanwise change of the mean bound circulation."""
    # The slope is that of the sine series of Gamma in closed form: integrated between stations it gives each vortex.
    log, wake = flown
    np.testing.assert_allclose(wake.trailing.sum(axis=1), 0.0, atol=1e-15)
    period = 1.0 / 4.75
    found = wake.mean_trailing(period, 3.0 * period)
    chosen = (wake.time >= period - 1e-9) & (wake.time < 3.0 * period - 1e-9)
    mean = log.truth["circulation"].values[chosen].mean(axis=0)
    count = len(mean)
    n, theta = np.arange(1, count + 1), np.arange(1, count + 1) * np.pi / (count + 1)
    modes = 2.0 / (count + 1) * np.sin(np.outer(n, theta)) @ mean
    edges = np.concatenate([[0.0], theta, [np.pi]])
    fine = [np.linspace(a, b, 401) for a, b in pairwise(edges)]
    slopes = [np.cos(np.outer(t, n)) @ (n * modes) for t in fine]  # d Gamma / d theta; left to right as theta grows
    expected = [np.trapezoid(slope, t) for slope, t in zip(slopes, fine, strict=True)]
    np.testing.assert_allclose(found, expected, atol=1e-5 * np.abs(mean).max())
    # A lifting flight leaves two counter-rotating halves behind.
    half = (count + 1) // 2
    assert found[:half].sum() > 0.0 > found[-half:].sum()


@pytest.mark.parametrize(("flap", "share"), [(0.0, 0.01), (30.0, 0.05)])
def test_the_wake_of_a_flapping_rectangle_takes_the_impulse_of_its_lift(flap: float, share: float) -> None:
    """At 5 deg, 4 m/s, 5 Hz: rho Gamma times the area its trailing edge sweeps, against the force that `fly` finds."""
    stroke = Stroke(4.0, np.radians(5.0), 5.0, flap=np.radians(flap))
    lift, wake = rectangle_wake(stroke, np.linspace(0.0, 1.0, 501), 101)
    assert impulse_lift(wake) == pytest.approx(lift, rel=share)
    assert lift > 0.1


@pytest.mark.parametrize(("strips", "share", "steps"), [(16, 0.92, STEPS // 10), *further((80, 0.93, STEPS // 4))])
def test_the_wake_of_the_flapping_robot_takes_the_impulse_of_its_lift(strips: int, share: float, steps: int) -> None:
    """Prescribed level flight: 92 % of what 16 strips lift, 93 % with 80."""
    force, wake = flap_robot(strips, steps)
    assert impulse_lift(wake) / force[:, 2].mean() == pytest.approx(share, abs=0.01)
    # Tips and halves turn against each other; a half leaves as much as is bound at the root.
    trailing = wake.mean_trailing(0.0, 1.0 / FREQUENCY)
    assert trailing[0] > 0.0
    assert trailing[: strips // 2].sum() == pytest.approx(wake.bound.mean(axis=0).max(), rel=0.02)
    np.testing.assert_allclose(trailing, -trailing[::-1], atol=1e-9)
    assert wake.position[-1, 0, 0] - wake.position[0, 0, 0] == pytest.approx(AIRSPEED / FREQUENCY, rel=0.01)


def test_the_wake_stays_where_it_was_shed_but_for_the_wind(flown: tuple[FlightLog, Wake]) -> None:
    """A point of the left distal trailing edge by hand, and the same one 0.3 s later, carried by the air."""
    log, wake = flown
    robot = flown_robot(load_scenario("paper"))
    data, k = robot.model.createData(), 150
    pin.framesForwardKinematics(robot.model, data, log.measured["q"].values[k])
    y = log.truth["strip"].values[1]
    place = data.oMf[robot.model.getFrameId("left_distal")]
    x = robot.morphology.wing.offset_x + float(robot.wing.leading_edge(y) - robot.wing.chord(y))
    x -= robot.morphology.wing.offset_x  # the link's own frame starts at the wing's
    elbow = robot.wing.breaks[1]
    expected = place.act(np.array([x, y - elbow, 0.0]))
    np.testing.assert_allclose(wake.position[k, 1], expected, atol=1e-12)
    points, strength = wake_at(wake, 0.45)
    assert points.shape == (451, 16, 3)
    assert strength.shape == (451, 16)
    fine = np.linspace(0.15, 0.45, 30001)
    blown = np.trapezoid(wake.wind.field(fine)[:, 0], fine, axis=0)
    np.testing.assert_allclose(points[k, 1] - expected, blown, atol=1e-8)
    np.testing.assert_allclose(wake.wind.drift(np.zeros(1)), 0.0, atol=1e-16)


def test_a_recorded_flight_has_no_wake_and_other_strips_are_refused(flown: tuple[FlightLog, Wake]) -> None:
    """Truth is needed, and as many strips as were flown."""
    log, robot = flown[0], flown_robot(load_scenario("paper"))
    with pytest.raises(LogError, match="no group 'truth'"):
        wake_of(FlightLog(log.measured), robot, AirSection())
    with pytest.raises(LogError, match=r"the log has 16 strips, air\.strips = 12"):
        wake_of(log, robot, AirSection(strips=12))
