"""Compute the aerodynamic forces that an assumed air exerts on an assumed robot, along a motion or sample by sample.

The forces are interval means of the generalised force Sigma_Aero. The samples of a log can be too far apart to
integrate the states of the aerodynamic model, so each interval is divided into equal steps. In between, the body
follows the geodesic between its sampled placements, and the joints follow the closed linkage at the interpolated crank
angle, bent by as much as at the samples (or a straight line between the joint angles, if the crank is not recorded).
The longest stable step follows from the fastest mode of the lifting line, whose rate grows with the airspeed and with
the number of strips.

Along a flight under way (`AirStream`), the joints follow a cubic through both samples' angles and rates; velocities and
wind change linearly. There are as many steps as the fastest airspeed of a flap at the start needs, or more where a
strip met faster air at the sample before; the method stays stable up to twice that airspeed.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pinocchio as pin

from aerobat_pin.aerobat.aerobat import Aerobat
from aerobat_pin.aerobat.air.believed_air_kernels import Stream, advance_air_stage, air_at
from aerobat_pin.aerobat.air.robot_in_air import RobotInAir
from aerobat_pin.aerobat.motion import Motion, robot_air, wind_of
from aerobat_pin.aerobat.prescribed_joints import BASE_SIZE, joint_table
from aerobat_pin.aerodynamics import LARGEST_AIRSPEED, StripLoads
from aerobat_pin.errors import LogError, ScenarioError, ShapeError
from aerobat_pin.numerics import Array, Integers, fields_of, guarded, new_state
from aerobat_pin.observers import rotations
from aerobat_pin.scenario import AirSection

TOO_FAST = 1.1 * LARGEST_AIRSPEED  # [m/s], for noisy sensors; a motion in millimetres is far beyond
LONGEST_STEP = 1.5e-3  # [s]: longer steps change the lift by more than a thousandth at 5 m/s and 6.7 Hz
LARGEST_MODE_STEP = 1.4  # rate of the fastest mode times the step; the method is unstable from 2.785 on
AIRSPEED = StripLoads._fields.index("airspeed")
CRANK_ANGLES_TRIED = 721  # every half degree
FLAP_ANGLES = 60  # number of crank angles in a turn at which its airspeeds are computed
WARM_UP_LIMIT = 3.0  # [s]: for a crank that hardly turns; the wake matters for about ten chords of travel
LONGEST_GAP = 0.5  # [s]: the motion of the wings during a longer gap is unknown


def reconstructed_air(robot: Aerobat, air: AirSection, moved: Motion) -> dict[str, Array]:
    """Return generalised forces (m, nv) along a motion, interval means: `aerodynamic`, and `added_mass` if it has any.

    Before the first sample, `warm_up_cycles` flapping cycles are simulated: the body stays as it is there, and the
    crank turns at its first rate. The length of a cycle is that of the median crank rate of the flight.

    Raises:
        LogError: the log has a gap in time that is too long, or wings that move impossibly fast.
    """
    dt = np.diff(moved.time)
    if np.max(dt) > LONGEST_GAP:
        at = int(np.argmax(dt))
        raise LogError(
            f"flight log: {dt[at]:.3g} s without a sample after t = {moved.time[at]:g} s: the air's past is lost; cut "
            "the log there"
        )
    aerodynamic, added = AirAlongMotion(robot, air).fly(moved)
    forces = {"aerodynamic": aerodynamic}
    if air.added_mass > 0.0:
        forces["added_mass"] = added
    return forces


class AirAlongMotion:
    """The aerodynamic model of an assumed robot in an assumed air, evaluated along a recorded motion."""

    def __init__(self, robot: Aerobat, air: AirSection) -> None:
        self.robot, self.section = robot, air
        self.in_air = RobotInAir(robot, robot_air(robot.wing, air))
        self.air = self.in_air.air
        self.fastest = self.air.line.fastest_mode if self.air.state_size else 0.0  # [1/m]

    def airspeed(self, twists: Array) -> Array:
        """Return the airspeed (n,) [m/s] of the fastest strip, from the links' twists relative to the air (n, 5, 6)."""
        return np.asarray(np.max(self.air.airspeed(twists), axis=1))

    def longest_step(self, airspeed: Array) -> Array:
        """Return the longest allowed step (n,) [s] for the airspeed (n,) [m/s] of the fastest strip."""
        return np.asarray(1.0 / np.maximum(1.0 / LONGEST_STEP, self.fastest * airspeed / LARGEST_MODE_STEP))

    def steps_now(self, span: float) -> int:
        """Return the number of steps that a span [s] needs at the airspeed of the fastest strip where it was last."""
        airspeed = min(TOO_FAST, float(self.in_air.fields.loads[AIRSPEED].max()))  # TOO_FAST for what is not a number
        return math.ceil(span * self.fastest * airspeed / LARGEST_MODE_STEP)

    def longest_in_flap(self, placement: Array, twist: Array, crank_rate: float) -> float:
        """Return the longest step [s] for the fastest airspeed of a flap, of a body as `through_air` returns it."""
        turn = joint_table(self.robot.linkage.solve(np.linspace(0.0, 2.0 * np.pi, FLAP_ANGLES), crank_rate))
        airspeed = float(np.max(self.airspeed(self.in_air.flapping_twists(placement, twist, turn))))
        if airspeed > TOO_FAST:  # which would take millions of steps
            most = f"at most {LARGEST_AIRSPEED:g}, in metres and seconds, was expected"
            raise ScenarioError(f"the wings meet air at {airspeed:.3g} m/s in a flap: {most}")
        return float(self.longest_step(np.array([airspeed]))[0])

    def steps(self, moved: Motion) -> Integers:
        """Return the number of integration steps (m,) of each interval between samples."""
        v = moved.v.copy()
        v[:, :3] -= np.einsum("nji,nj->ni", rotations(moved.q), moved.wind[:, 0])
        airspeed = self.airspeed(self.in_air.link_twists(moved.q, v))
        at = int(np.argmax(airspeed))
        if airspeed[at] > TOO_FAST:
            raise LogError(
                f"flight log: the wings meet air at {airspeed[at]:.0f} m/s at t = {moved.time[at]:g} s: metres, "
                "seconds and a motion that is less noisy were expected"
            )
        longest = self.longest_step(np.maximum(airspeed[1:], airspeed[:-1]))
        return np.asarray(np.maximum(np.ceil(np.diff(moved.time) / longest - 1e-9), 1), dtype=np.intp)

    def start(self, moved: Motion) -> Array:
        """Return the state of the aerodynamic model at the first sample, after the warm-up cycles."""
        cycles, crank = self.section.warm_up_cycles, moved.crank
        if crank is None:
            crank = _crank_of_joints(self.robot, moved.q[:1], moved.v[:1])
        rate = float(np.median(np.abs(crank[1])))
        if rate == 0.0 or cycles == 0 or not self.air.state_size:
            return np.zeros(self.air.state_size)
        body = through_air(moved.q[0], moved.v[0], moved.wind[0, 0])
        angle, turning = crank[:2, 0]
        duration = min(cycles * 2.0 * np.pi / rate, WARM_UP_LIMIT)
        count = int(np.ceil(duration / self.longest_in_flap(*body, turning)))
        back = (np.arange(2 * count + 1) * 0.5 / count - 1.0) * duration
        motion = joint_table(self.robot.linkage.solve(angle + turning * back, turning))
        return self.in_air.warmed_up(*body, motion, duration / count)

    def fly(self, moved: Motion, inertia: Array | None = None) -> tuple[Array, Array]:
        """Return interval means (m, nv) of the aerodynamic force and of that of the added mass, along a motion.

        If `inertia` (m, nv, nv) is given, the inertia of the added mass in each interval is written there.
        """
        fields, steps = self.in_air.fields, self.steps(moved)
        fields.start[:] = fields.state[:] = self.start(moved)
        return self.advance(half_steps(moved, self.robot, steps), steps, np.diff(moved.time) / steps, inertia)

    def advance(
        self, motion: tuple[Array, Array, Array, Array], steps: Integers, dt: Array, inertia: Array | None = None
    ) -> tuple[Array, Array]:
        """Do as `fly` from the aerodynamic state in `in_air.fields` on; the last one is left there.

        The motion is as `half_steps` returns it; each interval has `steps` (m,) of length `dt` (m,) [s].
        """
        model, data, memory, fields = self.robot.model, self.in_air.data, self.in_air.memory, self.in_air.fields
        nle, (q, v, a, wind) = pin.nonLinearEffects, motion
        means = np.zeros((len(steps), 2, model.nv))
        nle(model, data, q[0], v[0])
        half = 0
        for k, count in enumerate(steps.tolist()):
            if (step := dt[k]) > 0.0:
                mean = means[k]
                for i in range(half, half + 2 * count, 2):
                    # `data` already has Pinocchio's results for the step's start, where the previous step ended.
                    slope = a[i + 1]
                    advance_air_stage(memory, wind[i], slope, step, 0, mean)
                    nle(model, data, q[i + 1], v[i + 1])
                    advance_air_stage(memory, wind[i + 1], slope, step, 1, mean)
                    if inertia is not None:
                        inertia[k] = fields.H
                    nle(model, data, q[i + 2], v[i + 2])
                    advance_air_stage(memory, wind[i + 2], slope, step, 2, mean)
                mean /= count
            half += 2 * count
        return means[:, 0], means[:, 1]


