"""Where one unknown point force acts: from a wrench, from the whole body's, and from a log; and when nobody can say."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.signal import lfilter

from aerobat_description.meshes import parts
from aerobat_pin.aerobat import LINKS, Aerobat, load_aerobat
from aerobat_pin.errors import FrameNotFoundError, ObserverError
from aerobat_pin.observers import Application, ForceLevelObserver, LineOfAction, locate, locate_series
from aerobat_pin.observers.analysis.line_of_action import Panel
from aerobat_pin.observers.analysis.noise_and_lag import correlation_length

LINK = "left_distal"
SPOTS = [(0.02, 0.03, 0.0), (0.06, 0.08, 0.0), (-0.08, 0.012, 0.0)]  # [m], on the distal membrane
# Of force [N] and moment [N m], with a correlation: no direction and no entry is like another.
MIX = 0.3 * np.random.default_rng(7).normal(size=(6, 6)) + np.eye(6)
NOISE = np.diag([4e-3, 5e-3, 6e-3, 2e-4, 3e-4, 1e-4]) @ MIX
COVARIANCE = NOISE @ NOISE.T
EXACT = np.zeros((6, 6))


@pytest.fixture(scope="module")
def robot() -> Aerobat:
    return load_aerobat()


def pose(robot: Aerobat) -> np.ndarray:
    """Return a banked configuration with the wings half folded."""
    turn = pin.Quaternion(pin.rpy.rpyToMatrix(0.3, -0.2, 0.7)).coeffs()
    return robot.configuration([0.1, -0.2, 0.3, *turn], 0.3, -0.5)


def pushed(robot: Aerobat, spot: tuple[float, ...], force: np.ndarray) -> np.ndarray:
    """Return J^T f (nv,) of a force (3,) in the distal wing's axes at a spot of it, by a frame put there."""
    model = robot.model.copy()
    link = model.frames[model.getFrameId(LINK)]
    there = link.placement * pin.SE3(np.eye(3), np.array(spot))
    index = model.addFrame(pin.Frame("spot", link.parentJoint, 0, there, pin.FrameType.OP_FRAME))
    J = pin.computeFrameJacobian(model, model.createData(), pose(robot), index, pin.ReferenceFrame.LOCAL)
    return J[:3].T @ force


def wrench_of(robot: Aerobat, generalized: np.ndarray) -> np.ndarray:
    """Return the wrench (6,) at the distal link that explains a generalised force, as an observer projects it."""
    observer = ForceLevelObserver(robot.model, [Application(LINK, "wrench", "frame")])
    return np.linalg.lstsq(observer.applications.jacobian(pose(robot)).T, generalized, rcond=None)[0]


def at(spot: tuple[float, ...], force: np.ndarray) -> np.ndarray:
    """Return wrenches (..., 6) about the origin of forces (..., 3) at a spot."""
    return np.concatenate([force, np.cross(spot, force)], axis=-1)


@pytest.mark.parametrize("link", [name for name in LINKS if name != "base_link"])
def test_the_outline_of_a_panel_is_that_of_its_mesh(robot: Aerobat, link: str) -> None:
    """What is drawn lies within it, seen from above, and lacks only what would cut body and other wing: 12 mm."""
    drawn = np.array([point for triangle in parts(robot.morphology)[f"{link}_membrane"].mesh() for point in triangle])
    outline = robot.wing.outline(link)
    gaps = np.linalg.norm(drawn[:, None, :2] - outline[None, :, :2], axis=2)
    assert gaps.min(axis=0).max() < 0.012
    assert min(Panel(outline).margin(point)[0] for point in drawn) > -2e-3
    assert Panel(outline).margin(outline.mean(axis=0))[0] > 0.0


def test_an_outline_of_what_is_not_a_link_is_refused(robot: Aerobat) -> None:
    """The links that have one are listed; the body's is a rectangle as wide as the shoulders are apart."""
    with pytest.raises(FrameNotFoundError, match=r"no frame named 'tail'.*left_distal"):
        robot.wing.outline("tail")
    body = robot.wing.outline("base_link")
    assert body.shape == (4, 3)
    assert np.ptp(body[:, 1]) == pytest.approx(2.0 * robot.wing.breaks[0])


