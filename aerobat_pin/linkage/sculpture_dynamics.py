"""Sigma_K in the form of the paper: differential equations for the linkage's angles.

    x' = f_k(x) + g_k(x) u_k        y = C_k (f_k(x) + g_k(x) u_k)        x = [t, t'], u_k = t1''

(paper, section II-A). J4, J7 and J10 are each reached along two chains of bars. Equal accelerations along both chains
are six equations, J t'' = W t'^2 e in the notation of `aerobat_pin.linkage.arms`, for the six angles other than t1.

The output is y = [theta_s'', theta_e''] = [t5'', t6'' - t5'']; docs/conventions.md compares angles and output with the
paper's.

Equal accelerations do not close a gap that rounding or the integrator has opened, so the loops drift apart. The
stabilisation of Baumgarte (Computer Methods in Applied Mechanics and Engineering 1, 1972) closes the gaps at the rate
s: gap'' + 2 s gap' + s^2 gap = 0.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from aerobat_description.morphology_tables import LinkageLengths
from aerobat_pin.linkage.arms import ANGLES, loops, real_rows
from aerobat_pin.linkage.kinetic_sculpture import KineticSculpture
from aerobat_pin.numerics import Array, guarded

STATE_SIZE = 2 * len(ANGLES)


class SculptureDynamics:
    """The functions f_k and g_k and the matrix C_k of the linkage of one wing.

    A state is x (..., 14): the angles t1, t2, t3, t5, t6, t8, t9 [rad], then their rates [rad/s].

    Args:
        lengths: bar lengths and pivots; those of the default morphology when omitted.
        stabilisation: rate s at which gaps close [1/s]; 0 is the paper's form.
    """

    @guarded(stabilisation="not negative")
    def __init__(self, lengths: LinkageLengths | None = None, stabilisation: float = 0.0) -> None:
        self.sculpture = KineticSculpture(lengths)
        self.stabilisation = stabilisation
        self._loops = loops(self.sculpture.lengths)
        shoulder, elbow = (np.eye(STATE_SIZE)[len(ANGLES) + ANGLES.index(name)] for name in ("t5", "t6"))
        self.C_k = np.array([shoulder, elbow - shoulder])

    @guarded()
    def state(self, crank_angle: float, crank_velocity: float = 0.0) -> Array:
        """Return the state x (14,) of the closed linkage. Raises LinkageError if the linkage cannot close."""
        closed = self.sculpture.solve(crank_angle, crank_velocity)
        return np.array([*closed.angles.values(), *map(closed.rate, closed.bars.values())], float)

    @guarded(x=(..., STATE_SIZE))
    def f_k(self, x: ArrayLike) -> Array:
        """Return the time derivative (..., 14) of a state while the crank turns at constant rate."""
        angles, rates = self._parts(x)
        jacobian = self._loops.by_angles(angles)
        wanted = -self._loops.centripetal(angles, rates)
        if self.stabilisation != 0.0:
            opening = (jacobian @ rates[..., None])[..., 0]
            wanted = wanted - self.stabilisation * (2.0 * opening + self.stabilisation * self._loops.at(angles))
        J = real_rows(jacobian)
        dependent = np.linalg.solve(J[..., 1:], real_rows(wanted[..., None]))[..., 0]
        return np.concatenate([rates, np.zeros_like(rates[..., :1]), dependent], axis=-1)

    @guarded(x=(..., STATE_SIZE))
    def g_k(self, x: ArrayLike) -> Array:
        """Return the change of the state's time derivative (..., 14) per unit of crank acceleration."""
        angles, rates = self._parts(x)
        J = real_rows(self._loops.by_angles(angles))
        dependent = np.linalg.solve(J[..., 1:], -J[..., :1])[..., 0]
        return np.concatenate([np.zeros_like(rates), np.ones_like(rates[..., :1]), dependent], axis=-1)

    @guarded(x=(..., STATE_SIZE))
    def gap(self, x: ArrayLike) -> Array:
        """Return the largest gap (...) of the loops at J4, J7 and J10 [m]."""
        return np.asarray(np.max(np.abs(self._loops.at(self._parts(x)[0])), axis=-1))

    @staticmethod
    def _parts(x: ArrayLike) -> tuple[Array, Array]:
        state = np.asarray(x, float)
        return state[..., : len(ANGLES)], state[..., len(ANGLES) :]
