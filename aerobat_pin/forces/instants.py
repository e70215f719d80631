"""Instants of a record that show, behind the observer's low-pass, what its rows are made of.

A record is looked at once: what is expected of it, its friction, and the errors of its rows follow from the same
instants.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from aerobat_pin.forces.deviations import noise_of_rows
from aerobat_pin.forces.inputs import KnownInputs
from aerobat_pin.forces.inverse_dynamics import accelerations, mean_in, required_torque
from aerobat_pin.forces.known_forces import FittedValues, mean_motion
from aerobat_pin.forces.run_observers import points_of
from aerobat_pin.forces.stored_estimate import TIME_CONSTANTS_TO_SETTLE
from aerobat_pin.numerics import Array
from aerobat_pin.observers import AllBut, MomentumObserver, low_passed, typical_step
from aerobat_pin.records import Block, Record

LOOKED_AT, WEIGHED = 2_000, 100  # intervals of a record that are looked at, and of these those that are weighed ...
CLOSELY = 5  # times as many where friction is sought
CLEAR_OF = 2  # intervals that the noise of a sample of the rates is in


@dataclass(frozen=True)
class Instants:
    """Some instants of a record, behind the observer's low-pass."""

    time: Array  # (m,) when they are [s]
    q: Array  # (m, nq) configurations
    v: Array  # (m, nv) velocities
    rows: Array  # (m, nv) generalised forces
    jacobians: Array  # (m, c, nv) of the components sought
    kept: list[int]  # the k rows that are believed
    joints: list[str]  # those that are driven, have a row that is believed, and friction that is not known
    at: list[int]  # their places among the believed rows
    sliding: Array  # (m, k) tanh(v / v_s) of the believed rows; 1 for those without friction
    columns: Array  # (4, m, k) of Coulomb and viscous friction, a rotor's inertia, each of size 1, and of the effort
    rates: Array  # (m, k) how fast the efforts change [N/s or N m/s]
    # (2, m, k) what motion and weight need, and the third of `columns`: means of half a time constant before and after,
    # whose noise is not that of the rows
    around: Array
    past: tuple[Array, Array]  # q (m, nq) and v (m, nv) a time 1/K before, which is how late the rows are
    known: Mapping[str, Array]  # (m, nv) generalised forces of each force that the map knows
    every: int  # intervals of the record from one instant to the next
    effort: Array  # (nv,) rms of the joint torques [N or N m]
    needed: Array  # (nv,) rms of what motion and weight need
    noise: Array  # (nv,) standard deviation of what changes in the rows from sample to sample [N or N m]

    @property
    def weighed(self) -> slice:
        """Those of the instants that are weighed."""
        return slice(None, None, max(1, len(self.rows) // WEIGHED))

    def without(self, b: Array) -> Instants:
        """Return the instants without b (4, n) times `columns` of the joints."""
        rows = self.rows.copy()
        rows[:, np.array(self.kept)[self.at]] -= np.einsum("bmi,bi->mi", self.columns[:, :, self.at], b)
        return replace(self, rows=rows)


def looked_at(
    record: Record,
    inputs: Callable[[int, int], KnownInputs],
    values: FittedValues,
    *,
    closely: bool = False,
    between: tuple[float, float] | None = None,
) -> Instants | None:
    """Return instants of a record, spread evenly, none of which is at a start; None if it has none.

    `inputs` gives what an observer is given from one index of the common times to another. Joints whose friction is
    known by the values are not among `joints`. `closely` looks at as many intervals as friction needs, `between` at
    times after the start [s].
    """
    most, weighed = (LOOKED_AT, WEIGHED) if not closely else (CLOSELY * LOOKED_AT, CLOSELY * WEIGHED)
    stretches = [inputs(*ends) for ends in record.spread(most, *(between or ()), least=settling_intervals(record))]
    if not stretches:
        return None
    known, law, stiction_rate = values.joints, values.friction, values.stiction(record.robot)[1]
    robot, gain, rows = record.robot, float(record.map.observer.gain), stretches[0].rows
    model = robot.model
    kept = rows.kept(model) if isinstance(rows, AllBut) else list(range(model.nv))
    driven = [joint for joint in record.driven if robot.v_index(joint) in kept]
    joints = [joint for joint in driven if law is None or joint not in known]
    every = max(sum(len(stretch.tau) for stretch in stretches) // weighed, 1)
    observer, parts = MomentumObserver(model, points_of(record.map), gain, rows), []
    moments, needed, aside, noise = list[tuple[Array, ...]](), list[Array](), list[Array](), list[Array]()
    known_forces: dict[str, list[Array]] = {name: [] for name in record.map.known}
    for stretch in stretches:
        (v, a), step = mean_motion(record, stretch.time, stretch.v), typical_step(stretch.time)
        share = -np.expm1(-gain * step)
        y = observer.run(stretch.time, stretch.q, stretch.v, stretch.tau, stretch.known).residual
        noise.append(noise_of_rows(y, record))
        sliding, coulomb = np.tanh(v / stiction_rate), np.tanh(v / (stiction_rate if law is None else law.rate))
        chosen = settled_instants(stretch.time, gain)[::every]
        table = np.stack([y, sliding, *(low_passed(values, share) for values in (-coulomb, -v, -a, stretch.tau))])
        parts.append(table[:, chosen])
        reach = max(round(0.5 / share), CLEAR_OF)  # intervals before and after, at most to the first and the last
        ends = np.maximum(chosen - reach, 0), np.minimum(chosen + reach, len(y) - 1)
        earlier, later = (np.stack([table[-1, at], table[0, at] + table[-1, at], table[-2, at]]) for at in ends)
        apart = step * np.maximum(ends[1] - ends[0], 1)[:, None]
        aside.append(np.stack([(later[0] - earlier[0]) / apart, *0.5 * (later[1:] + earlier[1:])]))
        now, then = chosen + 1, chosen + 1 - round(1.0 / (gain * step))
        moments.append((stretch.time[chosen], *(each[at] for at in (now, then) for each in (stretch.q, stretch.v))))
        for name, felt in known_forces.items():
            felt.append(low_passed(stretch.known[name], share)[chosen])
        block = Block(stretch.time, stretch.q, stretch.v, stretch.tau)
        needed.append(required_torque(record, block, accelerations(block, record), slice(None, None, every)))
    (y, sliding, *columns) = np.concatenate(parts, axis=1)
    time, q, v, *before = (np.concatenate(part) for part in zip(*moments, strict=True))
    jacobians = observer.applications.jacobian(q)
    slides = [robot.v_index(joint) for joint in driven]
    sliding[:, [row for row in range(model.nv) if row not in slides]] = 1.0
    at = [kept.index(robot.v_index(joint)) for joint in joints]
    effort, need = (column_rms(np.concatenate(part)) for part in ([each.tau for each in stretches], needed))
    x, (rates, *around) = np.stack(columns)[:, :, kept], np.concatenate(aside, axis=1)[:, :, kept]
    return Instants(
        time=time,
        q=q,
        v=v,
        rows=y,
        jacobians=jacobians,
        kept=kept,
        joints=joints,
        at=at,
        sliding=sliding[:, kept],
        columns=x,
        rates=rates,
        around=np.stack(around),
        past=(before[0], before[1]),
        known={name: np.concatenate(felt) for name, felt in known_forces.items()},
        every=every,
        effort=effort,
        needed=need,
        noise=column_rms(np.array(noise)),
    )


def slopes_of_need(model: pin.Model, instants: Instants) -> Array:
    """Return (m, nv, nv) how what weight and motion need changes with each coordinate, at weighed instants.

    In [N, N m] for each [m, rad]: derivatives of inverse dynamics (Carpentier and Mansard 2018). Of a joint at rest its
    weight alone says where its zero is; of one in motion its inertia says more.
    """
    some, data = instants.weighed, model.createData()
    q, v = (each[some] for each in instants.past)
    a = np.zeros_like(v)
    a[:, instants.kept] = -instants.around[1, some]  # whose noise is not that of the rows
    slopes = [pin.computeRNEADerivatives(model, data, *each)[0].copy() for each in zip(q, v, a, strict=True)]
    return np.reshape(slopes, (len(q), model.nv, model.nv))


def seen_wrench(record: Record, instants: Instants, name: str) -> Array:
    """Return (m, p) what a known force's sensor shows as mapped [N, N m], behind the low-pass, at weighed instants."""
    section, gain = record.map.known[name], float(record.map.observer.gain)
    tare = 0.0 if section.tare is None else mean_in(record, f"known.{name}", section.tare)
    before = np.arange(int(TIME_CONSTANTS_TO_SETTLE / gain * record.rate), -1, -1)
    weight = np.exp(-gain * record.dt * before)
    times = (time + record.dt * np.append(-before, 1) for time in instants.time[instants.weighed])
    means = np.array([weight @ record.means(f"known.{name}", each) for each in times]) / weight.sum()
    return np.asarray(means - tare)


def column_rms(values: Array) -> Array:
    """Return the root mean square (k,) of the columns of values (m, k)."""
    return np.asarray(np.sqrt(np.mean(values**2, axis=0)))


def settling_intervals(record: Record) -> int:
    """Return how many intervals a stretch needs of which a half has settled."""
    return round(2.0 * TIME_CONSTANTS_TO_SETTLE / float(record.map.observer.gain) * record.rate)


def settled_instants(time: Array, gain: float) -> NDArray[np.intp]:
    """Return which intervals of times (m + 1,) [s] begin when an observer of gain K [1/s] has settled.

    Half an interval later, so that the last digit of a stamp does not decide which is the first.
    """
    step = typical_step(time)
    return np.flatnonzero(time[:-1] - time[0] > TIME_CONSTANTS_TO_SETTLE / gain + 0.5 * step)
