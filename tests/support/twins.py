"""Readable numpy twins of the compiled kernels, by Pinocchio's Jacobians, `oMi` and SE(3)'s own retraction."""

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from scipy.linalg import cho_factor, cho_solve

from aerobat_description.morphology import Morphology
from aerobat_pin.aerobat import LINKS, RobotAir, joint_table
from aerobat_pin.flight import Plant, Trajectory
from aerobat_pin.flight.attitude_hold import AttitudeHold
from aerobat_pin.flight.plant.plant_state import Forces, PointForce
from support.observer_twins import point_jacobian
from support.stepping import stage_mean, step

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


def at_joints(model: pin.Model, data: pin.Data, wrenches: Vector) -> Vector:
    """Return sum J^T f (nv,) of wrenches (5, 6) on the links, at and in their joints' own frames."""
    joints = [model.frames[model.getFrameId(link)].parentJoint for link in LINKS]
    return sum(pin.getJointJacobian(model, data, joint, LOCAL).T @ f for joint, f in zip(joints, wrenches, strict=True))


def plant_rates(
    plant: Plant, q: Vector, v: Vector, joints: Vector, air: Vector, held: Vector, time: float = 0.0
) -> tuple[Vector, Vector, Forces, Vector]:
    """Return base acceleration (6,), rate of the air, forces at this instant (no leading axis) and strip loads."""
    # H_bb a_b = F_b - h_b - H_bj theta'', u_m = H_jb a_b + H_jj theta'' + h_j - F_j; H and h with added mass.
    model, robot = plant.model, plant.robot
    data = model.createData()
    M = pin.crba(model, data, q).copy()
    nle = pin.nonLinearEffects(model, data, q, v).copy()
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    frames = [model.getFrameId(link) for link in LINKS]
    twists = np.array([pin.getFrameVelocity(model, data, frame, LOCAL).vector for frame in frames])
    wind = plant.wind(np.array([time]))[0]
    against = twists.copy()
    against[:, :3] -= [data.oMf[frame].rotation.T @ wind[0] for frame in frames]
    wrenches, air_rate, loads = air_loads(plant.air, robot.wing.morphology, against, air, plant.scenario.air.added_mass)
    aerodynamic = at_joints(model, data, wrenches)
    thrusters = np.zeros(model.nv)
    if plant.hold is not None:
        thrusters[:6] = hold_wrench(plant.hold, data.oMi[1].translation, data.oMi[1].rotation, v[:6])
    noisy, clean = forces_at_points(model, data, plant.forces, plant.points, joints[0, 1], *held)
    unknown = point_jacobian(model, plant.points, q).T @ noisy.ravel()

    M_air, bias_air = added_mass(plant, q, v, wind)
    H, h = M + M_air, nle + bias_air
    total = aerodynamic + thrusters + unknown
    acceleration = robot.velocity(np.zeros(6), *joints[2])
    driven = H[:6, 6:] @ acceleration[6:]
    acceleration[:6] = cho_solve(cho_factor(H[:6, :6]), total[:6] - h[:6] - driven)
    motor = np.concatenate([np.zeros(6), (H @ acceleration + h - total)[6:]])
    dragged = -(M_air @ acceleration + bias_air)
    power, air_power = np.array(motor[6:] @ v[6:]), np.array(np.sum(wrenches * twists) + dragged @ v)
    powers = power, air_power, np.array(thrusters @ v), np.array(unknown @ v)
    parts = (aerodynamic, dragged, thrusters, motor, unknown, noisy, clean, wrenches, *powers, *np.zeros(4))
    return acceleration[:6], air_rate, Forces(*parts), loads


def fly(plant: Plant, count: int, dt: float, held: Vector) -> Trajectory:
    """Fly by `stepping.step`: the base on SE(3), the joints prescribed, one evaluation after the other."""
    robot, retract = plant.robot, pin.liegroups.SE3().integrate
    closed = plant.closure(np.arange(2 * count + 1) * 0.5 * dt)
    motion = joint_table(closed)
    placement, y = plant.initial.placement, np.concatenate([plant.initial.twist, plant.initial.air])
    placements, states, means, loads = [placement], [y], [], []
    for k in range(count):

        def rates(time: float, here: Vector, y: Vector, k: int = k) -> tuple[Vector, Vector, tuple[Forces, Vector]]:
            joints = motion[round(2.0 * time / dt)]
            q, v = robot.configuration(here, *joints[0]), robot.velocity(y[:6], *joints[1])
            acceleration, air_rate, forces, strips = plant_rates(plant, q, v, joints, y[6:], held[:, :, k], time)
            return y[:6], np.concatenate([acceleration, air_rate]), (forces, strips)

        placement, y, outputs = step(rates, retract, k * dt, placement, y, dt)
        placements.append(placement)
        states.append(y)
        means.append([stage_mean(parts) for parts in zip(*(forces for forces, _ in outputs), strict=True)])
        loads.append(outputs[0][1])
    flown, joints = np.array(states), motion[::2]
    return Trajectory(
        crank_angle=closed.crank_angle[::2],
        crank_rate=closed.crank_velocity[::2],
        q=robot.configuration(np.array(placements), joints[:, 0, 0], joints[:, 0, 1]),
        v=robot.velocity(flown[:, :6], joints[:, 1, 0], joints[:, 1, 1]),
        deflection=np.zeros((len(flown), 4)),
        air=flown[:, 6:],
        forces=Forces(*(np.array(part) for part in zip(*means, strict=True))),
        loads=np.array(loads),
    )


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


def added_mass(plant: Plant, q: Vector, v: Vector, wind: Vector) -> tuple[Vector, Vector]:
    """Return M_a = sum m n^T n (nv, nv) and sum m n^T (n' v - d/dt(normal . v_air)) (nv,), by Pinocchio's Jacobians."""
    # n: a piece's normal velocity, or its turning about the span with m b^2 / 8; wind (2, 3): velocity and its rate.
    model, air, line = plant.model, plant.air, plant.air.line
    data = model.createData()
    pin.computeJointJacobiansTimeVariation(model, data, q, v)
    pin.forwardKinematics(model, data, q, v)
    mass = plant.scenario.air.added_mass * line.added_mass * line.width
    M, bias = np.zeros((model.nv, model.nv)), np.zeros(model.nv)
    for strip, link, x, y, _, share, _ in zip(*air.pieces, strict=True):
        joint = model.frames[model.getFrameId(LINKS[link])].parentJoint
        J = pin.getJointJacobian(model, data, joint, LOCAL)
        J_rate = pin.getJointJacobianTimeVariation(model, data, joint, LOCAL)
        R, omega = data.oMi[joint].rotation, data.v[joint].angular
        of_air = R.T @ wind[1] - np.cross(omega, R.T @ wind[0])
        rise, turn = np.array([0.0, 0.0, 1.0, y, -x, 0.0]), np.array([0.0, 0.0, 0.0, 0.0, 1.0, 0.0])
        m = share * mass[strip]
        for row, weight, air_rate in ((rise, m, of_air[2]), (turn, m * line.semichord[strip] ** 2 / 8.0, 0.0)):
            n = row @ J
            M += weight * np.outer(n, n)
            bias += weight * n * (row @ J_rate @ v - air_rate)
    return M, bias


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
