"""Unknown forces on a robot: the points where they push, and along what; the scenario says how they change in time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from aerobat_pin.errors import ScenarioError
from aerobat_pin.numerics import Array
from aerobat_pin.scenario import Axes, Scenario, UnknownForce


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
    signal: UnknownForce


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
        forces.append(PointForce(section.frame, np.array(section.direction) / size, section.axes, section))
    return tuple(forces)


def interval_means(forces: tuple[PointForce, ...], edges: Array, seed: int) -> Array:
    """Average noise and signal of every force over intervals, each from a stream of its own, by its place in the list.

    Args:
        forces: the forces.
        edges: (n + 1,) interval edges [s], from 0.
        seed: of the noise.

    Returns:
        (2, forces, n) mean noise and mean noise-free force [N], without what follows the elbow.

    Raises:
        ScenarioError: a recorded series cannot be read.
    """
    parts = np.zeros((2, len(forces), len(edges) - 1))
    for i, force in enumerate(forces):
        parts[:, i] = force.signal.interval_means(edges, np.random.default_rng([seed, i]))
    return parts
