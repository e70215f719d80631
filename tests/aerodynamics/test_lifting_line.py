"""The lifting line: its matrices are its equations, any planform goes in, and it agrees with the classics."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import ellipe

# Two dimensions: a span of 1e9 m, which leaves no downwash. Angles are small: U a is a section's normal velocity.
from support.references import LATTICE_START, elliptic, jones, jones_harmonic, rectangular, theodorsen

from aerobat_pin.aerodynamics import LiftingLine
from aerobat_pin.aerodynamics.planform import added_mass_factor, along_span
from aerobat_pin.errors import AerobatError, ShapeError


def rectangle(aspect_ratio: float, **options: Any) -> LiftingLine:
    """Return a rectangular wing of unit chord in air of unit density."""
    return LiftingLine(aspect_ratio, 1.0, air_density=1.0, **options)


@settings(max_examples=30, derandomize=True)
@given(st.integers(1, 24), st.integers(0, 2**32 - 1))
def test_the_matrices_are_the_equations(strips: int, seed: int) -> None:
    """The matrices A, B, C, D equal `rates` and `lift`, on random states, wings and speeds; so does Kutta-Joukowski."""
    rng = np.random.default_rng(seed)
    line = LiftingLine(0.4, rng.uniform(0.02, 0.2, strips), strips=strips)
    state, w_n = rng.normal(size=3 * strips), rng.normal(size=strips)
    speed = rng.uniform(0.0, 10.0, strips)
    w_eff, w = line.effective_velocity(state, speed, w_n)
    system, rates = line.state_space(speed), line.rates(state, speed, w_eff, w)
    assert system.A @ state + system.B @ w_n == pytest.approx(rates, rel=1e-12, abs=1e-12 * np.abs(rates).max())
    lift = line.lift(speed, w_eff)
    assert system.C @ state + system.D @ w_n == pytest.approx(lift, rel=1e-12, abs=1e-12 * np.abs(lift).max())
    # Unsteady Kutta-Joukowski: the lift is also rho U Gamma + rho c Gamma'.
    circulation, growth = line.split(state)[2], line.split(rates)[2]
    assert lift == pytest.approx(1.225 * (speed * circulation + line.chord * growth), rel=1e-12, abs=1e-9)


@pytest.mark.parametrize("width", [1e-6, 0.1, 0.55, 0.8, 2.0])
def test_the_mean_downwash_over_a_width_is_the_integral_of_prandtls(width: float) -> None:
    """The downwash n sin(n theta)/(2 S sin(theta)) of each mode, at 20,000 points about the root; not past the tips."""
    line, span = LiftingLine(0.8, 0.1, strips=9), min(width, 0.8)
    theta = np.arccos(((np.arange(20000) + 0.5) / 20000 - 0.5) * span / 0.4)
    for n in range(1, 10):
        fine = np.mean(n * np.sin(n * theta) / (1.6 * np.sin(theta)))
        assert line.mean_downwash(width) @ np.sin(n * line.theta) == pytest.approx(fine, rel=1e-4, abs=1e-9)


def test_the_strips_integrate_every_circulation_they_resolve_over_the_span() -> None:
    """The integral of sin(n theta) dy over the span is pi S/4 for n = 1 and 0 for all other n up to N."""
    line = LiftingLine(0.8, 0.1, strips=9)
    for n in range(1, 10):
        assert line.width @ np.sin(n * line.theta) == pytest.approx(np.pi * 0.2 if n == 1 else 0.0, abs=1e-15)
    for strips in (16, 64, 256):  # not a sine series: the span itself, with an error of (pi/(N + 1))^2/12
        width = LiftingLine(0.8, 0.1, strips=strips).width
        assert width.sum() == pytest.approx(0.8, rel=(np.pi / (strips + 1)) ** 2 / 11.0)


def test_steady_circulation_is_where_the_states_come_to_rest() -> None:
    """The state space's rest state, -A^-1 B w_n, holds the steady circulation; lift is then rho U Gamma."""
    line, w_n = rectangle(6.0), np.linspace(0.1, 0.4, 16)
    system = line.state_space(3.0)
    state = -np.linalg.solve(system.A, system.B @ w_n)
    assert line.split(state)[2] == pytest.approx(line.steady_circulation(w_n), rel=1e-11)
    assert system.C @ state + system.D @ w_n == pytest.approx(3.0 * line.steady_circulation(w_n), rel=1e-11)
    assert line.frequency_response(0.0, 3.0, w_n) == pytest.approx(3.0 * line.steady_circulation(w_n), rel=1e-12)
    assert np.all(np.linalg.eigvals(system.A).real < 0.0)


