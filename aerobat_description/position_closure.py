"""Close the linkage (the paper's Kinetic Sculpture) at one crank angle, with only Python's standard library.

The resulting positions are used for poses, pictures, and the check that the crank can turn; `aerobat_pin.linkage` also
computes rates, for arrays of crank angles. Points in the plane of the left wing are complex numbers, outboard + i up.
The linkage has three dyads (pairs of bars that share a pin), which are closed one after the other at the pins J4, J7
and J10. Each of these pins lies to the left of the line between the two pins at which its bars start.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

from aerobat_description.morphology_tables import LinkageLengths

CRANK_ANGLES = tuple(math.radians(0.5 * i) for i in range(720))
EDGE = 1e-8  # [m]: the search for a length ends this close to a length with which the crank cannot turn
# Lengths to change if a dyad cannot close: the adjustable lengths of the robot, then the bars of the dyad.
ADJUSTABLE = ("L3b", "L5a", "L5b")
BARS_OF = {"J4": ("L1", "L2a"), "J7": ("L4",), "J10": ("L6", "L7b")}


class ClosureError(ValueError):
    """Two bars cannot be joined.

    Attributes:
        dyad: name of the pin that should join the bars.
        crank_angle: crank angle at which they cannot be joined [rad].

    The message also gives the `span` between their ends and their lengths, the `reaches` [m].
    """

    def __init__(self, dyad: str, crank_angle: float, span: float, reaches: tuple[float, float]) -> None:
        first, second = (1e3 * reach for reach in reaches)
        super().__init__(
            f"the linkage cannot close at {dyad} for a crank angle of {math.degrees(crank_angle):.1f} deg: its bars "
            f"of {first:.3f} and {second:.3f} mm cannot span {1e3 * span:.3f} mm"
        )
        self.dyad, self.crank_angle = dyad, crank_angle


@dataclass(frozen=True)
class Pose:
    """The linkage at one crank angle.

    Attributes:
        pins: pin, J1 to J10 -> position, outboard + i up [m].
        angles: bar, L1 to L7 -> absolute angle [rad].
    """

    pins: Mapping[str, complex]
    angles: Mapping[str, float]

    @property
    def theta_s(self) -> float:
        """Shoulder angle [rad], positive up: the angle of the humerus L3."""
        return self.angles["L3"]

    @property
    def theta_e(self) -> float:
        """Elbow angle [rad]: the angle of the forearm L7 relative to the humerus L3, from -pi to pi."""
        return math.remainder(self.angles["L7"] - self.angles["L3"], 2.0 * math.pi)


def close_linkage(bars: LinkageLengths, crank_angle: float) -> Pose:
    """Return the pose of the linkage at an absolute crank angle t1 [rad]. Raises ClosureError if it cannot close."""

    def dyad(name: str, a: complex, reach_a: float, b: complex, reach_b: float) -> complex:
        ray = b - a
        d = abs(ray)
        x = (reach_a**2 - reach_b**2 + d * d) / (2.0 * d)
        rest = reach_a**2 - x * x
        if rest < 0.0:
            raise ClosureError(name, crank_angle, d, (reach_a, reach_b))
        return a + complex(x, math.sqrt(rest)) * ray / d

    p1, p5, p8 = complex(*bars.P1), complex(*bars.P5), complex(*bars.P8)
    rocker = cmath.rect(1.0, -bars.alpha3) * complex(-bars.L3b, bars.L3c)
    lever, forearm = complex(-bars.L5a, bars.L5b), complex(bars.L7b, bars.L7c)
    p2 = p1 + cmath.rect(bars.L1, crank_angle)
    p4 = dyad("J4", p2, bars.L2a, p5, abs(rocker))
    coupler, humerus = (p4 - p2) / bars.L2a, (p4 - p5) / rocker
    p3 = p2 + coupler * complex(bars.L2b, bars.L2c)
    p7 = dyad("J7", p3, bars.L4, p8, abs(lever))
    long_lever = (p7 - p8) / lever
    p9 = p8 + long_lever * complex(bars.L5c, bars.L5d)
    p6 = p5 + humerus * elbow(bars)
    p10 = dyad("J10", p9, bars.L6, p6, abs(forearm))
    turns = {
        "L1": (p2 - p1) / bars.L1,
        "L2": coupler,
        "L3": humerus,
        "L4": (p7 - p3) / bars.L4,
        "L5": long_lever,
        "L6": (p10 - p9) / bars.L6,
        "L7": (p10 - p6) / forearm,
    }
    pins = dict(zip((f"J{i}" for i in range(1, 11)), (p1, p2, p3, p4, p5, p6, p7, p8, p9, p10), strict=True))
    return Pose(pins, {name: cmath.phase(turn) for name, turn in turns.items()})


def elbow(bars: LinkageLengths) -> complex:
    """Return the position of pin J6 in the frame of the humerus, whose origin is J5, outboard + i up [m]."""
    return complex(bars.L3a + bars.L3c * math.sin(bars.alpha3), bars.L3c * math.cos(bars.alpha3))


@lru_cache(maxsize=64)
def turn(bars: LinkageLengths) -> tuple[Pose, ...]:
    """Close the linkage at every half degree of a turn. Raises ClosureError if the crank cannot turn all the way."""
    return tuple(close_linkage(bars, angle) for angle in CRANK_ANGLES)


def reach(bars: LinkageLengths) -> dict[str, tuple[float, float]]:
    """Return joint -> (lowest, highest angle) [rad] in a turn. Raises ClosureError if the crank cannot turn."""
    angles = {"shoulder": [pose.theta_s for pose in turn(bars)], "elbow": [pose.theta_e for pose in turn(bars)]}
    return {joint: (min(values), max(values)) for joint, values in angles.items()}


def remedies(bars: LinkageLengths, dyad: str) -> dict[str, float]:
    """Return new lengths by name [m], each of which alone lets the crank turn, of bars that do not close at a dyad."""
    lengths = {key: nearest_length(bars, key) for key in (*ADJUSTABLE, *BARS_OF[dyad])}
    return {key: value for key, value in lengths.items() if value is not None}


def advice(bars: LinkageLengths, lengths: Mapping[str, float]) -> str:
    """Return the end of a message: what `remedies` found, or nothing if it found nothing."""
    would = ", ".join(f"{key} = {value:.6g} (now {getattr(bars, key):g})" for key, value in lengths.items())
    return f"; any of these would do: {would}" if would else ""


def nearest_length(bars: LinkageLengths, key: str) -> float | None:
    """Return the value of one length, nearest to its present value, with which the crank can turn.

    The value is rounded to whole micrometres, away from the present value, so that the crank can still turn when the
    value is printed and typed in again. None if there is no value [m] from 0.2 to 5 times the present one.
    """
    present = getattr(bars, key)
    stuck = 0.0  # [rad]: the last crank angle that failed; trying it first rejects most lengths at once

    def turns(length: float) -> bool:
        nonlocal stuck
        changed: dict[str, Any] = {key: length}
        shape = replace(bars, **changed)
        for angle in (stuck, *CRANK_ANGLES):
            try:
                close_linkage(shape, angle)
            except ClosureError:
                stuck = angle
                return False
        return True

    nearest: list[float] = []
    for step in (1.02, 1.0 / 1.02):
        outside = present
        for _ in range(81):
            if nearest and abs(outside - present) > abs(nearest[0] - present):
                break
            inside = outside * step
            if turns(inside):
                while abs(inside - outside) > EDGE:  # between both lies the limit up to which the crank can turn
                    middle = 0.5 * (inside + outside)
                    inside, outside = (middle, outside) if turns(middle) else (inside, middle)
                away = math.ceil if step > 1.0 else math.floor
                nearest.append(away(1e6 * inside) * 1e-6)
                break
            outside = inside
    return min(nearest, key=lambda value: abs(value - present)) if nearest else None
