"""The thrusters of the guard: propellers that push one way only, up to a limit, and follow a command with a lag.

    lag T' = c(t - delay) - T        0 <= c <= limit        wrench = B (factor T)

Over an interval with a constant command c the thrust T is known exactly, and so is its mean, which acts on the body for
the whole interval (an error of the order of interval / lag in the shape, none in the impulse). The factor is what real
propellers push of what is commanded, and so of the limit too; a controller that believes another factor errs by it.

Column i of B (6, m) is the wrench of one newton of thruster i, at the body's centre of mass and in body axes: its
direction d, and the moment of its place plus its propeller's reaction about d, p x d + (torque / thrust) d.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np

from aerobat_description.morphology import Morphology
from aerobat_pin.errors import ScenarioError, ShapeError
from aerobat_pin.numerics import Array, Integers, Viewed, fields_of, guarded, kernel, new_state
from aerobat_pin.scenario import ThrustersSection


@dataclass(frozen=True)
class ThrusterSet:
    """The thrusters of a robot.

    Attributes:
        names: names of the m thrusters.
        map: (6, m) wrench per newton of thrust, at the body's centre of mass, body axes, force first [-, m].
        limit: (m,) largest thrusts [N].
    """

    names: tuple[str, ...]
    map: Array
    limit: Array


@guarded()
def thrusters_of(morphology: Morphology) -> ThrusterSet:
    """Return the thrusters of a robot. Raises ScenarioError if it has none."""
    thrusters = morphology.thrusters
    if not thrusters:
        raise ScenarioError(f"control: robot '{morphology.name}' has no thrusters; 'aerobat_guard' has six")
    direction, place = (
        np.array([getattr(thruster, key) for thruster in thrusters]) for key in ("direction", "position")
    )
    reaction = np.array([thruster.torque / thruster.thrust for thruster in thrusters])[:, None]
    moment = np.cross(place, direction) + reaction * direction
    return ThrusterSet(
        names=tuple(thruster.name for thruster in thrusters),
        map=np.concatenate([direction, moment], axis=1).T.copy(),
        limit=np.array([thruster.thrust for thruster in thrusters]),
    )


class LaggedThrust(Viewed):
    """The thrust of a robot's thrusters over time, from command to command.

    Args:
        thrusters: the thrusters.
        section: lag, delay and factor.
        dt: time from one command to the next [s].
        start: (m,) thrust at the beginning, before the factor [N]; the commands before were as large.

    Attributes:
        thrust: (m,) thrust at the end of the last interval, before the factor [N]; the next one is written over it.
        mean: (m,) mean thrust over the last interval, with the factor [N]; likewise.
    """

    def __init__(self, thrusters: ThrusterSet, section: ThrustersSection, dt: float, start: Array) -> None:
        """Start in a steady state."""
        waiting, self._fault, self._until_fault = round(section.delay / dt), section.fault, -1
        self._memory = new_state(Propellers, m=len(thrusters.limit), n=waiting)
        fields = self._view()
        fields.map[:], fields.limit[:], fields.factor[:] = thrusters.map, thrusters.limit, section.factor
        fields.kept[...] = kept = float(np.exp(-dt / section.lag)) if section.lag > 0.0 else 0.0
        fields.lagging[...] = section.lag / dt * (1.0 - kept)
        self.thrust[:] = fields.waiting[:] = np.clip(start, 0.0, thrusters.limit)
        self.mean[:] = section.factor * self.thrust
        if self._fault is not None:
            if self._fault.thruster > len(thrusters.limit):
                least = f"at most {len(thrusters.limit)} was expected"
                raise ScenarioError(f"thrusters.fault.thruster = {self._fault.thruster}: {least}")
            self._until_fault = round(self._fault.start / dt)

    def _view(self) -> Propellers:
        fields = fields_of(self._memory, Propellers)
        self.thrust, self.mean, self._factor = fields.thrust, fields.mean, fields.factor
        return fields

    def advance(self, command: Array) -> Array:
        """Follow a command (m,) [N] over the next interval; return the mean wrench (6,) on the body, body axes."""
        command, wrench = np.asarray(command, float), np.empty(6)
        if command.shape != self.thrust.shape:
            raise ShapeError(f"command has shape {command.shape}: {self.thrust.shape} was expected")
        if self._fault is not None:
            if self._until_fault == 0:
                self._factor[self._fault.thruster - 1] *= self._fault.factor
            self._until_fault -= 1
        follow(self._memory, command, wrench)
        return wrench


class Propellers(NamedTuple):
    """State of m thrusters, see `LaggedThrust`.

    `kept` () is the share of a difference that is there after an interval, `lagging` () its mean over it. `waiting`
    (n, m) are the n commands that are on their way, `turn` (1,) which of them is next.
    """

    map: Annotated[Array, "6, m"]
    limit: Annotated[Array, "m"]
    factor: Annotated[Array, "m"]
    kept: Annotated[Array, ""]
    lagging: Annotated[Array, ""]
    thrust: Annotated[Array, "m"]
    mean: Annotated[Array, "m"]
    waiting: Annotated[Array, "n, m"]
    turn: Annotated[Integers, "1"]


@kernel
def follow(memory: Array, command: Array, wrench: Array) -> None:
    """Follow a command (m,) over an interval, and write the mean wrench (6,)."""
    fields = fields_of(memory, Propellers)
    thrust, waiting, turn = fields.thrust, fields.waiting, fields.turn[0]
    wrench[:] = 0.0
    for j in range(thrust.shape[0]):
        wanted = min(max(command[j], 0.0), fields.limit[j])
        if waiting.shape[0] > 0:
            wanted, waiting[turn, j] = waiting[turn, j], wanted
        behind = thrust[j] - wanted
        thrust[j] = wanted + fields.kept[()] * behind
        fields.mean[j] = fields.factor[j] * (wanted + fields.lagging[()] * behind)
        for i in range(6):
            wrench[i] += fields.map[i, j] * fields.mean[j]
    if waiting.shape[0] > 0:
        fields.turn[0] = (turn + 1) % waiting.shape[0]
