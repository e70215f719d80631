"""Readable numpy twins of the compiled kernels, by Pinocchio's Jacobians, `oMi` and SE(3)'s own retraction."""

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from aerobat_description.morphology import Morphology
from aerobat_pin.aerobat import LINKS, RobotAir
from aerobat_pin.flight import Plant
from aerobat_pin.flight.attitude_hold import AttitudeHold
from aerobat_pin.flight.plant.plant_state import PointForce
from support.observer_twins import point_jacobian

LOCAL = pin.ReferenceFrame.LOCAL
Vector = np.ndarray


def hold_wrench(hold: AttitudeHold, position: Vector, rotation: Vector, twist: Vector) -> Vector:
    """Return the hold's wrench (6,) in body axes: torque sat(kp f log3(R^T R_ref) - kd omega), f: 1 at 90 deg, to 0."""
    # Force, world axes: x sat(kx (vx_ref - vx)), y 0, z lift + sat(kz (z_ref - z) - dz vz).
    velocity = rotation @ twist[:3]
    error = pin.log3(rotation.T @ hold.rotation)
    s = np.clip(2.0 - np.linalg.norm(error) / (np.pi / 2.0), 0.0, 1.0)
    error *= np.polyval([6.0, -15.0, 10.0, 0.0, 0.0, 0.0], s)
    torque = hold.attitude_stiffness * error - hold.attitude_damping * twist[3:]
    thrust = hold.speed_gain * (hold.forward_speed - velocity[0])
    rise = hold.height_stiffness * (hold.height - position[2]) - hold.height_damping * velocity[2]
    thrust, rise = np.clip([thrust, rise], *np.outer([-1.0, 1.0], [hold.thrust_limit, hold.lift_limit]))
    force = rotation.T @ np.array([thrust, 0.0, hold.lift + rise])
    return np.concatenate([force, np.clip(torque, -hold.torque_limit, hold.torque_limit)])


def forces_at_points(
    model: pin.Model,
    data: pin.Data,
    forces: Sequence[PointForce],
    points: Sequence[str],
    elbow: float,
    noise: Vector,
    steps: Vector,
) -> Vector:
    """Return forces (2, p, 3) at points, world axes, with and without noise: A sin(elbow) + step_i (+ noise_i)."""
    total = np.zeros((2, len(points), 3))
    for force, drawn, stepped in zip(forces, noise, steps, strict=True):
        frame = data.oMf[model.getFrameId(force.frame)].rotation
        axes = {"link": frame, "body": data.oMi[1].rotation, "world": np.eye(3)}
        direction = axes[force.axes] @ force.direction
        clean = force.signal.elbow_amplitude * np.sin(elbow) + stepped
        total[:, points.index(force.frame)] += np.outer([clean + drawn, clean], direction)
    return total


def forces_of(
    plant: Plant, q: Vector, v: Vector, elbow: float, air: Vector, held: Vector, time: float
) -> dict[str, Vector]:
    """Return what acts at an instant but motor and added mass, by its name in `Forces`, and `air_rate`."""
    model, data = plant.model, plant.model.createData()
    pin.forwardKinematics(model, data, q, v)
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    frames = [model.getFrameId(link) for link in LINKS]
    against = np.array([pin.getFrameVelocity(model, data, frame, LOCAL).vector for frame in frames])
    wind = plant.wind(np.array([time]))[0]
    against[:, :3] -= [data.oMf[frame].rotation.T @ wind[0] for frame in frames]
    shape, added = plant.robot.wing.morphology, plant.scenario.air.added_mass
    wrenches, air_rate, _ = air_loads(plant.air, shape, against, air, added)
    joints = [model.frames[frame].parentJoint for frame in frames]
    pairs = zip(joints, wrenches, strict=True)
    aerodynamic = sum(pin.getJointJacobian(model, data, joint, LOCAL).T @ wrench for joint, wrench in pairs)
    thrusters = np.zeros(model.nv)
    if plant.hold is not None:
        thrusters[:6] = hold_wrench(plant.hold, data.oMi[1].translation, data.oMi[1].rotation, v[:6])
    noisy, clean = forces_at_points(model, data, plant.forces, plant.points, elbow, *held)
    unknown = point_jacobian(model, plant.points, q).T @ noisy.ravel()
    named = {"aerodynamic": aerodynamic, "thrusters": thrusters, "unknown": unknown, "link_wrench": wrenches}
    return named | {"force_W": noisy, "force_noise_free_W": clean, "air_rate": air_rate}


def warmed_up(air: RobotAir, shape: Morphology, twists: Vector, dt: float, state: Vector) -> Vector:
    """Return the air's state (3N,) after classical Runge-Kutta steps under link twists (2 n + 1, 5, 6)."""
    for first, middle, last in zip(twists[:-1:2], twists[1::2], twists[2::2], strict=True):
        k1 = air_loads(air, shape, first, state)[1]
        k2 = air_loads(air, shape, middle, state + dt / 2.0 * k1)[1]
        k3 = air_loads(air, shape, middle, state + dt / 2.0 * k2)[1]
        k4 = air_loads(air, shape, last, state + dt * k3)[1]
        state = state + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return state


