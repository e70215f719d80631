"""The flow past a strip from every side, limits of its lift, the quasi-steady model, and nonsense."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from support.gliding import AIR, BARE, NO_DRAG, SHAPE, WING, evaluate, gliding

from aerobat_pin.aerodynamics import RobotAir, air_in
from aerobat_pin.errors import AerobatError
from aerobat_pin.numerics import fields_of
from aerobat_pin.robot.wing import Wing


def test_flow_from_behind_is_flow_from_ahead_in_a_mirror() -> None:
    """Turn every velocity about z by half a turn and swap the ends of the chords: the same strip seen from behind.

    A wing whose mid-chords lie at x = 0 is its own mirror image: x forces and y moments change sign, the rest stays.
    """
    air = RobotAir(Wing(replace(SHAPE, tail=None)))
    fields_of(air_in, air.memory).pieces.x[:] = 0.0
    turn = np.array([-1.0, 1.0, 1.0, 1.0, -1.0, -1.0])  # reflection in the y-z plane: u, omega_y, omega_z change sign
    rng = np.random.default_rng(12)
    twists, state = rng.normal(size=(5, 6)), 0.1 * rng.normal(size=air.state_size)
    ahead, rates, strips = evaluate(air, twists, state)
    behind, same, mirrored = evaluate(air, twists * turn, state)
    assert behind == pytest.approx(ahead * turn, rel=1e-12, abs=1e-15)
    assert same == pytest.approx(rates, rel=1e-12)
    assert mirrored.lead == pytest.approx(-strips.lead, rel=1e-12)


def test_the_airspeeds_of_many_instants_are_those_of_each() -> None:
    """Against the loads of one instant after the other."""
    twists = np.random.default_rng(14).normal(size=(7, 5, 6))
    single = [evaluate(AIR, one, np.zeros(AIR.state_size))[2].airspeed for one in twists]
    np.testing.assert_allclose(AIR.airspeed(twists), single, rtol=1e-12)


@pytest.mark.parametrize("options", [{}, {"lift_limit": 1.5}, {"model": "quasi_steady"}])
def test_no_load_jumps_as_the_flow_turns_all_the_way_round(options: dict[str, Any]) -> None:
    """Loads at 20,000 incidences around the circle: a step of 0.3 mrad changes none by more than it changes elsewhere.

    Suction that followed the sign of u jumped at broadside by twice its size.
    """
    air = RobotAir(WING, **options)
    state = 0.05 * np.random.default_rng(13).normal(size=air.state_size)
    angles = np.linspace(-np.pi, np.pi, 20001)
    found = np.array([evaluate(air, gliding(3.0, angle), state)[0].ravel() for angle in angles])
    step = np.max(np.abs(np.diff(found, axis=0)), axis=0)
    assert np.all(step <= 0.01 * np.ptp(found, axis=0) + 1e-12)


def test_suction_loses_little_where_the_flow_is_attached() -> None:
    """The factor of the suction is 1 - 3/8 incidence^4: half a percent at 20 degrees, 7 % at 39."""
    for degrees, loss in ((5.0, 3e-5), (20.0, 0.006), (39.0, 0.075)):
        lead = evaluate(BARE, gliding(3.0, np.radians(degrees)), np.zeros(BARE.state_size))[2].lead
        assert np.all(1.0 - lead < loss)
        assert 1.0 - lead[0] == pytest.approx(0.375 * np.radians(degrees) ** 4, rel=0.2)


def test_the_lift_limit_bends_the_lift_and_is_never_passed() -> None:
    """Steady CL of the strips: 1.5 % less at half the limit, 2^(-1/4) of it where the line alone would reach it."""
    free, limited = (RobotAir(Wing(replace(SHAPE, tail=None)), lift_limit=limit) for limit in (None, 1.5))
    line, state = free.line, np.zeros(free.state_size)
    for degrees in np.linspace(-80.0, 80.0, 33):
        twists = gliding(3.0, np.radians(degrees))
        cl, bent = (
            2.0 * 2.0 * np.pi * evaluate(air, twists, 0.0 * state)[2].effective_velocity / 3.0 / 2.0
            for air in (free, limited)
        )
        assert np.all(np.abs(bent) < 1.5)
        assert bent == pytest.approx(cl / (1.0 + (cl / 1.5) ** 4) ** 0.25, rel=1e-12)
    assert line.strips == limited.line.strips
    wild = evaluate(RobotAir(Wing(SHAPE), lift_limit=1.5), gliding(3.0, 0.7), np.full(48, 10.0))[2]
    assert np.all(np.abs(2.0 * np.pi * wild.effective_velocity / wild.airspeed) <= 1.5)


@pytest.mark.parametrize(
    ("degrees", "cl", "cd"), [(0.0, 0.0, 0.3927), (9.0, 0.5527, 0.3872), (45.0, 1.8046, 1.7037), (90.0, 0.0, 3.4609)]
)
def test_the_quasi_steady_wing_has_dickinsons_coefficients(degrees: float, cl: float, cd: float) -> None:
    """CL = 0.225 + 1.58 sin(2.13 a - 7.2), CD = 1.92 - 1.55 cos(2.04 a - 9.82), by hand; CL led to 0 at 0 and 90.

    Source: Dickinson, Lehmann & Sane 1999, Science 284, 1954.
    """
    air = RobotAir(Wing(replace(SHAPE, tail=None, aerodynamics=NO_DRAG)), model="quasi_steady")
    angle, area = np.radians(degrees), air.line.width * air.line.chord
    wrenches, rates, strips = evaluate(air, gliding(4.0, angle), np.zeros(0))
    assert rates.shape == (0,)
    dynamic = 0.5 * 1.225 * 16.0 * area
    lift = (strips.force_x * np.sin(angle) + strips.force_z * np.cos(angle)) / dynamic
    drag = (-strips.force_x * np.cos(angle) + strips.force_z * np.sin(angle)) / dynamic
    assert lift == pytest.approx(np.full(16, cl), abs=1e-4)
    assert drag == pytest.approx(np.full(16, cd), abs=1e-4)
    kutta = 1.225 * 4.0 * strips.circulation * air.line.width
    assert kutta == pytest.approx(cl * dynamic, abs=1e-4 * dynamic.max())
    down = evaluate(air, gliding(4.0, -angle), np.zeros(0))[0]
    assert down[1:, 2] == pytest.approx(-wrenches[1:, 2], rel=1e-12, abs=1e-15)


def test_nonsense_is_refused_by_name() -> None:
    """An unknown model, limits and factors that are none."""
    for options, message in (
        ({"model": "vortex"}, "one of lifting_line, quasi_steady was expected"),
        ({"lift_limit": 0.0}, "lift_limit = 0.0"),
        ({"added_mass": -1.0}, "added_mass = -1.0"),
        ({"air_density": -1.0}, "air_density = -1.0"),
    ):
        with pytest.raises(AerobatError, match=message):
            RobotAir(WING, **options)
