"""Readable numpy twins of the compiled air: loads on the links, tail and body, and added mass strip by strip."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from aerobat_description.morphology import Morphology
from aerobat_pin.aerodynamics import RobotAir
from aerobat_pin.flight.plant.plant import Plant
from aerobat_pin.robot.wing import LINKS

LOCAL = pin.ReferenceFrame.LOCAL
Vector = np.ndarray


def air_loads(
    air: RobotAir, shape: Morphology, twists: Vector, state: Vector, added: float = 1.0
) -> tuple[Vector, Vector, Vector]:
    """Return wrenches (5, 6) on the links, rates of the state and loads (9, N), all from twists against the air.

    The mid-chord of a link with twist (v, omega) sees V = v + omega x r, u = V_x forward and w = -V_z upward, and
    U = hypot(u, w). The leading edge's share lead = c (3 - c^2) / 2, c = u / U, puts the 3/4-chord point a quarter
    chord behind and the 1/4-chord point a quarter before mid-chord. At the latter act, times the strip's width,

        f_x = lead suction - rho/2 c cd0 U u          f_z = lift + rho/2 c cd0 U w

    and the couple -b/2 m lead u omega_y, with the strip's added mass m. A strip's velocities are means over its pieces,
    weighted by their shares; each piece carries its share of the forces.
    """
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
    """Return M_a (nv, nv) and C_a v less the air's share (nv,), strip by strip, from Pinocchio's Jacobians and rates.

    n is the row that gives a piece's normal velocity at mid-chord, or its rate of turning about the span, which has the
    weight m b^2 / 8; wind (2, 3) holds the air's velocity and its rate:

        M_a = sum m n^T n          sum m n^T (n' v - d/dt(normal . v_air))
    """
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
