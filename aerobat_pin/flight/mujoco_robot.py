"""The robot with its closed linkage in MuJoCo, as a simulator for a plant; needs `aerobat-pinocchio[mujoco]`.

MuJoCo reads the exported MJCF: all bars of the linkage, closed at points by its constraint solver, the crank turned by
the file's servo. The closed form of the linkage only says where it starts, and the plant's integrator nothing.

Three numbers differ from the file: steps are shorter, closures stiffer, and bars have a hundredth of their mass. The
paper's linkage has no mass and does not give, so ours is the limit. How far `paper_open_loop` is off ours after half a
second [mm], where one number is changed:

    bars' mass, of the file's, 1, .1, .01, .001       1.374, .337, .234, .224        .222 + 1.15 share
    time constant of closures, 2, 1, .5, .25 ms       1.394, .488, .234, .185        about .17 + .3 (time / ms)^2
    steps of MuJoCo, .25, .125, .0625 ms              .259, .234, .233

At all three limits .162 mm are left, .131 and .117 mm where the plant, which holds the air's forces over a step, has
steps of .5 and .25 ms. R2 of Fx in `paper` is above .998 whatever the mass, .9972 with closures of 2 ms; with .25 ms
they ring, and that of Fy falls to .936.
"""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin

from aerobat_description.write_mjcf import mjcf_text
from aerobat_pin.aerobat import JOINTS, Aerobat, closed_model, closed_state
from aerobat_pin.errors import ExtraError
from aerobat_pin.flight.plant.simulated_elsewhere import SimulatedMotion
from aerobat_pin.numerics import Array, guarded

MUJOCO_STEP = 1.25e-4  # [s]: longest step of MuJoCo's Runge-Kutta method
CLOSURE_TIME = 5e-4  # [s]: time constant of the closures
BAR_SHARE = 1e-2  # mass of the bars, as a share of what the file gives them
CRANK_HOLD = 100.0  # [1/s]: how fast a miss of the crank angle is taken back


class MujocoRobot:
    """A `Simulator` that flies a robot in MuJoCo.

    Args:
        robot: the robot; its morphology is exported, and its gravity acts.

    Attributes:
        model, data: MuJoCo's.

    Raises:
        ExtraError: MuJoCo is not installed.
    """

    @guarded()
    def __init__(self, robot: Aerobat) -> None:
        try:
            import mujoco
        except ModuleNotFoundError as error:
            raise ExtraError("MuJoCo is not installed: pip install 'aerobat-pinocchio[mujoco]'") from error
        self._robot, self._mujoco = robot, mujoco
        self.model = model = mujoco.MjModel.from_xml_string(mjcf_text(robot.morphology, meshdir=None))
        self.data = mujoco.MjData(model)
        model.opt.gravity[:], model.eq_solref[:, 0] = robot.model.gravity.linear, CLOSURE_TIME
        body = model.body("base_link").id
        for bar in (i for i in range(model.nbody) if "_L" in model.body(i).name):
            model.body_mass[body] += (1.0 - BAR_SHARE) * model.body_mass[bar]
            model.body_mass[bar] *= BAR_SHARE
            model.body_inertia[bar] *= BAR_SHARE
        self._angles = [model.joint(name).qposadr[0] for name in JOINTS]
        self._rates = [model.joint(name).dofadr[0] for name in JOINTS]
        self._crank = self.data.joint("left_crank")

    def start(self, q: Array, v: Array, crank_angle: float, crank_rate: float) -> None:
        """Place body, joints and bars."""
        data = self.data
        self._mujoco.mj_resetData(self.model, data)
        closed = closed_model(self._robot.morphology)[0]
        angles, rates, _ = closed_state(closed, self._robot.linkage, crank_angle, crank_rate)
        for name in list(closed.names)[2:]:
            index, joint = closed.joints[closed.getJointId(name)], data.joint(name)
            joint.qpos[0], joint.qvel[0] = angles[index.idx_q], rates[index.idx_v]
        data.qpos[:3], data.qpos[3:7] = q[:3], q[[6, 3, 4, 5]]
        data.qvel[:3], data.qvel[3:6] = pin.Quaternion(q[3:7]).matrix() @ v[:3], v[3:6]
        data.ctrl[0] = crank_rate
        self._mujoco.mj_forward(self.model, data)

    def step(self, force: Array, crank_angle: float, crank_rate: float, dt: float) -> SimulatedMotion:
        """Fly on; the force on the body keeps its direction in the world."""
        model, data, robot = self.model, self.data, self._robot
        data.qfrc_applied[:3] = pin.Quaternion(data.qpos[[4, 5, 6, 3]]).matrix() @ force[:3]
        data.qfrc_applied[3:6], data.qfrc_applied[self._rates] = force[3:6], force[list(robot.idx_v)]
        data.ctrl[0] = crank_rate + CRANK_HOLD * (crank_angle - self._crank.qpos[0] - crank_rate * dt)
        count, torque = math.ceil(dt / MUJOCO_STEP - 1e-9), np.zeros(4)
        model.opt.timestep = dt / count
        for _ in range(count):
            torque += 0.5 / count * data.qfrc_constraint[self._rates]
            self._mujoco.mj_step(model, data)
            torque += 0.5 / count * data.qfrc_constraint[self._rates]
        placement = np.concatenate([data.qpos[:3], data.qpos[[4, 5, 6, 3]]])
        q, v = robot.configuration(placement, 0.0, 0.0), robot.velocity(np.zeros(6), 0.0, 0.0)
        v[:3], v[3:6] = pin.Quaternion(q[3:7]).matrix().T @ data.qvel[:3], data.qvel[3:6]
        q[list(robot.idx_q)], v[list(robot.idx_v)] = data.qpos[self._angles], data.qvel[self._rates]
        return SimulatedMotion(q, v, float(self._crank.qpos[0]), float(self._crank.qvel[0]), torque)
