"""Known forces of a recording: thrust from commands, measured wrenches, and friction; fitted where the map asks for it.

A polynomial's force is sum_k c_k U^p_k along a direction, with U the sum of all commands over full scale, times or over
the supply. Its coefficients are fitted by least squares to the mass times the accelerometer's component along that
direction, over a share of the used record; how well the rest is met is reported.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from aerobat_pin.errors import MapError, ObserverError
from aerobat_pin.estimation.recordings.inverse_dynamics import (
    accelerations,
    contact_torque,
    mean_in,
    required_torque,
    turned,
)
from aerobat_pin.estimation.recordings.map_tables import KnownSection
from aerobat_pin.estimation.recordings.record import Block, Record, world_turn
from aerobat_pin.numerics import Array
from aerobat_pin.observers import JointFriction, fit_friction

MOST_FITTED = 200_000  # samples of a fit; a longer record is thinned


@dataclass(frozen=True)
class Fit:
    """A fit, and how well it holds on data that it did not use.

    Attributes:
        name: key of the map.
        values: coefficient -> value.
        unit: of the residuals.
        before: rms of what is left without the fit, on the part that was not fitted.
        inside: rms of what is left on the fitted part.
        outside: rms of what is left on the rest, NaN if there is none.
    """

    name: str
    values: dict[str, float]
    unit: str
    before: float
    inside: float
    outside: float

    def __str__(self) -> str:
        values = ", ".join(f"{key} {value:.4g}" for key, value in self.values.items())
        outside = "no part left to test it" if np.isnan(self.outside) else f"{self.outside:.3g} on the rest"
        return (
            f"{self.name}: {values}; left over {self.inside:.3g} {self.unit} where fitted, {outside} "
            f"({self.before:.3g} without)"
        )


@dataclass(frozen=True)
class KnownForces:
    """The known forces of a record, ready to be evaluated block by block.

    Attributes:
        record: the record.
        coefficients: name of a thrust -> coefficients [N].
        friction: of the joints that have channels; None without.
        scale: (n,) factor of each of these joints' efforts.
        tare: name of a wrench -> mean (k,) that is taken off.
        fits: what was fitted.
    """

    record: Record
    coefficients: dict[str, Array] = field(default_factory=dict)
    friction: JointFriction | None = None
    scale: Array = field(default_factory=lambda: np.ones(0))
    tare: dict[str, Array] = field(default_factory=dict)
    fits: tuple[Fit, ...] = ()

    def torque(self, block: Block) -> Array:
        """Return the joint torques (m, nv) of a block: the efforts times their factors."""
        if not len(self.scale):
            return block.tau
        tau = block.tau.copy()
        tau[:, self._rows] *= self.scale
        return tau

    def known(self, block: Block) -> dict[str, Array]:
        """Return the known generalised forces of a block: name -> (m, nv), interval means."""
        forces = {name: self._force(name, section, block) for name, section in self.record.map.known.items()}
        if self.friction is not None:
            v = 0.5 * (block.v[1:] + block.v[:-1])[:, self._rows]
            a = np.diff(block.v, axis=0)[:, self._rows] * self.record.rate
            found = np.zeros_like(block.tau)
            found[:, self._rows] = self.friction.torque(v, a)
            forces["friction"] = found
        return forces

    def thrust(self, name: str, block: Block) -> Array:
        """Return the size (m,) of a thrust [N], interval means."""
        commands = command_sum(self.record, name, block.time)
        section = self.record.map.known[name]
        return sum(
            (c * commands**p for c, p in zip(self.coefficients[name], section.powers, strict=True)), 0.0 * commands
        )

    @property
    def _rows(self) -> list[int]:
        return [self.record.robot.v_index(joint) for joint in self.record.joints]

    def _force(self, name: str, section: KnownSection, block: Block) -> Array:
        wrench: Array = np.zeros((len(block.tau), 6))
        if section.powers:
            wrench[:, :3] = self.thrust(name, block)[:, None] * unit_direction(section)
        else:
            values = section.sign * (self.record.means(f"known.{name}", block.time) - self.tare.get(name, 0.0))
            wrench[:, : values.shape[1]] = values
            if section.axes == "world":
                wrench = turned(wrench, world_turn(self.record.map))
        return frame_wrench(self.record, section, block, wrench)


def fitted_forces(record: Record) -> KnownForces:
    """Fit what the map asks for, and return all known forces.

    Raises:
        MapError: a fit lacks what it is fitted to.
    """
    coefficients: dict[str, Array] = {}
    tare: dict[str, Array] = {}
    fits: list[Fit] = []
    for name, section in record.map.known.items():
        if section.powers:
            coefficients[name] = np.array(section.coefficients, float)
            if section.fit is not None:
                coefficients[name], fit = _fit_thrust(record, name, section)
                fits.append(fit)
        elif section.tare is not None:
            tare[name] = mean_in(record, f"known.{name}", section.tare)
    forces = KnownForces(record, coefficients, tare=tare, fits=tuple(fits))
    if record.map.joints.friction is None:
        return forces
    friction, scale, found = _fit_friction(record, forces)
    return KnownForces(record, coefficients, friction, scale, tare, (*fits, *found))


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
    frame = model.getFrameId(section.frame) if section.frame is not None else _base_frame(record)
    if section.frame is not None and not model.existFrame(section.frame):
        raise MapError(f"map: known: no frame '{section.frame}' in robot {record.robot.title}")
    data, found = model.createData(), np.empty((len(wrench), model.nv))
    axes = pin.ReferenceFrame.LOCAL if section.axes == "frame" else pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    if record.robot.free and model.frames[frame].parentJoint == 1 and section.axes == "frame":
        jacobian = pin.computeFrameJacobian(model, data, block.q[0], frame, axes)  # the same at every configuration
        return np.asarray(wrench @ jacobian)
    for k, q in enumerate(block.q[:-1]):
        found[k] = pin.computeFrameJacobian(model, data, q, frame, axes).T @ wrench[k]
    return found


def _base_frame(record: Record) -> int:
    """Return the frame of the base: that of the free joint, or the universe."""
    model = record.robot.model
    return int(model.getFrameId(model.names[1])) if record.robot.free else 0


def _fit_thrust(record: Record, name: str, section: KnownSection) -> tuple[Array, Fit]:
    """Fit a thrust's polynomial to mass times accelerometer."""
    if "check.specific_force" not in record.channels:
        raise MapError(f"map: known.{name}.fit.to = check.specific_force, but check.specific_force has no columns")
    assert section.fit is not None
    direction = unit_direction(section)
    commands, targets = [], []
    for first, last in record.spread(MOST_FITTED):
        time = record.times(first, last)
        commands.append(command_sum(record, name, time))
        targets.append(record.robot.mass * record.means("check.specific_force", time) @ direction)
    u, target = np.concatenate(commands), np.concatenate(targets)
    low, high = (round(share * len(u)) for share in section.fit.part)
    inside = np.zeros(len(u), bool)
    inside[low:high] = True
    if inside.sum() < 10 * len(section.powers):
        raise MapError(f"map: known.{name}.fit.part = {list(section.fit.part)}: {inside.sum()} samples are too few")
    table = np.stack([u**p for p in section.powers], axis=1)
    found = np.linalg.lstsq(table[inside], target[inside], rcond=None)[0]
    left = target - table @ found
    rest = ~inside
    values = {f"of power {p}": float(c) for p, c in zip(section.powers, found, strict=True)}
    spread = target[rest] if rest.any() else target
    outside = _root_mean_square(left[rest]) if rest.any() else float("nan")
    return found, Fit(
        f"known.{name}",
        values,
        "N",
        _root_mean_square(spread - spread.mean()),
        _root_mean_square(left[inside]),
        outside,
    )


