"""Readable numpy twins of the compiled kernels: the same equations, by Pinocchio's and scipy's own functions.

Nothing here is compiled, packed or written in place. Generalised forces come from Pinocchio's Jacobians where the
kernels climb the tree, rotations and positions from `oMi` where they chain `liMi`, and the base is moved by SE(3)'s
own retraction where the plant moves the whole configuration.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pinocchio as pin
from scipy.linalg import cho_factor, cho_solve

from aerobat_description.morphology import Morphology
from aerobat_pin.aerodynamics import RobotAir
from aerobat_pin.disturbances import PointForce
from aerobat_pin.hold import AttitudeHold
from aerobat_pin.integrators import stage_mean, step
from aerobat_pin.plant import Flown, Forces, Plant, joint_table
from aerobat_pin.wing import LINKS

LOCAL, ALIGNED = pin.ReferenceFrame.LOCAL, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
Vector = np.ndarray


# ---------------------------------------------------------------------------------------------------------------- air


def air_loads(air: RobotAir, shape: Morphology, twists: Vector, state: Vector) -> tuple[Vector, Vector, Vector]:
    """Return wrenches (5, 6) on the links, rates (3N,) of the state and loads (5, N): u, w, w_eff, force x and z.

    The section at a 3/4-chord point r of a link with twist (v, omega) sees V = v + omega x r, u = V_x forward and
    w = -V_z upward, U = hypot(u, w), normal velocity w |u| / U. At the 1/4-chord point act, times the strip's width,

        f_x = sign(u) suction - rho/2 c cd0 U u          f_z = lift + rho/2 c cd0 U w
    """
    line = air.line
    velocity = twists[air.link, :3] + np.cross(twists[air.link, 3:], air.three_quarter_chord)
    u, w = velocity[:, 0], -velocity[:, 2]
    speed = np.hypot(u, w)
    normal_velocity = np.divide(w * np.abs(u), speed, out=np.zeros_like(u), where=speed > 0.0)
    w_eff, w_total = line.effective_velocity(state, speed, normal_velocity)
    drag = 0.5 * line.air_density * line.chord * shape.aerodynamics.profile_drag * speed
    force = np.zeros((line.strips, 3))
    force[:, 0] = line.width * (np.sign(u) * line.suction(w_eff) - drag * u)
    force[:, 2] = line.width * (line.lift(speed, w_eff) + drag * w)
    wrenches = np.zeros((len(LINKS), 6))
    np.add.at(wrenches, air.link, np.hstack([force, np.cross(air.quarter_chord, force)]))
    downwash = float(line.centre_downwash @ line.split(state)[2])
    wrenches[0] += body_and_tail(air, shape, twists[0], downwash)
    rates = line.rates(state, speed, w_eff, w_total)
    return wrenches, rates, np.array([u, w, w_eff, force[:, 0], force[:, 2]])


def body_and_tail(air: RobotAir, shape: Morphology, twist: Vector, centre_downwash: float) -> Vector:
    """Return the wrench (6,) of body drag and tail on the base, at its origin and in its axes.

    Drag -rho/2 A |V| V at the origin. The tail, a plate turned by its incidence, sees its centre's velocity with part
    of the wing's downwash, and pushes along its normal with rho/2 S a |along| across, a = 2 pi / (1 + 2 chord / span).
    """
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


# --------------------------------------------------------------------------------------------- hold and unknown forces


def hold_wrench(hold: AttitudeHold, position: Vector, rotation: Vector, twist: Vector) -> Vector:
    """Return the hold's wrench (6,) in body axes.

    torque, body axes: sat(kp log3(R^T R_ref) - kd omega); force, world axes: x sat(kx (vx_ref - vx)), y 0,
    z lift + sat(kz (z_ref - z) - dz vz).
    """
    velocity = rotation @ twist[:3]
    error = pin.log3(rotation.T @ hold.rotation)
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
    """Return the unknown forces (2, p, 3) at their points in world axes, with and without noise.

    Force i has size A sin(elbow) + step_i (+ noise_i) along its direction, which turns with link, body or not at all;
    forces at one point add up. Needs `updateFramePlacements` of the data.
    """
    total = np.zeros((2, len(points), 3))
    for force, drawn, stepped in zip(forces, noise, steps, strict=True):
        turned = data.oMf[model.getFrameId(force.frame)].rotation
        axes = {"link": turned, "body": data.oMi[1].rotation, "world": np.eye(3)}
        direction = axes[force.axes] @ force.direction
        clean = force.signal.amplitude * np.sin(elbow) + stepped
        total[:, points.index(force.frame)] += np.outer([clean + drawn, clean], direction)
    return total


def at_joints(model: pin.Model, data: pin.Data, wrenches: Vector) -> Vector:
    """Return sum J^T f (nv,) of wrenches (5, 6) on the links, at and in their joints' own frames."""
    joints = [model.frames[model.getFrameId(link)].parentJoint for link in LINKS]
    return sum(pin.getJointJacobian(model, data, joint, LOCAL).T @ f for joint, f in zip(joints, wrenches, strict=True))