def test_frequency_response_is_that_of_the_matrices() -> None:
    """D + C (i w - A)^-1 B, on a tapered wing whose strips fly at different speeds, one of them not at all."""
    line = LiftingLine(0.4, lambda y: 0.1 - 0.2 * np.abs(y), strips=6)
    speed, w_n = np.array([5.0, 4.0, 3.0, 2.0, 1.0, 0.0]), np.linspace(0.1, 0.3, 6)
    system, frequency = line.state_space(speed), np.array([0.5, 20.0, 900.0])
    lift = line.frequency_response(frequency, speed, w_n)
    assert lift.shape == (3, 6)
    for found, omega in zip(lift, frequency, strict=True):
        state = np.linalg.solve(1j * omega * np.eye(18) - system.A, system.B @ w_n)
        assert found == pytest.approx(system.C @ state + system.D @ w_n, rel=1e-10, abs=1e-14)
    assert line.frequency_response(20.0, speed, w_n) == pytest.approx(lift[1], rel=1e-14)


def test_step_response_is_that_of_the_matrices() -> None:
    """C A^-1 (e^(A t) - 1) B w_n + D w_n, by the eigenvectors of A; the steps in time may differ."""
    line = LiftingLine(0.4, lambda y: 0.1 - 0.2 * np.abs(y), strips=6)
    speed, w_n = np.array([5.0, 4.0, 3.0, 2.0, 1.0, 0.5]), np.linspace(0.1, 0.3, 6)
    system, time = line.state_space(speed), np.array([0.0, 0.001, 0.02, 0.02, 0.3, 300.0])
    values, vectors = np.linalg.eig(system.A)
    lift = line.step_response(time, speed, w_n)
    for found, t in zip(lift, time, strict=True):
        state = vectors @ (np.expm1(values * t) / values * np.linalg.solve(vectors, system.B @ w_n))
        assert found == pytest.approx(system.C @ state.real + system.D @ w_n, rel=1e-8)
    assert lift[0] == pytest.approx(system.D @ w_n, rel=1e-14)


def test_air_at_rest_freezes_circulation_and_makes_no_lift() -> None:
    """At U = 0, of all or one strip, nothing divides by it: no lift, no warning, all stands still at any frequency."""
    line, one_still = rectangle(4.0, strips=8), np.array([0.0, *[2.0] * 7])
    state, still = np.random.default_rng(5).normal(size=24), np.zeros(8)
    with np.errstate(all="raise"):
        w_eff, w = line.effective_velocity(state, still, np.full(8, 0.3))
        rates = line.rates(state, still, w_eff, w)
        system = line.state_space(0.0)
    assert not line.lift(still, w_eff).any()
    assert not line.split(rates)[2].any()
    assert line.split(rates)[0] == pytest.approx(w)
    assert np.all(np.isfinite(system.A))
    with np.errstate(all="raise"):
        for speed in (np.zeros(8), one_still):
            frequency = line.frequency_response([0.0, 3.0], speed)
            step = line.step_response([0.0, 0.5], speed, 1.0)
            for lift in (frequency, step):
                assert np.all(np.isfinite(lift))
                assert np.all((lift != 0.0) == (speed > 0.0))


