"""The lifting line agrees with the classics: Wagner, Theodorsen and Garrick in two dimensions, Prandtl in three.

Two dimensions are the limit of a span far larger than the chord (1e9 m here), which leaves no downwash. Angles are
small: the normal velocity of a section at incidence a and speed U is U a.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.linalg import expm
from scipy.special import hankel2, i0, i1, k0, k1

from aerobat_pin.aerodynamics import LiftingLine
from aerobat_pin.errors import AerobatError, ShapeError

ENDLESS = 1e9  # [m]
INCIDENCE = np.radians(5.0)


def jones(s: float) -> float:
    """R. T. Jones's fit of Wagner's function; s in semichords."""
    return 1.0 - 0.165 * np.exp(-0.0455 * s) - 0.335 * np.exp(-0.300 * s)


def theodorsen(k: float) -> complex:
    """Theodorsen's function C(k) for motion e^(i w t)."""
    return complex(hankel2(1, k) / (hankel2(1, k) + 1j * hankel2(0, k)))


def wagner(s: float) -> float:
    """Return Wagner's function: Theodorsen's, inverted by Laplace along its branch cut."""

    def decay(x: float) -> float:
        return np.exp(-s * x) / x**2 / ((k0(x) - k1(x)) ** 2 + (np.pi * (i0(x) + i1(x))) ** 2)

    return 1.0 - sum(quad(decay, *piece, epsabs=1e-10)[0] for piece in ((0.0, 0.01), (0.01, 1.0), (1.0, 20.0)))


def after_a_step(line: LiftingLine, airspeed: float, normal_velocity: float, time: float) -> np.ndarray:
    """Return the lift per span a while after the normal velocity jumps from rest: exact, by the matrix exponential."""
    system, size = line.state_space(airspeed), 3 * line.strips
    w_n = np.full(line.strips, normal_velocity)
    state = np.linalg.solve(system.A, (expm(system.A * time) - np.eye(size)) @ system.B @ w_n)
    return np.asarray(system.C @ state + system.D @ w_n)


def response(line: LiftingLine, airspeed: float, frequency: float) -> complex:
    """Return the lift per span over the normal velocity, at w [rad/s], of a one-strip line."""
    system = line.state_space(airspeed)
    state = np.linalg.solve(1j * frequency * np.eye(3) - system.A, system.B)
    return complex((system.C @ state + system.D)[0, 0])


def rectangle(aspect_ratio: float, **options: Any) -> LiftingLine:
    """Return a rectangular wing of unit chord in air of unit density."""
    return LiftingLine(aspect_ratio, 1.0, air_density=1.0, **options)


def coefficients(line: LiftingLine, area: float) -> tuple[float, float]:
    """Return steady CL and induced CDi at 5 deg and unit speed, from the circulation and its downwash."""
    circulation = line.steady_circulation(INCIDENCE)
    drag = line.width @ (circulation * (line.downwash @ circulation))
    return 2.0 * float(line.width @ circulation) / area, 2.0 * float(drag) / area


@pytest.mark.parametrize(("s", "printed"), [(0.0, 0.500), (5.0, 0.794), (40.0, 0.973)])
def test_the_lift_after_a_step_is_jones_function(s: float, printed: float) -> None:
    """Two-dimensional step of incidence: c_l / c_l(inf) is the fit of R. T. Jones (1938), to its closed form."""
    airspeed, chord = 4.0, 0.1
    line = LiftingLine(ENDLESS, chord, strips=1)
    lift = after_a_step(line, airspeed, 0.2, s * chord / 2.0 / airspeed)
    ratio = float(lift[0] / (np.pi * 1.225 * chord * airspeed * 0.2))
    assert ratio == pytest.approx(jones(s), rel=0.0, abs=1e-6)
    assert round(ratio, 3) == printed


@pytest.mark.parametrize(("s", "exact"), [(0.0, 0.5), (1.0, 0.60061), (5.0, 0.78820), (10.0, 0.87504), (50.0, 0.97676)])
def test_the_lift_after_a_step_is_near_wagners_exact_function(s: float, exact: float) -> None:
    """Wagner's exact function, integrated here (to 1e-5 of its table); the fit of Jones is within 1.1 %."""
    assert wagner(s) == pytest.approx(exact, rel=0.0, abs=1e-5)
    line = LiftingLine(ENDLESS, 2.0, strips=1, air_density=1.0)
    lift = after_a_step(line, 1.0, 1.0, s)[0]
    assert lift / (2.0 * np.pi) == pytest.approx(exact, rel=0.011)


