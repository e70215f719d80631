"""Complete a stretch of a flight: what was not measured follows from what was, by the closed linkage and the geometry.

| quantity | channel | if it was not measured |
|---|---|---|
| base placement | `base.position`, `base.quaternion` | (must be in the record) |
| base twist | `base.velocity`, `base.rate` | differentiated placement: weighted mean over both neighbouring intervals |
| joint angles | `joints.position` | computed from the crank angle by closing the linkage |
| joint rates | `joints.velocity` | computed from the crank's rate, or else differentiated joint angles |
| crank rate | `extra.crank_rate` | differentiated `extra.crank_angle` |
| crank acceleration | | differentiated crank rate |
| wind | `extra.wind_W` | computed from `extra.airspeed` along the body's x axis, or else the assumed wind |

What is known of the joint torques decides which forces can be estimated. The linkage prescribes the joints' motion, so
the *measured* torque contains the reaction to the unknown force. A torque *modelled* from the motion alone does not, so
the part of the force that this reaction balances cannot be estimated. *motor_only* is the torque at the crank: it
determines the power of all joints together, but not the torque of each. With *none*, only the rows of the base can be
used.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import pinocchio as pin

from aerobat_pin.aerobat.aerobat import Aerobat
from aerobat_pin.aerobat.air.robot_air import RobotAir
from aerobat_pin.aerobat.prescribed_joints import BASE_SIZE, prescribed_joint_dynamics
from aerobat_pin.aerobat.wing import Wing
from aerobat_pin.aerodynamics import Gust, Tones, Wind, dryden
from aerobat_pin.errors import LogError
from aerobat_pin.numerics import Array, guarded
from aerobat_pin.observers import Rows, rotations
from aerobat_pin.records import Block
from aerobat_pin.scenario import AirSection

Torque = Literal["measured", "modelled", "motor_only", "none"]
ROWS_OF_TORQUE: dict[str, Rows] = {"measured": "all", "modelled": "all", "motor_only": "base+power", "none": "base"}
RECORDED = "known."  # prefix of known forces among a block's extra channels


@guarded()
def robot_air(wing: Wing, air: AirSection) -> RobotAir:
    """Return the aerodynamic model of a wing with a scenario's air settings. Raises the same errors as `RobotAir`."""
    return RobotAir(
        wing,
        strips=air.strips,
        air_density=air.density,
        model=air.model,
        lift_limit=air.lift_limit,
        added_mass=air.added_mass,
    )


@guarded()
def wind_of(air: AirSection) -> Wind:
    """Return a scenario's wind, with its gust, its turbulence and its waves."""
    gust, blown = air.gust, air.turbulence
    tones = [] if blown is None else [dryden(blown.deviation, blown.length, blown.airspeed, blown.seed)]
    for wave in air.wave:
        rate, phase = 2.0 * np.pi * wave.frequency, np.radians(wave.phase_deg)
        tones.append(Tones(np.array([wave.amplitude]), np.full((1, 3), rate), np.full((1, 3), phase)))
    given = None if gust is None else Gust(gust.amplitude, gust.start, gust.duration)
    return Wind(air.wind, given, tuple(tones))


@dataclass(frozen=True)
class Motion:
    """The motion of a flight at its samples.

    Attributes:
        time: (m + 1,) times of the samples [s].
        q: (m + 1, nq) configurations.
        v: (m + 1, nv) velocities.
        crank: (3, m + 1) angle, rate and acceleration of the crank [rad, rad/s, rad/s2]; None if it is not recorded.
        wind: (m + 1, 2, 3) velocity of the air and its time derivative, world axes [m/s, m/s2].
        bend: (2, m + 1, 4) angle and rate by which joints depart from the linkage [rad, rad/s]; None if they follow it.
    """

    time: Array
    q: Array
    v: Array
    crank: Array | None
    wind: Array
    bend: Array | None = None

    @classmethod
    def of(cls, block: Block) -> Motion:
        """Return the motion of a block that `completed` returned."""
        crank, bend = (block.extra.get(name) for name in ("crank", "bend"))
        return cls(block.time, block.q, block.v, crank, block.extra["wind"], bend)

    def between(self, first: int, last: int) -> Motion:
        """Return the motion from one sample to another, inclusive."""
        at = slice(first, last + 1)
        crank, bend = (None if part is None else part[:, at] for part in (self.crank, self.bend))
        return Motion(self.time[at], self.q[at], self.v[at], crank, self.wind[at], bend)