@pytest.mark.parametrize("spot", SPOTS)
def test_a_known_force_on_the_distal_wing_is_found_where_it_pushes(robot: Aerobat, spot: tuple[float, ...]) -> None:
    """From J^T f by another road, without noise: the point on the membrane to a micron, and the line through it."""
    line = locate(wrench_of(robot, pushed(robot, spot, np.array([0.05, -0.02, 0.2]))), EXACT)
    assert line.verdict == "a point force"
    crossing = line.cross(robot.wing.outline(LINK))
    assert crossing.verdict == "inside"
    np.testing.assert_allclose(crossing.point, spot, atol=1e-6)
    np.testing.assert_allclose(np.cross(np.array(spot) - line.point, line.direction), 0.0, atol=1e-6)
    assert line.point @ line.direction == pytest.approx(0.0, abs=1e-9)
    assert line.direction @ np.array([0.05, -0.02, 0.2]) > 0.2


def test_the_whole_bodys_wrench_finds_the_link_that_nobody_named(robot: Aerobat) -> None:
    """The six base rows alone, seen from each link in turn: only the left distal membrane is hit."""
    line = locate(pushed(robot, SPOTS[1], np.array([0.01, 0.03, 0.2]))[:6], EXACT)
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, pose(robot))
    base = data.oMf[robot.model.getFrameId("base_link")]
    hits = {}
    for link in LINKS:
        seen = line.seen_from(base.actInv(data.oMf[robot.model.getFrameId(link)]))
        crossing = seen.cross(robot.wing.outline(link))
        if crossing.verdict == "inside":
            hits[link] = crossing.point
    assert list(hits) == [LINK]
    np.testing.assert_allclose(hits[LINK], SPOTS[1], atol=1e-6)


def test_covariances_are_those_of_many_noisy_wrenches(robot: Aerobat) -> None:
    """Point of the line, crossing, margin and pitch against four thousand draws, 5 %."""
    wrench, outline = at(SPOTS[0], np.array([0.05, -0.1, 0.4])), robot.wing.outline(LINK) + np.array([0.0, 0.0, 0.05])
    line = locate(wrench, COVARIANCE)
    crossing = line.cross(outline)
    rng, crossings, pitches, margins = np.random.default_rng(1), [], [], []
    for draw in wrench + rng.normal(size=(4000, 6)) @ NOISE.T:
        other = LineOfAction(draw, EXACT)
        pitches.append(other.pitch)
        force = other.wrench[:3]
        crossings.append(other.point + (0.05 - other.point[2]) / force[2] * force)
        margins.append(Panel(outline).margin(crossings[-1])[0])
    deviation = np.sqrt(np.diag(crossing.covariance))
    np.testing.assert_allclose(np.std(crossings, axis=0)[:2], deviation[:2], rtol=0.05)
    assert deviation[2] == pytest.approx(0.0, abs=1e-12)
    correlation = np.corrcoef(np.array(crossings)[:, :2].T)[0, 1]
    assert correlation == pytest.approx(crossing.covariance[0, 1] / deviation[0] / deviation[1], abs=0.05)
    assert np.std(margins) == pytest.approx(crossing.margin_deviation, rel=0.05)
    assert np.std(pitches) == pytest.approx(line.pitch_deviation, rel=0.05)
    screw, along_x = np.array([0.2, 0.0, 0.4, 0.03, 0.0, 0.0]), 5e-3 * np.eye(6)[0]
    pitches = [LineOfAction(screw + shift * along_x, EXACT).pitch for shift in rng.normal(size=4000)]
    assert np.std(pitches) == pytest.approx(locate(screw, np.outer(along_x, along_x)).pitch_deviation, rel=0.05)


