"""Every angle and pin of the linkage: rates, accelerations, and what the adjustable lengths do to them."""

# By differences of positions, by `arms`, linear in exp(i t), and by the paper's Sigma_K: x' = f_k + g_k u_k.

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aerobat_description.position_closure import ADJUSTABLE
from aerobat_pin.linkage import ANGLES, PINS, Closure, KineticSculpture, SculptureDynamics
from aerobat_pin.linkage.arms import loops, pins
from aerobat_pin.linkage.closure import Angle

LINKAGE = KineticSculpture()
BARS = LINKAGE.lengths
CRANK_ANGLES = st.floats(-20.0, 20.0, allow_nan=False)
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
        pin, near = here.points[name], along.points[name]
        assert pair(slope @ near.at) == pytest.approx(pair(here.rate(pin)), rel=0.0, abs=1e-9 * scale)
        expected = pair(here.acceleration(pin))
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


def test_a_length_moves_nothing_before_it_in_the_chain() -> None:
    """L5a and L5b belong to the second dyad: the first one, and with it the shoulder, does not feel them."""
    found = LINKAGE.sensitivity(np.linspace(0.0, 6.0, 7))
    for length in ("L5a", "L5b"):
        assert np.all(np.abs(found[length].theta_s) < 1e-12)
        for pin in ("J1", "J2", "J3", "J4", "J5", "J6", "J8"):
            assert np.all(np.abs(found[length].pins[pin]) < 1e-12)
        assert np.max(np.abs(found[length].theta_e)) > 10.0
    assert np.max(np.abs(found["L3b"].theta_s)) > 10.0
    assert found["L3b"].theta_s.shape == (7,)
    assert found["L3b"].pins["J10"].shape == (7, 2)


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
