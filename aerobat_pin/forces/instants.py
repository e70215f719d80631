"""Instants of a record that show, behind the observer's low-pass, what its rows are made of.

A record is looked at once: what is expected of it, its friction, and the errors of its rows follow from the same
instants.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from aerobat_pin.forces.inputs import KnownInputs
from aerobat_pin.forces.inverse_dynamics import accelerations, mean_in, noise_of_rows, required_torque
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


def instants_of(
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
    times = CLOSELY if closely else 1
    spread = record.spread(times * LOOKED_AT, *(between or ()), least=settling_intervals(record))
    stretches = [inputs(*ends) for ends in spread]
    if not stretches:
        return None
    robot, model, rows = record.robot, record.robot.model, stretches[0].rows
    observer = MomentumObserver(model, points_of(record.map), float(record.map.observer.gain), rows)
    every = max(sum(len(stretch.tau) for stretch in stretches) // (times * WEIGHED), 1)
    pieces = [_series_of(record, stretch, observer, values, every) for stretch in stretches]
    series: dict[str, Any] = {name: np.concatenate([piece[name] for piece in pieces], axis=-2) for name in pieces[0]}
    kept = rows.kept(model) if isinstance(rows, AllBut) else list(range(model.nv))
    driven = [joint for joint in record.driven if robot.v_index(joint) in kept]
    joints = [joint for joint in driven if values.friction is None or joint not in values.joints]
    series["sliding"][:, np.setdiff1d(range(model.nv), [robot.v_index(joint) for joint in driven])] = 1.0
    past = tuple(series.pop(f"past {name}") for name in "qv")
    known = {name: series.pop(f"known {name}") for name in record.map.known}
    series |= {name: series[name][..., kept] for name in ("sliding", "columns", "rates", "around")}
    series |= {name: column_rms(series[name]) for name in ("effort", "needed", "noise")}
    series |= {"time": series["time"][:, 0], "jacobians": observer.applications.jacobian(series["q"])}
    at = [kept.index(robot.v_index(joint)) for joint in joints]
    return Instants(**series, past=past, known=known, kept=kept, joints=joints, at=at, every=every)


def _series_of(
    record: Record, stretch: KnownInputs, observer: MomentumObserver, values: FittedValues, every: int
) -> dict[str, Array]:
    """Return the series (..., instants, n) of a stretch at one of `every` intervals that have settled.

    As in `Instants`, but for all rows; efforts of all intervals, what one of so many needs, and the noise (1, n).
    """
    gain, stiction_rate = float(record.map.observer.gain), values.stiction(record.robot)[1]
    (v, a), step = mean_motion(record, stretch.time, stretch.v), typical_step(stretch.time)
    behind = partial(low_passed, share=-np.expm1(-gain * step))
    y = observer.run(stretch.time, stretch.q, stretch.v, stretch.tau, stretch.known).residual
    coulomb = np.tanh(v / (stiction_rate if values.friction is None else values.friction.rate))
    columns = np.stack([behind(column) for column in (-coulomb, -v, -a, stretch.tau)])
    _, _, rotor, effort = columns
    chosen = settled_instants(stretch.time, gain)[::every]
    reach = max(round(0.5 / -np.expm1(-gain * step)), CLEAR_OF)  # intervals, at most to the first and the last
    before, after = np.maximum(chosen - reach, 0), np.minimum(chosen + reach, len(y) - 1)
    apart = step * np.maximum(after - before, 1)[:, None]
    now, past = chosen + 1, chosen + 1 - round(1.0 / (gain * step))
    block = Block(stretch.time, stretch.q, stretch.v, stretch.tau)
    return {
        "time": stretch.time[chosen, None],
        "q": stretch.q[now],
        "v": stretch.v[now],
        "past q": stretch.q[past],
        "past v": stretch.v[past],
        "rows": y[chosen],
        "sliding": np.tanh(v / stiction_rate)[chosen],
        "columns": columns.take(chosen, axis=1),
        "rates": (effort[after] - effort[before]) / apart,
        "around": np.stack([0.5 * (series[after] + series[before]) for series in (y + effort, rotor)]),
        "effort": stretch.tau,
        "needed": required_torque(record, block, accelerations(block, record), slice(None, None, every)),
        "noise": noise_of_rows(y, record)[None],
        **{f"known {name}": behind(stretch.known[name])[chosen] for name in record.map.known},
    }


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