def at_frames(model: pin.Model, data: pin.Data, frames: Sequence[str], forces: Vector) -> Vector:
    """Return sum J^T f (nv,) of world forces (p, 3) at the origins of frames."""
    jacobians = [pin.getFrameJacobian(model, data, model.getFrameId(name), ALIGNED)[:3] for name in frames]
    return sum((J.T @ f for J, f in zip(jacobians, forces, strict=True)), np.zeros(model.nv))


# -------------------------------------------------------------------------------------------------------------- plant


def plant_rates(
    plant: Plant, q: Vector, v: Vector, joints: Vector, air: Vector, held: Vector
) -> tuple[Vector, Vector, Forces, Vector]:
    """Return base acceleration (6,), rate of the air (3N,), forces at this instant (no leading axis) and strip loads.

    With F the sum of the generalised forces and b, j the rows of base and joints

        M_bb a_b = F_b - nle_b - M_bj theta''          u_m = M_jb a_b + M_jj theta'' + nle_j - F_j
    """
    model, robot = plant.model, plant.robot
    data = model.createData()
    M = pin.crba(model, data, q).copy()
    nle = pin.nonLinearEffects(model, data, q, v).copy()
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    twists = [pin.getFrameVelocity(model, data, model.getFrameId(link), LOCAL).vector for link in LINKS]
    wrenches, air_rate, loads = air_loads(plant.air, robot.wing.morphology, np.array(twists), air)
    aerodynamic = at_joints(model, data, wrenches)
    thrusters = np.zeros(model.nv)
    if plant.hold is not None:
        thrusters[:6] = hold_wrench(plant.hold, data.oMi[1].translation, data.oMi[1].rotation, v[:6])
    noisy, clean = forces_at_points(model, data, plant.forces, plant.points, joints[0, 1], *held)
    unknown = at_frames(model, data, plant.points, noisy)

    total = aerodynamic + thrusters + unknown
    acceleration = robot.velocity(np.zeros(6), *joints[2])
    driven = M[:6, 6:] @ acceleration[6:]
    acceleration[:6] = cho_solve(cho_factor(M[:6, :6]), total[:6] - nle[:6] - driven)
    motor = np.concatenate([np.zeros(6), (M @ acceleration + nle - total)[6:]])
    power = np.array(motor[6:] @ v[6:])
    return acceleration[:6], air_rate, Forces(aerodynamic, thrusters, motor, unknown, noisy, clean, power), loads


