"""Unknown forces on a robot: where they act and in which direction; the scenario gives their size over time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from aerobat_description.reading import did_you_mean
from aerobat_pin.errors import ScenarioError
from aerobat_pin.numerics import Array, guarded
from aerobat_pin.scenario import Axes, Scenario, UnknownForce


@dataclass(frozen=True)
class PointForce:
    """A force at the origin of a frame.

    Attributes:
        frame: name of the frame at whose origin the force acts.
        direction: (3,) unit vector along the force.
        axes: whether the direction is fixed in the frame's link, the body or the world.
        signal: size of the force over time.
    """

    frame: str
    direction: Array
    axes: Axes
    signal: UnknownForce


def point_forces(model: pin.Model, scenario: Scenario) -> tuple[PointForce, ...]:
    """Read a scenario's unknown forces. Raises ScenarioError if the model lacks a frame or a direction is zero."""
    forces = []
    for i, section in enumerate(scenario.unknown_force):
        if not model.existFrame(section.frame) or model.frames[model.getFrameId(section.frame)].parentJoint == 0:
            known = [frame.name for frame in model.frames if frame.parentJoint > 0]
            hint = did_you_mean(section.frame, known, "the robot's frames are")
            raise ScenarioError(f"unknown_force.{i}.frame = '{section.frame}': {hint}")
        size = float(np.linalg.norm(section.direction))
        if size == 0.0:
            raise ScenarioError(f"unknown_force.{i}.direction = {section.direction}: a direction must not be zero")
        forces.append(PointForce(section.frame, np.array(section.direction) / size, section.axes, section))
    return tuple(forces)


@guarded(edges=("2+",))
def interval_means(forces: tuple[PointForce, ...], edges: Array, seed: int) -> Array:
    """Average noise and signal of every force over intervals.

    Each force has its own stream of random numbers, seeded by its index in the list.

    Args:
        forces: the forces.
        edges: (n + 1,) interval edges [s].
        seed: seed of the noise.

    Returns:
        (2, forces, n) mean noise and mean noise-free force [N], without the part that depends on the elbow angle.

    Raises:
        ScenarioError: a recorded series cannot be read.
    """
    parts = np.zeros((2, len(forces), len(edges) - 1))
    for i, force in enumerate(forces):
        parts[:, i] = force.signal.interval_means(edges, np.random.default_rng([seed, i]))
    return parts