def test_harmonic_lift_is_theodorsens() -> None:
    """Frequency response over quasi-steady lift: C(k) of Jones to 1e-4, of Theodorsen (1935) to 2.3 %."""
    line = LiftingLine(ENDLESS, 2.0, strips=1, air_density=1.0)
    k = np.geomspace(0.01, 10.0, 400)
    lift = np.array([response(line, 1.0, frequency) for frequency in k]) / (2.0 * np.pi)
    fit = 1.0 - 0.165j * k / (1j * k + 0.0455) - 0.335j * k / (1j * k + 0.300)
    assert np.max(np.abs(lift - fit)) < 1e-4
    exact = np.array([theodorsen(frequency) for frequency in k])
    worst = np.max(np.abs(lift - exact) / np.abs(exact))
    assert round(worst, 3) == 0.023


def test_a_plunging_section_lifts_and_pulls_as_theodorsen_and_garrick_say() -> None:
    """Plunge 10 mm at 5 Hz, 4 m/s, chord 0.1 m: lift amplitude 2 pi rho U b |C| h w, thrust pi rho b |C|^2 (h w)^2.

    Closed forms of Theodorsen (1935) and Garrick (1936), 0.3139 N/m without added mass and 0.0080 N/m.
    """
    airspeed, chord, frequency, amplitude = 4.0, 0.1, 2.0 * np.pi * 5.0, 0.010 * 2.0 * np.pi * 5.0
    lag = abs(theodorsen(frequency * chord / 2.0 / airspeed))
    theodorsens = np.pi * 1.225 * chord * airspeed * lag * amplitude
    garricks = np.pi * 1.225 * chord / 2.0 * (lag * amplitude) ** 2
    assert round(theodorsens, 4) == 0.3139
    assert round(garricks, 4) == 0.0080

    line = LiftingLine(ENDLESS, chord, strips=1)
    system = line.state_space(airspeed)
    state = np.linalg.solve(1j * frequency * np.eye(3) - system.A, system.B[:, 0] * amplitude)
    lift, suction = [], []
    for phase in 2.0 * np.pi * np.arange(64) / 64:
        now, speed = np.real(state * np.exp(1j * phase)), np.array([airspeed])
        w_eff, _ = line.effective_velocity(now, speed, np.array([amplitude * np.cos(phase)]))
        lift.append(float(line.lift(speed, w_eff)[0]))
        suction.append(float(line.suction(w_eff)[0]))
    assert 2.0 * abs(np.fft.fft(lift)[1]) / 64 == pytest.approx(theodorsens, rel=0.01)
    assert np.mean(suction) == pytest.approx(garricks, rel=0.01)


@pytest.mark.parametrize("strips", [1, 7, 16])
@pytest.mark.parametrize(("aspect_ratio", "printed"), [(4.0, 0.36554), (6.0, 0.41123), (10.0, 0.45693)])
def test_a_steady_elliptic_wing_is_prandtls(aspect_ratio: float, printed: float, strips: int) -> None:
    """Closed form: CL = a0 a / (1 + a0/(pi AR)), CDi = CL^2/(pi AR), for any number of strips."""
    root = 4.0 / (np.pi * aspect_ratio)
    line = LiftingLine(1.0, lambda y: root * np.sqrt(1.0 - 4.0 * y**2), strips=strips, air_density=1.0)
    lift = 2.0 * np.pi * INCIDENCE / (1.0 + 2.0 / aspect_ratio)
    assert round(lift, 5) == printed
    drag = lift**2 / (np.pi * aspect_ratio)
    assert coefficients(line, 1.0 / aspect_ratio) == pytest.approx((lift, drag), rel=1e-6)


@pytest.mark.parametrize(
    ("aspect_ratio", "lift", "drag"),
    [(4.0, 0.35154, 0.01011), (6.0, 0.39535, 0.00869), (10.0, 0.44042, 0.00670)],
)
def test_a_steady_rectangular_wing_is_glauerts(aspect_ratio: float, lift: float, drag: float) -> None:
    """Prandtl's equation for a rectangle at 5 deg: Glauert's series, solved here at mid-strip angles with odd terms."""
    terms = np.arange(1, 120, 2)
    theta = (np.arange(len(terms)) + 0.5) * np.pi / (2 * len(terms))
    mu = 2.0 * np.pi / (4.0 * aspect_ratio)
    matrix = np.sin(np.outer(theta, terms)) * (terms * mu / np.sin(theta)[:, None] + 1.0)
    series = np.linalg.solve(matrix, np.full(len(terms), mu * INCIDENCE))
    glauert = np.pi * aspect_ratio * series[0], np.pi * aspect_ratio * float(terms @ series**2)
    assert glauert == pytest.approx((lift, drag), rel=0.0, abs=5e-6)
    assert coefficients(rectangle(aspect_ratio, strips=60), aspect_ratio) == pytest.approx(glauert, rel=1e-4)
    assert coefficients(rectangle(aspect_ratio, strips=16), aspect_ratio) == pytest.approx(glauert, rel=0.01)


