"""The lifting line agrees with the classics: Wagner and Theodorsen in two dimensions, Prandtl in three."""

# Two dimensions: a span of 1e9 m, which leaves no downwash. Angles are small: U a is a section's normal velocity.

from typing import Any

import numpy as np
import pytest
from support.references import LATTICE_START, elliptic, jones, jones_harmonic, rectangular, theodorsen

from aerobat_pin.aerodynamics import LiftingLine

ENDLESS = 1e9  # [m]
INCIDENCE = np.radians(5.0)


def section(chord: float = 2.0, air_density: float = 1.0) -> LiftingLine:
    """Return a wing without ends."""
    return LiftingLine(ENDLESS, chord, strips=1, air_density=air_density)


def rectangle(aspect_ratio: float, **options: Any) -> LiftingLine:
    """Return a rectangular wing of unit chord in air of unit density."""
    return LiftingLine(aspect_ratio, 1.0, air_density=1.0, **options)


def test_lift_after_a_step_is_jones_function() -> None:
    """Two-dimensional step of incidence, R. T. Jones (1938): c_l/c_l(inf) .500, .794, .973 at s = 0, 5, 40; to 1e-4."""
    airspeed, chord = 4.0, 0.1
    s = np.array([0.0, 5.0, 40.0])
    lift = section(chord, 1.225).step_response(s * chord / 2.0 / airspeed, airspeed, 0.2)[:, 0]
    ratio = lift / (np.pi * 1.225 * chord * airspeed * 0.2)
    assert ratio == pytest.approx(jones(s), rel=0.0, abs=1e-6)
    assert ratio == pytest.approx([0.500, 0.794, 0.973], rel=0.0, abs=5e-4)  # as printed
    assert 1.0 - 0.165 * np.exp(-0.0455 * s) - 0.335 * np.exp(-0.3 * s) == pytest.approx(ratio, abs=1e-4)


def test_harmonic_lift_is_theodorsens() -> None:
    """Lift over quasi-steady lift: C(k) of Jones to 1e-4, of Theodorsen (1935) to 2.34 %, worst near k = 0.5."""
    k = np.geomspace(0.01, 10.0, 400)
    lift = section().frequency_response(k, 1.0)[:, 0] / (2.0 * np.pi)
    fit = 1.0 - 0.165j * k / (1j * k + 0.0455) - 0.335j * k / (1j * k + 0.300)
    assert np.max(np.abs(lift - fit)) < 1e-4
    assert np.max(np.abs(lift - jones_harmonic(k))) < 1e-8
    error = np.abs(lift / theodorsen(k) - 1.0)
    assert error.max() == pytest.approx(0.0234, abs=5e-5)
    assert 0.4 < k[np.argmax(error)] < 0.6


@pytest.mark.parametrize("strips", [1, 7, 16])
@pytest.mark.parametrize(("aspect_ratio", "printed"), [(4.0, 0.36554), (6.0, 0.41123), (10.0, 0.45693)])
def test_steady_elliptic_wing_is_prandtls(aspect_ratio: float, printed: float, strips: int) -> None:
    """Closed form: CL = a0 a / (1 + a0/(pi AR)), CDi = CL^2/(pi AR), for any number of strips."""
    root = 4.0 / (np.pi * aspect_ratio)
    line = LiftingLine(1.0, lambda y: root * np.sqrt(1.0 - 4.0 * y**2), strips=strips, air_density=1.0)
    lift, drag = elliptic(aspect_ratio, INCIDENCE)
    assert round(lift, 5) == printed
    assert line.steady_coefficients(INCIDENCE) == pytest.approx((lift, drag), rel=1e-10)


@pytest.mark.parametrize(
    ("aspect_ratio", "lift", "drag"), [(4.0, 0.35154, 0.01011), (6.0, 0.39535, 0.00869), (10.0, 0.44042, 0.00670)]
)
def test_steady_rectangular_wing_is_glauerts(aspect_ratio: float, lift: float, drag: float) -> None:
    """Prandtl's equation for a rectangle at 5 deg, by Glauert's series (1926) at other angles than the line's own."""
    glauert = rectangular(aspect_ratio, INCIDENCE)
    assert glauert == pytest.approx((lift, drag), rel=0.0, abs=5e-6)
    assert rectangle(aspect_ratio, strips=60).steady_coefficients(INCIDENCE) == pytest.approx(glauert, rel=2e-6)
    assert rectangle(aspect_ratio, strips=16).steady_coefficients(INCIDENCE) == pytest.approx(glauert, rel=1e-3)


def test_impulsive_start_grows_as_the_vortex_lattice_says() -> None:
    """Rectangle of aspect ratio 4 at 5 deg against an unsteady vortex lattice; s in semichords."""
    # One vortex per section starts 11, 5, 2 % above the lattice at s = 0.25, 1, 2; at 5 and 10 they agree to 0.5 %.
    line = rectangle(4.0)
    lift = 2.0 * line.step_response(np.array(list(LATTICE_START)) / 2.0, 1.0, INCIDENCE) @ line.width / line.area
    ratio = lift / np.array(list(LATTICE_START.values())) - 1.0
    assert ratio == pytest.approx([0.11, 0.05, 0.02, 0.0, 0.0], abs=0.005)
