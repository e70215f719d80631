"""Sigma_Aero on any planform: Wagner's indicial lift on Prandtl's lifting line, as a linear state-space model.

The circulation is a state, so nothing is divided by the airspeed. Each strip has a chord c, a semichord b = c/2, a lift
slope a0, an airspeed U in its plane, and a normal velocity w_n of the air at the 3/4 chord (positive w_n gives lift
along the normal). Wagner's function is approximated after R. T. Jones, Phi(s) = 1 - sum_k Psi_k exp(-eps_k s), with
Phi0 = Phi(0) = 1/2:

    w        = w_n - D Gamma                                          downwash included
    zeta_k'  = w - eps_k (U/b) zeta_k                                 k = 1, 2
    w_eff    = Phi0 w + sum_k Psi_k eps_k (U/b) zeta_k
    Gamma'   = -(U/c) Gamma + (a0 U/2) w_eff
    lift per span = rho U Gamma + rho c Gamma' = a0 rho b U w_eff     at the 1/4 chord, along the normal
    suction per span = a0 rho b (w_eff - b q / 2)^2                   at the leading edge, toward it; q: nose-up rate

Stations y = (S/2) cos theta at theta_i = i pi/(N+1); Gamma = sum_n g_n sin(n theta) and the downwash
D Gamma = 1/(2S) sum_n n g_n sin(n theta)/sin(theta). At those stations sin(n theta_i) is orthogonal.

Sources: Boutet & Dimitriadis 2018 (Wagner lifting line); Sihite et al. 2022, arXiv 2207.12353 (state space).
The suction is Garrick's (NACA TR 567, 1936). The flow is attached: the model has no stall. Sweep moves the points at
which velocity is evaluated and force acts; the downwash is that of a straight line, as in Prandtl's theory.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aerobat_pin.aerodynamics.planform import FINE, AlongSpan, added_mass_factor, along_span
from aerobat_pin.errors import ShapeError
from aerobat_pin.numerics import Array, guarded

JONES_PSI = (0.165, 0.335)
JONES_EPS = (0.0455, 0.300)
PHI0 = 1.0 - sum(JONES_PSI)


@dataclass(frozen=True)
class StateSpace:
    """Matrices of xi' = A xi + B w_n, lift per span = C xi + D w_n: (3N, 3N), (3N, N), (N, 3N), (N, N)."""

    A: Array
    B: Array
    C: Array
    D: Array


