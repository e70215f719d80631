"""The error of a belief as a Fourier series of the crank's phase, fitted to what a free flight leaves unexplained.

    e(phase, z) = sum_j z_j (a_j0 + sum_k a_jk cos(k phase) + b_jk sin(k phase)),    z_0 = 1

Each row of the generalised force has its own coefficients. With states of the flight in z (speed, frequency, attitude,
about their means and in units of their spread) the coefficients are linear in these states, which needs free flights
that differ in them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aerobat_pin.aerobat.calibration.flight_state import STATES, FlightState
from aerobat_pin.aerobat.calibration.learnt_range import margins
from aerobat_pin.numerics import Array

LEAST_SPREAD = 0.05  # of the learnt range's margin: a state that varies less shows no dependence on it
RIDGE = 1.0e-3  # keeps coefficients of states that always vary together small


@dataclass(frozen=True)
class Harmonics:
    """A Fourier series of a generalised force over the crank's phase.

    Attributes:
        order: highest harmonic.
        varied: states on which the coefficients depend linearly.
        centre: (s,) value of each of them in the middle of what was learnt.
        spread: (s,) its standard deviation there.
        coefficients: (1 + s, 2 order + 1, nv) constant, cosines, sines of each row [N, N m]; first those of z_0.
    """

    order: int
    varied: tuple[str, ...]
    centre: Array
    spread: Array
    coefficients: Array

    def force(self, state: FlightState) -> Array:
        """Return the generalised force (m, nv) of the error, interval means."""
        terms = _terms(state, self.order, self.varied, self.centre, self.spread)
        return terms @ self.coefficients.reshape(-1, self.coefficients.shape[2])


def fit_harmonics(
    states: Sequence[FlightState], residuals: Sequence[Array], order: int, varied: Sequence[str] = ()
) -> Harmonics:
    """Fit a Fourier series to residuals (m, nv) of free flights by least squares.

    Args:
        states: phase and state of each flight.
        residuals: (m, nv) generalised force that the belief leaves unexplained in each flight.
        order: highest harmonic.
        varied: states on which the coefficients may depend; those that hardly vary are left out.
    """
    values = np.concatenate([state.values for state in states])
    allowed, spreads, centres = margins(values), np.std(values, axis=0), np.mean(values, axis=0)
    kept = tuple(name for name in varied if spreads[STATES.index(name)] > LEAST_SPREAD * allowed[STATES.index(name)])
    at = [STATES.index(name) for name in kept]
    centre, spread = centres[at], spreads[at]
    terms = np.concatenate([_terms(state, order, kept, centre, spread) for state in states])
    target = np.concatenate(residuals)
    weight = np.repeat([0.0] + [RIDGE * np.sqrt(len(target))] * len(kept), 2 * order + 1)
    rows = np.concatenate([terms, np.diag(weight)])
    found = np.linalg.lstsq(rows, np.concatenate([target, np.zeros((len(weight), target.shape[1]))]), rcond=None)[0]
    return Harmonics(order, kept, centre, spread, found.reshape(1 + len(kept), 2 * order + 1, target.shape[1]))


def _terms(state: FlightState, order: int, varied: Sequence[str], centre: Array, spread: Array) -> Array:
    """Return the regressors (m, (1 + s) (2 order + 1))."""
    turns = np.outer(state.phase, np.arange(1, order + 1))
    series = np.concatenate([np.ones((len(turns), 1)), np.cos(turns), np.sin(turns)], axis=1)
    z = (state.values[:, [STATES.index(name) for name in varied]] - centre) / spread
    factors = np.concatenate([np.ones((len(turns), 1)), z], axis=1)
    return np.asarray((factors[:, :, None] * series[:, None]).reshape(len(turns), -1))
