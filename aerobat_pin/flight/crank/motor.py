"""A motor with a rate controller on the crank, integrated before the flight is simulated.

    I(t1) t1'' = torque - load(t1) - I'(t1) t1'^2 / 2               I = rotor + wings
    lag torque' = sat(order) - torque
    order = kp miss + ki z        z' = miss - (order - sat(order)) / kp        miss = rate - t1'

`miss` is the error of the crank rate and `order` the commanded torque. z is the integral of the rate error, reduced
while the torque is at its limit so that it does not wind up.

The model includes the rotor, the wings' inertia with the body at rest, and a load that depends on the crank angle
alone. It omits the forces that act on the wings in flight (air, body motion, gravity, unknown forces), friction, and
the fall of the torque limit with speed. The crank's motion is therefore known before the flight. The motor torque in
the flight log does include the forces in flight: it is the torque that this crank motion requires, not the torque of
this motor model.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from aerobat_pin.errors import CrankError
from aerobat_pin.flight.crank.drives import CrankMotion
from aerobat_pin.numerics import Array, guarded

ACCURACY = 1.0e-9  # relative tolerance of the integration
STATE_SCALE = np.array([1.0, 10.0, 0.1, 1.0])  # typical angle [rad], rate [rad/s], torque [N m], integral [rad]


def no_load(crank_angle: Array) -> Array:
    """Return zero load torque."""
    return np.zeros_like(crank_angle)


def no_wings(crank_angle: Array) -> tuple[Array, Array]:
    """Return zero inertia and zero derivative."""
    return np.zeros_like(crank_angle), np.zeros_like(crank_angle)


@guarded(rotor_inertia="positive", torque_limit="positive", lag="positive", gain="positive")
@dataclass(frozen=True)
class RateControlledMotor:
    """A crank drive: a rate controller, a motor with torque limit and lag, and the inertia and load that it turns.

    Attributes:
        start: crank angle at t = 0 [rad].
        rate: commanded crank rate [rad/s].
        start_rate: crank rate at t = 0, constant at all times before [rad/s].
        rotor_inertia: rotor inertia as seen at the crank: the rotor's own times the gear ratio squared [kg m2].
        torque_limit: largest motor torque at the crank [N m].
        lag: time constant of the torque [s].
        gain: proportional gain kp [N m s/rad].
        integral_gain: integral gain ki [N m/rad].
        wings: function of the crank angle: the wings' inertia [kg m2] and its derivative by crank angle [kg m2/rad];
            see `WingInertia`.
        load: function of the crank angle: torque that resists turning forward [N m].
    """

    start: float
    rate: float
    start_rate: float
    rotor_inertia: float
    torque_limit: float
    lag: float
    gain: float
    integral_gain: float
    wings: Callable[[Array], tuple[Array, Array]] = no_wings
    load: Callable[[Array], Array] = no_load

    @guarded(time=("n",))
    def __call__(self, time: Array) -> CrankMotion:
        """Return the motion at times (n,) [s]. Raises the same errors as `states`."""
        angle, rate, torque, _ = self.states(time)
        return CrankMotion(angle, rate, np.where(time < 0.0, 0.0, self._acceleration(angle, rate, torque)))

    @guarded(time=("n",))
    def torque(self, time: Array) -> Array:
        """Return the motor's torque at the crank at times (n,) [N m]. Raises the same errors as `states`."""
        return np.asarray(self.states(time)[2])

    @guarded(time=("n",))
    def states(self, time: Array) -> Array:
        """Integrate from t = 0; return angle, rate, torque and integral z (4, n) at times (n,) [s].

        Raises:
            CrankError: the integration failed.
        """
        from scipy.integrate import solve_ivp  # takes a third of a second to import; other drives do without

        begin = np.array([self.start, self.start_rate, 0.0, 0.0])
        states = np.tile(begin[:, None], len(time))
        states[0] += self.start_rate * np.minimum(time, 0.0)
        flown = time > 0.0
        if np.any(flown):
            end = float(np.max(time))
            solved = solve_ivp(
                self._rates,
                (0.0, end),
                begin,
                "DOP853",
                dense_output=True,
                rtol=ACCURACY,
                atol=ACCURACY * STATE_SCALE,
            )
            if not solved.success or not np.all(np.isfinite(solved.y)):
                raise CrankError(f"the crank's motion cannot be integrated to t = {end:g} s: {solved.message}")
            states[:, flown] = solved.sol(time[flown])
        return states

    def _rates(self, _: float, state: Array) -> Array:
        angle, rate, torque, integral = state
        miss = self.rate - rate
        order = self.gain * miss + self.integral_gain * integral
        limited = min(max(order, -self.torque_limit), self.torque_limit)
        bled = (order - limited) / self.gain
        acceleration = self._acceleration(angle, rate, torque)
        return np.array([rate, float(acceleration), (limited - torque) / self.lag, miss - bled])

    def _acceleration(self, angle: Array, rate: Array, torque: Array) -> Array:
        inertia, slope = self.wings(angle)
        return np.asarray((torque - self.load(angle) - 0.5 * slope * rate**2) / (self.rotor_inertia + inertia))
