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
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from aerobat_pin.aerobat.aerobat import Aerobat
from aerobat_pin.aerobat.air.robot_air import RobotAir
from aerobat_pin.aerobat.prescribed_joints import BASE_SIZE
from aerobat_pin.aerobat.wing import Wing
from aerobat_pin.aerodynamics import Gust, Tones, Wind, dryden
from aerobat_pin.errors import LogError
from aerobat_pin.numerics import Array, guarded
from aerobat_pin.observers import rotations
from aerobat_pin.records import Block
from aerobat_pin.scenario import AirSection


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
        rate = extra["crank_rate"][:, 0] if "crank_rate" in extra else _slope(angle, time)
        extra["crank"] = crank = np.stack([angle, rate, _slope(rate, time)])
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
    return np.stack([velocity, _slope(velocity, time)], axis=1), source


def _slope(values: Array, time: Array) -> Array:
    """Return the time derivative of values (m, ...); samples with the same time have the same derivative."""
    stamps, index = np.unique(time, return_inverse=True)
    first = np.searchsorted(time, stamps)
    if len(stamps) < 2:
        return np.zeros_like(values)
    return np.asarray(np.gradient(values[first], stamps, axis=0, edge_order=2 if len(stamps) > 2 else 1)[index])