def _crank_of_joints(robot: Aerobat, q: Array, v: Array) -> Array:
    """Return angle and rate (2, 1) of the crank at which the linkage is closest to the joints at one sample."""
    turn = np.linspace(0.0, 2.0 * np.pi, CRANK_ANGLES_TRIED)
    angles, slopes, _ = np.tile(joint_table(robot.linkage.solve(turn, 1.0)), 2).swapaxes(0, 1)  # of both wings
    at = int(np.argmin(np.sum((angles - q[:, list(robot.idx_q)]) ** 2, axis=1)))
    return np.stack([turn[[at]], v[:, list(robot.idx_v)] @ slopes[at] / (slopes[at] @ slopes[at])])


def through_air(q: Array, v: Array, wind: Array) -> tuple[Array, Array]:
    """Return placement (7,) and twist (6,) relative to the air of a body in wind (3,), world axes."""
    return q[:7], v[:BASE_SIZE] - np.append(pin.Quaternion(q[3:7]).matrix().T @ wind, np.zeros(3))


def half_steps(moved: Motion, robot: Aerobat, steps: Integers) -> tuple[Array, Array, Array, Array]:
    """Return q, v, acceleration and wind at the beginning of every half step, and at the end of the last.

    Between two samples the body moves along a straight line and turns at a constant rate; velocities and wind are
    interpolated linearly.
    """
    k = np.append(np.repeat(np.arange(len(steps)), 2 * steps), len(steps) - 1)
    first = 2 * np.append(0, np.cumsum(steps)[:-1])
    share = ((np.arange(len(k)) - first[k]) / (2.0 * steps[k]))[:, None]
    dt = np.diff(moved.time)
    q = moved.q[k] + share * (moved.q[k + 1] - moved.q[k])
    q[:, 3:7] = _slerp(moved.q[k, 3:7], moved.q[k + 1, 3:7], share)
    v = moved.v[k] + share * (moved.v[k + 1] - moved.v[k])
    a = _slopes(moved.v, dt)[k]
    wind = moved.wind[k] + share[:, :, None] * (moved.wind[k + 1] - moved.wind[k])
    if moved.crank is not None:
        angles = _linkage_between(moved.crank, robot, dt, k, share[:, 0])
        for row, (at_q, at_v) in enumerate(zip(robot.idx_q, robot.idx_v, strict=True)):
            q[:, at_q], v[:, at_v], a[:, at_v] = angles[:, :, row % 2].T
        if moved.bend is not None:
            angle, rate = moved.bend
            q[:, list(robot.idx_q)] += angle[k] + share * (angle[k + 1] - angle[k])
            v[:, list(robot.idx_v)] += rate[k] + share * (rate[k + 1] - rate[k])
            a[:, list(robot.idx_v)] += _slopes(rate, dt)[k]
    return q, v, a, wind


