"""Crank drives given by formulas, and a check that a drive's angle, rate and acceleration agree."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from aerobat_pin.errors import CrankError
from aerobat_pin.numerics import Array, guarded

MISMATCH = 0.01  # allowed gap between a change and the integral of its rate, as a share of the total variation


class CrankMotion(NamedTuple):
    """The crank at times (n,): absolute angle t1 [rad], rate [rad/s], acceleration [rad/s2]."""

    angle: Array
    rate: Array
    acceleration: Array


CrankDrive = Callable[[Array], tuple[ArrayLike, ArrayLike, ArrayLike]]


@guarded()
@dataclass(frozen=True)
class ConstantRate:
    """A crank that always turns at `rate` [rad/s], also before t = 0; its angle at t = 0 is `start` [rad]."""

    start: float
    rate: float

    @guarded()
    def __call__(self, time: Array) -> CrankMotion:
        """Return the motion at times (n,) [s]."""
        return CrankMotion(self.start + self.rate * time, np.full_like(time, self.rate), np.zeros_like(time))


@guarded(duration="positive")
@dataclass(frozen=True)
class SpinUp:
    """A crank that rests at `start` [rad] until t = 0 and turns at `rate` [rad/s] from t = `duration` [s] on.

    In between, the rate grows as 10 s^3 - 15 s^4 + 6 s^5 with s = t / duration. The first and second derivatives of
    this polynomial vanish at both ends, so the torque and its rate do not jump.
    """

    start: float
    rate: float
    duration: float

    @guarded()
    def __call__(self, time: Array) -> CrankMotion:
        """Return the motion at times (n,) [s]."""
        s = np.clip(time / self.duration, 0.0, 1.0)
        way = self.duration * s**4 * (2.5 - 3.0 * s + s**2) + np.maximum(time - self.duration, 0.0)
        share = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        slope = 30.0 * s**2 * (1.0 - s) ** 2 / self.duration
        return CrankMotion(self.start + self.rate * way, self.rate * share, self.rate * slope)


def checked_motion(drive: CrankDrive, time: Array) -> CrankMotion:
    """Evaluate a drive and check its result.

    Args:
        drive: any function of time.
        time: (n,) rising [s].

    Raises:
        CrankError: the drive does not return three finite quantities at these times, or its rate is not the derivative
            of its angle, or its acceleration is not the derivative of its rate.
    """
    motion = drive(time)
    if not isinstance(motion, tuple) or len(motion) != 3:
        raise CrankError("a crank drive must return a tuple (angle, rate, acceleration) at the times it is given")
    parts: list[Array] = []
    for part, name in zip(motion, CrankMotion._fields, strict=True):
        values = np.asarray(part, float)
        if values.shape not in ((), time.shape):
            raise CrankError(f"crank drive: {name} has shape {values.shape}: {time.shape} was expected, as for time")
        if not np.all(np.isfinite(values)):
            raise CrankError(
                f"crank drive: {name} is not finite everywhere from t = {time[0]:g} to {time[-1]:g} s; times before "
                "t = 0 are needed to warm up the aerodynamic state"
            )
        parts.append(np.broadcast_to(values, time.shape))
    found = CrankMotion(*parts)
    _derivative("rate", "angle", found.angle, found.rate, time)
    _derivative("acceleration", "rate", found.rate, found.acceleration, time)
    return found


def _derivative(name: str, of: str, values: Array, slopes: Array, time: Array) -> None:
    """Raise CrankError unless the integral of `slopes` matches the change of `values`, within sampling error and jumps.

    `of` is what an error calls the values, `name` what it calls their slopes.
    """
    step = np.diff(time)
    if step.size == 0:
        return
    gained = values[1:] - values[0]
    summed = np.cumsum(0.5 * step * (slopes[1:] + slopes[:-1]))
    way = np.sum(np.abs(np.diff(values))) + np.sum(step * np.abs(slopes[1:]))
    rounding = 1e-9 * np.max(np.abs(values))
    worst = int(np.argmax(np.abs(gained - summed)))
    if abs(gained[worst] - summed[worst]) > MISMATCH * way + np.max(step) * np.max(np.abs(slopes)) + rounding:
        raise CrankError(
            f"crank drive: from t = {time[0]:g} to {time[worst + 1]:g} s the {of} changes by {gained[worst]:.4g}, but "
            f"the {name} adds up to {summed[worst]:.4g}; it must be the {of}'s derivative, in radians and seconds"
        )
