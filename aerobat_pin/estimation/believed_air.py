"""Sigma_Aero along a recorded motion: what a believed air does to a believed robot, as interval means.

Samples may lie too far apart for the air's states: an interval is flown in equal steps, on the geodesic between the
samples' placements and the closed linkage at the crank's angle in between (or straight between the joint angles, where
the crank is not recorded). How long a step may be follows from the fastest mode of the lifting line, whose rate grows
with the airspeed and with the number of strips.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from aerobat_pin.aerodynamics import RobotInAir
from aerobat_pin.errors import LogError
from aerobat_pin.estimation.believed_air_kernels import advance_air_stage
from aerobat_pin.estimation.motion import Motion
from aerobat_pin.flight import robot_air
from aerobat_pin.numerics import Array, Integers
from aerobat_pin.robot import BASE_SIZE, Aerobat, joint_table, rotations
from aerobat_pin.scenario import AirSection

LONGEST_STEP = 1.5e-3  # [s]: longer ones miss a thousandth of the lift at 5 m/s and 6.7 Hz
LARGEST_MODE_STEP = 1.4  # rate of the fastest mode times a step; the method is unstable from 2.785 on
LARGEST_AIRSPEED = 100.0  # [m/s]: no wing meets faster air, but a log in millimetres does
WARM_UP_ANGLES = 60  # crank angles of a turn at which the warm-up's airspeeds are computed
WARM_UP_LIMIT = 3.0  # [s]: for a crank that hardly turns; the air remembers some ten chords of way
LONGEST_GAP = 0.5  # [s]: what the wings did in a longer one is unknown


def reconstructed_air(robot: Aerobat, air: AirSection, moved: Motion) -> dict[str, Array]:
    """Return the generalised forces of the air as interval means.

    Args:
        robot: the believed robot.
        air: the believed air. For its warm-up cycles, at the flight's median rate, the body is held as at the first
            sample and the crank turns at its first rate.
        moved: the recorded motion.

    Returns:
        `aerodynamic` and, where the air has added mass, `added_mass`: (m, nv).

    Raises:
        LogError: a gap in time is too long to be flown through, or the motion too fast to be one.
    """
    dt = np.diff(moved.time)
    if np.max(dt) > LONGEST_GAP:
        at = int(np.argmax(dt))
        raise LogError(
            f"flight log: {dt[at]:.3g} s without a sample after t = {moved.time[at]:g} s: the air's past is lost; cut "
            "the log there"
        )
    aerodynamic, added = AirAlongMotion(robot, air).fly(moved)
    made = {"aerodynamic": aerodynamic}
    if air.added_mass > 0.0:
        made["added_mass"] = added
    return made


class AirAlongMotion:
    """The air on a robot along a recorded motion.

    Args:
        robot: the believed robot.
        air: the believed air.
    """

    def __init__(self, robot: Aerobat, air: AirSection) -> None:
        """Lay the robot out in its air."""
        self.robot, self.section = robot, air
        self.in_air = RobotInAir(robot, robot_air(robot.wing, air))
        self.air = self.in_air.air
        modes = np.linalg.eigvals(self.air.line.state_space(1.0).A) if self.air.state_size else np.zeros(1)
        self.fastest = float(np.max(np.abs(modes)))  # [1/m]: rate of a mode per airspeed

    def airspeed(self, twists: Array) -> Array:
        """Return the fastest strip's (n,) [m/s] at the links' twists against the air (n, 5, 6)."""
        return np.asarray(np.max(self.air.airspeed(twists), axis=1))

    def longest_step(self, airspeed: Array) -> Array:
        """Return how long a step (n,) [s] may be, by the fastest strip's airspeed (n,) [m/s]."""
        return np.asarray(1.0 / np.maximum(1.0 / LONGEST_STEP, self.fastest * airspeed / LARGEST_MODE_STEP))

    def steps(self, moved: Motion) -> Integers:
        """Return in how many steps each interval (m,) is flown."""
        v = moved.v.copy()
        v[:, :3] -= np.einsum("nji,nj->ni", rotations(moved.q), moved.wind[:, 0])
        airspeed = self.airspeed(self.in_air.link_twists(moved.q, v))
        at = int(np.argmax(airspeed))
        if airspeed[at] > LARGEST_AIRSPEED:
            raise LogError(
                f"flight log: the wings meet air at {airspeed[at]:.0f} m/s at t = {moved.time[at]:g} s: metres, "
                "seconds and a motion that is less noisy were expected"
            )
        longest = self.longest_step(np.maximum(airspeed[1:], airspeed[:-1]))
        return np.asarray(np.maximum(np.ceil(np.diff(moved.time) / longest - 1e-9), 1), dtype=np.intp)

    def start(self, moved: Motion) -> Array:
        """Return the air's state at the first sample, warmed up."""
        cycles = self.section.warm_up_cycles
        rate = 0.0 if moved.crank is None else float(np.median(np.abs(moved.crank[1])))
        if rate == 0.0 or cycles == 0 or not self.air.state_size:
            return np.zeros(self.air.state_size)
        assert moved.crank is not None
        R = pin.Quaternion(moved.q[0, 3:7]).matrix()
        body = moved.q[0, :7], moved.v[0, :BASE_SIZE] - np.concatenate([R.T @ moved.wind[0, 0], np.zeros(3)])
        angle, turning = moved.crank[:2, 0]
        turn = joint_table(self.robot.linkage.solve(np.linspace(0.0, 2.0 * np.pi, WARM_UP_ANGLES), turning))
        duration = min(cycles * 2.0 * np.pi / rate, WARM_UP_LIMIT)
        longest = np.min(self.longest_step(self.airspeed(self.in_air.flapping_twists(*body, turn))))
        count = int(np.ceil(duration / longest))
        back = (np.arange(2 * count + 1) * 0.5 / count - 1.0) * duration
        motion = joint_table(self.robot.linkage.solve(angle + turning * back, turning))
        return self.in_air.warmed_up(*body, motion, duration / count)

    def fly(self, moved: Motion) -> tuple[Array, Array]:
        """Fly along; return the means (m, nv) of aerodynamic force and added mass over the intervals."""
        model, data, memory, fields = self.robot.model, self.in_air.data, self.in_air.memory, self.in_air.fields
        nle, steps = pin.nonLinearEffects, self.steps(moved)
        q, v, a, wind = _half_steps(moved, self.robot, steps)
        fields.start[:] = fields.state[:] = self.start(moved)
        means = np.zeros((len(steps), 2, model.nv))
        dt = np.diff(moved.time) / steps
        nle(model, data, q[0], v[0])
        half = 0
        for k, count in enumerate(steps.tolist()):
            if dt[k] > 0.0:
                for i in range(half, half + 2 * count, 2):
                    # Pinocchio's results are those of the start: the step before has ended here.
                    advance_air_stage(memory, wind[i], a[i + 1], dt[k], 0, means[k])
                    nle(model, data, q[i + 1], v[i + 1])
                    advance_air_stage(memory, wind[i + 1], a[i + 1], dt[k], 1, means[k])
                    nle(model, data, q[i + 2], v[i + 2])
                    advance_air_stage(memory, wind[i + 2], a[i + 1], dt[k], 2, means[k])
                means[k] /= count
            half += 2 * count
        return means[:, 0], means[:, 1]