def _fit_friction(record: Record, forces: KnownForces) -> tuple[JointFriction, Array, tuple[Fit, ...]]:
    """Fit friction (and factors of the efforts) where the map says that no unknown force acts, or a known one."""
    section = record.map.joints.friction
    assert section is not None
    if "joints.effort" not in record.channels:
        raise MapError("map: joints.friction needs joints.effort")
    rows = [record.robot.v_index(joint) for joint in record.joints]
    held_out: list[Array] = []
    inside: list[Array] = []
    for first, last, fits_here, tests_here in _fitted_stretches(record, section.fit):
        block = record.block(first, last)
        a = accelerations(block, record)
        needed = required_torque(record, block, a) - sum(forces.known(block).values(), np.zeros_like(block.tau))
        if section.to is not None:
            needed = needed - contact_torque(record, block)
        middle = 0.5 * (block.v[1:] + block.v[:-1])
        q = 0.5 * (block.q[1:] + block.q[:-1])[:, [record.robot.q_index(joint) for joint in record.joints]]
        table = np.stack([q, middle[:, rows], a[:, rows], needed[:, rows], block.tau[:, rows]])
        when = block.time[:-1] - record.start
        chosen = (when >= section.fit[0]) & (when < section.fit[1])
        if fits_here:
            inside.append(table[:, chosen])
        if tests_here:
            held_out.append(table[:, ~chosen & _testable(record, when)])
    if not inside:
        raise MapError(f"map: joints.friction.fit = {list(section.fit)}: no used part of the record is there")
    q, v, a, needed, tau = np.concatenate(inside, axis=1)
    scale = np.ones(len(rows))
    if section.scale:
        for k in range(len(rows)):
            shape = np.column_stack([tau[:, k], -np.tanh(v[:, k] / section.slow), -v[:, k], -np.ones(len(v))])
            scale[k] = np.linalg.lstsq(shape, needed[:, k], rcond=None)[0][0]
    rotor = a if section.law.endswith("inertia") else np.zeros_like(a)
    try:
        friction = fit_friction(q, v, rotor, needed - scale * tau, section.slow)
    except ObserverError as error:
        raise MapError(f"map: joints.friction.fit = {list(section.fit)}: {error}") from error
    left = needed - scale * tau - friction.torque(v, rotor)
    _, v, a, needed, tau = np.concatenate(held_out, axis=1)
    rest = needed - scale * tau - friction.torque(v, a if section.law.endswith("inertia") else np.zeros_like(a))
    fits = []
    for k, joint in enumerate(record.joints):
        values = {name: float(getattr(friction, name)[k]) for name in ("coulomb", "viscous", "inertia", "offset")}
        if section.scale:
            values["effort times"] = float(scale[k])
        outside = _root_mean_square(rest[:, k]) if len(rest) else float("nan")
        before = _root_mean_square((needed - tau)[:, k]) if len(rest) else float("nan")
        fits.append(Fit(f"friction of {joint}", values, "N m", before, _root_mean_square(left[:, k]), outside))
    return friction, scale, tuple(fits)


