"""Elastic joints and a payload: what flies differs from the rigid robot that observers believe in.

The linkage drives a joint to theta(t1). An elastic joint turns to theta + d, and its own row of the equations of
motion, in which a rigid joint's torque is the unknown, gives the acceleration of the deflection d:

    [H_bb  H_be] [a_b]   [F_b - h_b - H_bj theta'']
    [H_eb  H_ee] [d''] = [F_e - h_e - H_ej theta'' - k d - c d']         k stiffness, c damping; H, h, F as in `plant`

The torque that passes the joint is -k d - c d'. It is the one that a torque sensor there measures, and that the linkage
carries to the crank. At the start d is what the torque of the rigid joint asks of the spring, so that it rings little.

The integrator is explicit. Its steps are cut into equal parts where the fastest mode of a joint, with the body free and
without air, would otherwise turn or decay by more than `MODE_TURN` in a step; more than `MOST_PARTS` are refused.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin

from aerobat_pin.aerobat import BASE_SIZE, JOINTS, Aerobat, tree_of
from aerobat_pin.errors import ScenarioError
from aerobat_pin.numerics import Array
from aerobat_pin.scenario import LoadSection, PlantSection, Scenario

MODE_TURN = 0.5  # [rad] a step: the method adds 0.02 % of critical damping there, and is unstable from 2.8 on
MOST_PARTS = 20  # of an interval
MODE_ANGLES = 24  # crank angles in a turn at which the modes are computed
FLOATING = 1  # Pinocchio's index of the floating base's joint


class ElasticJoints:
    """The elastic joints of a plant, of which there can be none.

    Args:
        robot: the robot that flies.
        plant: the scenario's table `plant`.

    Attributes:
        count: number e of elastic joints.
        joints: (e,) their indices in `JOINTS`.
        rows: (e,) their rows in v.
        links: (e,) indices in `LINKS` of the links that they carry.
        stiffness, damping: (e,) of their springs [N m/rad, N m s/rad].
        fastest_mode: largest modulus of their eigenvalues [1/s].
    """

    def __init__(self, robot: Aerobat, plant: PlantSection) -> None:
        sections = {i: getattr(plant, name.split("_")[1]) for i, name in enumerate(JOINTS)}
        elastic = {i: section for i, section in sections.items() if section is not None}
        self.plant, self.count, self.joints = plant, len(elastic), list(elastic)
        self.stiffness = np.array([section.stiffness for section in elastic.values()])
        self.damping = np.array([section.damping for section in elastic.values()])
        self.rows = [robot.idx_v[i] for i in self.joints]
        carried = [robot.model.names[int(i)] for i in tree_of(robot.model).joint]
        self.links = [carried.index(JOINTS[i]) for i in self.joints]
        self.fastest_mode = max(self._modes(robot), default=0.0)

    def spread(self, values: Array) -> Array:
        """Return values (..., 4) of all joints in the order of `JOINTS` from those (..., e) of the elastic ones."""
        every = np.zeros((*values.shape[:-1], len(JOINTS)))
        every[..., self.joints] = values
        return every

    def substeps(self, dt: float) -> int:
        """Return the number of integration steps in an interval [s]. Raises ScenarioError where they are too many."""
        parts = int(np.ceil(dt * self.fastest_mode / MODE_TURN - 1e-9))
        if parts > MOST_PARTS:
            names = ", ".join(sorted({f"plant.{JOINTS[i].split('_')[1]}" for i in self.joints}))
            raise ScenarioError(
                f"{names}: the fastest mode, {self.fastest_mode:.3g} 1/s, needs steps of "
                f"{MODE_TURN / self.fastest_mode:.2g} s, {parts} in simulation.dt = {dt:g} s; at most {MOST_PARTS} "
                "were expected: take a softer spring, less damping or a shorter dt, or a rigid joint (no table)"
            )
        return parts

    def _modes(self, robot: Aerobat) -> list[float]:
        """Return the largest modulus of the eigenvalues [1/s] at crank angles all around, the body free, no air."""
        if not self.count:
            return []
        data, moduli, e = robot.model.createData(), [], self.count
        for angle in np.linspace(0.0, 2.0 * np.pi, MODE_ANGLES, endpoint=False):
            closed = robot.linkage.solve(angle)
            q = robot.configuration(robot.q0[:7], closed.theta_s, closed.theta_e)
            M = np.triu(pin.crba(robot.model, data, q))
            M += np.triu(M, 1).T
            across = M[:BASE_SIZE, self.rows]
            free = M[np.ix_(self.rows, self.rows)] - across.T @ np.linalg.solve(M[:BASE_SIZE, :BASE_SIZE], across)
            rates = -np.linalg.solve(free, np.hstack([np.diag(self.stiffness), np.diag(self.damping)]))
            modes = np.linalg.eigvals(np.vstack([np.hstack([np.zeros((e, e)), np.eye(e)]), rates]))
            moduli.append(float(np.max(np.abs(modes))))
        return moduli


def loaded(robot: Aerobat, payload: LoadSection | None) -> Aerobat:
    """Return a robot that carries a payload; configurations stay those of the COM of its body without it."""
    if payload is None:
        return robot
    model = robot.model.copy()
    place = model.inertias[FLOATING].lever + np.array(payload.position)
    model.inertias[FLOATING] += pin.Inertia(payload.mass, place, np.zeros((3, 3)))
    return replace(robot, model=model)


def as_measured(
    scenario: Scenario, robot: Aerobat, q: Array, v: Array, crank_angle: Array, crank_rate: Array
) -> tuple[Array, Array, Array]:
    """Return what exact sensors show of q, v and the crank's angle, which a slipped zero of its encoder shifts.

    Of a robot whose zero has slipped, or whose joints are elastic, they show the joints that follow from the encoder by
    the closed linkage, as a robot does that has no sensor at its joints. With a table `sensors.joint_angle` or
    `sensors.joint_rate`, sensors at the joints show their true motion.

    Args:
        scenario: its tables `plant` and `sensors` are read.
        robot: the robot that flies.
        q: (..., nq) configurations.
        v: (..., nv) velocities.
        crank_angle: (...) absolute crank angle t1 [rad].
        crank_rate: (...) its rate [rad/s].
    """
    plant, sensors = scenario.plant, scenario.sensors
    angle = crank_angle + np.radians(plant.crank_zero_deg) if plant.crank_zero_deg else crank_angle
    if plant.shows_joints and sensors.joint_angle is None and sensors.joint_rate is None:
        closed = robot.linkage.solve(angle, crank_rate)
        q = robot.configuration(q[..., :7], closed.theta_s, closed.theta_e)
        v = robot.velocity(v[..., :BASE_SIZE], closed.theta_s_dot, closed.theta_e_dot)
    return q, v, angle
