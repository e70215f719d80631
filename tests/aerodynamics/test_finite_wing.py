"""Added mass of wings with open tips: closed forms of discs, tables of plates, reciprocity."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ellipe

from aerobat_pin.aerodynamics.planform import _edges_and_centres, _rings, added_mass_factor

ANGLES = (np.arange(400) + 0.5) * np.pi / 400
WIDTH = 0.5 * np.sin(ANGLES) * np.pi / 400  # of stations 0.5 cos(angle) along a unit span


@pytest.mark.parametrize("aspect", [1.0, 2.0, 5.0, 20.0])
def test_an_elliptic_disc_has_lambs_added_mass_at_every_section(aspect: float) -> None:
    """Hydrodynamics, art. 373: 1 / E of pi rho b^2, E the complete integral of modulus^2 1 - 1/aspect^2; a disc 2/pi.

    The sum is within 0.6 %, a section within 1.5 % out to 0.8 of the half span. `aspect` is span over root chord.
    """
    root = 1.0 / aspect
    factor = added_mass_factor(lambda y: root * np.sqrt(1.0 - 4.0 * y**2), 1.0, 0.5 * np.cos(ANGLES))
    exact = 1.0 / ellipe(1.0 - root**2)
    if aspect == 1.0:
        assert exact == pytest.approx(2.0 / np.pi)
    squares = np.sin(ANGLES) ** 2 * WIDTH
    assert factor @ squares / squares.sum() == pytest.approx(exact, rel=6e-3)
    assert factor[np.abs(np.cos(ANGLES)) < 0.8] == pytest.approx(exact, rel=0.015)


@pytest.mark.parametrize(("aspect", "table"), [(1, 0.579), (2, 0.757), (4, 0.871), (6, 0.917), (10, 0.947)])
def test_a_rectangular_plate_has_the_tabulated_added_mass(aspect: float, table: float) -> None:
    """Blevins, Formulas for natural frequency and mode shape (1979), table 14-1; within half a percent."""
    factor = added_mass_factor(lambda y: np.full(y.shape, 1.0 / aspect), 1.0, 0.5 * np.cos(ANGLES))
    assert factor @ WIDTH == pytest.approx(table, rel=5e-3)
    assert np.all(np.diff(factor[:200]) > -1e-12)  # from a tip to the root
    np.testing.assert_allclose(factor, factor[::-1], rtol=1e-9)


def test_a_wing_without_ends_has_thin_aerofoil_theorys() -> None:
    """1 at every station that is not a tip."""
    factor = added_mass_factor(lambda y: np.full(y.shape, 0.1), 1e9, np.array([-0.45e9, -1e8, 0.0, 3e8]))
    assert factor == pytest.approx(np.ones(4), rel=2e-3)


def test_a_lopsided_wing_has_its_own_factor_and_its_mirror_image_the_mirrored_one() -> None:
    """The wide half carries along more of pi rho b^2 of its narrow end than the narrow half of its own."""
    y = np.linspace(-0.49, 0.49, 21)
    ours, theirs = (added_mass_factor(lambda y, s=side: 0.2 - 0.3 * s * y, 1.0, y) for side in (1.0, -1.0))
    np.testing.assert_allclose(ours, theirs[::-1], rtol=1e-9)
    assert np.max(np.abs(ours - ours[::-1])) > 0.01


@pytest.mark.parametrize(("aspect", "inertia_error"), [(4.0, 0.056), (6.0, 0.033)])
def test_the_factor_of_plunging_gives_the_force_of_flapping(aspect: float, inertia_error: float) -> None:
    """Reciprocity: the plunging plate's jump times the flapping velocity |y| sums to the flapping plate's own force.

    That force comes from the potential jump of a plate whose normal velocity is |y|. Two moments of inertia are not
    exact: against flapping 6 and 3 % too large at aspect ratio 4 and 6, against pitching, pi rho b^4 / 8 times the same
    factor, 9 and 7 % too small, of which the 12 panels along the chord explain one.
    """
    chord, (edge_x, x), (edge_y, y) = 1.0 / aspect, _edges_and_centres(12), _edges_and_centres(48)
    grid = np.meshgrid(0.5 * chord * edge_x, 0.5 * edge_y, indexing="ij")
    at_x, at_y = (part.ravel() for part in np.meshgrid(0.5 * chord * x, 0.5 * y, indexing="ij"))
    rings = _rings(*grid, at_x, at_y).reshape(len(at_x), -1)
    area = np.outer(0.5 * chord * np.diff(edge_x), 0.5 * np.diff(edge_y)).ravel()
    force_of = {name: np.linalg.solve(rings, w) * area for name, w in (("flap", np.abs(at_y)), ("pitch", at_x))}
    lumped = 0.25 * np.pi * chord**2 * added_mass_factor(lambda y: np.full(y.shape, chord), 1.0, 0.5 * np.cos(ANGLES))
    out = np.abs(0.5 * np.cos(ANGLES))
    assert force_of["flap"].sum() == pytest.approx(lumped * out @ WIDTH, rel=5e-3)
    assert lumped * out**2 @ WIDTH / (force_of["flap"] @ np.abs(at_y)) - 1.0 == pytest.approx(inertia_error, abs=0.002)
    assert -0.1 < lumped * chord**2 / 32.0 @ WIDTH / (force_of["pitch"] @ at_x) - 1.0 < -0.05
