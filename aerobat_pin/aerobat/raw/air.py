"""The air along a nominal motion, and its change with the body's twist."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aerobat_pin.aerobat.believed_air import AirAlongMotion
from aerobat_pin.aerobat.motion import Motion, wind_of
from aerobat_pin.aerobat.raw.nominal_motion import WING_JOINTS, NominalMotion, wing_angles, wing_motion
from aerobat_pin.linkage import joint_series
from aerobat_pin.numerics import Array
from aerobat_pin.robot import BASE_SIZE, Aerobat, joint_table
from aerobat_pin.scenario import AirSection

FLAP_ANGLES = 64  # of the crank, at which the fastest airspeed of a flap is looked for
SHIFTS = (0.02, 0.02, 0.02, 0.2, 0.2, 0.2)  # [m/s, rad/s] by which the twist is shifted


@dataclass(frozen=True)
class AirForces:
    """The air of m intervals.

    Attributes:
        force: (m, nv) generalised force, added mass included, interval means.
        added_mass: (m, nv, nv) inertia of the added mass, at the middle.
        by_twist: (m, nv, 6) derivative of `force` by the body's twist.
    """

    force: Array
    added_mass: Array
    by_twist: Array


class AirAboutNominal:
    """The believed air, flown along nominal motions: along whole records, or interval by interval.

    The derivative by the body's twist is that of flights whose twist is shifted from the first interval on, so it
    contains the wake that the shift has made. Only its present size counts, not its history.
    """

    def __init__(self, robot: Aerobat, section: AirSection) -> None:
        """Set up the aerodynamic model."""
        self.robot, self.section, self.along = robot, section, AirAlongMotion(robot, section)
        self.wind = wind_of(section)
        self._series = joint_series(robot.linkage)
        self.in_air, self._longest = self.along.in_air, np.inf
        self._states = np.zeros((1 + len(SHIFTS), self.along.air.state_size))

    def motion(self, nominal: NominalMotion) -> Motion:
        """Return a nominal motion in the form of a recorded one."""
        closure = self.robot.linkage.solve(*nominal.crank.T)
        q = self.robot.configuration(nominal.placements(), closure.theta_s, closure.theta_e)
        v = self.robot.velocity(nominal.twist, closure.theta_s_dot, closure.theta_e_dot)
        return Motion(nominal.time, q, v, nominal.crank.T.copy(), self.wind.field(nominal.time))

    def fly(self, nominal: NominalMotion, by_twist: Array | None = None) -> AirForces:
        """Return the air along a motion.

        Args:
            nominal: the motion.
            by_twist: derivative by the twist, if it is known from an earlier motion; flown anew when omitted.
        """
        moved, nv = self.motion(nominal), self.robot.model.nv
        state, inertia = self.along.in_air.fields.state, np.zeros((len(nominal.time) - 1, nv, nv))
        force = np.add(*self.along.fly(moved, inertia))
        self._states[0] = state
        if by_twist is None:
            by_twist = np.empty((len(force), nv, BASE_SIZE))
            for i, shift in enumerate(SHIFTS):
                v = moved.v.copy()
                v[:, i] += shift
                shifted = Motion(moved.time, moved.q, v, moved.crank, moved.wind)
                by_twist[:, :, i] = (np.add(*self.along.fly(shifted)) - force) / shift
                self._states[1 + i] = state
        return AirForces(force, inertia, by_twist)

    def begin(self, nominal: NominalMotion) -> None:
        """Fly along a motion, for `go_on`: with steps as short as the fastest airspeed of a flap at its end needs."""
        self.fly(nominal)
        moved, solve = self.motion(nominal), self.robot.linkage.solve
        angle, rate, _ = nominal.crank[-1]
        turn = joint_table(solve(angle + np.linspace(0.0, 2.0 * np.pi, FLAP_ANGLES), rate))
        body = moved.q[-1, :7], nominal.twist[-1] - np.append(nominal.rotation[-1].T @ moved.wind[-1, 0], np.zeros(3))
        self._longest = float(
            np.min(self.along.longest_step(self.along.airspeed(self.in_air.flapping_twists(*body, turn))))
        )

    def go_on(self, nominal: NominalMotion) -> AirForces:
        """Return the air of one more interval, from where `begin` or `go_on` has ended.

        Between the knots the body moves as in `believed_air`, and the crank's acceleration is that at the start.
        """
        nv = self.robot.model.nv
        fields, inertia, by_twist = self.in_air.fields, np.zeros((1, nv, nv)), np.empty((1, nv, BASE_SIZE))
        span = float(nominal.time[1] - nominal.time[0])
        count = max(int(np.ceil(span / self._longest - 1e-9)), 1)
        q, v, a, wind = self._half_steps(nominal, span, count)
        steps, dt = np.array([count]), np.array([span / count])

        def flown(i: int, inertia: Array | None = None) -> Array:
            fields.start[:] = fields.state[:] = self._states[i]
            force = np.add(*self.along.advance((q, v, a, wind), steps, dt, inertia))
            self._states[i] = fields.state
            return force

        force = flown(0, inertia)
        for i, shift in enumerate(SHIFTS):
            v[:, i] += shift
            by_twist[:, :, i] = (flown(1 + i) - force) / shift
            v[:, i] -= shift
        return AirForces(force, inertia, by_twist)

    def _half_steps(self, nominal: NominalMotion, span: float, count: int) -> tuple[Array, Array, Array, Array]:
        """Return q, v, acceleration and wind at the half steps of one interval, as `believed_air.half_steps` does."""
        robot, share = self.robot, np.arange(2 * count + 1) / (2.0 * count)
        time = share * span
        q, v, a = (np.empty((len(share), size)) for size in (robot.model.nq, robot.model.nv, robot.model.nv))
        start, end = nominal.placements()
        q[:, :7] = start + share[:, None] * (end - start)
        q[:, 3:7] /= np.linalg.norm(q[:, 3:7], axis=1, keepdims=True)
        change = nominal.twist[1] - nominal.twist[0]
        v[:, :BASE_SIZE], a[:, :BASE_SIZE] = nominal.twist[0] + share[:, None] * change, change / span
        angle, turning, speeding = nominal.crank[0]
        rate, bend = turning + time * speeding, np.full_like(time, speeding)
        wings = wing_angles(self._series, angle + 0.5 * time * (turning + rate))
        q[:, WING_JOINTS], v[:, WING_JOINTS], a[:, WING_JOINTS] = wing_motion(wings, rate, bend)
        return q, v, a, self.wind.field(nominal.time[0] + time)
