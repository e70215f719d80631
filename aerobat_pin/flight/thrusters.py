"""The thrusters of the guard: propellers that push one way only, up to a limit, and follow a command with a lag.

    lag T' = c(t - delay) - T        0 <= c <= limit        wrench = B (factor T)

Over an interval with a constant command c the thrust T is known exactly, and so is its mean, which acts on the body for
the whole interval (an error of the order of interval / lag in the shape, none in the impulse). The factor is what real
propellers push of what is commanded, and so of the limit too; a controller that believes another factor errs by it.

Column i of B (6, m) is the wrench of one newton of thruster i, at the body's centre of mass and in body axes: its
direction d, and the moment of its place plus its propeller's reaction about d, p x d + (torque / thrust) d.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from aerobat_description.morphology import Morphology
from aerobat_pin.errors import ScenarioError
from aerobat_pin.numerics import Array, guarded
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
    found = morphology.thrusters
    if not found:
        raise ScenarioError(f"control: robot '{morphology.name}' has no thrusters; 'aerobat_guard' has six")
    direction, place = (np.array([getattr(one, key) for one in found]) for key in ("direction", "position"))
    reaction = np.array([one.torque / one.thrust for one in found])[:, None]
    moment = np.cross(place, direction) + reaction * direction
    return ThrusterSet(
        names=tuple(one.name for one in found),
        map=np.concatenate([direction, moment], axis=1).T.copy(),
        limit=np.array([one.thrust for one in found]),
    )


class LaggedThrust:
    """The thrust of a robot's thrusters over time, from command to command.

    Args:
        thrusters: the thrusters.
        section: lag, delay and factor.
        dt: time from one command to the next [s].
        start: (m,) thrust at the beginning, before the factor [N]; the commands before were as large.

    Attributes:
        thrust: (m,) thrust at the end of the last interval, before the factor [N].
        mean: (m,) mean thrust over the last interval, with the factor [N].
    """

    def __init__(self, thrusters: ThrusterSet, section: ThrustersSection, dt: float, start: Array) -> None:
        """Start in a steady state."""
        self._map, self._limit, self._factor = thrusters.map, thrusters.limit, section.factor
        self._kept = float(np.exp(-dt / section.lag)) if section.lag > 0.0 else 0.0
        self._lagging = section.lag / dt * (1.0 - self._kept)
        self.thrust = np.clip(start, 0.0, thrusters.limit)
        self.mean = self._factor * self.thrust
        self._waiting = deque([self.thrust] * round(section.delay / dt))

    def advance(self, command: Array) -> Array:
        """Follow a command (m,) [N] over the next interval; return the mean wrench (6,) on the body, body axes."""
        command = np.minimum(np.maximum(command, 0.0), self._limit)
        if self._waiting:
            self._waiting.append(command)
            command = self._waiting.popleft()
        behind = self.thrust - command
        self.thrust = command + self._kept * behind
        self.mean = self._factor * (command + self._lagging * behind)
        return np.asarray(self._map @ self.mean)