@pytest.mark.parametrize(
    "chord",
    [
        lambda y: np.interp(y, [-0.3, 0.0, 0.1, 0.3], [0.05, 0.1, 0.1, 0.02]),
        ([-0.3, 0.0, 0.1, 0.3], [0.05, 0.1, 0.1, 0.02]),
        np.array([[-0.3, 0.0, 0.1, 0.3], [0.05, 0.1, 0.1, 0.02]]),
    ],
    ids=["function", "polyline", "array"],
)
def test_function_and_polyline_are_the_same_wing(chord: Any) -> None:
    """Chord at the stations, area of the trapezia, and the points of each section."""
    line = LiftingLine(0.6, chord, quarter_chord=([-0.3, 0.3], [-0.1, 0.2]), strips=9)
    assert line.chord == pytest.approx(np.interp(line.y, [-0.3, 0.0, 0.1, 0.3], [0.05, 0.1, 0.1, 0.02]), rel=1e-15)
    assert line.area == pytest.approx(0.3 * 0.075 + 0.1 * 0.1 + 0.2 * 0.06, rel=1e-6)
    assert line.quarter_chord == pytest.approx(0.05 + 0.5 * line.y, abs=1e-15)
    assert line.mid_chord == pytest.approx(line.quarter_chord - line.chord / 4.0, abs=1e-15)
    assert line.three_quarter_chord == pytest.approx(line.quarter_chord - line.chord / 2.0, abs=1e-15)
    factor = added_mass_factor(along_span(chord, line.y, 0.6, "chord")[0], 0.6, line.y)
    assert line.added_mass == pytest.approx(factor * 1.225 * np.pi * line.chord**2 / 4.0, rel=1e-15)


@pytest.mark.parametrize(
    ("span", "chord", "options", "message"),
    [
        (1.0, 0.1, {"strips": 0}, "strips = 0"),
        (1.0, 0.0, {}, "chord = 0"),
        (1.0, lambda y: 0.1 * y, {}, "chord = -0.05"),
        (1.0, lambda y: np.where(np.abs(y) < 0.01, -0.1, 0.1), {}, "chord = -0.1"),  # between two stations
        (1.0, lambda y: y[:3], {}, r"chord as a function has shape \(3,\)"),
        (1.0, ([0.5, 0.0, -0.5], [0.1, 0.1, 0.1]), {}, "chord: the polyline's stations .* to rise"),
        (1.0, ([0.0, 0.5], [0.1, 0.1]), {}, "from tip to tip, -0.5 m to 0.5 m"),  # half a wing
        (1.0, np.full(5, 0.1), {}, r"shape \(5,\).* 16 numbers"),
    ],
)
def test_a_wing_that_cannot_be_is_refused(span: float, chord: Any, options: dict[str, Any], message: str) -> None:
    """Errors name the argument, what was got and what was expected."""
    with pytest.raises(ShapeError, match=message) as caught:
        LiftingLine(span, chord, **options)
    assert isinstance(caught.value, AerobatError)


ANGLES = (np.arange(400) + 0.5) * np.pi / 400
WIDTH = 0.5 * np.sin(ANGLES) * np.pi / 400  # of stations 0.5 cos(angle) along a unit span


@pytest.mark.parametrize("aspect", [1.0, 2.0, 5.0, 20.0])
def test_an_elliptic_disc_has_lambs_added_mass_at_every_section(aspect: float) -> None:
    """Hydrodynamics, art. 373: 1 / E of pi rho b^2, E complete integral of modulus^2 1 - 1/aspect^2; a disc 2/pi."""
    # The sum is within 0.6 %, a section within 1.5 % out to 0.8 of the half span. `aspect` is span over root chord.
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


INCIDENCE = np.radians(5.0)


def section(chord: float = 2.0, air_density: float = 1.0) -> LiftingLine:
    """Return a wing without ends."""
    return LiftingLine(1e9, chord, strips=1, air_density=air_density)


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
