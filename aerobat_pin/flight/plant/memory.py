"""Memory layout of the plant's kernels: robot, air, unknown forces, hold, motor, integrator stages, results."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from aerobat_pin.aerodynamics import LINK_COUNT, RobotMemory, robot_in
from aerobat_pin.flight.attitude_hold import AttitudeHold
from aerobat_pin.flight.crank import RateControlledMotor
from aerobat_pin.flight.point_forces import PointForce
from aerobat_pin.numerics import Array, Integers, array_at, frame_id, merged, next_size, rewind, take, take_integers
from aerobat_pin.robot import LINKS

DIRECTION_AXES = ("link", "body", "world")


class UnknownForces(NamedTuple):
    """The f unknown forces and the p points at which they act.

    For each force: index of its `point` (f,), index of the `link` (f,) it acts on, index of the `axes` (f,) of its
    direction in `DIRECTION_AXES`, `direction` (f, 3), `elbow_amplitude` (f,) [N]. For each point: index of its link
    `point_link` (p,), position `point_place` (p, 3) in the link's frame [m].
    """

    point: Integers
    link: Integers
    axes: Integers
    direction: Array
    elbow_amplitude: Array
    point_link: Integers
    point_place: Array


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

    aerodynamic: Array
    added_mass: Array
    thrusters: Array
    motor: Array
    unknown: Array
    force_W: Array
    force_noise_free_W: Array
    link_wrench: Array
    motor_power: Array
    air_power: Array
    thruster_power: Array
    unknown_power: Array
    crank_torque: Array
    drive_torque: Array
    drive_power: Array
    friction_power: Array


class PlantMemory(NamedTuple):
    """Memory of the plant's kernels.

    `holds` () is 1 if the attitude hold `hold` acts, 0 if the wrench `command` (6,) acts in its place: on the body, at
    its centre of mass and in body axes, force first [N, N m]. `linkage` (n, 4) are the series of the joint angles (see
    `joint_series`) if a `motor` turns the crank; otherwise n is 0. S is the number of aerodynamic states, plus 4 for
    the crank's state at the end if there is a motor.

    Scratch arrays: `error_rotation` (3, 3) for the attitude hold, `pushes` (5, 6) for the wrenches of the unknown
    forces on the links, `closed` (3, 2) for the linkage, `A` (7, 7) and `b` (7,) for the equations of base and crank.
    Integrator: base `twists` (4, 6) and `rates` (4, 6 + S) at the stages, `start` (6 + S,) at the start of the step,
    `state` (6 + S,), `v` (nv,) and `tangent` (2, nv) for the next stage, `second` (2,) joint angles at the second
    stage, `forces` at the current stage.
    """

    robot: RobotMemory
    unknown: UnknownForces
    holds: Array
    command: Array
    hold: AttitudeHold
    motor: RateControlledMotor
    linkage: Array
    error_rotation: Array
    pushes: Array
    closed: Array
    A: Array
    b: Array
    twists: Array
    rates: Array
    start: Array
    state: Array
    tangent: Array
    v: Array
    second: Array
    forces: Forces


@merged
def plant_in(memory: Array) -> PlantMemory:
    """Lay out a plant's memory. Sizes: address of the robot's memory, nv, S, harmonics, number of forces and points."""
    cursor = rewind(memory)
    robot, nv, states, harmonics = next_size(cursor), next_size(cursor), next_size(cursor) + 6, next_size(cursor)
    f, p = next_size(cursor), next_size(cursor)
    return PlantMemory(
        robot=robot_in(array_at(robot, (1,))),
        unknown=UnknownForces(
            point=take_integers(cursor, (f,)),
            link=take_integers(cursor, (f,)),
            axes=take_integers(cursor, (f,)),
            direction=take(cursor, (f, 3)),
            elbow_amplitude=take(cursor, (f,)),
            point_link=take_integers(cursor, (p,)),
            point_place=take(cursor, (p, 3)),
        ),
        holds=take(cursor, ()),
        command=take(cursor, (6,)),
        hold=AttitudeHold(
            rotation=take(cursor, (3, 3)),
            forward_speed=take(cursor, ()),
            height=take(cursor, ()),
            attitude_stiffness=take(cursor, (3,)),
            attitude_damping=take(cursor, (3,)),
            torque_limit=take(cursor, (3,)),
            speed_gain=take(cursor, ()),
            thrust_limit=take(cursor, ()),
            lift=take(cursor, ()),
            height_stiffness=take(cursor, ()),
            height_damping=take(cursor, ()),
            lift_limit=take(cursor, ()),
        ),
        motor=RateControlledMotor(
            start=take(cursor, ()),
            rate=take(cursor, ()),
            start_rate=take(cursor, ()),
            rotor_inertia=take(cursor, ()),
            torque_limit=take(cursor, ()),
            lag=take(cursor, ()),
            gain=take(cursor, ()),
            integral_gain=take(cursor, ()),
            friction=take(cursor, ()),
        ),
        linkage=take(cursor, (harmonics, 4)),
        error_rotation=take(cursor, (3, 3)),
        pushes=take(cursor, (LINK_COUNT, 6)),
        closed=take(cursor, (3, 2)),
        A=take(cursor, (7, 7)),
        b=take(cursor, (7,)),
        twists=take(cursor, (4, 6)),
        rates=take(cursor, (4, states)),
        start=take(cursor, (states,)),
        state=take(cursor, (states,)),
        tangent=take(cursor, (2, nv)),
        v=take(cursor, (nv,)),
        second=take(cursor, (2,)),
        forces=Forces(
            aerodynamic=take(cursor, (nv,)),
            added_mass=take(cursor, (nv,)),
            thrusters=take(cursor, (nv,)),
            motor=take(cursor, (nv,)),
            unknown=take(cursor, (nv,)),
            force_W=take(cursor, (p, 3)),
            force_noise_free_W=take(cursor, (p, 3)),
            link_wrench=take(cursor, (LINK_COUNT, 6)),
            motor_power=take(cursor, ()),
            air_power=take(cursor, ()),
            thruster_power=take(cursor, ()),
            unknown_power=take(cursor, ()),
            crank_torque=take(cursor, ()),
            drive_torque=take(cursor, ()),
            drive_power=take(cursor, ()),
            friction_power=take(cursor, ()),
        ),
    )


def split_forces(forces: Forces, rows: Array) -> Forces:
    """Split rows (n, size) into named forces; each row is laid out like `forces` in a plant's memory."""
    starts = [(part.ctypes.data - forces[0].ctypes.data) // part.itemsize for part in forces]
    parts = [rows[:, start : start + part.size] for start, part in zip(starts, forces, strict=True)]
    return Forces(*(part.reshape(len(rows), *one.shape) for part, one in zip(parts, forces, strict=True)))


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
