"""The equations by which efforts are checked against what the motion and the weight need.

Whatever the unknown forces f are, the believed rows obey  W (rnea(q, v, a) - known) = W (S tau) + A f  with A = W J^T.
Projected on the directions that A does not reach, f disappears. In the mean over a record the forces on a robot carry
its weight, whatever they are: so factors of its legs' efforts are found where no row of the base is believed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from aerobat_pin.forces.inputs import KnownInputs
from aerobat_pin.forces.instants import column_rms
from aerobat_pin.forces.inverse_dynamics import accelerations, halfway, slope_noise
from aerobat_pin.forces.run_observers import ignored_rows, points_of
from aerobat_pin.numerics import Array
from aerobat_pin.observers import MOMENT_ARM, SMOOTH_RATE, AllBut, Applications
from aerobat_pin.records import Block, Record, torques_per_unit

INSTANTS = 400  # of the record that are looked at
COMPARED_FOR = 3.0  # [s] of the record, in stretches
FEWEST_COMPARED, SHORTEST = 240, 10  # intervals together, and of a stretch
RANK = 1e-6
FACTOR_SIZES = np.linspace(0.05, 1.0, 20)  # of g, over the largest: one is as likely as another before
BALANCE_STRETCHES = 8  # of a record, whose means show how far its momentum changes
SERIES = ("q", "halfway", "v", "a", "tau", "known")  # of a motion at its instants
Exchange = tuple[tuple[int, ...], tuple[int, ...]]  # columns of two joints, or of two limbs, that may be exchanged
InputsBetween = Callable[[int, int], KnownInputs]  # of first and last index of the common times
MotionOf = Callable[[InputsBetween], "FreeMotion | None"]  # of a record with such inputs


@dataclass(frozen=True)
class Balance:
    """The projected equations at some instants: `needed` (n,) = sum of `reach` times efforts - `base` d."""

    needed: Array  # (n,) what motion and weight need
    reach: Array  # (n, joints) what an effort of 1 N m or N of each joint gives
    base: Array  # (n,) what the mass of the base link needs
    project: Array  # (n, nv) what a generalised force gives
    at: NDArray[np.intp]  # (n,) the instant of each equation
    effort: Array  # (instants, joints) efforts [N m, N]
    v: Array  # (instants, joints) rates
    a: Array  # (instants, joints) accelerations
    span: float  # time that the instants cover [s]
    later: Callable[[float], Array]  # time [s] -> (instants, joints) what the efforts are so much later [N m, N]
    shaken: Callable[[], float]  # () -> sum of squares of what noise of the motion makes of what is needed
    unit: Array  # (joints,) what their efforts are for each unit of their columns [N m, N]

    def between(self, first: int, last: int) -> Balance:
        """Return the equations of the instants from one to before another."""
        low, high = np.searchsorted(self.at, (first, last))
        rows = {name: getattr(self, name)[low:high] for name in ("needed", "reach", "base", "project")}
        instants = {name: getattr(self, name)[first:last] for name in ("effort", "v", "a")}
        return replace(self, at=self.at[low:high] - first, **rows, **instants)

    @cached_property
    def given(self) -> Array:
        """(n, joints) what each effort gives."""
        return np.asarray(self.reach * self.effort[self.at])

    @cached_property
    def residual(self) -> Array:
        """(n,) what the efforts leave of what is needed."""
        return np.asarray(self.needed - self.given.sum(axis=1))

    @cached_property
    def size(self) -> float:
        """Sum of squares of what is needed."""
        return max(float(self.needed @ self.needed), 1e-300)

    @cached_property
    def rubbing(self) -> Array:
        """(n, 2 joints) what Coulomb and viscous friction of 1 N m, 1 N m s/rad of each joint give."""
        v = self.v[self.at]
        return np.column_stack([self.reach * np.tanh(v / SMOOTH_RATE), self.reach * v])

    @cached_property
    def common_factor(self) -> float:
        """Factor of all efforts with which they come nearest to what is needed."""
        given = self.given.sum(axis=1)
        return float(given @ self.needed) / max(float(given @ given), 1e-300)

    def of_forces(self, forces: Array) -> Array:
        """Return (n, p) what generalised forces (instants, nv, p) give."""
        return np.asarray(np.einsum("nv,nvp->np", self.project, forces[self.at]))

    def share_of(self, residual: Array) -> float:
        """Return the sum of squares of a residual (n,), over the needed one."""
        return float(residual @ residual) / self.size

    def beside_friction(self, residual: Array) -> float:
        """Return the sum of squares of a residual (n,) that friction of the joints leaves, over the needed one.

        By normal equations, damped by what `RANK` counts as nothing: least squares take several times as long.
        """
        size = np.linalg.norm(self.rubbing, axis=0)
        X = self.rubbing / np.maximum(size, max(RANK * float(size.max(initial=0.0)), 1e-300))
        along = X.T @ residual
        explained = along @ np.linalg.solve(X.T @ X + RANK**2 * len(size) * np.eye(len(size)), along)
        return max(float(residual @ residual - explained), 0.0) / self.size

    def explained_by(self, table: Array) -> Array:
        """Return how much (k,) of each column (n, k) makes up best for what the efforts leave.

        By normal equations, as `beside_friction`, and without directions that `RANK` counts as nothing.
        """
        size = np.linalg.norm(table, axis=0)
        size = np.maximum(size, max(RANK * float(size.max()), 1e-300))  # what no row feels is rounding alone
        X = table / size
        values, vectors = np.linalg.eigh(X.T @ X)
        seen = values > RANK**2 * values[-1]
        V = vectors[:, seen]
        return np.asarray(-V @ (V.T @ (X.T @ self.residual) / values[seen]) / size)

    def imbalance(self, pair: Exchange = ((), ()), signs: Array | None = None) -> float:
        """Return the sum of squares that the efforts leave, those of a pair exchanged, over the needed one."""
        residual = self.residual if signs is None else self.needed - self.given @ signs
        for j, k in [*zip(*pair, strict=True), *zip(*pair[::-1], strict=True)]:
            change = self.unit[j] / self.unit[k] * self.effort[:, k] - self.effort[:, j]
            residual = residual - self.reach[:, j] * change[self.at]
        return self.share_of(residual)

    def of_joints(self, equations: Array) -> tuple[Array, Array]:
        """Return what equations (n,) say about each effort [N m, N], and its weight, (instants, joints) both."""
        first = np.flatnonzero(np.diff(self.at, prepend=-1))
        weight = np.add.reduceat(self.reach**2, first)
        effort = np.add.reduceat(self.reach * equations[:, None], first)
        return np.divide(effort, weight, out=np.zeros_like(effort), where=weight > 0.0), weight


@dataclass(frozen=True)
class FreeMotion:
    """A free robot's motion at m instants."""

    q: Array  # (m, nq) at the start of an interval; placement of the base and joint positions [m, rad]
    halfway: Array  # (m, nq) in its middle
    v: Array  # (m, nv) mean velocities, the base's twist in its own axes [m/s, rad/s]
    a: Array  # (m, nv) their rates [m/s2, rad/s2]
    tau: Array  # (m, nv) mean efforts [N, N m]
    known: Array  # (m, nv) generalised forces that are known [N, N m]
    span: float  # time that the instants cover [s]
    later: Callable[[float], Array]  # time [s] -> (m, joints) what the efforts are so much later [N m, N]
    noise: Array  # (nv,) standard deviation of what changes in a from sample to sample [m/s2, rad/s2]

    def every(self, step: int) -> FreeMotion:
        """Return one of so many instants."""
        return replace(self, **{name: getattr(self, name)[::step] for name in SERIES})

    def joined(self, motions: Sequence[FreeMotion]) -> FreeMotion:
        """Return other motions one after the other, as if in this one's time."""
        series: dict[str, Any] = {name: np.concatenate([getattr(each, name) for each in motions]) for name in SERIES}
        return replace(self, **series)


