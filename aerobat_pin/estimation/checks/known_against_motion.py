"""Whether a free robot's known forces are what its motion needs: their mean over the weight, and the axes they are in.

With m the base forces and moments that the motion needs, and k the known ones, about their means and forces in world
axes, a reading of the motion leaves

    E = mean over forces and moments, if any are known, of  |m - k|^2 / (|m|^2 + |k|^2),

0 if known forces are all that moves the robot, 1 if the two have nothing to do with each other, 2 if they are
opposite. What pushes at points adds to each reading. Each known wrench is read in its other axes, too. Where known
forces explain less than half as mapped, they are read with the other sign, and the motion in axes turned by quarters:
the body's alone, or the world's alike, as of a log whose z axes point down.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin

from aerobat_pin.estimation.findings import Finding, FindingVerdict
from aerobat_pin.forces import (
    CARRIES,
    LOOKED_AT,
    WEIGHED,
    Balance,
    FittedValues,
    FreeMotion,
    KnownForces,
    KnownInputs,
    accelerations,
    balance_of,
    believed_rows,
    column_rms,
    command_sum,
    expected_from,
    frame_wrench,
    inputs_between,
    motion_of,
    points_of,
    required_torque,
    settled_instants,
    settling_intervals,
    unit_direction,
)
from aerobat_pin.numerics import Array
from aerobat_pin.observers import AllBut, Applications, low_passed, rotation_matrices, typical_step
from aerobat_pin.records import Block, KnownSection, Record

UPSIDE_DOWN = 1.5  # weights of mean force upward, about 2, from which a flight's known thrust points down
FALLS = 0.25  # of the weight that motion needs at most, and of a free fall's height that is lost at least, in a fall
LEFT_BY_TURN = 1.0 / 3.0  # of E as mapped, up to which a turn is named: rotors in another order left .37 by one
TRIED_AT = 12  # instants by which the turns are tried
OTHER_AXES = "known forces against motion"
SAYS_NOTHING = 0.5  # E of forces and moments of which half are explained
QUARTER_TURNS = [
    turn
    for order in itertools.permutations(np.eye(3))
    for signs in itertools.product((1.0, -1.0), repeat=3)
    if np.linalg.det(turn := np.array(order) * signs) > 0.0
]
LEFT_BY_ORDER = 0.5  # of Q in the map's order, up to which another order is named
SIZES = 0.5 ** np.arange(7)  # s: sizes of forces over what is expected without a record


def known_findings(forces: KnownForces, motion: FreeMotion | None, estimated: Array | None) -> Iterator[Finding]:
    """Yield the mean of all unknown forces over the weight, and other axes in which known ones are what motion needs.

    For a robot with a free base that nothing else holds; a record that is too short has no motion. The forces that are
    sought, of a mean `estimated` (3,), must carry it where known forces do not; of others, what is not known counts,
    whether or not points show it.
    """
    record = forces.record
    robot, chosen = record.robot, record.map
    if motion is None or chosen.base.held or "base" in chosen.robot.rows.ignore:
        return
    if not robot.weightless:
        turns, needed = _needed(record, motion)
        mean, known = ((turns @ each[:, :3, None]).mean(axis=(0, 2)) for each in (needed, motion.known))
        fallen = float(motion.halfway[0, 2] - motion.halfway[-1, 2]) if "base.position" in record.channels else 0.0
        falls = fallen > 0.5 * FALLS * float(np.linalg.norm(robot.model.gravity.linear)) * motion.span**2
        yield _mean_force(record, estimated, mean, known, fallen if falls else 0.0)
    if motion.known[:, :6].any():
        [mapped] = _opposed(record, motion)
        other_axes = [*_in_other_axes(forces, mapped)]
        yield from other_axes or _turned(record, motion, mapped)


def _needed(record: Record, motion: FreeMotion) -> tuple[Array, Array]:
    """Return the base's axes in the world (m, 3, 3), and the generalised forces (m, nv) that a motion needs."""
    model, data = record.robot.model, record.robot.model.createData()
    each = zip(motion.halfway, motion.v, motion.a, strict=True)
    return rotation_matrices(motion.halfway[:, 3:7]), np.array([pin.rnea(model, data, *instant) for instant in each])


