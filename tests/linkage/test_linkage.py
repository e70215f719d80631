"""The Kinetic Sculpture closes at every crank angle in the real robot's assembly, with exact derivatives."""

# The loops are written out a second time, from the bar angles; golden figures are of the published bar lengths.

import math
import warnings
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

# By differences of positions, by `arms`, linear in exp(i t), and by the paper's Sigma_K: x' = f_k + g_k u_k.
from aerobat_description.position_closure import ADJUSTABLE
from aerobat_pin.aerobat import load_aerobat
from aerobat_pin.errors import AerobatError, LinkageError, NearSingularWarning
from aerobat_pin.linkage import ANGLES, PINS, Closure, KineticSculpture, SculptureDynamics
from aerobat_pin.linkage.arms import loops, pins
from aerobat_pin.linkage.closure import Angle

LINKAGE = KineticSculpture()
BARS = LINKAGE.lengths
TURN = np.radians(np.arange(0.0, 360.0, 0.01))
CRANK_ANGLES = st.floats(-20.0, 20.0, allow_nan=False)


def rotate(angle: np.ndarray, x: float, y: float) -> np.ndarray:
    """Return R(angle) [x, y] as (..., 2)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * x - s * y, s * x + c * y], axis=-1)


def ways(angles: dict[str, np.ndarray]) -> dict[str, tuple[np.ndarray, ...]]:
    """Return each moving pin, J4, J7 and J10 by two ways, as the paper draws them, from the seven bar angles."""
    t1, t2, t3, t5, t6, t8, t9 = (np.asarray(angles[name]) for name in ("t1", "t2", "t3", "t5", "t6", "t8", "t9"))
    p2 = np.array(BARS.P1) + rotate(t1, BARS.L1, 0.0)
    p3 = p2 + rotate(t2, BARS.L2b, BARS.L2c)
    p6 = np.array(BARS.P5) + rotate(t5, BARS.L3a + BARS.L3c * math.sin(BARS.alpha3), BARS.L3c * math.cos(BARS.alpha3))
    p9 = np.array(BARS.P8) + rotate(t8, BARS.L5c, BARS.L5d)
    return {
        "J2": (p2,),
        "J3": (p3,),
        "J6": (p6,),
        "J9": (p9,),
        "J4": (p2 + rotate(t2, BARS.L2a, 0.0), BARS.P5 + rotate(t5 - BARS.alpha3, -BARS.L3b, BARS.L3c)),
        "J7": (p3 + rotate(t3, BARS.L4, 0.0), BARS.P8 + rotate(t8, -BARS.L5a, BARS.L5b)),
        "J10": (p9 + rotate(t9, BARS.L6, 0.0), p6 + rotate(t6, BARS.L7b, BARS.L7c)),
    }


def test_the_bar_angles_at_the_start_are_known() -> None:
    """All absolute bar angles [rad] with the crank straight down; measured on the published bar lengths."""
    angles = LINKAGE.solve(-np.pi / 2).angles
    known = {"t2": 0.8912, "t3": 1.4493, "t5": 0.1980, "t6": -0.2806, "t8": 0.4953, "t9": -0.8275}
    assert {name: round(float(angles[name]), 4) for name in known} == known
    assert angles["t1"] == -np.pi / 2


@settings(max_examples=100, derandomize=True)
@given(CRANK_ANGLES)
def test_every_loop_closes(t1: float) -> None:
    """Pins by rigid bars, written out independently, meet to rounding at J4, J7 and J10 (paper, section II-A)."""
    closure = LINKAGE.solve(t1)
    for joint, places in ways(closure.angles).items():
        for place in places:
            assert np.linalg.norm(place - closure.pins[joint]) < 1e-15
    assert closure.residual < 1e-15
    assert closure.theta_s == closure.angles["t5"]
    assert np.exp(1j * closure.theta_e) == pytest.approx(np.exp(1j * (closure.angles["t6"] - closure.angles["t5"])))
    assert -np.pi <= closure.theta_e < np.pi


@settings(max_examples=50, derandomize=True)
@given(CRANK_ANGLES, st.floats(-100.0, 100.0), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))
def test_a_crank_torque_spread_over_joints_has_its_power(t1: float, rate: float, crank: float, strain: float) -> None:
    """Virtual work the other way; any other pair with this power is larger by what strains the linkage."""
    closure = LINKAGE.solve(t1, rate)
    shoulder, elbow = closure.joint_torques(crank)
    assert closure.crank_torque(shoulder, elbow) == pytest.approx(crank, rel=1e-14, abs=1e-15)
    power = shoulder * closure.theta_s_dot + elbow * closure.theta_e_dot
    assert power == pytest.approx(crank * rate, rel=1e-13, abs=1e-14)
    other = shoulder - strain * closure.dtheta_e, elbow + strain * closure.dtheta_s
    assert closure.crank_torque(*other) == pytest.approx(crank, rel=1e-13, abs=1e-14)
    assert math.hypot(*other) >= math.hypot(shoulder, elbow) * (1.0 - 1e-12)


def test_the_trees_joints_lie_on_the_linkages_pins() -> None:
    """At any crank angle shoulder and elbow of the tree are J5 and J6, and the forearm turns by t6; mirrored right."""
    # The derived elbow: (0, 48.4471, 5.7956) mm from the shoulder, L3a + L3c sin(alpha3) and L3c cos(alpha3).
    robot = load_aerobat("aerobat")
    assert 1e3 * np.array(robot.morphology.elbow) == pytest.approx([0.0, 48.4471, 5.7956], abs=5e-5)
    data = robot.model.createData()
    for t1 in (-np.pi / 2, 0.1, 2.0, 4.0):
        closure = LINKAGE.solve(t1)
        q = robot.configuration([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], closure.theta_s, closure.theta_e)
        pin.forwardKinematics(robot.model, data, q)
        for side, sign in (("left", 1.0), ("right", -1.0)):
            shoulder, elbow = (data.oMi[robot.model.getJointId(f"{side}_{joint}")] for joint in ("shoulder", "elbow"))
            forearm = elbow.rotation @ [0.0, sign, 0.0]
            out = np.array([np.cos(closure.angles["t6"]), np.sin(closure.angles["t6"])])
            assert shoulder.translation[1:] == pytest.approx(closure.pins["J5"] * [sign, 1.0], abs=1e-16)
            assert elbow.translation[1:] == pytest.approx(closure.pins["J6"] * [sign, 1.0], abs=1e-16)
            assert forearm[1:] == pytest.approx(out * [sign, 1.0], abs=1e-14)
    start = LINKAGE.solve(-np.pi / 2)
    joints = [start.theta_s, start.theta_e] * 2
    assert np.array_equal(robot.q0[list(robot.idx_q)], joints)


def test_many_crank_angles_at_once_equal_one_at_a_time() -> None:
    """Vectorised closure equals the scalar one exactly, in every field and for any shape."""
    crank = np.random.default_rng(3).uniform(-7.0, 7.0, (2, 5))
    many = LINKAGE.solve(crank, 30.0, -4.0)
    assert many.theta_s.shape == (2, 5)
    assert many.pins["J10"].shape == (2, 5, 2)
    for index in np.ndindex(crank.shape):
        one = LINKAGE.solve(crank[index], 30.0, -4.0)
        for field in ("theta_s", "theta_e", "theta_s_dot", "theta_e_ddot", "d2theta_s", "d2theta_e"):
            assert getattr(one, field) == pytest.approx(getattr(many, field)[index], rel=1e-14, abs=1e-14)
        assert one.pins["J10"] == pytest.approx(many.pins["J10"][index], rel=1e-14)
        assert np.shape(one.theta_s) == ()
    assert LINKAGE.solve(0.3, np.ones(4)).theta_e_dot.shape == (4,)
    assert LINKAGE.solve([]).theta_s.shape == (0,)
    found = LINKAGE.sensitivity(crank)["L3b"]
    assert (found.theta_s.shape, found.pins["J10"].shape) == ((2, 5), (2, 5, 2))


@pytest.mark.parametrize(
    ("bar", "factor", "dyad"), [("L3b", 0.7, "J4"), ("L2a", 1.1, "J4"), ("L5a", 0.7, "J7"), ("L6", 0.5, "J10")]
)
def test_a_linkage_that_cannot_turn_names_the_pin_and_the_crank_angle(bar: str, factor: float, dyad: str) -> None:
    """A bar too short or too long leaves a dyad open; the error says which one and where."""
    linkage = KineticSculpture(replace(BARS, **{bar: factor * getattr(BARS, bar)}))
    with pytest.raises(LinkageError, match=f"at {dyad} for a crank angle of .* deg") as caught:
        linkage.check()
    assert isinstance(caught.value, AerobatError)
    assert caught.value.dyad == dyad
    assert f"{np.degrees(caught.value.crank_angle):.1f} deg" in str(caught.value)
    with pytest.raises(LinkageError):
        linkage.solve(caught.value.crank_angle)
    nearest = caught.value.nearest
    assert bar in nearest
    for name, value in nearest.items():
        assert f"{name} = {value:.6g} (now " in str(caught.value)
        with pytest.warns(NearSingularWarning):  # it just turns
            KineticSculpture(replace(linkage.lengths, **{name: value})).check()


def test_the_nearest_feasible_rocker_is_grashofs() -> None:
    """J1 J2 J4 J5 close all around while ground + L1 <= L2a + rocker: L3b >= sqrt(rocker^2 - L3c^2) = 4.870 mm."""
    rocker = math.dist(BARS.P1, BARS.P5) + BARS.L1 - BARS.L2a
    with pytest.raises(LinkageError) as caught:
        KineticSculpture(replace(BARS, L3b=3e-3)).check()
    assert caught.value.nearest["L3b"] == pytest.approx(math.sqrt(rocker**2 - BARS.L3c**2), abs=1e-6)
    assert 1e3 * caught.value.nearest["L3b"] == pytest.approx(4.870, abs=1e-9)


@pytest.mark.parametrize(("bar", "least", "most"), [("L3b", 0.876, 3.0), ("L5a", 0.876, 1.648), ("L5b", 0.876, 1.166)])
def test_the_lengths_the_laboratory_sets_neither_lock_nor_come_near(bar: str, least: float, most: float) -> None:
    """Factors on the nominal length in the laboratory's morphing control; any warning here is an error."""
    for factor in np.linspace(least, most, 7):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            KineticSculpture(replace(BARS, **{bar: factor * getattr(BARS, bar)})).check()