def _half_steps(moved: Motion, robot: Aerobat, steps: Integers) -> tuple[Array, Array, Array, Array]:
    """Return q, v, acceleration and wind at every half step, one row more than there are half steps.

    Between two samples the body moves straight and turns evenly, velocities and wind change evenly.
    """
    k = np.append(np.repeat(np.arange(len(steps)), 2 * steps), len(steps) - 1)
    share = np.append(np.concatenate([np.arange(2 * n) / (2.0 * n) for n in steps]), 1.0)[:, None]
    dt = np.diff(moved.time)
    q = moved.q[k] + share * (moved.q[k + 1] - moved.q[k])
    q[:, 3:7] = _slerp(moved.q[k, 3:7], moved.q[k + 1, 3:7], share)
    v = moved.v[k] + share * (moved.v[k + 1] - moved.v[k])
    slope = np.divide(np.diff(moved.v, axis=0), dt[:, None], out=np.zeros_like(moved.v[1:]), where=dt[:, None] > 0.0)
    a = slope[k]
    wind = moved.wind[k] + share[:, :, None] * (moved.wind[k + 1] - moved.wind[k])
    if moved.crank is not None:
        angles = _linkage_between(moved.crank, robot, dt, k, share[:, 0])
        for row, (at_q, at_v) in enumerate(zip(robot.idx_q, robot.idx_v, strict=True)):
            q[:, at_q], v[:, at_v], a[:, at_v] = angles[:, :, row % 2].T
    return q, v, a, wind


def _slerp(start: Array, end: Array, share: Array) -> Array:
    """Turn evenly from unit quaternions start to end (n, 4), the shorter way."""
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
    """Return angle, rate and acceleration (n, 3, 2) of shoulder and elbow at shares of the intervals k.

    The crank's angle follows the cubic through both ends' angles and rates. Its rate and acceleration change evenly:
    those of the cubic make more of an angle's noise.
    """
    angle, rate, acceleration = crank
    length = dt[k]
    gap, a, b = angle[k + 1] - angle[k], rate[k] * length, rate[k + 1] * length
    second, third = 3.0 * gap - 2.0 * a - b, a + b - 2.0 * gap
    value = angle[k] + share * (a + share * (second + share * third))
    slope = rate[k] + share * (rate[k + 1] - rate[k])
    bend = acceleration[k] + share * (acceleration[k + 1] - acceleration[k])
    return joint_table(robot.linkage.solve(value, slope, bend))
