"""What no force explains: a check of the belief (robot, air, sensors) that every record offers for free.

There are often more rows than independent unknowns. Whatever the forces are, some combinations of the weighted rows are
then zero if the belief is right. What they show instead needs no flight without forces to be seen, and hardly depends
on the forces:

    r = (I - A A^+) L^T phi,   A = L^T J^T       rms = sqrt(mean |r|^2 / (rows - rank))

with phi the generalised residual of an interval and L the weighted rows in use, moments over a lever arm of 50 mm.

Noise of the velocity sensors appears in r as its derivative: large between samples, small over a wing beat. The verdict
therefore looks at r behind two low-passes of 10 ms, and takes off what the sensors leave there; the fifth differences
of r show how much that is. An error of the belief that looks like a force at the given points is invisible: a wrong
mass at the very point at which a force is sought, for example.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any, Literal

import numpy as np

from aerobat_pin.numerics import Array

SLOW_TIME = 0.01  # [s]: time constant of both low-passes; an error of the belief changes with the wing beat
ALLOWED = 0.005  # of the robot's weight, per redundant row: what still counts as consistent
SENSOR_MARGIN = 1.5  # the same in units of what the sensors explain: noise also enters the known forces
SCATTER_GAIN = 0.6745 * np.sqrt(924.0)  # median |fifth difference| of a derivative of white noise, over its deviation
SHARE_OF_ERROR = 2.5  # a force that is smaller than this times the belief's error can be made up by it
NOTHING = 1e-18  # a weight in a sum that double precision does not notice

Verdict = Literal["consistent", "inconsistent", "blind"]


@dataclass(frozen=True, repr=False)
class Redundancy:
    """What no force explains, over a record; sizes in N per redundant row, moments over a lever arm of 50 mm.

    Attributes:
        rms: root mean square of the size in each interval, see `Estimate.redundancy_series`.
        rows: number of rows in use.
        redundant: number of rows beyond the rank of the unknown components; 0 if the verdict is `blind`.
        sensors: the part of the low-passed residual that noise of the velocity sensors explains.
        belief: the rest of the low-passed residual: what the belief about robot and air must answer for.
        allowed: largest `belief` that counts as consistent.
        points: frames at which forces are sought.
    """

    rms: float
    rows: int
    redundant: int
    sensors: float
    belief: float
    allowed: float
    points: tuple[str, ...]

    @property
    def verdict(self) -> Verdict:
        """`blind` without redundant rows, `inconsistent` if the belief is off by more than is allowed."""
        if self.redundant < 1:
            return "blind"
        return "consistent" if self.belief <= self.allowed else "inconsistent"

    @property
    def least(self) -> float:
        """Force [N] that the belief's error can look like."""
        return SHARE_OF_ERROR * self.belief

    def describe(self) -> str:
        """Return the verdict in words, with what it cannot see."""
        if self.verdict == "blind":
            return f"belief: cannot be judged, as {self.rows} rows have no redundancy for the forces sought"
        unseen = f"blind to errors that look like forces at {', '.join(self.points)}"
        if self.verdict == "consistent":
            return f"belief: consistent within {force_size(self.allowed)} a row; {unseen}"
        size = f"belief off by about {force_size(self.belief)} a row"
        return f"{size}: forces below {force_size(self.least)} are not to be trusted; {unseen}"

    def to_json(self) -> dict[str, Any]:
        """Return plain values, with the verdict and its words."""
        return {**asdict(self), "points": list(self.points), "verdict": self.verdict, "words": self.describe()}

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> Redundancy:
        """Read what `to_json` wrote."""
        named = {item.name: values[item.name] for item in fields(cls)}
        return cls(**{**named, "points": tuple(named["points"])})

    def __repr__(self) -> str:
        return f"Redundancy: {self.describe()}"


def redundancy_of(
    time: Array, unexplained: Array, rows: int, rank: int, weight: float, points: Sequence[str]
) -> Redundancy:
    """Judge what no force explains.

    Args:
        time: (m + 1,) sample times [s].
        unexplained: (m, k) weighted rows that no force explains, padded with zeros.
        rows: number of rows in use.
        rank: number of independent components that the rows determine; 0 if no force is sought.
        weight: weight of everything that moves [N].
        points: frames at which forces are sought.
    """
    redundant = max(rows - rank, 0) if rank else 0
    dt = typical_step(time)
    share = -np.expm1(-dt / SLOW_TIME)
    slow = slow_part(time, unexplained)
    sensors = 0.0
    if len(unexplained) > 6:
        scatter = np.median(np.abs(np.diff(unexplained, 5, axis=0)), axis=0) / SCATTER_GAIN
        k = np.arange(int(30.0 * SLOW_TIME / dt) + 3)
        response = share**2 * (k + 1) * (1.0 - share) ** k  # of both low-passes to one interval
        power = np.sum(scatter**2) * np.sum(np.diff(response, prepend=0.0) ** 2)
        sensors = float(np.sqrt(power / max(redundant, 1)))
    seen = float(np.mean(slow**2) * slow.shape[1] / max(redundant, 1))
    return Redundancy(
        rms=float(np.sqrt(np.sum(unexplained**2) / (max(redundant, 1) * len(unexplained)))),
        rows=rows,
        redundant=redundant,
        sensors=sensors,
        belief=float(np.sqrt(max(seen - sensors**2, 0.0))),
        allowed=float(np.hypot(ALLOWED * weight, SENSOR_MARGIN * sensors)),
        points=tuple(points),
    )


def low_passed(values: Array, share: float | Array) -> Array:
    """Filter the columns of `values` (m, k) by y_n = (1 - share_n) y_(n-1) + share_n x_n, from rest.

    The sum over the past is built by doubling its length until what is older than that no longer counts. `share` is a
    number, (m,) or (m, k); `scipy.signal` knows only numbers.
    """
    uneven = isinstance(share, np.ndarray)
    each: Any = np.reshape(share, (len(values), -1)) if uneven else share
    result, decay, reach = each * values, 1.0 - (each[1:] if uneven else each), 1
    while reach < len(values) and (decay.max(initial=0.0) if uneven else decay) > NOTHING:
        result[reach:] += decay * result[:-reach]
        decay, reach = decay[reach:] * decay[:-reach] if uneven else decay * decay, 2 * reach
    return np.asarray(result)


def slow_part(time: Array, values: Array) -> Array:
    """Return values (m, k) of the intervals of `time` (m + 1,) behind two low-passes of `SLOW_TIME`, from zero on."""
    return twice_low_passed(values, -np.expm1(-typical_step(time) / SLOW_TIME))


def twice_low_passed(values: Array, share: float) -> Array:
    """Return values (m, k) behind two low-passes that take on this share of a new value, from zero on."""
    return low_passed(low_passed(values, share), share)


def repeats(share: float) -> float:
    """Return how many values behind two low-passes count as one, where white noise was before them."""
    return (2.0 - share) ** 3 / (share * (1.0 + (1.0 - share) ** 2))


def typical_step(time: Array) -> float:
    """Return the median step [s] of sample times (m + 1,), repeated ones left out."""
    steps = np.diff(time)
    return float(np.median(steps[steps > 0.0])) if np.any(steps > 0.0) else SLOW_TIME


def force_size(force: float) -> str:
    """Return a force [N] with two digits or more, as `4.6 mN`, `238 mN` and `30.1 N`."""
    if force < 0.9995:
        return f"{1e3 * force:.2g} mN" if force < 0.0995 else f"{1e3 * force:.0f} mN"
    return f"{force:.3g} N" if force < 999.5 else f"{force:.0f} N"
