"""Crank drives that are plain functions of time, and the check that any drive is a motion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from aerobat_pin.errors import CrankError
from aerobat_pin.numerics import Array

MISMATCH = 0.01  # of the way turned (or of the speed gained): by how much an angle and its rate may differ


class CrankMotion(NamedTuple):
    """The crank at times (n,): absolute angle t1 [rad], rate [rad/s], acceleration [rad/s2]."""

    angle: Array
    rate: Array
    acceleration: Array


CrankDrive = Callable[[Array], tuple[ArrayLike, ArrayLike, ArrayLike]]


@dataclass(frozen=True)
class ConstantRate:
    """The crank turns steadily, at all times: `start` [rad] at t = 0, `rate` [rad/s]."""

    start: float
    rate: float

    def __call__(self, time: Array) -> CrankMotion:
        """Return the motion at times (n,) [s]."""
        return CrankMotion(self.start + self.rate * time, np.full_like(time, self.rate), np.zeros_like(time))


@dataclass(frozen=True)
class SpinUp:
    """The crank rests at `start` [rad] until t = 0 and turns at `rate` [rad/s] from t = `duration` [s] on.

    In between the rate follows the quintic 10 s^3 - 15 s^4 + 6 s^5, s = t / duration, whose first and second derivative
    vanish at both ends: neither torque nor its rate jumps.
    """

    start: float
    rate: float
    duration: float

    def __call__(self, time: Array) -> CrankMotion:
        """Return the motion at times (n,) [s]."""
        s = np.clip(time / self.duration, 0.0, 1.0)
        way = self.duration * s**4 * (2.5 - 3.0 * s + s**2) + np.maximum(time - self.duration, 0.0)
        share = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        slope = 30.0 * s**2 * (1.0 - s) ** 2 / self.duration
        return CrankMotion(self.start + self.rate * way, self.rate * share, self.rate * slope)


def checked_motion(drive: CrankDrive, time: Array) -> CrankMotion:
    """Return a drive's motion, checked.

    Args:
        drive: any function of time.
        time: (n,) rising [s].

    Raises:
        CrankError: not three quantities at these times, not finite, or the rate is not the angle's derivative, or the
            acceleration not the rate's.
    """
    motion = drive(time)
    if not isinstance(motion, tuple) or len(motion) != 3:
        raise CrankError("a crank drive returns a tuple (angle, rate, acceleration) of the times that it is given")
    parts: list[Array] = []
    for part, name in zip(motion, CrankMotion._fields, strict=True):
        values = np.asarray(part, float)
        if values.shape not in ((), time.shape):
            raise CrankError(f"crank drive: {name} has shape {values.shape}: {time.shape} was expected, as of the time")
        if not np.all(np.isfinite(values)):
            raise CrankError(
                f"crank drive: {name} is not finite everywhere from t = {time[0]:g} to {time[-1]:g} s; before t = 0 "
                "the air warms up"
            )
        parts.append(np.broadcast_to(values, time.shape))
    found = CrankMotion(*parts)
    _derivative("rate", "angle", found.angle, found.rate, time)
    _derivative("acceleration", "rate", found.rate, found.acceleration, time)
    return found


def _derivative(name: str, of: str, values: Array, slopes: Array, time: Array) -> None:
    """Raise CrankError unless slopes add up to the change of values, but for the sampling and for jumps."""
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
