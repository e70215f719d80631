"""Sigma_Aero on any planform: Wagner's indicial lift on Prandtl's lifting line, as a linear state-space model.

Circulation states (no division by the airspeed anywhere). Per strip, with chord c, semichord b = c/2, airspeed U in
the strip's plane, normal velocity w_n of the air at the 3/4 chord (positive gives lift along the normal), a0 the lift
slope and Wagner's function after R. T. Jones, Phi(s) = 1 - sum_k Psi_k exp(-eps_k s), Phi0 = Phi(0) = 1/2:

    w        = w_n - D Gamma                                          downwash included
    zeta_k'  = w - eps_k (U/b) zeta_k                                 k = 1, 2
    w_eff    = Phi0 w + sum_k Psi_k eps_k (U/b) zeta_k
    Gamma'   = -(U/c) Gamma + (a0 U/2) w_eff
    lift per span = rho U Gamma + rho c Gamma' = a0 rho b U w_eff     at the 1/4 chord, along the normal
    suction per span = a0 rho b w_eff^2                               at the leading edge, toward it

Stations y = (S/2) cos theta at theta_i = i pi/(N+1); Gamma = sum_n g_n sin(n theta) and the downwash
D Gamma = 1/(2S) sum_n n g_n sin(n theta)/sin(theta). At those stations sin(n theta_i) is orthogonal.

Sources: Boutet & Dimitriadis 2018 (Wagner lifting line); Sihite et al. 2022, arXiv 2207.12353 (state space).
Attached flow: the model knows no stall. The suction answers to the 3/4-chord velocity alone: exact for plunging and
flapping, without Garrick's pitch-rate term.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from aerobat_pin.arrays import Array
from aerobat_pin.errors import ShapeError

JONES_PSI = (0.165, 0.335)
JONES_EPS = (0.0455, 0.300)
PHI0 = 1.0 - sum(JONES_PSI)


@dataclass(frozen=True)
class StateSpace:
    """xi' = A xi + B w_n, lift per span = C xi + D w_n, at one instant. Shapes (3N, 3N), (3N, N), (N, 3N), (N, N)."""

    A: Array
    B: Array
    C: Array
    D: Array


class LiftingLine:
    """An unsteady lifting line.

    The state (3N,) is [zeta_1 (N) [m], zeta_2 (N) [m], circulation (N) [m2/s]].

    Args:
        span: full span S [m]. A span far larger than the chord gives the two-dimensional limit.
        chord: one chord [m], one per station (N,), or a function of the spanwise coordinate y [m].
        strips: number of stations N; even is better than odd.
        lift_slope: two-dimensional lift slope a0 [1/rad].
        air_density: [kg/m3].

    Raises:
        ShapeError: span, chord, strips or density are not finite and positive, or the shapes do not fit.
    """

    def __init__(
        self,
        span: float,
        chord: float | ArrayLike | Callable[[Array], ArrayLike],
        *,
        strips: int = 16,
        lift_slope: float = 2.0 * np.pi,
        air_density: float = 1.225,
    ) -> None:
        """Place the stations and build the downwash operator."""
        if strips < 1 or strips != int(strips):
            raise ShapeError(f"strips = {strips}: a whole number, at least one, was expected")
        for name, value, unit in (
            ("span", span, "m"),
            ("lift_slope", lift_slope, "1/rad"),
            ("air_density", air_density, "kg/m3"),
        ):
            if not (np.isfinite(value) and value > 0.0):
                raise ShapeError(f"{name} = {value}: a finite positive number in {unit} was expected")
        self.span = float(span)
        self.strips = int(strips)
        self.lift_slope = float(lift_slope)
        self.air_density = float(air_density)
        n = np.arange(1, strips + 1)
        self.theta = n * np.pi / (strips + 1)
        self.y = 0.5 * span * np.cos(self.theta)
        values = np.asarray(chord(self.y) if callable(chord) else chord, float)
        if values.shape not in ((), (strips,)):
            raise ShapeError(f"chord has shape {values.shape}: one number or {strips} numbers were expected")
        self.chord = np.array(np.broadcast_to(values, (strips,)))
        if not (np.all(np.isfinite(self.chord)) and np.all(self.chord > 0.0)):
            raise ShapeError("chord: finite positive lengths in metres were expected at every station")
        self.semichord = self.chord / 2.0
        # Quadrature along the span: exact for every sin(n theta) that the stations resolve.
        self.width = 0.5 * span * np.sin(self.theta) * np.pi / (strips + 1)
        sines = np.sin(np.outer(self.theta, n))
        to_modes = 2.0 / (strips + 1) * sines.T
        self.downwash = (sines / np.sin(self.theta)[:, None] * n / (2.0 * span)) @ to_modes
        self.centre_downwash = (np.sin(n * np.pi / 2.0) * n / (2.0 * span)) @ to_modes

    def split(self, state: Array) -> tuple[Array, Array, Array]:
        """Return zeta_1, zeta_2 and circulation, each (N,), of a state (3N,)."""
        n = self.strips
        return state[:n], state[n : 2 * n], state[2 * n :]

    def effective_velocity(self, state: Array, airspeed: Array, normal_velocity: Array) -> tuple[Array, Array]:
        """Return w_eff, the normal velocity the lift answers to, and w, with the downwash; both (N,) [m/s]."""
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

    def suction(self, w_eff: Array) -> Array:
        """Return the leading-edge suction per span (N,) [N/m], toward the leading edge."""
        return self.lift_slope * self.air_density * self.semichord * w_eff**2

    def state_space(self, airspeed: ArrayLike) -> StateSpace:
        """Return A, B, C, D; input the normal velocity (N,) [m/s], output the lift per span (N,) [N/m].

        Args:
            airspeed: one number or (N,) [m/s], not negative: flow from behind would make the modes grow.

        Raises:
            ShapeError: the airspeed is negative or not finite.
        """
        n = self.strips
        speed = np.broadcast_to(np.asarray(airspeed, float), (n,))
        if not np.all(speed >= 0.0) or not np.all(np.isfinite(speed)):
            raise ShapeError(f"airspeed = {speed}: finite numbers in m/s, not negative, were expected")
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

    def steady_circulation(self, normal_velocity: ArrayLike) -> Array:
        """Return the circulation (N,) [m2/s] of steady flow, Gamma = a0 b (w_n - D Gamma), whatever the airspeed."""
        slope = self.lift_slope * self.semichord
        w_n = np.broadcast_to(np.asarray(normal_velocity, float), (self.strips,))
        return np.asarray(np.linalg.solve(np.eye(self.strips) + slope[:, None] * self.downwash, slope * w_n))