def test_a_nearly_singular_linkage_warns_once_and_says_where() -> None:
    """L5a at 0.8 of nominal: the worst transmission angle of the turn, 12.5 deg, below the threshold of 15 deg."""
    linkage = KineticSculpture(replace(BARS, L5a=0.8 * BARS.L5a))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        linkage.check()
        linkage.check()
        linkage.solve(np.radians(55.0))
    assert len(caught) == 1
    warning = caught[0].message
    assert isinstance(warning, NearSingularWarning)
    turn = linkage.solve(TURN)
    assert warning.dyad == "J7"
    assert np.degrees(warning.transmission) == pytest.approx(12.54, abs=0.005)
    assert warning.transmission == pytest.approx(turn.transmission["J7"].min(), abs=1e-4)
    assert warning.crank_angle == pytest.approx(TURN[turn.transmission["J7"].argmin()], abs=np.radians(0.5))
    assert f"at J7: its bars make {np.degrees(warning.transmission):.1f} deg" in str(warning)
    assert f"angle of {np.degrees(warning.crank_angle):.1f} deg" in str(warning)


def test_a_pose_far_from_the_singular_one_does_not_warn_yet() -> None:
    """Without a check of the whole turn, the warning comes with the first crank angle that deserves it."""
    linkage = KineticSculpture(replace(BARS, L5a=0.8 * BARS.L5a))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        linkage.solve(np.radians(240.0))
    with pytest.warns(NearSingularWarning, match="at a crank angle of 55"):
        linkage.solve(np.radians(55.0))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        linkage.solve(np.radians(56.0))


