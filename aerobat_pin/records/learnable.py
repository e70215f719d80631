"""What a robot says can be learnt about it: parameters, a phase on which errors depend, things of its own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from aerobat_pin.numerics import Array


class Parameter(NamedTuple):
    """A parameter of a robot's belief that a calibration can identify.

    Attributes:
        unit: of its change, `1` for a factor.
        expected: standard deviation that is expected of the change.
        usual: whether it is sought unless others are asked for.
        inertial: whether it changes nothing but the model's inertias, so that torques and known forces stay.
    """

    unit: str
    expected: float
    usual: bool = False
    inertial: bool = False


class Extras(NamedTuple):
    """What only the robot itself learns and reads, such as where a sensor sits: name -> values, and notes in words."""

    values: Mapping[str, Array]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Condition:
    """Phase and state in the m intervals of a stretch, as a robot that has a phase computes them.

    Attributes:
        cycle: what turns, such as `the crank`.
        phase: (m,) phase in the middle of the interval [rad].
        values: (m, s) states, averaged over a cycle or so.
        states: state -> its unit, s of them.
        groups: what coefficients can vary with -> the states that stand for it.
        margin: (s,) how far from where something was learnt it still holds.
    """

    cycle: str
    phase: Array
    values: Array
    states: Mapping[str, str]
    groups: Mapping[str, tuple[str, ...]]
    margin: Array

    @property
    def turns(self) -> float:
        """How many cycles the stretch has."""
        return abs(float(self.phase[-1] - self.phase[0])) / (2.0 * np.pi)

    def part(self, chosen: slice) -> Condition:
        """Return phase and state in some of the intervals."""
        return Condition(self.cycle, self.phase[chosen], self.values[chosen], self.states, self.groups, self.margin)

    def reduced(self, force: Array) -> Array:
        """Return what is a smooth function of the phase in a generalised force (m, nv) of the whole stretch."""
        return force

    def spread(self, force: Array) -> Array:
        """Return the generalised force (m, nv) whose `reduced` form is given."""
        return force
