"""The air along a nominal motion, and its change with the body's twist."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from aerobat_pin.aerobat.aerobat import Aerobat
from aerobat_pin.aerobat.air.believed_air import AirAlongMotion, through_air
from aerobat_pin.aerobat.motion import Motion, wind_of
from aerobat_pin.aerobat.prescribed_joints import BASE_SIZE
from aerobat_pin.aerobat.raw.nominal_motion import WING_JOINTS, NominalMotion, wing_angles, wing_motion
from aerobat_pin.linkage import joint_series
from aerobat_pin.numerics import Array
from aerobat_pin.scenario import AirSection

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
        self.robot, self.along = robot, AirAlongMotion(robot, section)
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
        """Return the air along a motion; a derivative by the twist, from an earlier motion, is not flown anew."""
        moved, nv = self.motion(nominal), self.robot.model.nv
        inertia = np.zeros((len(nominal.time) - 1, nv, nv))

        def flown(i: int, v: Array, inertia: Array | None = None) -> Array:
            force = np.add(*self.along.fly(replace(moved, v=v), inertia))
            self._states[i] = self.in_air.fields.state
            return force

        force = flown(0, moved.v, inertia)
        return AirForces(force, inertia, _by_twist(flown, moved.v, force) if by_twist is None else by_twist)

    def begin(self, nominal: NominalMotion) -> None:
        """Fly along a motion, for `go_on`: with steps as short as the fastest airspeed of a flap at its end needs."""
        self.fly(nominal)
        moved = self.motion(nominal)
        body = through_air(moved.q[-1], moved.v[-1], moved.wind[-1, 0])
        self._longest = self.along.longest_in_flap(*body, nominal.crank[-1, 1])

    def go_on(self, nominal: NominalMotion) -> AirForces:
        """Return the air of one more interval, from where `begin` or `go_on` has ended.

        Between the knots the body moves as in `believed_air`, and the crank's acceleration is that at the start.
        """
        fields, inertia = self.in_air.fields, np.zeros((1, self.robot.model.nv, self.robot.model.nv))
        span = float(nominal.time[1] - nominal.time[0])
        count = max(int(np.ceil(span / self._longest - 1e-9)), self.along.steps_now(span), 1)
        q, v, a, wind = self._half_steps(nominal, span, count)
        steps, dt = np.array([count]), np.array([span / count])

        def flown(i: int, v: Array, inertia: Array | None = None) -> Array:
            fields.start[:] = fields.state[:] = self._states[i]
            force = np.add(*self.along.advance((q, v, a, wind), steps, dt, inertia))
            self._states[i] = fields.state
            return force

        force = flown(0, v, inertia)
        return AirForces(force, inertia, _by_twist(flown, v, force))

    def _half_steps(self, nominal: NominalMotion, span: float, count: int) -> tuple[Array, Array, Array, Array]:
        """Return q, v, acceleration and wind at the half steps of one interval, as `believed_air.half_steps` does."""
        robot, share = self.robot, np.arange(2 * count + 1)[:, None] / (2.0 * count)
        q, v, a = (np.empty((len(share), size)) for size in (robot.model.nq, robot.model.nv, robot.model.nv))
        start, end = nominal.placements()
        q[:, :7] = start + share * (end - start)
        q[:, 3:7] /= np.linalg.norm(q[:, 3:7], axis=1, keepdims=True)
        change = nominal.twist[1] - nominal.twist[0]
        v[:, :BASE_SIZE], a[:, :BASE_SIZE] = nominal.twist[0] + share * change, change / span
        angle, turning, speeding = nominal.crank[0]
        time = share * span
        rate = turning + time * speeding
        wings = wing_angles(self._series, (angle + 0.5 * time * (turning + rate))[:, 0])
        q[:, WING_JOINTS], v[:, WING_JOINTS], a[:, WING_JOINTS] = wing_motion(wings, rate, speeding)
        return q, v, a, self.wind.field(nominal.time[0] + time[:, 0])


def _by_twist(flown: Callable[[int, Array], Array], v: Array, force: Array) -> Array:
    """Return the derivative (m, nv, 6) of a force (m, nv) flown with velocities v: `flown(i, v)` flies shift i - 1."""
    by_twist = np.empty((*force.shape, BASE_SIZE))
    for i, shift in enumerate(SHIFTS):
        shifted = v.copy()
        shifted[:, i] += shift
        by_twist[:, :, i] = (flown(1 + i, shifted) - force) / shift
    return by_twist