def test_loading_a_robot_warns_of_a_nearly_singular_linkage() -> None:
    with pytest.warns(NearSingularWarning, match="nearly singular at J7"):
        load_aerobat("aerobat", {"linkage": {"L5a": 0.8 * BARS.L5a}})


STEP = 1e-3 * np.array([-2.0, -1.0, 1.0, 2.0])
SLOPE = np.array([1.0, -8.0, 8.0, -1.0]) / 12e-3  # fourth-order central difference at STEP


def angles_of(closure: Closure) -> dict[str, Angle]:
    """Return the seven angles of the bars and those of both joints, with their derivatives by crank angle."""
    return {**closure.bars, "theta_s": closure.shoulder, "theta_e": closure.elbow}


def pair(points: np.ndarray) -> np.ndarray:
    """Return complex points (...) as outboard and up (..., 2)."""
    return np.stack([np.real(points), np.imag(points)], axis=-1)


@settings(max_examples=60, derandomize=True)
@given(CRANK_ANGLES, st.floats(-100.0, 100.0), st.floats(-1e3, 1e3))
def test_every_angle_and_pin_has_its_rate_and_acceleration(t1: float, rate: float, acceleration: float) -> None:
    """Seven angles, both joints and ten pins, by differences in time along t1 + rate t + acceleration t^2 / 2."""
    here = LINKAGE.solve(t1, rate, acceleration)
    assert (tuple(here.angles), tuple(here.pins)) == (ANGLES, PINS)
    scale = max(1.0, abs(rate), np.sqrt(abs(acceleration)))
    time, slope = STEP / scale, SLOPE * scale
    along = LINKAGE.solve(t1 + rate * time + acceleration * time**2 / 2.0, rate + acceleration * time, acceleration)
    for (name, bar), near in zip(angles_of(here).items(), angles_of(along).values(), strict=True):
        moving = here.rate(bar), here.acceleration(bar)
        assert abs(slope @ np.unwrap(near.at) - moving[0]) < 1e-8 * scale
        assert abs(slope @ along.rate(near) - moving[1]) < 1e-8 * scale**2
        if name not in ANGLES:
            assert moving == (getattr(here, f"{name}_dot"), getattr(here, f"{name}_ddot"))
            assert (bar.d, bar.d2) == (getattr(here, f"d{name}"), getattr(here, f"d2{name}"))
    for name in PINS:
        point, near = here.points[name], along.points[name]
        assert pair(slope @ near.at) == pytest.approx(pair(here.rate(point)), rel=0.0, abs=1e-9 * scale)
        expected = pair(here.acceleration(point))
        assert pair(slope @ along.rate(near)) == pytest.approx(expected, rel=0.0, abs=1e-9 * scale**2)