def completed(block: Block, robot: Aerobat, air: AirSection) -> Block:
    """Return a block with all joints, and among its extra channels `crank` and `wind` as in `Motion`.

    Args:
        block: a stretch of a flight, as it was measured.
        robot: the assumed robot; its linkage supplies joint angles that were not measured.
        air: the assumed air; it supplies the wind if that was not measured.

    Raises:
        LogError: neither the joint angles nor the crank angle are recorded.
        LinkageError: the assumed linkage cannot close at a recorded crank angle.
    """
    time, q, v, extra, source = block.time, block.q, block.v, dict(block.extra), dict(block.source)
    crank = None
    if "crank_angle" in extra:
        angle = extra["crank_angle"][:, 0]
        rate = extra["crank_rate"][:, 0] if "crank_rate" in extra else time_slope(angle, time)
        extra["crank"] = crank = np.stack([angle, rate, time_slope(rate, time)])
    if "joints.position" not in block.measured:
        if crank is None:
            raise LogError("flight log: neither joints nor crank_angle are recorded: the wings' motion is unknown")
        closure = robot.linkage.solve(crank[0])
        q, source["q"] = robot.configuration(q[:, :7], closure.theta_s, closure.theta_e), "reconstructed"
    if "joints.velocity" not in block.measured and crank is not None:
        closure = robot.linkage.solve(crank[0], crank[1])
        v = robot.velocity(v[:, :BASE_SIZE], closure.theta_s_dot, closure.theta_e_dot)
        source["v"] = "reconstructed"
    extra["wind"], source["wind"] = _wind(time, q, v, extra, air)
    known = {name.removeprefix("known."): "measured" for name in extra if name.startswith("known.")}
    return replace(block, q=q, v=v, extra=extra, source={**source, **known})


def _wind(time: Array, q: Array, v: Array, extra: dict[str, Array], air: AirSection) -> tuple[Array, str]:
    if "wind_W" in extra:
        velocity, source = extra["wind_W"], "measured"
    elif any(air.wind) or air != air.steady or "airspeed" not in extra:
        return wind_of(air).field(time), "believed"
    else:
        along = v[:, 0] - extra["airspeed"][:, 0]
        velocity, source = along[:, None] * rotations(q)[:, :, 0], "reconstructed"
    return np.stack([velocity, time_slope(velocity, time)], axis=1), source


def time_slope(values: Array, time: Array, edge_order: Literal[1, 2] = 2) -> Array:
    """Return the time derivative of values (m, ...); samples with the same time have the same derivative."""
    stamps, index = np.unique(time, return_inverse=True)
    first = np.searchsorted(time, stamps)
    if len(stamps) < 2:
        return np.zeros_like(values)
    order = edge_order if len(stamps) > 2 else 1
    return np.asarray(np.gradient(values[first], stamps, axis=0, edge_order=order)[index])


def crank_halfway(moved: Motion) -> Array:
    """Return angle, rate and acceleration (3, m) of the crank in the middle of each interval."""
    if moved.crank is None:
        raise LogError("flight log: no channel named crank_angle: a torque at the crank, or from its motion, needs it")
    return np.asarray(0.5 * (moved.crank[:, 1:] + moved.crank[:, :-1]))


def modelled_torque(robot: Aerobat, moved: Motion, force: Array) -> Array:
    """Return the motor torque (m, nv) that the prescribed joint motion needs if no unknown force acts.

    `force` (m, nv) is the sum of the known generalised forces. Raises LogError if the crank is not recorded.
    """
    model, data = robot.model, robot.model.createData()
    closure = robot.linkage.solve(*crank_halfway(moved))
    still = np.zeros((len(force), BASE_SIZE))
    joints = robot.velocity(still, closure.theta_s_ddot, closure.theta_e_ddot)[:, BASE_SIZE:]
    torque = np.zeros_like(force)
    q, v = moved.q, moved.v
    for k in range(len(force)):
        halfway = pin.interpolate(model, q[k], q[k + 1], 0.5)
        nle = pin.nonLinearEffects(model, data, halfway, 0.5 * (v[k] + v[k + 1]))
        torque[k] = prescribed_joint_dynamics(pin.crba(model, data, halfway), nle, force[k], joints[k])[1]
    return torque


def spread_crank_torque(robot: Aerobat, moved: Motion, torque: Array) -> Array:
    """Return the generalised force (m, nv) that has the power of a torque (m,) at the crank [N m], interval means.

    Each wing receives half of the torque. Raises LogError if the crank is not recorded.
    """
    shoulder, elbow = robot.linkage.solve(crank_halfway(moved)[0]).joint_torques(0.5 * torque)
    return robot.velocity(np.zeros((len(torque), BASE_SIZE)), shoulder, elbow)
