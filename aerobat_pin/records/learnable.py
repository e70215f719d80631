"""What a robot says can be learnt about it: parameters, a phase on which errors depend, things of its own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from aerobat_pin.errors import CalibrationError
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


class Suspect(NamedTuple):
    """A parameter of something that may have changed since a robot was calibrated.

    Attributes:
        label: what it is, such as `mass`.
        step: difference for the derivative by it [SI].
        factor: of the unit in which it is told.
        unit: this unit.
        inertial: whether it changes nothing but the model's inertias.
        of_error: whether it is a relative change, which the learnt error shares.
    """

    label: str
    step: float
    factor: float
    unit: str
    inertial: bool = False
    of_error: bool = False


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
        values: (m, s) states at that instant.
        states: state -> its unit, s of them.
        scale: (s,) change of each state by which an error of the belief may change as much as it is large.
        alike: rows of the generalised force whose errors are of one size; every other row stands alone.
        doubted: names of the known forces of which the error of the belief may be a share.
    """

    cycle: str
    phase: Array
    values: Array
    states: Mapping[str, str]
    scale: Array
    alike: tuple[tuple[int, ...], ...] = ()
    doubted: tuple[str, ...] = ()

    @property
    def turns(self) -> float:
        """How many cycles the stretch has."""
        return abs(float(self.phase[-1] - self.phase[0])) / (2.0 * np.pi)

    def part(self, chosen: slice) -> Condition:
        """Return phase and state in some of the intervals."""
        return replace(self, phase=self.phase[chosen], values=self.values[chosen])

    @property
    def means(self) -> Array:
        """States (m, s), means over the cycle before each interval's end; over the first cycle during that."""
        count = min(len(self.values), max(1, round(len(self.values) / max(self.turns, 1e-9))))
        total = np.concatenate([np.zeros((1, self.values.shape[1])), np.cumsum(self.values, axis=0)])
        means = (total[count:] - total[:-count]) / count
        return np.concatenate([np.repeat(means[:1], count - 1, axis=0), means])

    def doubted_force(self, known: Mapping[str, Array]) -> Array:
        """Return the reduced sum (m, nv) of the doubted ones of known forces (m, nv); zeros (m, 1) if none is doubted.

        Raises CalibrationError if a force that is doubted is not known.
        """
        for name in self.doubted:
            if name not in known:
                raise CalibrationError(f"condition: doubted has '{name}': of {', '.join(known)} some were expected")
        forces = [known[name] for name in self.doubted]
        return self.reduced(np.sum(forces, axis=0)) if forces else np.zeros((len(self.phase), 1))

    def reduced(self, force: Array) -> Array:
        """Return what is a smooth function of the phase in a generalised force (m, nv) of the whole stretch."""
        return force

    def spread(self, force: Array) -> Array:
        """Return the generalised force (m, nv) whose `reduced` form is given."""
        return force