def _mean_force(record: Record, estimated: Array | None, needed: Array, known: Array, fallen: float) -> Finding:
    """Return the mean of all unknown forces over the weight, of means (3,) in world axes; `fallen` [m] if it falls."""
    weight = record.robot.weight
    rotors = not record.robot.joints and any(section.powers for section in record.map.known.values())
    carried = record.robot.knows_forces or rotors  # which have nothing to stand on
    carried = carried or float(np.linalg.norm(known)) > CARRIES * weight
    force = needed - known if carried or estimated is None else estimated
    mean = np.round(force / weight, 3) + 0.0  # no -0.000
    expected = 0.0 if carried else 1.0
    text = f"mean force over weight is {mean[0]:.3f}, {mean[1]:.3f}, {mean[2]:.3f} (x, y, z)"
    off = float(np.linalg.norm(mean - [0.0, 0.0, expected]))
    verdict: FindingVerdict = "good"
    if carried and float(np.linalg.norm(mean - [0.0, 0.0, 2.0])) < 2.0 - UPSIDE_DOWN:
        misread = "the attitude is misread and thrust points down, or what is known counts the other way (its sign)"
        verdict, text = "refused", f"{text}: about 2 if {misread}"
    elif off > 0.5 and expected and fallen and abs(needed[2]) < FALLS * weight:
        verdict, text = "note", f"{text}: it falls, by {fallen:.3g} m"
    elif off > 0.5:
        other = (
            'the weight was expected, or, where wheels or a deck bear it, robot.rows = {ignore = ["base"]}; buoyancy '
            "is a known force, and an orbit has robot.gravity = 0"
        )
        verdict, text = "warning", f"{text}; {other if expected else 'little was expected'}"
    return Finding("mean force", verdict, text, off, "1")


def _in_other_axes(forces: KnownForces, mapped: float) -> Iterator[Finding]:
    """Yield the other axes of a known wrench, if it then leaves far less than E as mapped."""
    record, inputs = forces.record, inputs_between(forces.record, forces)
    for name, section in record.map.known.items():
        if section.powers:
            continue
        other = section.model_copy(update={"axes": "world" if section.axes == "frame" else "frame"})

        def between(first: int, last: int, name: str = name, other: KnownSection = other) -> KnownInputs:
            given = inputs(first, last)
            block = Block(given.time, given.q, given.v, given.tau)
            return replace(given, known={**given.known, name: forces.force_of(name, other, block)})

        motion = motion_of(record, between)
        opposed = mapped if motion is None else float(_opposed(record, motion)[0])
        if opposed < LEFT_BY_TURN * mapped:
            share = float(np.sqrt(opposed / mapped))
            what = f"leaves {100.0 * share:.0f} % of what known forces leave of the motion as mapped"
            yield Finding(
                OTHER_AXES, "warning", f'known.{name} in axes = "{other.axes}" {what}: known.{name}.axes', share, "1"
            )