def air_loads(
    air: RobotAir, shape: Morphology, twists: Vector, state: Vector, added: float = 1.0
) -> tuple[Vector, Vector, Vector]:
    """Return wrenches (5, 6) on the links, rates of the state and loads (9, N), all from twists against the air."""
    # u = V_x forward, w = -V_z upward at mid-chord, U = hypot(u, w); lead = c (3 - c^2) / 2, c = u / U, moves the point
    # of w and that of the force a quarter chord apart; f_x = lead suction - rho/2 c cd0 U u, f_z = lift + rho/2 c cd0 U
    # w, and the couple -b/2 m lead u omega_y. A strip's velocities are means over its pieces, which share its force.
    line, pieces = air.line, air.pieces
    points = np.column_stack([pieces.x, pieces.y, pieces.z])

    def of_strips(values: Vector) -> Vector:
        return np.array([pieces.share[pieces.strip == i] @ values[pieces.strip == i] for i in range(line.strips)])

    middle = of_strips(twists[pieces.link, :3] + np.cross(twists[pieces.link, 3:], points))
    turn = of_strips(twists[pieces.link, 4])
    speed = np.hypot(middle[:, 0], middle[:, 2])
    cosine = np.divide(middle[:, 0], speed, out=np.zeros_like(speed), where=speed > 0.0)
    lead = cosine * (3.0 - cosine**2) / 2.0
    u, w = middle[:, 0], -middle[:, 2] - lead * line.chord / 4.0 * turn
    force = np.zeros((line.strips, 3))
    if air.model == "quasi_steady":
        incidence = np.degrees(np.arctan2(np.abs(w), np.abs(u)))
        cl = 0.225 + 1.58 * np.sin(np.radians(2.13 * incidence - 7.2))
        cl *= np.min([incidence, 90.0 - incidence, np.ones_like(u)], axis=0)
        cd = 1.92 - 1.55 * np.cos(np.radians(2.04 * incidence - 9.82))
        push = 0.5 * line.air_density * line.chord * line.width * speed
        force[:, 0] = push * (np.sign(u) * cl * np.abs(w) - cd * u)
        force[:, 2] = push * (np.sign(w) * cl * np.abs(u) + cd * w)
        w_eff, downwash, centre, rates = w, np.zeros_like(u), 0.0, np.zeros(0)
        circulation = 0.5 * line.chord * speed * np.sign(w) * cl
    else:
        circulation = line.split(state)[2]
        downwash = line.downwash @ circulation
        centre = 0.0 if shape.tail is None else float(line.mean_downwash(shape.tail.span) @ circulation)
        w_eff, w_total = line.effective_velocity(state, speed, w * np.abs(cosine))
        if air.lift_limit is not None:
            ratio = line.lift_slope * w_eff / (np.where(speed > 0.0, speed, 1e-300) * air.lift_limit)
            w_eff = w_eff / (1.0 + np.minimum(np.abs(ratio), 1e70) ** 4) ** 0.25
        drag = 0.5 * line.air_density * line.chord * shape.aerodynamics.profile_drag * speed
        force[:, 0] = line.width * (lead * line.suction(w_eff, -lead * turn) - drag * u)
        force[:, 2] = line.width * (line.lift(speed, w_eff) + drag * w)
        rates = line.rates(state, speed, w_eff, w_total)
    wrenches = np.zeros((len(LINKS), 6))
    couple = np.zeros((line.strips, 3))
    couple[:, 1] = -0.5 * line.semichord * (added * line.added_mass * line.width) * lead * u
    for strip, link, x, y, z, share, _ in zip(*pieces, strict=True):
        part, at = share * force[strip], np.array([x + lead[strip] * line.chord[strip] / 4.0, y, z])
        wrenches[link] += np.concatenate([part, np.cross(at, part) + share * couple[strip] * twists[link, 4]])
    wrenches[0] += body_and_tail(air, shape, twists[0], centre)
    return wrenches, rates, np.array([u, w, speed, lead, downwash, circulation, w_eff, force[:, 0], force[:, 2]])


def body_and_tail(air: RobotAir, shape: Morphology, twist: Vector, centre_downwash: float) -> Vector:
    """Return the wrench (6,) of body drag -rho/2 A |V| V and tail on the base, at its origin and in its axes."""
    # The tail, turned by its incidence, with part of the downwash: rho/2 S a |along| across, a = 2 pi / (1 + 2 c / b).
    density, drag, tail = air.line.air_density, shape.aerodynamics, shape.tail
    force = -0.5 * density * drag.body_drag_area * np.linalg.norm(twist[:3]) * twist[:3]
    wrench = np.concatenate([force, np.zeros(3)])
    if tail is None:
        return wrench
    velocity = twist[:3] + np.cross(twist[3:], tail.position)
    seen = np.array([velocity[0], -velocity[2] - drag.tail_downwash_factor * centre_downwash])  # forward, upward
    sine, cosine = np.sin(tail.incidence), np.cos(tail.incidence)
    along, across = np.array([[cosine, -sine], [sine, cosine]]) @ seen
    slope = 2.0 * np.pi / (1.0 + 2.0 * tail.chord / tail.span)
    size = 0.5 * density * tail.span * tail.chord * slope * abs(along) * across
    push = size * np.array([-sine, 0.0, cosine])
    return wrench + np.concatenate([push, np.cross(tail.position, push)])