def _fitted_stretches(record: Record, fit: tuple[float, float]) -> Iterator[tuple[int, int, bool, bool]]:
    """Yield (first, last) of stretches, and whether they are for the fit, and for its test; a long record is thinned.

    Args:
        record: the record.
        fit: times after the start [s] between which friction is fitted.
    """
    if sum(last - first for first, last in record.parts) <= MOST_FITTED:
        yield from ((first, last, True, True) for first, last in record.parts)
        return
    yield from ((first, last, True, False) for first, last in record.spread(MOST_FITTED, *fit))
    friction, free = record.map.joints.friction, record.map.use.free
    if friction is not None and friction.to is None and free is not None:
        yield from ((first, last, False, True) for first, last in record.spread(MOST_FITTED, *free))
    else:
        yield from ((first, last, False, True) for first, last in record.spread(MOST_FITTED))


def _testable(record: Record, when: Array) -> NDArray[np.bool_]:
    """Return which intervals, by their time (m,) after the start [s], can test friction: nothing unknown acts there."""
    friction, free = record.map.joints.friction, record.map.use.free
    if friction is not None and friction.to is not None:
        return np.ones(len(when), bool)
    return np.zeros(len(when), bool) if free is None else (when >= free[0]) & (when < free[1])


def _root_mean_square(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")