@settings(max_examples=40, derandomize=True)
@given(CRANK_ANGLES)
def test_every_angle_and_pin_is_differentiated_by_the_adjustable_lengths(t1: float) -> None:
    """L3b, L5a and L5b in turn, the crank angle held, against differences of step 1e-5 m."""
    found = LINKAGE.sensitivity(t1)
    assert tuple(found) == ADJUSTABLE == ("L3b", "L5a", "L5b")
    for length, here in found.items():
        bars = [replace(BARS, **{length: getattr(BARS, length) + 1e-2 * step}) for step in STEP]
        near = [KineticSculpture(one).solve(t1) for one in bars]
        slope = 100.0 * SLOPE
        for name in ANGLES:
            turned = np.unwrap([one.angles[name] for one in near])
            assert slope @ turned == pytest.approx(here.angles[name], rel=1e-6, abs=1e-6)
        for name in PINS:
            moved = np.array([one.pins[name] for one in near])
            assert slope @ moved == pytest.approx(here.pins[name], rel=1e-6, abs=1e-8)
        for joint in ("theta_s", "theta_e"):
            turned = np.unwrap([getattr(one, joint) for one in near])
            assert slope @ turned == pytest.approx(getattr(here, joint), rel=1e-6, abs=1e-6)


def test_pins_and_loops_are_linear_in_the_turning_arms() -> None:
    """P = p + V exp(i t), P' = i V e t', P'' = V (i t'' - t'^2) e give the closed form's pins; the loops are shut."""
    t1 = np.linspace(-3.0, 3.0, 13)
    closed = LINKAGE.solve(t1, 30.0, 500.0)
    t, t_dot, t_ddot = (
        np.stack([of(bar) for bar in closed.bars.values()], axis=-1)
        for of in (lambda bar: bar.at, closed.rate, closed.acceleration)
    )
    points = pins(BARS)
    place = points.at(t)
    velocity = (points.by_angles(t) @ t_dot[..., None])[..., 0]
    acceleration = (points.by_angles(t) @ t_ddot[..., None])[..., 0] + points.centripetal(t, t_dot)
    for i, name in enumerate(PINS):
        for mine, theirs, size in (
            (place, lambda pin: pin.at, 1.0),
            (velocity, closed.rate, 1e2),
            (acceleration, closed.acceleration, 1e4),
        ):
            expected = pair(theirs(closed.points[name]))
            assert pair(mine[:, i]) == pytest.approx(expected, rel=0.0, abs=1e-15 * size)
    assert np.max(np.abs(loops(BARS).at(t))) < 1e-15


