"""Where the linkage cannot close, what would help; where it nearly locks, a warning, once."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace

import numpy as np
import pytest

from aerobat_pin.errors import AerobatError, LinkageError, NearSingularWarning
from aerobat_pin.linkage import KineticSculpture
from aerobat_pin.robot.aerobat import load_aerobat

BARS = KineticSculpture().lengths
TURN = np.radians(np.arange(0.0, 360.0, 0.01))


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
    """The robot checks its linkage when it is made."""
    with pytest.warns(NearSingularWarning, match="nearly singular at J7"):
        load_aerobat("aerobat", {"linkage": {"L5a": 0.8 * BARS.L5a}})