def test_a_pure_force_passes_the_pitch_test_but_for_one_in_370() -> None:
    """Three standard deviations: between 0.1 and 0.5 % of noisy pure forces are refused."""
    wrench, rng = at(SPOTS[0], np.array([0.05, -0.1, 0.4])), np.random.default_rng(2)
    draws = wrench + rng.normal(size=(4000, 6)) @ NOISE.T
    refused = sum(locate(draw, COVARIANCE).verdict != "a point force" for draw in draws)
    assert 4 <= refused <= 20


def test_what_is_no_pure_force_has_no_line(robot: Aerobat) -> None:
    """A moment along the force, a moment without any force, no force; the crossing is refused with the reason."""
    force = np.array([0.05, -0.1, 0.4])
    wrench = at(SPOTS[0], force)
    wrench[3:] += 10e-3 * force
    noise = NOISE @ np.random.default_rng(3).normal(size=6)
    for screw, verdict in (
        (wrench, "not a pure force"),
        (np.array([0.0, 0.0, 1e-6, 0.01, 0.0, 0.02]), "not a pure force"),
        (np.zeros(6), "nothing can be said"),
        (noise, "nothing can be said"),
    ):
        line = locate(screw, COVARIANCE)
        assert line.verdict == verdict
        with pytest.raises(ObserverError, match=f"no line of action: {verdict}"):
            line.cross(robot.wing.outline(LINK))
    assert locate(np.zeros(6), EXACT).verdict == "nothing can be said"
    with pytest.raises(ObserverError, match="the force is zero"):
        _ = locate(np.zeros(6), EXACT).point


def test_a_line_that_misses_the_membrane_says_so(robot: Aerobat) -> None:
    """30 mm behind it: outside, by that much; a micron inside the edge: too close to tell, with noise."""
    outline, force = robot.wing.outline(LINK), np.array([0.0, 0.0, 0.4])
    behind = 0.5 * (outline[-1] + outline[-2]) - np.array([0.03, 0.0, 0.0])
    crossing = locate(at(tuple(behind), force), COVARIANCE).cross(outline)
    assert crossing.verdict == "outside"
    assert crossing.margin == pytest.approx(-0.03, rel=0.2)
    edge = 0.5 * (outline[0] + outline[-1]) + np.array([0.0, 1e-6, 0.0])
    assert locate(at(tuple(edge), force), COVARIANCE).cross(outline).verdict == "too close to the outline to tell"
    assert locate(at(tuple(edge), force), EXACT).cross(outline).verdict == "inside"
    with pytest.raises(ObserverError, match="is parallel to the plane"):
        locate(at((0.0, 0.0, 0.05), np.array([0.4, 0.1, 0.001])), COVARIANCE).cross(outline)


def test_what_is_no_wrench_and_no_panel_is_refused(robot: Aerobat) -> None:
    """Covariances that are none, outlines without an area or a plane."""
    good = at(SPOTS[0], np.array([0.0, 0.0, 1.0]))
    for wrong in (-COVARIANCE, np.triu(COVARIANCE)):
        with pytest.raises(ObserverError, match="symmetric, positive semidefinite"):
            locate(good, wrong)
    corners = robot.wing.outline(LINK)
    for outline in (corners[:2], np.vstack([corners[0]] * 4)):
        with pytest.raises(ObserverError, match="corners"):
            locate(good, EXACT).cross(outline)
    bent = corners.copy()
    bent[2, 2] = 0.05
    with pytest.raises(ObserverError, match="flat polygon"):
        locate(good, EXACT).cross(bent)


def turning(count: int, rng: np.random.Generator) -> np.ndarray:
    """Return forces (count, 3) that turn about a mean."""
    return np.array([0.05, -0.1, 0.4]) + 0.2 * rng.normal(size=(count, 3))