def fly(plant: Plant, count: int, dt: float, held: Vector) -> Flown:
    """Fly by `integrators.step`: the base on SE(3), the joints prescribed, one evaluation after the other."""
    robot, retract = plant.robot, pin.liegroups.SE3().integrate
    motion = joint_table(plant.closure(np.arange(2 * count + 1) * 0.5 * dt))
    placement, y = plant.start.placement, np.concatenate([plant.start.twist, plant.start.air])
    placements, states, means, loads = [placement], [y], [], []
    for k in range(count):

        def rates(time: float, here: Vector, y: Vector, k: int = k) -> tuple[Vector, Vector, tuple[Forces, Vector]]:
            joints = motion[round(2.0 * time / dt)]
            q, v = robot.configuration(here, *joints[0]), robot.velocity(y[:6], *joints[1])
            acceleration, air_rate, forces, strips = plant_rates(plant, q, v, joints, y[6:], held[:, :, k])
            return y[:6], np.concatenate([acceleration, air_rate]), (forces, strips)

        placement, y, outputs = step(rates, retract, k * dt, placement, y, dt)
        placements.append(placement)
        states.append(y)
        means.append([stage_mean(parts) for parts in zip(*(forces for forces, _ in outputs), strict=True)])
        loads.append(outputs[0][1])
    flown, joints = np.array(states), motion[::2]
    return Flown(
        q=robot.configuration(np.array(placements), joints[:, 0, 0], joints[:, 0, 1]),
        v=robot.velocity(flown[:, :6], joints[:, 1, 0], joints[:, 1, 1]),
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


def next_stage(stage: int, dt: float, k: Vector, rate: Vector, start: Vector) -> tuple[Vector, list[Vector]]:
    """Return y and the ways of q to the next stage, or in two parts to the next step, from the method's tableau.

    y: 0, 1/2, 1/2, 1; (1, 2, 2, 1) / 6          q2 = q exp(h/2 k1), q3 = q exp(h/2 k2), q4 = q2 exp(h k3 - h/2 k1)
    q' = q exp(h (k1/4 + k2/6 + k3/6 - k4/12)) exp(h (-k1/12 + k2/6 + k3/6 + k4/4))
    """
    vector = np.array([[1 / 2, 0, 0, 0], [0, 1 / 2, 0, 0], [0, 0, 1, 0], [1 / 6, 1 / 3, 1 / 3, 1 / 6]])
    ways = (
        [[1 / 2, 0, 0, 0]],
        [[0, 1 / 2, 0, 0]],
        [[-1 / 2, 0, 1, 0]],
        [[1 / 4, 1 / 6, 1 / 6, -1 / 12], [-1 / 12, 1 / 6, 1 / 6, 1 / 4]],
    )
    return start + dt * vector[stage] @ rate, [dt * np.array(way) @ k for way in ways[stage]]


# ----------------------------------------------------------------------------------------------------------- observers


def point_jacobian(model: pin.Model, frames: Sequence[str], q: Vector) -> Vector:
    """Return J (3n, nv): world velocities of the frames' origins per unit generalised velocity."""
    data = model.createData()
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    rows = [pin.getFrameJacobian(model, data, model.getFrameId(name), ALIGNED)[:3] for name in frames]
    return np.vstack([np.zeros((0, model.nv)), *rows])


def remembered(model: pin.Model, frames: Sequence[str], q: Vector, v: Vector) -> Vector:
    """Return what a sample leaves behind, (3 + 3n, nv): momentum p = M v, drift C^T v - g, v, point Jacobians."""
    data = model.createData()
    momentum = pin.crba(model, data, q) @ v
    drift = pin.computeCoriolisMatrix(model, data, q, v).T @ v
    gravity = pin.computeGeneralizedGravity(model, data, q)
    return np.vstack([momentum, drift - gravity, v, point_jacobian(model, frames, q)])


def believed(model: pin.Model, rows: str, v: Vector) -> Vector:
    """Return the weighted choice W (rows, nv) of what is believed of a generalised force.

    Weights are 1 for the base's translation and one over a lever of 50 mm for every moment. All rows; or the base's
    six; or these and the power of all joints per unit of joint velocity, v_j . phi_j / |v_j|, nothing at rest.
    """
    free = model.joints[1].nv == 6
    weighted = np.diag(np.concatenate([np.ones(3 * free), np.full(model.nv - 3 * free, 1.0 / 0.05)]))
    if rows == "all":
        return weighted
    speed = np.linalg.norm(v[6:])
    if rows == "base" or speed == 0.0:
        return weighted[:6]
    return np.vstack([weighted[:6], np.concatenate([np.zeros(6), v[6:] / speed / 0.05])])


def project(J: Vector, W: Vector, generalized: Vector) -> Vector:
    """Return argmin |W (phi - J^T f)|^2 + 1e-12 trace(W J^T J W^T) |f|^2, the forces (3n,), by least squares (QR)."""
    if not len(J):
        return np.zeros(0)
    weighted = W @ J.T
    stacked = np.vstack([weighted, 1.0e-6 * np.linalg.norm(weighted) * np.eye(len(J))])
    Q, R = np.linalg.qr(stacked)
    return np.linalg.solve(R, Q[: len(W)].T @ (W @ generalized))


class ObserverTwin:
    """Both observers: an exact exponential filter of the residual, or of the forces projected from it.

    phi = (p_1 - p_0) / dt - (drift_0 + drift_1) / 2 - u is the mean external generalised force of an interval, and the
    mean of its two end Jacobians stands for the one in its middle.

        momentum       r <- phi + exp(-K dt) (r - phi),  f = J^T+ r
        force_level    f <- J^T+ phi + exp(-K dt) (f - J^T+ phi),  r = J^T f
    """

    def __init__(
        self, model: pin.Model, frames: Sequence[str], gain: float | Vector, rows: str = "all", *, project_first: bool
    ) -> None:
        """Prepare the filter."""
        self.model, self.frames, self.gain = model, tuple(frames), gain
        self.rows, self.project_first = rows, project_first

    def reset(self, q: Vector, v: Vector, time: float) -> None:
        """Start from a sample with the filter at zero."""
        self.time, self.sample = time, remembered(self.model, self.frames, q, v)
        self.residual, self.force = np.zeros(self.model.nv), np.zeros(3 * len(self.frames))

    def update(
        self, time: float, q: Vector, v: Vector, tau: Vector, known: Mapping[str, Vector]
    ) -> tuple[Vector, Vector]:
        """Return residual (nv,) and force (n, 3) of the interval since the sample before."""
        dt = time - self.time
        if dt > 0.0:
            before, after = self.sample, remembered(self.model, self.frames, q, v)
            mean = 0.5 * (before + after)
            phi = (after[0] - before[0]) / dt - mean[1] - tau - sum(known.values(), np.zeros_like(tau))
            J, decay, W = mean[3:], np.exp(-self.gain * dt), believed(self.model, self.rows, mean[2])
            if self.project_first:
                force = project(J, W, phi)
                self.force = force + decay * (self.force - force)
                self.residual = J.T @ self.force
            else:
                self.residual = phi + decay * (self.residual - phi)
                self.force = project(J, W, self.residual)
            self.time, self.sample = time, after
        return self.residual, self.force.reshape(-1, 3)

    def run(
        self, time: Vector, q: Vector, v: Vector, tau: Vector, known: Mapping[str, Vector]
    ) -> tuple[Vector, Vector]:
        """Return residuals (m, nv) and forces (m, n, 3) over a record."""
        self.reset(q[0], v[0], time[0])
        found = []
        for k, torque in enumerate(tau):
            now = {name: values[k] for name, values in known.items()}
            found.append(self.update(time[k + 1], q[k + 1], v[k + 1], torque, now))
        residual, force = zip(*found, strict=True)
        return np.array(residual), np.array(force)
