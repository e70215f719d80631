"""Known forces of a recording: thrust from commands, measured wrenches, and friction.

A polynomial's force is sum_k c_k U^p_k along a direction, with U the sum of all commands over full scale, times or over
the supply. Coefficients and friction are given, fitted (`fit_known_forces.py`), or learnt from another recording, as is
a series over the robot's phase.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import pinocchio as pin

from aerobat_pin.errors import MapError
from aerobat_pin.forces.inverse_dynamics import frame_jacobians, halfway, turned
from aerobat_pin.forces.learnt_error import LearntError
from aerobat_pin.numerics import Array, frame_id
from aerobat_pin.observers import SMOOTH_RATE, JointFriction, as_others_rub, effort_limits
from aerobat_pin.records import Block, KnownSection, PlainRobot, Record, world_turn

CALIBRATION, FRICTION = "calibration", "friction"  # names of the known forces that are learnt
BESIDE = ", beside the forces"  # ends the name of a fit that was made while unknown forces pushed
FRICTION_SHOWN = 0.9  # of errors of rows, geometric mean: where friction leaves as much or more, none is believed
LEAST_LEFT = 1e-9  # of what was there: so much counts where nothing is left
SLIDING_RATE = 2.0 * SMOOTH_RATE  # below it friction falls with the speed (Stribeck): no fitted law holds there


@dataclass(frozen=True)
class Fit:
    """A fit, and how well it holds on data that it did not use.

    Attributes:
        name: key of the map.
        values: coefficient -> value.
        unit: of the residuals.
        before: rms of what is left without the fit, on the part that was not fitted.
        inside: rms of what is left on the fitted part.
        outside: rms of what is left on the rest, of thrusts in a calm piece of it; NaN if there is none.
        log: the recording, if it is another one.
        untold: what the record does not tell, in words.
    """

    name: str
    values: dict[str, float]
    unit: str
    before: float
    inside: float
    outside: float
    log: str = ""
    untold: str = ""

    def __str__(self) -> str:
        values = ", ".join(f"{key} {value:.4g}" for key, value in self.values.items())
        outside = "no part left to test it"
        if np.isfinite(self.outside):
            outside = f"{self.outside:.3g} on the rest ({self.before:.3g} without)"
        where = f" in {self.log}" if self.log else ""
        words = f"; {self.untold}" if self.untold else ""
        return f"{self.name}: {values}; left over {self.inside:.3g} {self.unit} where fitted{where}, {outside}{words}"


@dataclass(frozen=True)
class FittedValues:
    """What a record shows about a map's known forces."""

    coefficients: dict[str, Array] = field(default_factory=dict)  # name of a thrust -> coefficients of its powers [N]
    joints: tuple[str, ...] = ()  # those whose friction is known, and whose efforts have factors
    friction: JointFriction | None = None  # of these joints; None if it is not known
    scale: Array = field(default_factory=lambda: np.ones(0))  # (n,) factor of each of their efforts
    mass: float = 1.0  # factor of all masses and inertias
    # (links, 10) changes of the dynamic parameters of the robot's links, in Pinocchio's order; empty if none
    links: Array = field(default_factory=lambda: np.zeros((0, 10)))
    # of the factors of efforts, relative, and of all errors of links over what is expected of them; empty if unknown
    gain_covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))
    fits: tuple[Fit, ...] = ()  # how well each holds
    # row -> root second moment of what all of this leaves where nothing touches, in data that no fit used [N, N m];
    # empty where that is not known
    row_noise: Mapping[str, float] = field(default_factory=dict)
    doubt: float = 1.0  # least k, where the errors of rows were found while unknown forces pushed

    def stiction(self, robot: PlainRobot) -> tuple[Array, Array]:
        """Return (nv,) friction at rest [N or N m], and the speed from which each joint slides [m/s or rad/s].

        Joints of which no friction is known rub as the others, if that of any is known.
        """
        size, rate = np.zeros(robot.model.nv), np.full(robot.model.nv, SLIDING_RATE)
        if self.friction is not None:
            known, every = ([robot.v_index(joint) for joint in joints] for joints in (self.joints, robot.joints))
            size[known], rate[known] = np.abs(self.friction.coulomb), max(self.friction.rate, SLIDING_RATE)
            size[every] = as_others_rub(size[every], np.isin(every, known), effort_limits(robot.model, every))
        return size, rate

    def joined(self, other: FittedValues) -> FittedValues:
        """Return these values of joints whose friction is known with what was found of `other` joints."""
        law, more = self.friction, other.friction
        assert law is not None
        assert more is not None
        names = "coulomb", "viscous", "inertia", "offset"
        both = {name: np.concatenate([getattr(law, name), getattr(more, name)]) for name in names}
        return replace(
            other,
            joints=(*self.joints, *other.joints),
            friction=JointFriction(**both, rate=law.rate),
            scale=np.concatenate([self.scale, other.scale]),
            row_noise={**other.row_noise, **self.row_noise},
        )


