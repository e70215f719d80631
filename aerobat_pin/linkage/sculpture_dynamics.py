"""Sigma_K as the paper writes it: accelerations of the linkage's angles, to be integrated.

    x' = f_k(x) + g_k(x) u_k        y = C_k (f_k(x) + g_k(x) u_k)        x = [t, t'], u_k = t1''

(paper, section II-A). Equal accelerations of J4, J7 and J10 by their two ways are six equations, J t'' = W t'^2 e in
the arms of `aerobat_pin.linkage.arms`, for the six angles that follow the crank.

Names. The paper numbers nine angles q1..q9 after the pins J1..J9 and does not say more. Seven bars have seven angles;
each of ours is named after the pin where its bar begins:

    q1 = t1 crank    q2 = t2 (L2)    q3 = t3 (L4)    q5 = t5 (L3, shoulder)    q6 = t6 (L7, elbow)
    q8 = t8 (L5)     q9 = t9 (L6)    q4, q7: at J4 and J7 two of these bars meet, no bar begins

q4 and q7 can only be relative angles, t5 - t2 and t8 - t3; as states of their own they would be two freedoms without
equations. The printed output y = [q6'', q7''], "at the shoulder and elbow joints", is ours as [theta_s'', theta_e'']
= [t5'', t6'' - t5'']: shoulder and elbow are J5 and J6.

Equal accelerations keep nothing closed that rounding or the integrator opens: the loops drift. The stabilisation of
Baumgarte (Computer Methods in Applied Mechanics and Engineering 1, 1972), open'' + 2 s open' + s^2 open = 0, pulls them
shut at the rate s.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from aerobat_description.morphology_tables import LinkageLengths
from aerobat_pin.linkage.arms import ANGLES, loops, real_rows
from aerobat_pin.linkage.kinetic_sculpture import KineticSculpture
from aerobat_pin.numerics import Array

STATE_SIZE = 2 * len(ANGLES)


class SculptureDynamics:
    """f_k, g_k and C_k of the linkage of one wing.

    A state is x (..., 14): the angles t1, t2, t3, t5, t6, t8, t9 [rad], then their rates [rad/s].

    Args:
        lengths: bar lengths and pivots; those of the default morphology when omitted.
        stabilisation: rate s at which open loops close [1/s]; 0 is the paper's form.
    """

    def __init__(self, lengths: LinkageLengths | None = None, stabilisation: float = 0.0) -> None:
        """Lay out the loops."""
        self.sculpture = KineticSculpture(lengths)
        self.stabilisation = stabilisation
        self._loops = loops(self.sculpture.lengths)
        shoulder, elbow = (np.eye(STATE_SIZE)[len(ANGLES) + ANGLES.index(name)] for name in ("t5", "t6"))
        self.C_k = np.array([shoulder, elbow - shoulder])

    def state(self, crank_angle: float, crank_velocity: float = 0.0) -> Array:
        """Return the closed state x (14,). Raises LinkageError where the linkage cannot close."""
        closed = self.sculpture.solve(crank_angle, crank_velocity)
        return np.array([*closed.angles.values(), *map(closed.rate, closed.bars.values())], float)

    def f_k(self, x: ArrayLike) -> Array:
        """Return the rate (..., 14) of a state whose crank turns steadily."""
        angles, rates = self._parts(x)
        jacobian = self._loops.by_angles(angles)
        wanted = -self._loops.centripetal(angles, rates)
        if self.stabilisation != 0.0:
            opening = (jacobian @ rates[..., None])[..., 0]
            wanted = wanted - self.stabilisation * (2.0 * opening + self.stabilisation * self._loops.at(angles))
        J = real_rows(jacobian)
        dependent = np.linalg.solve(J[..., 1:], real_rows(wanted[..., None]))[..., 0]
        return np.concatenate([rates, np.zeros_like(rates[..., :1]), dependent], axis=-1)

    def g_k(self, x: ArrayLike) -> Array:
        """Return what a unit of crank acceleration adds to the rate (..., 14)."""
        angles, rates = self._parts(x)
        J = real_rows(self._loops.by_angles(angles))
        dependent = np.linalg.solve(J[..., 1:], -J[..., :1])[..., 0]
        return np.concatenate([np.zeros_like(rates), np.ones_like(rates[..., :1]), dependent], axis=-1)

    def gap(self, x: ArrayLike) -> Array:
        """Return the largest opening (...) of the loops at J4, J7 and J10 [m]."""
        return np.asarray(np.max(np.abs(self._loops.at(self._parts(x)[0])), axis=-1))

    @staticmethod
    def _parts(x: ArrayLike) -> tuple[Array, Array]:
        state = np.asarray(x, float)
        return state[..., : len(ANGLES)], state[..., len(ANGLES) :]