class LiftingLine:
    """An unsteady lifting line.

    The state (3N,) is [zeta_1 (N) [m], zeta_2 (N) [m], circulation (N) [m2/s]]. The wing's axes: x forward, y to the
    left, z along the normal. `chord` and `quarter_chord` are given in a form that `planform.along_span` reads: a
    number, a function of y, a polyline (stations, values), or a number for each station.

    Args:
        span: full span S [m]. A span far larger than the chord gives the two-dimensional limit.
        chord: chord along the span [m].
        quarter_chord: x of the quarter-chord line, on which the lift acts [m].
        strips: number of stations N; even is better than odd.
        lift_slope: two-dimensional lift slope a0 [1/rad].
        air_density: density of the air [kg/m3].

    Attributes:
        y: stations (N,) [m], from the left tip to the right one.
        chord, semichord: chord and half of it at the stations (N,) [m].
        quarter_chord, mid_chord, three_quarter_chord: x of these points at the stations (N,) [m].
        width: weight of each station in an integral along the span (N,) [m].
        added_mass: mass per span of the air that a section accelerates (N,) [kg/m]: pi rho b^2 times the planform's
            `planform.added_mass_factor`. The force per span along the normal, at mid-chord, is minus this mass times
            the rate of the normal velocity there. Two couples oppose a nose-up rate q: b^2 / 8 times this mass times
            q', and b / 2 times this mass times U q, Theodorsen's pitch-rate force moved from mid-chord to 3/4 chord.
        area: area of the planform [m2].
        downwash: the operator D (N, N) [1/m].

    Raises:
        ShapeError: span, chord, strips or density are not finite and positive, or the shapes do not fit.
    """

    @guarded(span="positive", lift_slope="positive", air_density="positive")
    def __init__(
        self,
        span: float,
        chord: AlongSpan,
        *,
        quarter_chord: AlongSpan = 0.0,
        strips: int = 16,
        lift_slope: float = 2.0 * np.pi,
        air_density: float = 1.225,
    ) -> None:
        if strips < 1:
            raise ShapeError(f"strips = {strips}: a whole number, at least one, was expected")
        self.span, self.strips, self.lift_slope, self.air_density = span, int(strips), lift_slope, air_density
        n = np.arange(1, strips + 1)
        self.theta = n * np.pi / (strips + 1)
        self.y = 0.5 * span * np.cos(self.theta)
        shape, self.chord = along_span(chord, self.y, self.span, "chord")
        _, self.quarter_chord = along_span(quarter_chord, self.y, self.span, "quarter_chord")
        fine = (np.arange(FINE) + 0.5) * np.pi / FINE
        chords = shape(0.5 * span * np.cos(fine))
        if np.any(self.chord <= 0.0) or np.any(chords < 0.0):
            least = min(self.chord.min(), chords.min())
            raise ShapeError(f"chord = {least:g}: positive lengths in metres were expected between the tips")
        self.area = float(chords @ np.sin(fine)) * 0.5 * self.span * np.pi / FINE
        self.semichord = self.chord / 2.0
        self.mid_chord = self.quarter_chord - 0.25 * self.chord
        self.three_quarter_chord = self.quarter_chord - 0.5 * self.chord
        self.added_mass = np.pi * self.air_density * self.semichord**2 * added_mass_factor(shape, self.span, self.y)
        # Quadrature along the span: exact for every sin(n theta) that the stations resolve.
        self.width = 0.5 * span * np.sin(self.theta) * np.pi / (strips + 1)
        sines = np.sin(np.outer(self.theta, n))
        self._to_modes = 2.0 / (strips + 1) * sines.T
        self.downwash = (sines / np.sin(self.theta)[:, None] * n / (2.0 * span)) @ self._to_modes

    def __repr__(self) -> str:
        return f"LiftingLine(span {self.span:g} m, area {self.area:.4g} m2, {self.strips} strips)"

    @cached_property
    def fastest_mode(self) -> float:
        """Largest rate of the states at unit airspeed [1/m]: it grows with the square of the number of strips."""
        return float(np.max(np.abs(np.linalg.eigvals(self.state_space(1.0).A))))

    def mean_downwash(self, width: float) -> Array:
        """Return the row (N,) [1/m] of the downwash, averaged over a width [m] about the root, at most the span."""
        width = min(width, self.span)
        n, angle = np.arange(1, self.strips + 1), np.arccos(width / self.span)
        odd = n % 2  # the mean of sin(n theta) / sin(theta) in y is 2 cos(n angle) / (n width) times span / 2
        return np.asarray((odd * np.cos(n * angle) / (2.0 * width)) @ self._to_modes)

    def split(self, state: Array) -> tuple[Array, Array, Array]:
        """Return zeta_1, zeta_2 and circulation, each (N,), of a state (3N,)."""
        n = self.strips
        return state[:n], state[n : 2 * n], state[2 * n :]

    def effective_velocity(self, state: Array, airspeed: Array, normal_velocity: Array) -> tuple[Array, Array]:
        """Return w_eff, to which the lift is proportional, and w, which includes the downwash; both (N,) [m/s]."""
        zeta1, zeta2, circulation = self.split(state)
        w = normal_velocity - self.downwash @ circulation
        rate = airspeed / self.semichord
        lag = rate * (JONES_PSI[0] * JONES_EPS[0] * zeta1 + JONES_PSI[1] * JONES_EPS[1] * zeta2)
        return PHI0 * w + lag, w

    def rates(self, state: Array, airspeed: Array, w_eff: Array, w: Array) -> Array:
        """Return the state's rate (3N,) from its effective velocities (see `effective_velocity`)."""
        zeta1, zeta2, circulation = self.split(state)
        rate = airspeed / self.semichord
        growth = -airspeed / self.chord * circulation + 0.5 * self.lift_slope * airspeed * w_eff
        return np.concatenate([w - JONES_EPS[0] * rate * zeta1, w - JONES_EPS[1] * rate * zeta2, growth])

    def lift(self, airspeed: Array, w_eff: Array) -> Array:
        """Return the lift per span (N,) [N/m], along the normal at the 1/4 chord."""
        return self.lift_slope * self.air_density * self.semichord * airspeed * w_eff

    def suction(self, w_eff: Array, pitch_rate: Array) -> Array:
        """Return the leading-edge suction per span (N,) [N/m]; the pitch rate (N,) [rad/s] is positive nose up."""
        edge = w_eff - 0.5 * self.semichord * pitch_rate
        return self.lift_slope * self.air_density * self.semichord * edge**2

    @guarded()
    def state_space(self, airspeed: ArrayLike) -> StateSpace:
        """Return A, B, C, D; the input is the normal velocity (N,) [m/s], the output the lift per span (N,) [N/m].

        The airspeed is one number or (N,) [m/s], not negative: flow from behind would make the modes grow.

        Raises:
            ShapeError: the airspeed is negative or not finite.
        """
        n = self.strips
        speed = self._airspeed(airspeed)
        rate, eye, zero = speed / self.semichord, np.eye(n), np.zeros((n, n))
        lags = [np.diag(psi * eps * rate) for psi, eps in zip(JONES_PSI, JONES_EPS, strict=True)]
        gain = np.diag(0.5 * self.lift_slope * speed)
        a = np.block(
            [
                [np.diag(-JONES_EPS[0] * rate), zero, -self.downwash],
                [zero, np.diag(-JONES_EPS[1] * rate), -self.downwash],
                [gain @ lags[0], gain @ lags[1], np.diag(-speed / self.chord) - PHI0 * gain @ self.downwash],
            ]
        )
        force = np.diag(self.lift_slope * self.air_density * self.semichord * speed)
        return StateSpace(
            A=a,
            B=np.vstack([eye, eye, PHI0 * gain]),
            C=force @ np.hstack([lags[0], lags[1], -PHI0 * self.downwash]),
            D=PHI0 * force,
        )

    @guarded()
    def steady_circulation(self, normal_velocity: ArrayLike) -> Array:
        """Return the circulation (N,) [m2/s] of steady flow, Gamma = a0 b (w_n - D Gamma), which holds at any airspeed.

        The normal velocity of the air at the 3/4 chord is one number or (N,) [m/s].

        Raises:
            ShapeError: the normal velocity is not finite, or its shape is not one of these two.
        """
        slope = self.lift_slope * self.semichord
        w_n = self._each(normal_velocity, "normal_velocity")
        return np.asarray(np.linalg.solve(np.eye(self.strips) + slope[:, None] * self.downwash, slope * w_n))

    @guarded()
    def steady_coefficients(self, incidence: ArrayLike) -> tuple[float, float]:
        """Return lift coefficient and induced drag coefficient of steady flow, after Prandtl, per planform area.

        The incidence is a small angle, one number or (N,) [rad].

        Raises:
            ShapeError: the incidence is not finite, or its shape is not one of these two.
        """
        circulation = self.steady_circulation(self._each(incidence, "incidence"))  # at unit airspeed
        drag = self.width @ (circulation * (self.downwash @ circulation))
        return 2.0 * float(self.width @ circulation) / self.area, 2.0 * float(drag) / self.area

    @guarded()
    def frequency_response(
        self, frequency: ArrayLike, airspeed: ArrayLike, normal_velocity: ArrayLike = 1.0
    ) -> NDArray[np.complex128]:
        """Return the lift per span [N/m] due to a harmonic normal velocity, as complex amplitudes.

        At angular frequency w the circulation is Gamma = G (w_n - D Gamma) with G = (a0 U/2) C / (i w + U/c) and
        Jones's lag C = Phi0 + sum_k Psi_k eps_k (U/b)/(i w + eps_k U/b). The reduced frequency is k = w b/U.

        Args:
            frequency: angular frequency w, any shape (...) [rad/s], not negative.
            airspeed: one number or (N,) [m/s], not negative.
            normal_velocity: amplitude at the 3/4 chord, one number or (N,) [m/s].

        Returns:
            Amplitudes (..., N); a real amplitude is in phase with the normal velocity.

        Raises:
            ShapeError: a number is negative or not finite, or a shape does not fit.
        """
        omega = np.asarray(frequency, float)
        if np.any(omega < 0.0):
            raise ShapeError("frequency: numbers in rad/s, not negative, were expected")
        speed, w_n = self._airspeed(airspeed), self._each(normal_velocity, "normal_velocity")
        rate, s = speed / self.semichord, 1j * omega[..., None]
        lag = PHI0 + sum(
            psi * _ratio(eps * rate, s + eps * rate) for psi, eps in zip(JONES_PSI, JONES_EPS, strict=True)
        )
        gain = self.lift_slope * self.semichord * lag * _ratio(0.5 * rate, s + 0.5 * rate)
        w = np.linalg.solve(np.eye(self.strips) + self.downwash * gain[..., None, :], w_n[:, None])[..., 0]
        return np.asarray(self.lift_slope * self.air_density * self.semichord * speed * lag * w)

    @guarded(time=("n",))
    def step_response(self, time: ArrayLike, airspeed: ArrayLike, normal_velocity: ArrayLike) -> Array:
        """Return the lift per span (T, N) [N/m] after the normal velocity jumps from zero to a constant; exact.

        Args:
            time: time since the jump, (T,) [s], not negative, not falling.
            airspeed: one number or (N,) [m/s], not negative.
            normal_velocity: value after the jump, one number or (N,) [m/s].

        Raises:
            ShapeError: the time falls or is negative, a number is not finite, or a shape does not fit.
        """
        from scipy.linalg import expm  # takes as long to import as everything else together

        steps = np.diff(np.asarray(time, float), prepend=0.0)
        if np.any(steps < 0.0):
            raise ShapeError("time: seconds since the step, not falling, were expected")
        w_n = self._each(normal_velocity, "normal_velocity")
        system = self.state_space(airspeed)
        # The constant input becomes one more state: no matrix is inverted, so zero airspeed needs no special case.
        whole = np.zeros((3 * self.strips + 1,) * 2)
        whole[:-1, :-1], whole[:-1, -1] = system.A, system.B @ w_n
        state, lift = np.append(np.zeros(3 * self.strips), 1.0), np.empty((len(steps), self.strips))
        for k, step in enumerate(steps):
            state = expm(whole * step) @ state
            lift[k] = system.C @ state[:-1] + system.D @ w_n
        return lift

    def _airspeed(self, airspeed: ArrayLike) -> Array:
        """Check an airspeed and return it for each strip (N,) [m/s]."""
        speed = self._each(airspeed, "airspeed")
        if np.any(speed < 0.0):
            raise ShapeError(f"airspeed = {speed.min():g}: zero or more was expected; flow from behind is not modelled")
        return speed

    def _each(self, values: ArrayLike, name: str) -> Array:
        """Return one number, or one number for each strip, as an array (N,). Raises ShapeError for another shape."""
        array = np.asarray(values, float)
        if array.shape not in ((), (self.strips,)):
            raise ShapeError(f"{name} has shape {array.shape}: one number or {self.strips} numbers were expected")
        return np.broadcast_to(array, (self.strips,))


def _ratio(part: Array, whole: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return part / whole, but zero where the part is zero, as at zero airspeed."""
    return np.divide(part, whole, out=np.zeros(whole.shape, complex), where=part > 0.0)