def test_a_log_of_a_turning_force_gives_the_point_itself_with_its_covariance() -> None:
    """No plane needed. Unbiased though the force has errors too, and the covariance is that of 250 logs."""
    rng, spot, found = np.random.default_rng(4), np.array([0.02, 0.03, 0.01]), []
    for _ in range(250):
        log = at(tuple(spot), turning(100, rng)) + rng.normal(size=(100, 6)) @ (3.0 * NOISE).T
        found.append(locate_series(log, 9.0 * COVARIANCE))
    assert {one.verdict for one in found} == {"a point"}
    points = np.array([one.point for one in found])
    spread = points.std(axis=0)
    assert np.all(np.abs(points.mean(axis=0) - spot) < 4.0 * spread / np.sqrt(250.0))
    predicted = np.sqrt(np.mean([np.diag(one.covariance) for one in found], axis=0))
    np.testing.assert_allclose(predicted, spread, rtol=0.2)  # correlation is never found to be below one: 10 % over
    assert np.mean([one.misfit for one in found]) == pytest.approx(1.0, abs=0.02)


def test_errors_that_hang_together_are_counted_once() -> None:
    """The same noise through a first-order filter, force and moment of slow turns: predicted within a third."""
    rng, spot, found = np.random.default_rng(5), (0.02, 0.03, 0.0), []
    a = np.exp(-0.1)
    for _ in range(60):
        slow = lfilter([np.sqrt(1.0 - a * a)], [1.0, -a], rng.normal(size=(500, 6)), axis=0)[100:]
        angle = 2.0 * np.pi * np.arange(400) / 400.0
        force = np.column_stack([0.3 * np.sin(angle), 0.3 * np.cos(angle), 0.3 + 0.0 * angle])
        found.append(locate_series(at(spot, force) + slow @ NOISE.T, COVARIANCE))
    spread = np.std([one.point for one in found], axis=0)
    predicted = np.sqrt(np.mean([np.diag(one.covariance) for one in found], axis=0))
    np.testing.assert_allclose(predicted, spread, rtol=0.35)


def test_a_log_says_when_it_tells_a_line_no_point_or_nothing() -> None:
    """A force that never turns, two forces at once, noise alone, nothing at all; and exact data."""
    rng, spot = np.random.default_rng(6), SPOTS[0]
    noise = rng.normal(size=(300, 6)) @ NOISE.T
    straight = rng.normal(size=(300, 1)) * np.array([0.05, -0.1, 0.4])
    line = locate_series(at(spot, straight) + noise, COVARIANCE)
    assert line.verdict == "a line: the force never turns"
    along = straight[0] / np.linalg.norm(straight[0])
    assert abs(float(line.unknown[0] @ along)) > 0.99
    assert np.linalg.norm(np.cross(np.array(spot) - line.point, along)) < 1e-3
    two = at(spot, turning(300, rng)) + at(SPOTS[2], turning(300, rng)) + noise
    assert locate_series(two, COVARIANCE).verdict == "not one point force"
    couple = noise + np.array([0.0, 0.0, 0.0, 0.01, 0.0, 0.0])
    assert locate_series(couple, COVARIANCE).verdict == "not one point force"
    for _ in range(20):
        silence = rng.normal(size=(300, 6)) @ NOISE.T
        assert locate_series(silence, COVARIANCE).verdict == "nothing can be said"
    assert locate_series(np.zeros((5, 6)), EXACT).verdict == "nothing can be said"
    exact = locate_series(at(spot, turning(3, rng)), EXACT)
    assert exact.verdict == "a point"
    np.testing.assert_allclose(exact.point, spot, atol=1e-9)


def test_the_correlation_length_is_that_of_the_filter() -> None:
    """(1 + a)/(1 - a) of a first-order filter, one of white noise and of a constant."""
    rng, a = np.random.default_rng(8), np.exp(-0.2)
    white = rng.normal(size=400_000)
    filtered = lfilter([1.0], [1.0, -a], white)
    assert correlation_length(white) == pytest.approx(1.0, abs=0.05)
    assert correlation_length(filtered) == pytest.approx((1.0 + a) / (1.0 - a), rel=0.1)
    assert correlation_length(np.column_stack([white, filtered])) == correlation_length(filtered)
    assert correlation_length(np.full(10, 0.25)) == 1.0
