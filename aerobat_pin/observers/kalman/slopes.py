"""The derivative of C^T v by the velocity v, from Pinocchio's derivatives of inverse dynamics.

With M' = C + C^T and C v = ID(q, v, 0) - g, where ID(q, v, a) = M a + C v + g,

    C^T v = M' v - C v,      M' w = d(M w)/dq along v
    D = d(C^T v)/dv = M' + E - B,      E = dID(q, 0, v)/dq without gravity,      B = dID(q, v, 0)/dv

C^T v is quadratic in v, so differences of it with any step are exact: the tests compare D with them.
"""

from __future__ import annotations

import pinocchio as pin

from aerobat_pin.numerics import Array, addresses


class Slopes:
    """E and B of a model at one sample, at fixed places in memory.

    Args:
        model: any model.
    """

    def __init__(self, model: pin.Model) -> None:
        """Allocate the results."""
        self.model = model.copy()
        self.model.gravity.setZero()
        self._by_q, self._by_v = self.model.createData(), self.model.createData()
        self.E, self.B = self._by_q.dtau_dq, self._by_v.dtau_dv
        self.places = addresses(self.E, self.B)
        self._still = 0.0 * self.E[0]

    def at(self, q: Array, v: Array) -> None:
        """Compute E and B for a configuration q (nq,) and a velocity v (nv,)."""
        pin.computeRNEADerivatives(self.model, self._by_q, q, self._still, v)
        pin.computeRNEADerivatives(self.model, self._by_v, q, v, self._still)

    def __reduce__(self) -> tuple[type[Slopes], tuple[pin.Model]]:
        """Pickle the model alone: addresses do not outlive the process."""
        return Slopes, (self.model,)