@dataclass(frozen=True)
class KnownForces:
    """The known forces of a record, ready to be evaluated block by block."""

    record: Record  # the record, whose robot already has the mass of the values
    values: FittedValues = FittedValues()  # coefficients, friction and factors of efforts
    tare: dict[str, Array] = field(default_factory=dict)  # name of a wrench -> mean (k,) that is taken off
    series: LearntError | None = None  # what a calibration found to repeat itself with the robot's phase
    # name of a known force -> where it comes from, of those that a calibration gives
    sources: Mapping[str, str] = field(default_factory=dict)

    @property
    def fits(self) -> tuple[Fit, ...]:
        """What was fitted, here or in another recording."""
        return self.values.fits

    def torque(self, block: Block) -> Array:
        """Return the joint torques (m, nv) of a block: the efforts times their factors."""
        if not len(self.values.scale):
            return block.tau
        tau = block.tau.copy()
        tau[:, self._rows] *= self.values.scale
        return tau

    def known(self, block: Block) -> dict[str, Array]:
        """Return the known generalised forces of a block but for the series: name -> (m, nv), interval means."""
        forces = dict(self.record.robot.known(block))
        forces |= {name: self.force_of(name, section, block) for name, section in self.record.map.known.items()}
        if self.values.friction is not None:
            friction = np.zeros_like(block.tau)
            motion = mean_motion(self.record, block.time, block.v[:, self._rows])
            friction[:, self._rows] = self.values.friction.torque(*motion)
            forces[FRICTION] = friction
        return forces

    @property
    def _rows(self) -> list[int]:
        return [self.record.robot.v_index(joint) for joint in self.values.joints]

    def force_of(self, name: str, section: KnownSection, block: Block) -> Array:
        """Return the generalised force (m, nv) of one of the map's known forces, interval means."""
        wrench: Array = np.zeros((len(block.tau), 6))
        if section.powers:
            commands = command_sum(self.record, name, block.time)
            terms = zip(self.values.coefficients[name], section.powers, strict=True)
            size = sum((c * commands**p for c, p in terms), 0.0 * commands)
            wrench[:, :3] = size[:, None] * unit_direction(section)
        else:
            values = section.sign * (self.record.means(f"known.{name}", block.time) - self.tare.get(name, 0.0))
            wrench[:, : values.shape[1]] = values
            if section.axes == "world":
                wrench = turned(wrench, world_turn(self.record.map))
        return frame_wrench(self.record, section, block, wrench)


def share_left(pairs: Iterable[tuple[float, float]]) -> float:
    """Return the geometric mean of what is left over what was there, of pairs; NaN if there was nothing in any."""
    shares = [after / before for after, before in pairs if before > 0.0 and np.isfinite(after)]
    return float(np.exp(np.mean(np.log(np.maximum(shares, LEAST_LEFT))))) if shares else float("nan")


def mean_motion(record: Record, time: Array, v: Array) -> tuple[Array, Array]:
    """Return mean rates and accelerations (m, n) between samples v (m + 1, n) of rates at common times (m + 1,)."""
    change = np.diff(v, axis=0)
    if record.knots is None:
        return 0.5 * (v[1:] + v[:-1]), change * record.rate
    dt = np.diff(time)[:, None]
    return 0.5 * (v[1:] + v[:-1]), np.divide(change, dt, out=np.zeros_like(change), where=dt > 0.0)


def command_sum(record: Record, name: str, time: Array) -> Array:
    """Return the sum (m,) of a thrust's commands over full scale, with its supply, means between times (m + 1,)."""
    section = record.map.known[name]
    total = np.sum(record.means(f"known.{name}", time), axis=1) / section.full_scale
    if section.supply is None:
        return np.asarray(total)
    supply = record.means(f"known.{name}.supply", time)[:, 0]
    return np.asarray(total / supply if section.supply.divide else total * supply)


def unit_direction(section: KnownSection) -> Array:
    """Return the direction (3,) of a thrust. Raises MapError if it is zero."""
    size = float(np.linalg.norm(section.direction))
    if size == 0.0:
        raise MapError("map: known: direction = [0, 0, 0]: a direction was expected")
    return np.array(section.direction) / size


def frame_wrench(record: Record, section: KnownSection, block: Block, wrench: Array) -> Array:
    """Return the generalised force (m, nv) of a wrench (m, 6) at a frame, in its axes or those of the world."""
    model = record.robot.model
    base = model.names[1] if record.robot.free else "universe"
    if section.frame is not None and not model.existFrame(section.frame):
        raise MapError(f"map: known: no frame '{section.frame}' in robot {record.robot.title}")
    frame = frame_id(model, base if section.frame is None else section.frame)
    axes = pin.ReferenceFrame.LOCAL if section.axes == "frame" else pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    if record.robot.free and model.frames[frame].parentJoint == 1 and section.axes == "frame":
        return wrench @ next(frame_jacobians(model, block.q[:1], frame, axes))  # the same at every configuration
    jacobians = frame_jacobians(model, halfway(record, block), frame, axes)
    return np.array([J.T @ w for J, w in zip(jacobians, wrench, strict=True)]).reshape(-1, model.nv)
