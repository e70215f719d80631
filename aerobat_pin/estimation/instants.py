"""Instants of a record that show, behind the observer's low-pass, what its rows are made of."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aerobat_pin.estimation.inputs import KnownInputs
from aerobat_pin.estimation.known_forces import mean_motion
from aerobat_pin.estimation.run_observers import points_of
from aerobat_pin.estimation.stored_estimate import TIME_CONSTANTS_TO_SETTLE
from aerobat_pin.numerics import Array
from aerobat_pin.observers import AllBut, MomentumObserver, low_passed, typical_step
from aerobat_pin.records import Record

SEEN_INTERVALS, MOST_INSTANTS = 10_000, 500  # of a record that are looked at, and of these those that are weighed


@dataclass(frozen=True)
class Instants:
    """Some instants of a record, behind the observer's low-pass.

    Attributes:
        time: (m,) when they are [s].
        q: (m, nq) configurations.
        rows: (m, nv) generalised forces.
        jacobians: (m, c, nv) of the components sought.
        kept: the rows that are believed.
        joints: those that are driven, have a row that is believed, and friction that is not known.
        at: their places among the believed rows.
        sliding: (m, k) tanh(v / v_s) of the believed rows; 1 for those without friction.
        columns: (4, m, k) what Coulomb and viscous friction and a rotor's inertia of size 1, and the effort, do in each
            believed row.
        every: intervals of the record from one instant to the next.
    """

    time: Array
    q: Array
    rows: Array
    jacobians: Array
    kept: list[int]
    joints: list[str]
    at: list[int]
    sliding: Array
    columns: Array
    every: int


def looked_at(
    record: Record,
    inputs: Callable[[int, int], KnownInputs],
    stiction_rate: Array,
    *,
    known: Collection[str] = (),
    rate: float | None = None,
) -> Instants:
    """Return instants of a record, spread evenly, none of which is at a start.

    Args:
        record: the record.
        inputs: function of first and last index of the common times: what an observer is given there.
        stiction_rate: (nv,) speed from which each joint slides [m/s or rad/s].
        known: joints whose friction is among the inputs.
        rate: speed at which Coulomb friction sets in [m/s or rad/s]; that from which joints slide when omitted.
    """
    stretches = [inputs(*ends) for ends in record.spread(SEEN_INTERVALS, least=settling_intervals(record))]
    robot, gain, rows = record.robot, float(record.map.observer.gain), stretches[0].rows
    model = robot.model
    kept = rows.kept(model) if isinstance(rows, AllBut) else list(range(model.nv))
    driven = [joint for joint in record.driven if robot.v_index(joint) in kept]
    joints = [joint for joint in driven if joint not in known]
    every = max(sum(len(stretch.tau) for stretch in stretches) // MOST_INSTANTS, 1)
    observer, parts = MomentumObserver(model, points_of(record.map), gain, rows), []
    places, times = list[Array](), list[Array]()
    for stretch in stretches:
        (v, a), share = mean_motion(record, stretch.time, stretch.v), -np.expm1(-gain * typical_step(stretch.time))
        y = observer.run(stretch.time, stretch.q, stretch.v, stretch.tau, stretch.known).residual
        sliding, coulomb = np.tanh(v / stiction_rate), np.tanh(v / (stiction_rate if rate is None else rate))
        chosen = settled_instants(stretch.time, gain)[::every]
        table = np.stack([y, sliding, *(low_passed(values, share) for values in (-coulomb, -v, -a, stretch.tau))])
        parts.append(table[:, chosen])
        places.append(stretch.q[chosen + 1])
        times.append(stretch.time[chosen])
    (y, sliding, *columns), q = np.concatenate(parts, axis=1), np.concatenate(places)
    components = len(observer.applications.components)
    jacobians = np.array([observer.applications.jacobian(q_k) for q_k in q]).reshape(len(q), components, model.nv)
    slides = [robot.v_index(joint) for joint in driven]
    sliding[:, [row for row in range(model.nv) if row not in slides]] = 1.0
    at = [kept.index(robot.v_index(joint)) for joint in joints]
    time, x = np.concatenate(times), np.stack(columns)[:, :, kept]
    return Instants(time, q, y, jacobians, kept, joints, at, sliding[:, kept], x, every)


def settling_intervals(record: Record) -> int:
    """Return how many intervals a stretch needs of which a half has settled."""
    return round(2.0 * TIME_CONSTANTS_TO_SETTLE / float(record.map.observer.gain) * record.rate)


def settled_instants(time: Array, gain: float) -> NDArray[np.intp]:
    """Return which intervals of times (m + 1,) [s] begin when an observer of gain K [1/s] has settled.

    Half an interval later, so that the last digit of a stamp does not decide which is the first.
    """
    step = typical_step(time)
    return np.flatnonzero(time[:-1] - time[0] > TIME_CONSTANTS_TO_SETTLE / gain + 0.5 * step)
