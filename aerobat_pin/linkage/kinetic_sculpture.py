"""The Kinetic Sculpture, the linkage of one wing, closed dyad by dyad at any crank angle; and as the paper's equations.

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

import warnings

import numpy as np
from numpy.typing import ArrayLike

from aerobat_description.morphology import Morphology
from aerobat_description.morphology_tables import LinkageLengths
from aerobat_description.position_closure import CRANK_ANGLES, ClosureError, advice, remedies
from aerobat_pin.errors import LinkageError, NearSingularWarning
from aerobat_pin.linkage.arms import ANGLES, Sensitivity, bent_arms, loops, real_rows, sensitivities
from aerobat_pin.linkage.closure import DYADS, Closure, close_dyads
from aerobat_pin.numerics import Array, guarded, together

NEAR_SINGULAR = np.radians(15.0)  # [rad]: a transmission angle closer than this to 0 or 180 deg causes a warning
STATE_SIZE = 2 * len(ANGLES)


class KineticSculpture:
    """The linkage of one wing in its (+,+,+) assembly: each dyad closes left of the ray between its ends (see `meet`).

    Its lengths, and the pivots, are those of the default morphology when omitted.
    """

    @guarded()
    def __init__(self, lengths: LinkageLengths | None = None) -> None:
        """Store the lengths without checking them; `check` tests whether the crank can turn."""
        self.lengths = lengths if lengths is not None else Morphology.load("aerobat").linkage
        self._judged = False

    @guarded()
    def solve(
        self, crank_angle: ArrayLike, crank_velocity: ArrayLike = 0.0, crank_acceleration: ArrayLike = 0.0
    ) -> Closure:
        """Close the linkage at one or many crank angles.

        Issues a `NearSingularWarning`, once, if the two bars of a dyad come within 15 deg of a straight line.

        Args:
            crank_angle: absolute t1 [rad], scalar or any shape.
            crank_velocity: rate of t1 [rad/s], broadcast against the angle.
            crank_acceleration: acceleration of t1 [rad/s2], broadcast against the angle.

        Raises:
            LinkageError: a dyad cannot close; the message names its pin, the crank angle and lengths that would help.
            ShapeError: an angle, velocity or acceleration is not finite, or their shapes do not fit each other.
        """
        t1, rate, acceleration = together(
            crank_angle=np.asarray(crank_angle),
            crank_velocity=np.asarray(crank_velocity),
            crank_acceleration=np.asarray(crank_acceleration),
        )
        closed = Closure(self.lengths, t1[()], rate[()], acceleration[()], *close_dyads(self.lengths, t1))
        for name in DYADS:
            if np.any(np.isnan(closed.points[name].at)):
                raise self._open(closed, name)
        if not self._judged:
            self._judge(closed)
        return closed

    @guarded()
    def sensitivity(self, crank_angle: ArrayLike) -> dict[str, Sensitivity]:
        """Differentiate the closed linkage by the lengths that morphing control changes: L3b, L5a and L5b.

        The absolute t1 [rad], scalar or any shape, is kept constant in the derivatives.

        Raises:
            LinkageError, ShapeError: for the same reasons as `solve`.
        """
        closed = self.solve(crank_angle)
        return sensitivities(self.lengths, np.stack([closed.angles[name] for name in ANGLES], axis=-1))

    def check(self) -> None:
        """Raise LinkageError unless the crank can turn through a full circle; warn as `solve` does."""
        self.solve(CRANK_ANGLES)
        self._judged = True

    def _open(self, closed: Closure, dyad: str) -> LinkageError:
        """Return the error for a dyad that cannot close.

        The error gives the first crank angle at which the dyad cannot close, and lengths that would let it close.
        """
        bars, arm = self.lengths, bent_arms(self.lengths)
        start, end = (np.ravel(closed.points[name].at) for name in DYADS[dyad])
        first = int(np.argmax(np.isnan(np.ravel(closed.points[dyad].at))))
        reach = {"J4": (bars.L2a, arm.J5_J4), "J7": (bars.L4, arm.J8_J7), "J10": (bars.L6, arm.J6_J10)}[dyad]
        crank_angle, span = float(np.ravel(closed.crank_angle)[first]), abs(end[first] - start[first])
        nearest = remedies(bars, dyad)
        error = ClosureError(dyad, crank_angle, span, (abs(reach[0]), abs(reach[1])))
        return LinkageError(f"{error}{advice(bars, nearest)}", dyad, crank_angle, nearest)

    def _judge(self, closed: Closure) -> None:
        """Warn of the worst transmission angle if it is nearly singular, at most once for each linkage."""
        if closed.crank_angle.size == 0:
            return
        angles = np.array([np.ravel(angle) for angle in closed.transmission.values()])
        margins = np.minimum(angles, np.pi - angles)
        pin, k = (int(i) for i in np.unravel_index(np.argmin(margins), margins.shape))
        if margins[pin, k] < NEAR_SINGULAR:
            self._judged = True
            name, crank_angle = list(closed.transmission)[pin], float(np.ravel(closed.crank_angle)[k])
            warnings.warn(NearSingularWarning(name, float(angles[pin, k]), crank_angle), stacklevel=3)


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