def motion_of(record: Record, inputs: InputsBetween) -> FreeMotion | None:
    """Return a free robot's motion at instants spread over its record; None if it is too short."""
    parts, seen, noise = list[tuple[Array, ...]](), list[tuple[Array, Array, slice]](), list[Array]()
    most = max(FEWEST_COMPARED, round(COMPARED_FOR * record.rate))
    step, at = max(1, most // INSTANTS), [record.robot.v_index(joint) for joint in record.driven]
    for stretch in record.spread(most, *(record.map.use.free or ())):
        if stretch[1] - stretch[0] < SHORTEST:
            continue
        given = inputs(*stretch)
        block = Block(given.time, given.q, given.v, given.tau)
        count = len(given.tau)
        chosen = slice(count // 10, count - count // 10, step)
        v = 0.5 * (block.v[:-1] + block.v[1:])
        known = sum(given.known.values(), np.zeros_like(given.tau))
        noise.append(slope_noise(block.v, record))
        rates = (each[chosen] for each in (v, accelerations(block, record), given.tau, known))
        parts.append((block.q[:-1][chosen], halfway(record, block, chosen), *rates))
        seen.append((given.time, given.tau[:, at], chosen))
    if not parts:
        return None
    q, middle, v, a, tau, known = (np.concatenate(part) for part in zip(*parts, strict=True))

    def later(by: float) -> Array:
        return np.concatenate([later_efforts(record, time, efforts, by)[chosen] for time, efforts, chosen in seen])

    return FreeMotion(q, middle, v, a, tau, known, len(q) * step * record.dt, later, column_rms(np.array(noise)))


def later_efforts(record: Record, time: Array, efforts: Array, by: float) -> Array:
    """Return efforts (m, joints) between times (m + 1,) as they are measured a time [s] later, with their factors."""
    now, then = (record.means("joints.effort", time + shift) for shift in (0.0, by))
    return np.asarray(then * np.sum(now * efforts, axis=0) / np.maximum(np.sum(now**2, axis=0), 1e-300))


def balance_of(record: Record, motion: FreeMotion) -> Balance | None:
    """Return a free robot's equations; None if unknown forces leave no row."""
    robot, model, free = record.robot, record.robot.model, record.map.use.free
    if free is None and not (record.map.robot.points or record.map.robot.wrenches):
        return None  # a force that is not sought may be in every row
    rows = AllBut(*ignored_rows(record)).kept(model)
    arms = 3 * [1.0] + 3 * [1.0 / MOMENT_ARM]
    arms += [1.0 if robot.slides(joint) else 1.0 / MOMENT_ARM for joint in robot.joints]
    weight, at = np.array(arms)[rows], [robot.v_index(joint) for joint in record.driven]
    beyond: Sequence[Array] = len(motion.q) * [np.eye(len(rows))]
    if free is None:
        beyond = _beyond_forces(record, motion.q, rows, weight)
    if any(Q.shape[1] == 0 for Q in beyond):
        return None
    instant = np.repeat(np.arange(len(beyond)), [Q.shape[1] for Q in beyond])
    project = np.zeros((len(instant), model.nv))
    project[:, rows] = np.concatenate([Q.T * weight for Q in beyond])
    needed = _weight_and_motion(model, motion.halfway, motion) - motion.known
    alone = model.copy()  # of which only the base link has mass: its rnea is the base's share
    for k in range(2, model.njoints):
        alone.inertias[k] = pin.Inertia.Zero()
    base = _weight_and_motion(alone, motion.q, motion)
    b, heavier = (np.einsum("nv,nv->n", project, part[instant]) for part in (needed, base))
    effort, rates, bends = (part[:, at] for part in (motion.tau, motion.v, motion.a))

    @cache
    def shaken() -> float:
        data, parts = model.createData(), np.split(project, np.cumsum([Q.shape[1] for Q in beyond])[:-1])
        each = zip(parts, motion.halfway, strict=True)
        return float(sum(np.sum((part @ pin.crba(model, data, q) * motion.noise) ** 2) for part, q in each))

    unit, series = torques_per_unit(record.map.joints.effort, record.driven), (effort, rates, bends)
    return Balance(b, project[:, at], heavier, project, instant, *series, motion.span, motion.later, shaken, unit)


def _weight_and_motion(model: pin.Model, q: Array, motion: FreeMotion) -> Array:
    data = model.createData()
    return np.array([pin.rnea(model, data, *each) for each in zip(q, motion.v, motion.a, strict=True)])


def _beyond_forces(record: Record, q: Array, rows: list[int], weight: Array) -> list[Array]:
    """Return orthonormal bases (rows, k) of what the forces sought cannot reach, at each configuration (m, nq)."""
    A = Applications(record.robot.model, points_of(record.map)).jacobian(q)[:, :, rows] * weight
    reached, values, _ = np.linalg.svd(np.swapaxes(A, 1, 2), full_matrices=False)
    ranks = np.sum(values > RANK * np.maximum(values.max(axis=1, keepdims=True), 1e-300), axis=1)
    every = np.linalg.qr(reached, mode="complete").Q  # begins with what is reached, in the order of the values
    return [basis[:, rank:] for basis, rank in zip(every, ranks, strict=True)]


def factors_by_balance(
    y: Array, J: Array, G: Array, legs: list[int], efforts: Array, attitude: Array, least: Array, largest: float
) -> tuple[Array, Array]:
    """Return errors d (n,) of the factors of efforts, and their standard deviations (n,), by the weight of a robot.

    Its momentum hardly changes over a record, so in the mean all forces on it, and all moments about its base, cancel.
    With the most likely forces on the feet, f = G (y_l - X d) by the rows y_l of the legs, the base's rows y_b say

        mean(y_b - J_b^T G y_l) + A d = e,    A = mean(J_b^T G X),    d ~ N(0, g^2),    e ~ N(0, s^2)

    where X are the efforts. Six numbers show how large g is, and which efforts hold up too much or too little.

    Args:
        y: (m, nv) rows, of which the first six are the base's; friction is taken out of the others.
        J: (m, c, nv) Jacobian of the forces on the feet.
        G: (m, c, n) these forces by the rows of the legs.
        legs: the n rows of the legs.
        efforts: (m, n) behind the low-pass of the rows.
        attitude: (m, 3, 3) from the base's axes to the world's.
        least: (6,) of s.
        largest: g.
    """
    base = np.swapaxes(J[:, :, :6], 1, 2) @ G
    remainder, moved = y[:, :6] - np.einsum("mbk,mk->mb", base, y[:, legs]), base * efforts[:, None]
    table = np.concatenate([moved, remainder[..., None]], axis=2).reshape(len(y), 2, 3, -1)
    table = np.einsum("mij,mbjk->mbik", attitude, table).reshape(len(y), 6, -1)  # in the world's axes
    A, z = (part := table.mean(axis=0))[:, :-1], part[:, -1]
    means = np.stack([part[..., -1].mean(axis=0) for part in np.array_split(table, BALANCE_STRETCHES)])
    s = np.hypot(least, means.std(axis=0, ddof=1) / np.sqrt(BALANCE_STRETCHES))
    solutions = []
    for g in largest * FACTOR_SIZES:
        cov = g**2 * A @ A.T + np.diag(s**2)
        gain = g**2 * np.linalg.solve(cov, A).T
        likely = -0.5 * (np.linalg.slogdet(cov)[1] + z @ np.linalg.solve(cov, z))
        solutions.append((likely, -gain @ z, g**2 - g**2 * np.einsum("ib,bi->i", gain, A)))
    likely, d, variance = (np.stack(part) for part in zip(*solutions, strict=True))
    share = np.exp(likely - likely.max())
    share /= share.sum()
    mean = share @ d
    return mean, np.sqrt(share @ (variance + d**2) - mean**2)