FLAPPING = 2.0 * np.pi * 4.75  # [rad/s]
PAPER = SculptureDynamics()


@settings(max_examples=60, derandomize=True, deadline=None)
@given(st.floats(-20.0, 20.0), st.floats(-100.0, 100.0), st.floats(-3e3, 3e3))
def test_the_papers_form_gives_the_closed_forms_accelerations(t1: float, rate: float, u_k: float) -> None:
    """The rates and accelerations of all seven angles are f_k + g_k u_k, those of the joints y = C_k x'."""
    x = PAPER.state(t1, rate)
    closed = PAPER.sculpture.solve(t1, rate, u_k)
    x_dot = PAPER.f_k(x) + PAPER.g_k(x) * u_k
    scale = 1e-12 * max(1.0, rate**2, abs(u_k))
    assert x_dot[:7] == pytest.approx([closed.rate(bar) for bar in closed.bars.values()], rel=0.0, abs=scale)
    assert x_dot[7:] == pytest.approx([closed.acceleration(bar) for bar in closed.bars.values()], rel=0.0, abs=scale)
    y = PAPER.C_k @ x_dot
    assert y == pytest.approx([closed.theta_s_ddot, closed.theta_e_ddot], rel=0.0, abs=scale)
    assert PAPER.gap(x) < 1e-15


def test_many_states_at_once_equal_one_at_a_time() -> None:
    """A stack of states gives a stack of rates, stabilised or not."""
    for dynamics in (PAPER, SculptureDynamics(stabilisation=50.0)):
        states = np.array([dynamics.state(t1, 20.0) for t1 in (0.0, 1.0, 2.0)]) + 1e-3
        for of in (dynamics.f_k, dynamics.g_k, dynamics.gap):
            assert of(states) == pytest.approx(np.array([of(x) for x in states]), rel=1e-12)


def test_stabilisation_shuts_an_open_loop_at_its_rate_and_leaves_a_closed_one_alone() -> None:
    """Critical damping: openings at rest shrink as (1 + s t) exp(-s t); where nothing is open, f_k is the paper's."""
    stabilised = SculptureDynamics(stabilisation=100.0)
    x = stabilised.state(0.3, FLAPPING)
    assert stabilised.f_k(x) == pytest.approx(PAPER.f_k(x), rel=1e-11)
    x = stabilised.state(0.3)
    x[ANGLES.index("t9")] += 1e-6
    before, dt = stabilised.gap(x), 1e-4
    for _ in range(200):
        k1 = stabilised.f_k(x)
        x = x + dt * stabilised.f_k(x + 0.5 * dt * k1)
    assert stabilised.gap(x) / before == pytest.approx(3.0 * np.exp(-2.0), rel=1e-3)
