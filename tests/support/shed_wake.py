"""Where a frozen wake is, and the impulse of a shed wake: the lift of the wing, or flapping robot, that sheds it."""

from functools import cache
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from aerobat_pin.aerobat import LINKS, RobotAir, load_aerobat
from aerobat_pin.aerodynamics import LiftingLine, Stroke, Wind, fly, strips_of
from aerobat_pin.flight import Wake
from aerobat_pin.numerics import Array
from support.section_law import fly_strips

DENSITY = 1.225  # [kg/m3]


def impulse_lift(wake: Wake) -> float:
    """Return the mean rate of the wake's vertical impulse [N], while it sheds in still air."""
    # rho Gamma times a ring's area: what a strip leaves in a second is around what its trailing edge sweeps.
    ends = wake.position[:, :1], wake.position[:, -1:]
    edges = np.concatenate([ends[0], 0.5 * (wake.position[:, 1:] + wake.position[:, :-1]), ends[1]], axis=1)
    swept = np.cross(np.gradient(wake.position, wake.time, axis=0), edges[:, :-1] - edges[:, 1:])
    return float(DENSITY * np.mean(np.sum(wake.bound * swept[..., 2], axis=1)))


def rectangle_wake(stroke: Stroke, time: Array, last: int) -> tuple[float, Wake]:
    """Fly the lattice's rectangle: its mean lift [N] without added mass, and what it sheds, over the last instants."""
    line = LiftingLine(0.40, 0.10)
    flight, half = fly(line, stroke, time, added_mass=0.0), np.where(line.y > 0.0, 0, 1)
    points = np.column_stack([np.full(line.strips, -0.05), line.y, np.zeros(line.strips)])
    position = np.array([np.einsum("nij,nj->ni", stroke(t).rotation[half], points) for t in time[-last:]])
    position[..., 0] += stroke.airspeed * time[-last:, None]
    wake = Wake(time[-last:], position, flight.circulation[-last:], Wind())
    return float(flight.force[-last:, 2].mean()), wake


def wake_at(wake: Wake, time: float) -> tuple[np.ndarray, np.ndarray]:
    """Return where the k samples shed until a time [s] are then (k, N, 3), oldest first, with their circulation."""
    old = int(np.searchsorted(wake.time, time, side="right"))
    moved = wake.wind.drift(np.array([time])) - wake.wind.drift(wake.time[:old])
    return wake.position[:old] + moved[:, None], wake.bound[:old]


AIRSPEED, PITCH, FREQUENCY = 4.5, np.radians(8.0), 4.75  # [m/s, rad, Hz]
STEPS, FLAPS = 8400, 4  # a flap at its finest, which 160 strips need; the fourth no longer changes


class Motion(NamedTuple):
    """One flap of the robot at even instants (n,), the links' twists (n, 5, 6), rotations and places in the world."""

    time: Array
    twist: Array
    rotation: Array
    place: Array


@cache
def prescribed() -> Motion:
    """Return one flap of the default robot, level at a steady speed and pitch, at the half steps of the finest run."""
    robot, count = load_aerobat(), 2 * STEPS
    data, frames = robot.model.createData(), [robot.model.getFrameId(link) for link in LINKS]
    time, rate = np.arange(count) / count / FREQUENCY, 2.0 * np.pi * FREQUENCY
    crank = robot.linkage.solve(rate * time, rate)
    attitude = pin.Quaternion(pin.rpy.rpyToMatrix(0.0, -PITCH, 0.0))
    speed = attitude.matrix().T @ [AIRSPEED, 0.0, 0.0]
    found = Motion(time, np.empty((count, 5, 6)), np.empty((count, 5, 3, 3)), np.empty((count, 5, 3)))
    for k, t in enumerate(time):
        base = [AIRSPEED * t, 0.0, 0.0, *attitude.coeffs()]
        q = robot.configuration(base, crank.theta_s[k], crank.theta_e[k])
        v = robot.velocity([*speed, 0.0, 0.0, 0.0], crank.theta_s_dot[k], crank.theta_e_dot[k])
        pin.forwardKinematics(robot.model, data, q, v)
        for i, frame in enumerate(frames):
            place = pin.updateFramePlacement(robot.model, data, frame)
            found.rotation[k, i], found.place[k, i] = place.rotation, place.translation
            found.twist[k, i] = pin.getFrameVelocity(robot.model, data, frame, pin.ReferenceFrame.LOCAL).vector
    return found


def flap_robot(strips: int, steps: int) -> tuple[Array, Wake]:
    """Fly strips along the prescribed motion: force in world axes (steps, 3) [N], what they shed, over a last flap."""
    motion, stride = prescribed(), STEPS // steps
    air, one = RobotAir(load_aerobat().wing, strips=strips), motion.twist[::stride]
    twists = np.concatenate([np.tile(one, (FLAPS, 1, 1)), one[:1]])
    found = strips_of(fly_strips(air.memory, twists, 1.0 / FREQUENCY / steps, steps)[0])
    strip, link, x, y, z, share, _ = air.pieces
    rotation, place = (each[:: 2 * stride][:, link] for each in (motion.rotation, motion.place))
    local = np.stack([found.force_x, 0.0 * found.force_x, found.force_z], axis=-1)[:, strip]
    force = np.einsum("tnij,tnj,n->ti", rotation, local, share)
    aft = -np.sign(found.lead)[..., None] * air.line.chord[:, None] / 2.0 * [1.0, 0.0, 0.0]
    edges = place + np.einsum("tnij,tnj->tni", rotation, np.column_stack([x, y, z]) + aft[:, strip])
    position = np.zeros_like(aft)
    for piece, i in enumerate(strip):
        position[:, i] += share[piece] * edges[:, piece]
    return force, Wake(motion.time[:: 2 * stride], position, found.circulation, Wind())