def test_an_impulsive_start_grows_as_the_vortex_lattice_says() -> None:
    """Rectangle of aspect ratio 4 at 5 deg against an unsteady vortex lattice; s in semichords.

    The line, which has one vortex per section, starts 11, 5 and 2 % above the lattice at s = 0.25, 1 and 2; at 5 and
    10 the two agree within 0.5 %.
    """
    line = rectangle(4.0)
    for s, lattice, difference in (
        (0.25, 0.2476, 0.11),
        (1.0, 0.2701, 0.05),
        (2.0, 0.2894, 0.02),
        (5.0, 0.3153, 0.0),
        (10.0, 0.3270, 0.0),
    ):
        lift = 2.0 * float(line.width @ after_a_step(line, 1.0, INCIDENCE, s / 2.0)) / 4.0
        assert lift / lattice - 1.0 == pytest.approx(difference, abs=0.005)


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


def test_the_sine_matrix_is_orthogonal() -> None:
    """At theta_i = i pi/(N + 1), sum_i sin(n theta_i) sin(m theta_i) = (N + 1)/2 delta_nm: condition 1."""
    line = LiftingLine(1.0, 0.1, strips=16)
    sines = np.sin(np.outer(line.theta, np.arange(1, 17)))
    assert sines.T @ sines == pytest.approx(8.5 * np.eye(16), abs=1e-13)
    assert np.linalg.cond(sines) == pytest.approx(1.0, abs=1e-12)
    assert line.y == pytest.approx(-line.y[::-1], abs=1e-15)


def test_the_downwash_of_an_elliptic_circulation_is_uniform() -> None:
    """Prandtl: Gamma = G sin(theta) gives w = G/(2 S); sin(3 theta) gives 3 G sin(3 theta)/(2 S sin(theta))."""
    line = LiftingLine(0.8, 0.1, strips=16)
    ellipse = np.sin(line.theta)
    assert line.downwash @ ellipse == pytest.approx(np.full(16, 1.0 / 1.6), rel=1e-12)
    assert line.centre_downwash @ ellipse == pytest.approx(1.0 / 1.6, rel=1e-12)
    third = np.sin(3.0 * line.theta)
    assert line.downwash @ third == pytest.approx(3.0 * third / ellipse / 1.6, rel=1e-11)
    assert line.centre_downwash @ third == pytest.approx(-3.0 / 1.6, rel=1e-12)


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
    assert np.all(np.linalg.eigvals(system.A).real < 0.0)


def test_air_at_rest_freezes_circulation_and_makes_no_lift() -> None:
    """At U = 0 nothing divides by the airspeed: no lift, circulation and lag decay stand still, no warning."""
    line = rectangle(4.0, strips=8)
    state, still = np.random.default_rng(5).normal(size=24), np.zeros(8)
    with np.errstate(all="raise"):
        w_eff, w = line.effective_velocity(state, still, np.full(8, 0.3))
        rates = line.rates(state, still, w_eff, w)
        system = line.state_space(0.0)
    assert not line.lift(still, w_eff).any()
    assert not line.split(rates)[2].any()
    assert line.split(rates)[0] == pytest.approx(w)
    assert np.all(np.isfinite(system.A))


@pytest.mark.parametrize(
    ("span", "chord", "options", "message"),
    [
        (1.0, 0.1, {"strips": 0}, "strips = 0"),
        (np.nan, 0.1, {}, "span = nan"),
        (-1.0, 0.1, {}, "span = -1"),
        (1.0, np.nan, {}, "chord"),
        (1.0, -0.1, {}, "chord"),
        (1.0, lambda y: 0.1 * y, {}, "chord"),
        (1.0, np.full(5, 0.1), {}, r"shape \(5,\).* 16 numbers"),
        (1.0, 0.1, {"air_density": 0.0}, "air_density = 0"),
        (1.0, 0.1, {"air_density": np.inf}, "air_density = inf"),
    ],
)
def test_a_wing_that_cannot_be_is_refused(span: float, chord: Any, options: dict[str, Any], message: str) -> None:
    """Errors name the argument, what was got and what was expected."""
    with pytest.raises(ShapeError, match=message) as caught:
        LiftingLine(span, chord, **options)
    assert isinstance(caught.value, AerobatError)
