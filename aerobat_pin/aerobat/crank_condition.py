"""What the errors of a belief about Aerobat depend on: the crank's phase, and the state of the flight over a flap.

If only the motor's torque is known, its share in each joint is a guess that has the right power and nothing else
(`spread_crank_torque`). What a belief leaves unexplained of the joint rows is then no smooth function of the crank's
angle, but its power divided by the crank's rate is one: a torque at the crank. On `paper` with quasi-steady air six
harmonics of this torque leave the smoother R2 0.96 of Fy, those of four joint torques -0.8.

Forces of air without viscosity, steady or not, and of inertia grow with the square of all velocities at once, as the
crank prescribes the wings: e(phase, v, w, F) = F^2 e(phase, v/F, w/F, 1). So velocities count per flap, and errors over
the square of the frequency; what is learnt at one frequency then holds at another.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np

from aerobat_pin.aerobat.aerobat import Aerobat
from aerobat_pin.aerobat.motion import Motion, spread_crank_torque
from aerobat_pin.aerobat.prescribed_joints import BASE_SIZE
from aerobat_pin.errors import CalibrationError
from aerobat_pin.numerics import Array
from aerobat_pin.observers import rotations
from aerobat_pin.records import Condition

STATES = MappingProxyType(
    dict.fromkeys(("speed", "side", "climb"), "m")
    | dict.fromkeys(("roll_rate", "pitch_rate", "yaw_rate"), "rad")
    | {"frequency": "Hz"}
)
WINGS = ((0, 1, 2), (3, 4, 5), (6, 8), (7, 9))  # rows whose errors are of one size: body, shoulders, elbows
DOUBTED_FORCES = ("aerodynamic",)  # known force of which the error of a belief may be a share
LOWEST_FREQUENCY = 0.2  # [Hz]: a crank that turns less often has no phase
FREQUENCY_SCALE = 10.0  # how much less than with other states errors per squared frequency change with it
LEVER = 0.18  # [m]: airspeed over it is the body rate that changes the wings' flow as much as that speed


@dataclass(frozen=True)
class CrankCondition(Condition):
    """Phase and state of a flight; with the motor's torque alone, joint rows are reduced to one at the crank.

    `values` are velocity of the body through the air in body axes (forward, left, up) and body rates in body axes, both
    per flap, and the frequency.

    Attributes:
        pace: (m,) mean frequency over a flap [Hz].
        robot: the believed robot.
        moved: its motion; None if every joint's torque is known, or none.
    """

    pace: Array = field(kw_only=True)
    robot: Aerobat = field(kw_only=True)
    moved: Motion | None = field(kw_only=True)

    def part(self, chosen: slice) -> CrankCondition:
        """Return phase and state in some of the intervals."""
        first, last, _ = chosen.indices(len(self.phase))
        moved = None if self.moved is None else self.moved.between(first, last)
        rows = {name: getattr(self, name)[first:last] for name in ("phase", "values", "pace")}
        return replace(self, **rows, moved=moved)

    def reduced(self, force: Array) -> Array:
        """Return a generalised force (m, nv) over the squared frequency [N s2, N m s2].

        If there is a motion, its joint rows are one torque at the crank, followed by zeros.
        """
        force = force / self.pace[:, None] ** 2
        if self.moved is None or self.moved.crank is None:
            return force
        rate = 0.5 * (self.moved.crank[1, 1:] + self.moved.crank[1, :-1])
        v = 0.5 * (self.moved.v[1:] + self.moved.v[:-1])
        power = np.sum(v[:, BASE_SIZE:] * force[:, BASE_SIZE:], axis=1)
        reduced = force.copy()
        reduced[:, BASE_SIZE:] = 0.0
        reduced[:, BASE_SIZE] = np.divide(power, rate, out=np.zeros_like(power), where=rate != 0.0)
        return reduced

    def spread(self, force: Array) -> Array:
        """Return the generalised force (m, nv) of which `reduced` is given, as far as its power."""
        force = force * self.pace[:, None] ** 2
        if self.moved is None:
            return force
        spread = spread_crank_torque(self.robot, self.moved, force[:, BASE_SIZE])
        spread[:, :BASE_SIZE] = force[:, :BASE_SIZE]
        return spread


def crank_condition(moved: Motion, robot: Aerobat, kind: str) -> CrankCondition:
    """Return phase and state of a flight of which a kind of torque is known. Raises CalibrationError if it has none."""
    if moved.crank is None:
        raise CalibrationError(
            "flight log: no channel named crank_angle: a calibration follows the phase of the crank, and needs it"
        )
    angle, rate, _ = moved.crank
    frequency = float(np.median(np.abs(rate))) / (2.0 * np.pi)
    if frequency < LOWEST_FREQUENCY:
        raise CalibrationError(
            f"flight log: the crank turns at {frequency:.2g} Hz: at least {LOWEST_FREQUENCY} Hz were expected by a "
            "calibration, which follows its phase"
        )
    base = moved.v[:, :BASE_SIZE].copy()
    base[:, :3] -= np.einsum("nji,nj->ni", rotations(moved.q), moved.wind[:, 0])
    samples = np.column_stack([base, np.abs(rate) / (2.0 * np.pi)])
    values, phase = 0.5 * (samples[1:] + samples[:-1]), 0.5 * (angle[1:] + angle[:-1])
    of_turn = Condition("the crank", phase, values, STATES, np.ones(len(STATES))).means[:, -1]
    pace = np.maximum(of_turn, 0.5 * frequency)
    values[:, :BASE_SIZE] /= pace[:, None]
    speed = float(np.linalg.norm(np.mean(values[:, :3], axis=0)))
    scale = np.array([speed] * 3 + [speed / LEVER] * 3 + [FREQUENCY_SCALE * float(np.mean(values[:, -1]))])
    at_the_crank = moved if kind == "motor_only" else None
    alike = WINGS if at_the_crank is None else WINGS[:2]
    return CrankCondition(
        "the crank", phase, values, STATES, scale, alike, DOUBTED_FORCES, pace=pace, robot=robot, moved=at_the_crank
    )
