"""Unknown forces: signals in time, and the points on the robot where they push.

The paper's signal (its section III-A): f_t = 0.2 sin(q_e) + noise, plus 0.15 while 1 s < t <= 1.6 s, with
noise ~ N(0, 0.01^2). The sine follows the elbow continuously. Noise and step live on a clock of their own, one value
held over each of its ticks, so a flight does not depend on the integrator's step.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import pinocchio as pin

from aerobat_pin.arrays import Array
from aerobat_pin.errors import ScenarioError
from aerobat_pin.scenario import Scenario

Axes = Literal["link", "body", "world"]


@dataclass(frozen=True)
class PaperSignal:
    """The paper's unknown force as a scalar [N]; the plant's kernel adds its sine, which follows the elbow.

    Attributes:
        amplitude: factor of sin(elbow angle) [N].
        noise: standard deviation of the noise [N].
        step: height of the step [N].
        step_start, step_end: the step is on at ticks with step_start < t <= step_end [s].
        tick: how long one value of noise and step is held [s].
    """

    amplitude: float = 0.2
    noise: float = 0.01
    step: float = 0.15
    step_start: float = 1.0
    step_end: float = 1.6
    tick: float = 1.0e-3

    def held(self, edges: Array, rng: np.random.Generator) -> tuple[Array, Array]:
        """Draw the run's noise and average noise and step over intervals.

        Args:
            edges: (n + 1,) interval edges [s], from 0.
            rng: source of the noise.

        Returns:
            Mean noise (n,) and mean step (n,) [N] over each interval; on the signal's own clock, the values themselves.
        """
        ticks = int(np.ceil(edges[-1] / self.tick - 1e-6))
        start = np.arange(ticks) * self.tick
        # Half a tick in a thousand keeps 1.0 s out of "1 s < t" however it is rounded.
        on = (start > self.step_start + 5e-4 * self.tick) & (start <= self.step_end + 5e-4 * self.tick)
        noise = self.noise * rng.standard_normal(ticks)
        return held_means(noise, self.tick, edges), held_means(self.step * on, self.tick, edges)


def held_means(values: Array, tick: float, edges: Array) -> Array:
    """Average a held series (value i on [i tick, (i + 1) tick)) over intervals given by their edges (n + 1,)."""
    clock = np.arange(len(values) + 1) * tick
    integral = np.concatenate([[0.0], np.cumsum(values) * tick])
    return np.asarray(np.diff(np.interp(edges, clock, integral)) / np.diff(edges))


@dataclass(frozen=True)
class PointForce:
    """A force at the origin of a frame.

    Attributes:
        frame: name of the frame it acts at.
        direction: (3,) unit vector.
        axes: whether the direction is fixed in the frame's link, the body or the world.
        signal: its size over time.
    """

    frame: str
    direction: Array
    axes: Axes
    signal: PaperSignal


def point_forces(model: pin.Model, scenario: Scenario) -> tuple[PointForce, ...]:
    """Read a scenario's unknown forces. Raises ScenarioError for a frame the model lacks, or no direction."""
    forces = []
    for i, section in enumerate(scenario.unknown_force):
        if not model.existFrame(section.frame) or model.frames[model.getFrameId(section.frame)].parentJoint == 0:
            known = ", ".join(frame.name for frame in model.frames if frame.parentJoint > 0)
            raise ScenarioError(f"unknown_force.{i}.frame = '{section.frame}': the robot's frames are {known}")
        size = float(np.linalg.norm(section.direction))
        if size == 0.0:
            raise ScenarioError(f"unknown_force.{i}.direction = {section.direction}: a direction is not zero")
        signal = PaperSignal(
            section.amplitude, section.noise, section.step, section.step_start, section.step_end, section.tick
        )
        forces.append(PointForce(section.frame, np.array(section.direction) / size, section.axes, signal))
    return tuple(forces)
