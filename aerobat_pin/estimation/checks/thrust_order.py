"""Whether thrusts at different places take each other's commands: rotors in another order than the map's.

An exchange leaves the sum of thrusts as it is and turns moments, which forces beside the base make up for, larger ones
in the wrong order. So what motion and weight need beyond all known forces is weighed as if forces explained it:

    Q = y^T A^-1 y,    A = s^2 J^T S^2 J + R,    log-likelihood = -(Q + log det A) / 2

y are rows behind the observer's low-pass, S and R what is expected without a record, and s is that of `SIZES` which
makes an order most likely. What is constant over a record says nothing of it, as a centre of mass elsewhere, or rotors
that differ a little, look alike: means are taken off.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from aerobat_pin.estimation.findings import Finding
from aerobat_pin.forces import (
    LOOKED_AT,
    WEIGHED,
    FittedValues,
    KnownForces,
    accelerations,
    column_rms,
    command_sum,
    expected_from,
    frame_wrench,
    inputs_between,
    points_of,
    required_torque,
    rows_of,
    settled_instants,
    settling_intervals,
    unit_direction,
)
from aerobat_pin.numerics import Array
from aerobat_pin.observers import AllBut, Applications, low_passed, typical_step
from aerobat_pin.records import Block, Record

LEFT_BY_ORDER = 0.5  # of Q in the map's order, up to which another order is named
SIZES = 0.5 ** np.arange(7)  # s: sizes of forces over what is expected without a record


def thrust_order_findings(record: Record, forces: KnownForces) -> Iterator[Finding]:
    """Yield that other places for the commands of thrusts leave far less of what the motion needs."""
    known = record.map.known
    names = [name for name, section in known.items() if section.powers and section.frame is not None]
    if not record.robot.free or len(names) < 2:
        return
    ends = record.spread(LOOKED_AT, least=settling_intervals(record))
    stretches = [_stretch(record, forces, names, *each) for each in ends]
    if not stretches:
        return
    y, q, needed, thrusts = (np.concatenate(each, axis=-2) for each in zip(*stretches, strict=True))
    weigh, robot = slice(None, None, max(len(y) // WEIGHED, 1)), record.robot
    rows, _ = rows_of(record.map, robot, record.joints, record.channels)
    kept = rows.kept(robot.model) if isinstance(rows, AllBut) else list(range(robot.model.nv))
    size = column_rms(needed)
    expected = expected_from(robot, rows, FittedValues(), points_of(record.map), 0.0 * size, size)
    applications = Applications(robot.model, points_of(record.map))
    B = expected.force[:, None] * applications.jacobian(q[weigh])[:, :, kept]
    A = SIZES[:, None, None, None] ** 2 * (np.swapaxes(B, 1, 2) @ B) + np.diag(expected.row_error[kept] ** 2)
    inverse, volume = np.linalg.inv(A), np.linalg.slogdet(A)[1].sum(axis=1)
    rest, by_others = (x - x.mean(axis=-2, keepdims=True) for x in (y[weigh][:, kept], thrusts[:, :, weigh][..., kept]))

    def left(order: Sequence[int]) -> Array:
        """Return Q (sizes,) where thrust i takes the commands of thrust order[i]."""
        z = rest + sum((by_others[i, i] - by_others[i, j] for i, j in enumerate(order)), np.zeros_like(rest))
        return np.asarray(np.einsum("mi,smij,mj->s", z, inverse, z, optimize=True))

    order = _likeliest(lambda order: float(np.min(left(order) + volume)), len(names))
    found, mapped = left(order), left(range(len(names)))
    s = int(np.argmin(found + volume))
    share = float(np.sqrt(found[s] / mapped[s]))
    if share**2 < LEFT_BY_ORDER:
        moved = ", ".join(f"known.{names[i]} of known.{names[j]}" for i, j in enumerate(order) if i != j)
        text = (
            f"with the commands of others the thrusts leave {100.0 * share:.0f} % of what they leave as mapped: "
            f"{moved}: the order of the rotors' columns, their frames, or a push beside the points"
        )
        yield Finding("swapped thrusts", "warning", text, share, "1")


def _likeliest(unlikely: Callable[[Sequence[int]], float], count: int) -> list[int]:
    """Return the order (count,) that no exchange of two, nor of two and another two, makes likelier."""
    pairs = [*itertools.combinations(range(count), 2)]
    twice = [both for both in itertools.combinations(pairs, 2) if not {*both[0]} & {*both[1]}]
    moves: list[tuple[tuple[int, int], ...]] = [*((pair,) for pair in pairs), *twice]
    order = list(range(count))
    least = unlikely(order)
    while True:
        others = []
        for move in moves:
            other = order.copy()
            for i, j in move:
                other[i], other[j] = order[j], order[i]
            others.append((unlikely(other), other))
        best, other = min(others)
        if best >= least:
            return order
        order, least = other, best


def _stretch(
    record: Record, forces: KnownForces, names: Sequence[str], first: int, last: int
) -> tuple[Array, Array, Array, Array]:
    """Return y (m, nv), q (m, nq), what the motion needs (m, nv), and thrusts (n, n, m, nv) by others' commands.

    Of a stretch's intervals that have settled; all but the need behind the observer's low-pass.
    """
    given, block = inputs_between(record, forces)(first, last), record.block(first, last)
    gain, known = float(record.map.observer.gain), record.map.known
    share, at = -np.expm1(-gain * typical_step(given.time)), settled_instants(given.time, gain)
    moving = Block(given.time, given.q, given.v, given.tau)
    needed = required_torque(record, moving, accelerations(moving, record))
    y = low_passed(needed - given.tau - sum(given.known.values()), share)
    commands = [command_sum(record, name, block.time) for name in names]
    thrusts = []
    for name in names:
        unit = np.zeros((len(y), 6))
        unit[:, :3] = unit_direction(known[name])
        push = frame_wrench(record, known[name], block, unit)
        terms = [*zip(forces.values.coefficients[name], known[name].powers, strict=True)]
        sizes = [sum((c * u**p for c, p in terms), 0.0 * u) for u in commands]
        thrusts.append([low_passed(push * size[:, None], share)[at] for size in sizes])
    return y[at], given.q[at + 1], needed[at], np.array(thrusts)