def _slopes(values: Array, dt: Array) -> Array:
    """Return the rate of change of values (m + 1, c) over intervals dt (m,) [s]; 0 over one of no length."""
    slopes = np.divide(np.diff(values, axis=0), dt[:, None], out=np.zeros_like(values[1:]), where=dt[:, None] > 0.0)
    return np.asarray(slopes)


def _slerp(start: Array, end: Array, share: Array) -> Array:
    """Interpolate between unit quaternions `start` and `end` (n, 4) along the shorter arc at a constant rate."""
    cosine = np.sum(start * end, axis=1, keepdims=True)
    end, cosine = np.where(cosine < 0.0, -end, end), np.minimum(np.abs(cosine), 1.0)
    angle = np.arccos(cosine)
    sine = np.sin(angle)
    near = sine < 1e-6
    safe = np.where(near, 1.0, sine)
    first = np.where(near, 1.0 - share, np.sin((1.0 - share) * angle) / safe)
    second = np.where(near, share, np.sin(share * angle) / safe)
    turned = first * start + second * end
    return np.asarray(turned / np.linalg.norm(turned, axis=1, keepdims=True))


def _linkage_between(crank: Array, robot: Aerobat, dt: Array, k: Integers, share: Array) -> Array:
    """Return angle, rate and acceleration (n, 3, 2) of shoulder and elbow between the samples of the crank.

    The crank angle is the cubic through the angles and rates of both samples. Its rate and acceleration are
    interpolated linearly, because the derivatives of the cubic would amplify the noise of the angle. Row i lies in the
    interval k_i, of length dt[k_i] [s], at a share_i of it from 0 to 1.
    """
    angle, rate, acceleration = crank
    length = dt[k]
    gap, a, b = angle[k + 1] - angle[k], rate[k] * length, rate[k + 1] * length
    second, third = 3.0 * gap - 2.0 * a - b, a + b - 2.0 * gap
    value = angle[k] + share * (a + share * (second + share * third))
    slope = rate[k] + share * (rate[k + 1] - rate[k])
    bend = acceleration[k] + share * (acceleration[k + 1] - acceleration[k])
    return joint_table(robot.linkage.solve(value, slope, bend))


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
        self._fewest = self._steps = 1
        self._memory = new_state(Stream, air=self._in_air.memory, nq=robot.model.nq, nv=robot.model.nv)
        self._stream = fields_of(self._memory, Stream)
        self._stream.dt[...] = dt

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle and copy as one that is not yet reset: its memory points into that of the robot in its air."""
        return type(self), (self.robot, self._along.section, self.dt)

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
        step = along.longest_in_flap(*through_air(q, v, wind[0, 0]), crank_rate)
        self._fewest = self._steps = int(np.ceil(self.dt / step - 1e-9))
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
        self._steps = max(self._fewest, self._along.steps_now(self.dt))
        return stream.means.copy()
