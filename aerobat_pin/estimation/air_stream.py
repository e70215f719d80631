"""The believed air along a flight under way: the forces of `believed_air`, sample by sample.

Between two samples the body follows the geodesic, the joints a cubic through both samples' angles and rates; velocities
and wind change linearly. Each interval is divided into as many steps as the fastest airspeed of a flap at the start
needs; the method stays stable up to twice that airspeed.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from aerobat_pin.estimation.believed_air import WARM_UP_ANGLES, AirAlongMotion
from aerobat_pin.estimation.believed_air_kernels import advance_air_stage
from aerobat_pin.estimation.motion import Motion
from aerobat_pin.flight import wind_of
from aerobat_pin.numerics import Array, guarded
from aerobat_pin.robot import BASE_SIZE, Aerobat, joint_table
from aerobat_pin.scenario import AirSection


class AirStream:
    """The aerodynamic forces on a believed robot in believed air, interval by interval.

    Args:
        robot: the believed robot.
        air: the believed air.
        dt: time between samples [s].
    """

    @guarded(dt="positive")
    def __init__(self, robot: Aerobat, air: AirSection, dt: float) -> None:
        """Set up the aerodynamic model; `reset` starts it."""
        self.robot, self.dt = robot, dt
        self._along = AirAlongMotion(robot, air)
        self._in_air, self._wind = self._along.in_air, wind_of(air)
        self._gusty = air.gust is not None and any(air.gust.amplitude)
        self._steps = 1

    @guarded(q=("nq",), v=("nv",))
    def reset(self, time: float, q: Array, v: Array, crank_angle: float, crank_rate: float) -> None:
        """Start at a sample, with wings that have flapped at this rate before and a body that has not moved."""
        wind = self._wind.field(np.array([time]))
        crank = np.array([[crank_angle], [crank_rate], [0.0]])
        begin = Motion(np.array([time]), q[None], v[None], crank, wind, {})
        along, fields = self._along, self._in_air.fields
        fields.start[:] = fields.state[:] = along.start(begin)
        self._q, self._v, self._at = np.array(q), np.array(v), wind[0]
        body = v[:BASE_SIZE] - np.concatenate([pin.Quaternion(q[3:7]).matrix().T @ wind[0, 0], np.zeros(3)])
        turn = joint_table(self.robot.linkage.solve(np.linspace(0.0, 2.0 * np.pi, WARM_UP_ANGLES), crank_rate))
        fastest = np.max(along.airspeed(self._in_air.flapping_twists(q[:7], body, turn)), keepdims=True)
        self._steps = int(np.ceil(self.dt / along.longest_step(fastest)[0] - 1e-9))
        pin.nonLinearEffects(self.robot.model, self._in_air.data, self._q, self._v)

    def update(self, time: float, q: Array, v: Array) -> Array:
        """Take the next sample, and return the mean forces (2, nv) since the last one: of the air, of the added mass.

        The arguments are not checked; they are those of a sample that an observer has taken.
        """
        model, data, memory, count = self.robot.model, self._in_air.data, self._in_air.memory, self._steps
        nle, before, rate = pin.nonLinearEffects, self._q, self._v
        length = self.dt / count
        a, joints = (v - rate) / self.dt, before[7:]
        wind, last = self._at, self._at
        if self._gusty:
            last = self._wind.field(np.array([time]))[0]
        means = np.zeros((2, model.nv))
        gap = q[7:] - joints
        bend, twist = gap - self.dt * rate[6:], gap - self.dt * v[6:]  # of the cubic: -(slopes less the chord) dt
        here, velocity = wind, rate
        for i in range(count):
            for place in (1, 2):
                if place == 1:
                    advance_air_stage(memory, here, a, length, 0, means)
                share = (i + 0.5 * place) / count
                if share < 1.0:
                    middle = pin.interpolate(model, before, q, share)
                    middle[7:] -= share * (1.0 - share) * ((1.0 - share) * bend - share * twist)
                    velocity = rate + share * (v - rate)
                    here = wind + share * (last - wind) if self._gusty else wind
                else:
                    middle, velocity, here = q, v, last
                nle(model, data, middle, velocity)
                advance_air_stage(memory, here, a, length, place, means)
        self._q, self._v, self._at = q, v, last
        if count > 1:
            means /= count
        return means
