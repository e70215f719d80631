"""Friction and rotor inertia of joints as a known torque, and their fit to a record without unknown forces.

A joint torque is measured at the motor, or follows from its current. What reaches the link is less by

    tau_f = -(coulomb s(v) + viscous v + inertia a + offset)        s(v) = tanh(v / rate)

with v and a the joint's velocity and acceleration. `inertia` is that of the rotor times the gear ratio squared, where
the model's links do not contain it; `offset` is the bias of the sensor. Given to an observer as one more known force,
tau_f keeps friction from being taken for contact. The model is linear in its four coefficients per joint; s is smooth,
because the sign of a noisy velocity near zero is a coin (the fit at standstill would be arbitrary).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from aerobat_pin.errors import ObserverError
from aerobat_pin.numerics import Array, guarded
from aerobat_pin.observers.redundancy import repeats, twice_low_passed

SMOOTH_RATE = 0.02  # [rad/s, m/s]: where Coulomb friction has reached 76 %
BOUNDLESS = 1.0e6  # [N m, N]: a larger limit of an effort is none
STILL = 1.0e-3  # [rad, m]: a joint that moved less shows only its offset
LEAST_SHARE = 1.0e-3  # of a regressor that is not explained by the joint's others: below, it is not identifiable
FRICTION_COEFFICIENTS = ("coulomb", "viscous", "inertia", "offset")


@guarded(coulomb=("n",), viscous=("n",), inertia=("n",), offset=("n",), deviation="any", rate="positive")
@dataclass(frozen=True)
class JointFriction:
    """Friction of n joints.

    Attributes:
        coulomb: (n,) friction that does not depend on the speed [N m; N where a joint slides].
        viscous: (n,) friction per speed [N m s/rad].
        inertia: (n,) inertia of what turns with the joint beside the links, seen at the joint [kg m2].
        offset: (n,) what the measured torque shows too much [N m].
        rate: speed at which Coulomb friction has reached 76 % of its size [rad/s].
        deviation: (n, 4) standard deviations of the four, in this order, if they were fitted; infinite where the record
            does not show one.
    """

    coulomb: Array
    viscous: Array
    inertia: Array
    offset: Array
    rate: float = SMOOTH_RATE
    deviation: Array | None = None

    @guarded(v=(..., "n"), a=(..., "n"))
    def torque(self, v: Array, a: Array) -> Array:
        """Return the torque (..., n) [N m] that friction adds to the motors', for rates and accelerations (..., n)."""
        resisting = self.coulomb * np.tanh(v / self.rate) + self.viscous * v + self.inertia * a + self.offset
        return np.asarray(-resisting)

    @property
    def unseen(self) -> list[str]:
        """The coefficients that the record does not show, such as `coulomb of joint 2`; they are zero."""
        if self.deviation is None:
            return []
        return [f"{FRICTION_COEFFICIENTS[k]} of joint {joint}" for joint, k in np.argwhere(np.isinf(self.deviation))]


@guarded(q=("m", "n"), v=("m", "n"), a=("m", "n"), residual_torque=("m", "n"), rate="positive", share="positive")
def fit_friction(
    q: Array, v: Array, a: Array, residual_torque: Array, rate: float = SMOOTH_RATE, share: float = 1.0
) -> JointFriction:
    """Fit friction to a record in which no unknown force acts, by least squares for each joint.

    Coulomb and viscous friction and inertia are not negative. What the motion does not show is zero with an infinite
    deviation: Coulomb friction cannot be told from the offset in a joint that turns one way only, and a joint that
    stands still shows nothing but its offset.

    Args:
        q: (m, n) joint angles.
        v: (m, n) joint rates, means over the intervals.
        a: (m, n) joint accelerations, means over the intervals.
        residual_torque: (m, n) torque that the model leaves unexplained, interval means: the rows of these joints in an
            observer's generalised residual.
        rate: see `JointFriction`.
        share: of a new interval, in two low-passes before both sides of the fit; 1 for none. Noise of the accelerations
            makes the inertia too small.

    Raises:
        ObserverError: there are fewer than ten intervals.
    """
    from scipy.optimize import lsq_linear  # takes as long to import as everything else together

    if len(v) < 10:
        raise ObserverError(f"friction: {len(v)} intervals: ten or more were expected")
    count = q.shape[1]
    coefficients, deviation = np.zeros((count, 4)), np.full((count, 4), np.inf)
    for joint in range(count):
        regressors = -np.column_stack([np.tanh(v[:, joint] / rate), v[:, joint], a[:, joint], np.ones(len(v))])
        seen = [3] if np.ptp(q[:, joint]) < STILL else _independent(regressors)
        slow = twice_low_passed(np.column_stack([regressors, residual_torque[:, joint]]), share)
        columns, target = slow[:, seen], slow[:, -1]
        lowest = np.where(np.array(seen) == 3, -np.inf, 0.0)
        coefficients[joint, seen] = lsq_linear(columns, target, (lowest, np.inf), method="bvls").x
        residual = target - slow[:, :-1] @ coefficients[joint]
        variance = float(np.sum(residual**2)) / max(len(v) - len(seen), 1) * repeats(share)
        deviation[joint, seen] = np.sqrt(variance * np.diag(np.linalg.inv(columns.T @ columns)))
    coulomb, viscous, inertia, offset = coefficients.T
    return JointFriction(coulomb, viscous, inertia, offset, rate, deviation)


def _independent(regressors: Array) -> list[int]:
    """Return the regressors that the others do not explain, offset first, then viscous, Coulomb and inertia."""
    kept: list[int] = []
    for k in (3, 1, 0, 2):
        column = regressors[:, k]
        residual = column - regressors[:, kept] @ np.linalg.lstsq(regressors[:, kept], column, rcond=None)[0]
        if np.linalg.norm(residual) > LEAST_SHARE * np.linalg.norm(column) > 0.0:
            kept.append(k)
    return sorted(kept)


def effort_limits(model: pin.Model, rows: list[int]) -> Array:
    """Return the efforts (n,) that joints of some rows can bear [N or N m]; 1 for all if the model does not say so."""
    limits = model.effortLimit[rows]
    return np.asarray(limits if np.all((limits > 0.0) & (limits < BOUNDLESS)) else np.ones(len(limits)))


def as_others_rub(friction: Array, slides: NDArray[np.bool_], limits: Array) -> Array:
    """Return friction (n,) in which joints that do not slide rub as the worst of the others, over what they can bear.

    What a joint at rest holds by its friction is otherwise no different from a push that lasts. `slides` (n,) says
    which joints move so fast that their friction is shown; it is 0 if none does. Limits (n,) are efforts that joints
    can bear (`effort_limits`), in the unit of the friction [N m; N where a joint slides along its axis].
    """
    return np.where(slides, friction, limits * np.max(friction / limits, where=slides, initial=0.0))
