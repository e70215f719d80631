"""The believed air along a flight under way: the forces of `believed_air`, sample by sample.

Between two samples the body follows the geodesic, the joints a cubic through both samples' angles and rates; velocities
and wind change linearly. Each interval is divided into as many steps as the fastest airspeed of a flap at the start
needs; the method stays stable up to twice that airspeed.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from aerobat_pin.aerobat.believed_air import WARM_UP_ANGLES, AirAlongMotion
from aerobat_pin.aerobat.believed_air_kernels import Stream, air_at
from aerobat_pin.aerobat.motion import Motion, wind_of
from aerobat_pin.errors import ShapeError
from aerobat_pin.numerics import Array, fields_of, guarded, new_state
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
        self._gusty = not air.is_steady
        self._steps = 1
        self._memory = new_state(Stream, air=self._in_air.memory, nq=robot.model.nq, nv=robot.model.nv)
        self._stream = fields_of(self._memory, Stream)
        self._stream.dt[...] = dt

    @guarded(q=("nq",), v=("nv",))
    def reset(self, time: float, q: Array, v: Array, crank_angle: float, crank_rate: float) -> None:
        """Start at a sample, with wings that have flapped at this rate before and a body that has not moved."""
        wind = self._wind.field(np.array([time]))
        crank = np.array([[crank_angle], [crank_rate], [0.0]])
        begin = Motion(np.array([time]), q[None], v[None], crank, wind)
        along, fields = self._along, self._in_air.fields
        fields.start[:] = fields.state[:] = along.start(begin)
        stream = self._stream
        stream.q[:], stream.v[:] = q, v
        stream.wind[:] = stream.last_wind[:] = wind[0]
        body = v[:BASE_SIZE] - np.concatenate([pin.Quaternion(q[3:7]).matrix().T @ wind[0, 0], np.zeros(3)])
        turn = joint_table(self.robot.linkage.solve(np.linspace(0.0, 2.0 * np.pi, WARM_UP_ANGLES), crank_rate))
        fastest = np.max(along.airspeed(self._in_air.flapping_twists(q[:7], body, turn)), keepdims=True)
        self._steps = int(np.ceil(self.dt / along.longest_step(fastest)[0] - 1e-9))
        pin.nonLinearEffects(self.robot.model, self._in_air.data, stream.q, stream.v)

    def update(self, time: float, q: Array, v: Array) -> Array:
        """Take the next sample, and return the mean forces (2, nv) since the last one: of the air, of the added mass.

        Values are not checked; they are those of a sample that an observer takes. Raises ShapeError for other shapes.
        """
        model, data, stream, count = self.robot.model, self._in_air.data, self._stream, self._steps
        if q.shape != stream.q.shape or v.shape != stream.v.shape:
            raise ShapeError(f"q, v have shapes {q.shape}, {v.shape}: {stream.q.shape}, {stream.v.shape} were expected")
        memory, nle, interpolate, ends = self._memory, pin.nonLinearEffects, pin.interpolate, 2 * count
        if self._gusty:
            stream.last_wind[:] = self._wind.field(np.array([time]))[0]
        for half in range(ends - 1):
            middle = interpolate(model, stream.q, q, 0.5 * (half + 1) / count)
            air_at(memory, q, v, half, count, middle)
            nle(model, data, middle, stream.velocity)
        air_at(memory, q, v, ends - 1, count, q)
        nle(model, data, q, v)
        air_at(memory, q, v, ends, count, q)
        return stream.means.copy()