def _turned(record: Record, motion: FreeMotion, mapped: float) -> Iterator[Finding]:
    """Yield other axes of a motion, or another sign of known forces, if these then explain far more of it."""
    if mapped < SAYS_NOTHING:
        return
    [against] = _opposed(record, replace(motion, known=-motion.known))
    few = motion.every(-(-len(motion.v) // TRIED_AT))
    turns, worlds = np.repeat(QUARTER_TURNS, 2, axis=0), np.arange(2 * len(QUARTER_TURNS)) % 2 == 1
    best = int(np.argmin(_opposed(record, _turned_back(few, turns, worlds), len(turns))))
    turn, world = turns[best], bool(worlds[best])
    [least] = _opposed(record, _turned_back(motion, turn[None], worlds[best : best + 1]))
    if min(against, least) > LEFT_BY_TURN * mapped:
        return
    share = float(np.sqrt(min(against, least) / mapped))
    leave = f"leave {100.0 * share:.0f} % of what known forces leave of the motion as mapped"
    if against <= least:
        text = f"known forces of the other sign {leave}: known.NAME.sign"
    else:
        vector = pin.log3(turn)
        angle = float(np.linalg.norm(vector))
        axis = ", ".join(f"{x:.2g}" for x in (vector / angle).round(2) + 0.0)
        text = (
            f"axes of the body{' and the world' * world} turned by {np.degrees(angle):.0f} deg about ({axis}) {leave}: "
            "base.axes and log.world (is z down, or y up?), the axes of known forces, or something moves the robot "
            "against them"
        )
    yield Finding(OTHER_AXES, "warning", text, share, "1")


def _turned_back(motion: FreeMotion, turns: Array, worlds: Array) -> FreeMotion:
    """Return a motion of m instants n times: as if read with its body turned (n, 3, 3), and the world too (n,)."""
    attitude = rotation_matrices(motion.halfway[:, 3:7]) @ turns[:, None]
    attitude = np.where(worlds[:, None, None, None], turns.swapaxes(1, 2)[:, None] @ attitude, attitude)
    motion = motion.joined([motion] * len(turns))
    motion.halfway[:, 3:7] = [pin.Quaternion(each).coeffs() for each in attitude.reshape(-1, 3, 3)]
    for rates in (motion.v, motion.a):
        rates[:, :6] = (rates[:, :6].reshape(len(turns), -1, 2, 3) @ turns[:, None]).reshape(-1, 6)
    return motion


def turned_base(record: Record, motion: FreeMotion, share: float, most: float) -> Finding | None:
    """Return that the base's axes are turned by quarters, if the motion then leaves far less, and less than `most`.

    What is left is in squares: a `share` of what is needed as mapped. What pushes at points is taken off.
    """

    def turned(motion: FreeMotion, turns: Sequence[Array]) -> Balance | None:
        return balance_of(record, _turned_back(motion, np.array(turns), np.zeros(len(turns), bool)))

    few = motion.every(-(-len(motion.v) // TRIED_AT))
    if (tried := turned(few, QUARTER_TURNS)) is None:
        return None
    m = len(few.v)
    left_by = [tried.between(k * m, k * m + m).imbalance() for k in range(len(QUARTER_TURNS))]
    best = QUARTER_TURNS[np.argmin(left_by)]
    balance = turned(motion, [best])
    if balance is None or (after := balance.imbalance()) >= min(LEFT_BY_TURN * share, most):
        return None
    turn = best.T @ pin.rpy.rpyToMatrix(*np.radians(record.map.base.imu.turn))
    angles = ", ".join(f"{x:.0f}" for x in np.degrees(pin.rpy.matrixToRpy(turn)).round() + 0.0)
    what = (
        f"attitude and rates of a sensor with base.imu.turn = [{angles}] leave {100.0 * after**0.5:.1f} %, as mapped "
        f"{100.0 * share**0.5:.1f} %: how is it mounted, or has the body whose pose it is other axes (base.axes)?"
    )
    return Finding("axes of the base", "warning", what, after, "1")


def _opposed(record: Record, motion: FreeMotion, readings: int = 1) -> Array:
    """Return E (n,) of a motion, whose instants are those of n readings, one after the other."""
    (attitude, needed), total = _needed(record, motion), []
    for part, axes in ((slice(3), attitude), (slice(3, 6), np.eye(3)[None])):
        if not motion.known[:, part].any():
            continue
        both = (np.einsum("mij,mj->mi", axes, side[:, part]) for side in (needed, motion.known))
        sides = (side.reshape(readings, -1, 3) for side in both)
        m, k = (side - side.mean(axis=1, keepdims=True) for side in sides)
        total.append(np.sum((m - k) ** 2, axis=(1, 2)) / np.maximum(np.sum(m**2 + k**2, axis=(1, 2)), 1e-300))
    return np.asarray(np.mean(total, axis=0))


def thrust_order_findings(record: Record, forces: KnownForces) -> Iterator[Finding]:
    """Yield that other places for the commands of thrusts leave far less of what the motion needs.

    An exchange of rotors leaves the sum of thrusts as it is and turns moments, which forces beside the base make up
    for, larger ones in the wrong order. So what motion and weight need beyond all known forces is weighed as if forces
    explained it:

        Q = y^T A^-1 y,    A = s^2 J^T S^2 J + R,    log-likelihood = -(Q + log det A) / 2

    y are rows behind the observer's low-pass, S and R what is expected without a record, and s is that of `SIZES` which
    makes an order most likely. What is constant over a record says nothing of it, as a centre of mass elsewhere, or
    rotors that differ a little, look alike: means are taken off.
    """
    known = record.map.known
    names = [name for name, section in known.items() if section.powers and section.frame is not None]
    if not record.robot.free or len(names) < 2:
        return
    ends = record.spread(LOOKED_AT, least=settling_intervals(record))
    stretches = [_rows_and_thrusts(record, forces, names, *each) for each in ends]
    if not stretches:
        return
    y, q, needed, thrusts = (np.concatenate(each, axis=-2) for each in zip(*stretches, strict=True))
    weigh, robot, rows = slice(None, None, max(len(y) // WEIGHED, 1)), record.robot, believed_rows(record)
    kept = rows.kept(robot.model) if isinstance(rows, AllBut) else list(range(robot.model.nv))
    size = column_rms(needed)
    expected = expected_from(robot, rows, FittedValues(), points_of(record.map), 0.0 * size, size)
    applications = Applications(robot.model, points_of(record.map))
    B = expected.force[:, None] * applications.jacobian(q[weigh])[:, :, kept]
    A = SIZES[:, None, None, None] ** 2 * (np.swapaxes(B, 1, 2) @ B) + np.diag(expected.row_error[kept] ** 2)
    inverse, volume = np.linalg.inv(A), np.linalg.slogdet(A)[1].sum(axis=1)
    rest, by_others = (x - x.mean(axis=-2, keepdims=True) for x in (y[weigh][:, kept], thrusts[:, :, weigh][..., kept]))

    def misfit(order: Sequence[int]) -> Array:
        """Return Q (sizes,) where thrust i takes the commands of thrust order[i]."""
        z = rest + sum((by_others[i, i] - by_others[i, j] for i, j in enumerate(order)), np.zeros_like(rest))
        return np.asarray(np.einsum("mi,smij,mj->s", z, inverse, z, optimize=True))

    order = _likeliest(lambda order: float(np.min(misfit(order) + volume)), len(names))
    reordered, mapped = misfit(order), misfit(range(len(names)))
    s = int(np.argmin(reordered + volume))
    share = float(np.sqrt(reordered[s] / mapped[s]))
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


def _rows_and_thrusts(
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
