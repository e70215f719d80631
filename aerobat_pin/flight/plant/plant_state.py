"""State of the plant's kernels: robot, air, unknown forces, hold, motor, integrator stages, results.

Where unknown forces act and in which direction, this file reads from a scenario, which gives their size over time.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
import pinocchio as pin

from aerobat_description.reading import did_you_mean
from aerobat_pin.aerobat import LINKS, RobotState
from aerobat_pin.errors import ScenarioError
from aerobat_pin.flight.attitude_hold import AttitudeHold
from aerobat_pin.flight.crank import RateControlledMotor
from aerobat_pin.numerics import ELSEWHERE, Array, Integers, frame_id, guarded
from aerobat_pin.scenario import Axes, Scenario, UnknownForce

DIRECTION_AXES = ("link", "body", "world")


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
    """Average noise and signal of every force over intervals, between edges (n + 1,) [s].

    Each force has its own stream of random numbers, from the seed and its index in the list.

    Returns:
        (2, forces, n) mean noise and mean noise-free force [N], without the part that depends on the elbow angle.

    Raises:
        ScenarioError: a recorded series cannot be read.
    """
    parts = np.zeros((2, len(forces), len(edges) - 1))
    for i, force in enumerate(forces):
        parts[:, i] = force.signal.interval_means(edges, np.random.default_rng([seed, i]))
    return parts


class UnknownForces(NamedTuple):
    """The f unknown forces and the p points at which they act.

    For each force: index of its `point` (f,), index of the `link` (f,) it acts on, index of the `axes` (f,) of its
    direction in `DIRECTION_AXES`, `direction` (f, 3), `elbow_amplitude` (f,) [N]. For each point: index of its link
    `point_link` (p,), position `point_place` (p, 3) in the link's frame [m].
    """

    point: Annotated[Integers, "f"]
    link: Annotated[Integers, "f"]
    axes: Annotated[Integers, "f"]
    direction: Annotated[Array, "f, 3"]
    elbow_amplitude: Annotated[Array, "f"]
    point_link: Annotated[Integers, "p"]
    point_place: Annotated[Array, "p, 3"]


class Forces(NamedTuple):
    """All forces at one instant, or their means over n steps; means have an additional first axis (n,).

    `aerodynamic`, `added_mass`, `thrusters`, `motor` and `unknown` are generalised forces (nv,). `force_W` and
    `force_noise_free_W` (p, 3) [N] are the unknown forces at their points in world axes. `link_wrench` (5, 6) is the
    aerodynamic wrench on each link without added mass, at the origin and in the axes of the link's frame.

    Powers () [W]: `motor_power` is motor torque times joint rates, `air_power` the power of the air on the robot with
    added mass, `thruster_power` and `unknown_power` those of the attitude hold and the unknown forces. With a motor on
    the crank: `crank_torque` () [N m] passes from the crank to the linkage, `drive_torque` () [N m] from the motor to
    the crank; `drive_power` and `friction_power` are the powers of the latter and of friction, the second positive.
    All four are 0 for other drives.
    """

    aerodynamic: Annotated[Array, "nv"]
    added_mass: Annotated[Array, "nv"]
    thrusters: Annotated[Array, "nv"]
    motor: Annotated[Array, "nv"]
    unknown: Annotated[Array, "nv"]
    force_W: Annotated[Array, "p, 3"]
    force_noise_free_W: Annotated[Array, "p, 3"]
    link_wrench: Annotated[Array, "link_count, 6"]
    motor_power: Annotated[Array, ""]
    air_power: Annotated[Array, ""]
    thruster_power: Annotated[Array, ""]
    unknown_power: Annotated[Array, ""]
    crank_torque: Annotated[Array, ""]
    drive_torque: Annotated[Array, ""]
    drive_power: Annotated[Array, ""]
    friction_power: Annotated[Array, ""]


class PlantState(NamedTuple):
    """What the plant's kernels keep between calls.

    The e `elastic` links (e,) turn on springs, with `stiffness` (e,) [N m/rad] and `damping` (e,) [N m s/rad].

    `holds` () is 1 if the attitude hold `hold` acts, 0 if the wrench `command` (6,) acts in its place: on the body, at
    its centre of mass and in body axes, force first [N, N m]. `linkage` (n, 4) are the series of the joint angles (see
    `joint_series`) if a `motor` turns the crank; otherwise n is 0. S is the number of aerodynamic states, plus 4 for
    the crank's state if there is a motor, plus 2 e at the end: deflections [rad], then their rates.

    Scratch arrays: `error_rotation` (3, 3) for the attitude hold, `pushes` (5, 6) for the wrenches of the unknown
    forces on the links, `closed` (3, 2) for the linkage, `A` (11, 11) and `b` (11,) for the equations of base, crank
    and elastic joints, `swing` (2, 5) rate and acceleration of each link's joint, `departed` (2, e) deflections at the
    first two stages.
    Integrator: base `twists` (4, 6) and `rates` (4, 6 + S) at the stages, `start` (6 + S,) at the start of the step,
    `state` (6 + S,), `v` (nv,) and `tangent` (2, nv) for the next stage, `second` (2,) joint angles at the second
    stage, `forces` at the current stage.
    """

    robot: Annotated[RobotState, ELSEWHERE]
    unknown: UnknownForces
    holds: Annotated[Array, ""]
    command: Annotated[Array, "6"]
    hold: AttitudeHold
    motor: RateControlledMotor
    linkage: Annotated[Array, "harmonics, 4"]
    elastic: Annotated[Integers, "e"]
    stiffness: Annotated[Array, "e"]
    damping: Annotated[Array, "e"]
    departed: Annotated[Array, "2, e"]
    swing: Annotated[Array, "2, link_count"]
    error_rotation: Annotated[Array, "3, 3"]
    pushes: Annotated[Array, "link_count, 6"]
    closed: Annotated[Array, "3, 2"]
    A: Annotated[Array, "11, 11"]
    b: Annotated[Array, "11"]
    twists: Annotated[Array, "4, 6"]
    rates: Annotated[Array, "4, states"]
    start: Annotated[Array, "states"]
    state: Annotated[Array, "states"]
    tangent: Annotated[Array, "2, nv"]
    v: Annotated[Array, "nv"]
    second: Annotated[Array, "2"]
    forces: Forces


def split_forces(forces: Forces, rows: Array) -> Forces:
    """Split rows (n, size) into named forces; each row is laid out like `forces` in a plant's memory."""
    starts = [(part.ctypes.data - forces[0].ctypes.data) // part.itemsize for part in forces]
    parts = [rows[:, start : start + part.size] for start, part in zip(starts, forces, strict=True)]
    return Forces(*(part.reshape(len(rows), *force.shape) for part, force in zip(parts, forces, strict=True)))


def unknown_forces(model: pin.Model, forces: tuple[PointForce, ...], points: tuple[str, ...]) -> UnknownForces:
    """Return the tables of unknown forces that kernels read; `points` names the frames at which the forces act."""
    carriers = [model.frames[model.getFrameId(link)].parentJoint for link in LINKS]
    frames = {name: model.frames[frame_id(model, name)] for name in points}
    links = {name: carriers.index(frame.parentJoint) for name, frame in frames.items()}
    directions = [
        frames[force.frame].placement.rotation @ force.direction if force.axes == "link" else force.direction
        for force in forces
    ]
    return UnknownForces(
        point=np.array([points.index(force.frame) for force in forces], dtype=np.intp),
        link=np.array([links[force.frame] for force in forces], dtype=np.intp),
        axes=np.array([DIRECTION_AXES.index(force.axes) for force in forces], dtype=np.intp),
        direction=np.array(directions).reshape(-1, 3),
        elbow_amplitude=np.array([force.signal.elbow_amplitude for force in forces], dtype=float),
        point_link=np.array(list(links.values()), dtype=np.intp),
        point_place=np.array([frame.placement.translation for frame in frames.values()]).reshape(-1, 3),
    )
