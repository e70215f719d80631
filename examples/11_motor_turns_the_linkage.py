"""A motor turns the closed linkage of a falling robot; then the robot with prescribed joints repeats the flight.

Both have no air. The closed robot knows no prescribed motion: torques turn its cranks, and six points hold its bars
together. The crank angle that comes out is then prescribed to the robot without bars.
"""

import numpy as np
import pinocchio as pin
from scipy.interpolate import CubicSpline

from aerobat_pin import closed_model, load_aerobat
from aerobat_pin.aerobat import closed_settings, closed_state, prescribed_joint_dynamics

RATE, GAIN, STALL = 2.0 * np.pi * 4.75, 5e-3, 0.05  # [rad/s], [N m s/rad] and [N m] of the motor at each crank
ROTOR = 2.5e-5  # [kg m2] at each crank; without a rotor the crank races where the wings hardly resist it
STEP, STEPS = 1e-3, 800  # [s]

robot = load_aerobat("aerobat")
model, constraints = closed_model("aerobat", bars="light")
data, datas = model.createData(), pin.StdVec_RigidConstraintData()
datas.extend(one.createData() for one in constraints)
pin.initConstraintDynamics(model, data, constraints, datas)
cranks = [model.joints[model.getJointId(f"{side}_crank")] for side in ("left", "right")]
model.armature = ROTOR * np.isin(np.arange(model.nv), [crank.idx_v for crank in cranks])


def turned_by_motors(q, v, time):
    """Return the acceleration of the closed robot under the motors' torques."""
    tau = np.zeros(model.nv)
    for crank in cranks:
        tau[crank.idx_v] = np.clip(GAIN * (RATE - v[crank.idx_v]), -STALL, STALL)
    return pin.constraintDynamics(model, data, q, v, tau, constraints, datas, closed_settings())


def step(one, q, v, time, rate):
    """Take a step of the classical Runge-Kutta method."""
    a1 = rate(q, v, time)
    v2 = v + STEP / 2 * a1
    a2 = rate(pin.integrate(one, q, STEP / 2 * v), v2, time + STEP / 2)
    v3 = v + STEP / 2 * a2
    a3 = rate(pin.integrate(one, q, STEP / 2 * v2), v3, time + STEP / 2)
    v4 = v + STEP * a3
    a4 = rate(pin.integrate(one, q, STEP * v3), v4, time + STEP)
    mean = (v + 2 * v2 + 2 * v3 + v4) / 6
    return pin.integrate(one, q, STEP * mean), v + STEP / 6 * (a1 + 2 * a2 + 2 * a3 + a4)


q, v, _ = closed_state(model, robot.linkage, crank_angle=-np.pi / 2, crank_velocity=RATE)
closed = [q]
for k in range(STEPS):
    q, v = step(model, q, v, k * STEP, turned_by_motors)
    closed.append(q)
closed = np.array(closed)
crank = CubicSpline(STEP * np.arange(STEPS + 1), closed[:, cranks[0].idx_q])
print(
    f"the crank made {np.ptp(closed[:, cranks[0].idx_q]) / (2 * np.pi):.2f} turns, {crank(0.8, 1):.1f} rad/s at the end"
)
closure, joints = robot.linkage.solve(closed[:, cranks[0].idx_q]), list(robot.idx_q)
shoulder = model.joints[model.getJointId("left_shoulder")].idx_q
print(f"the closed shoulder keeps to the linkage within {np.abs(closed[:, shoulder] - closure.theta_s).max():.1e} rad")


def prescribed(q, v, time):
    """Return the acceleration of the robot whose joints follow that crank."""
    moved = robot.linkage.solve(float(crank(time)), float(crank(time, 1)), float(crank(time, 2)))
    q[joints], v[list(robot.idx_v)] = [moved.theta_s, moved.theta_e] * 2, [moved.theta_s_dot, moved.theta_e_dot] * 2
    M, nle = pin.crba(robot.model, tree, q), pin.nonLinearEffects(robot.model, tree, q, v)
    M = np.triu(M) + np.triu(M, 1).T
    return prescribed_joint_dynamics(M, nle, 0 * nle, np.array([moved.theta_s_ddot, moved.theta_e_ddot] * 2))[0]


tree, q, rows = robot.model.createData(), robot.q0, []
v = robot.velocity(np.zeros(6), closure.dtheta_s[0] * RATE, closure.dtheta_e[0] * RATE)
for k in range(STEPS):
    rows.append(q)
    q, v = step(robot.model, q.copy(), v.copy(), k * STEP, prescribed)
away = np.abs(np.array(rows)[:, :3] - closed[:-1, :3]).max(axis=0)
print(
    f"largest difference of the two flights: {1e3 * away.max():.3f} mm, of {1e3 * np.ptp(closed[:, 2]):.0f} mm fallen"
)
