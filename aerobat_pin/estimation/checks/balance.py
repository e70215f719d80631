"""Check the efforts against what the motion and the weight need: units, signs, swapped joints, wrong masses.

Whatever the unknown forces f are, the believed rows obey  W (rnea(q, v, a) - known) = W (S tau) + A f  with A = W J^T.
Projected on the directions that A does not reach, f disappears, and the factors of the efforts (and of the base link's
mass) follow by least squares: 1 for each effort and 0 for the mass if map and robot are right.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from aerobat_pin.estimation.findings import Finding
from aerobat_pin.estimation.inputs import KnownInputs
from aerobat_pin.estimation.inverse_dynamics import accelerations, required_torque
from aerobat_pin.estimation.run_observers import believed_rows
from aerobat_pin.numerics import Array, frame_jacobian
from aerobat_pin.observers import MOMENT_ARM, AllBut
from aerobat_pin.records import Block, Record

INSTANTS = 1200  # of the record that are looked at
COMPARED_FOR = 3.0  # [s] of the record, in stretches
FEWEST_COMPARED, SHORTEST = 240, 10  # intervals together, and of a stretch
NAMED = 0.1  # deviation of a factor from 1 that is named
SURE = 4.0  # in standard deviations
EXPLAINED = 0.5  # share of the imbalance that the factors must explain before they are named
UNFIT = 0.05  # of the needed square sum left by the best factors, from which they explain nothing
CLEAR = 0.9  # share of the imbalance that is explained, from which they are named all the same
SWAP = 0.5  # of the imbalance that is left if two efforts change places
RANK = 1e-6
HARMLESS = frozenset(  # warnings that leave the motion as it is, but for some ms
    "held channel, interpolated channel, late channel, gap, repeated stamps, time goes back, recorder clock, "
    "duplicate file, accelerometer against gravity".split(", ")
)


@dataclass(frozen=True)
class Balance:
    """The projected equations at some instants: `needed` (n,) = `efforts` (n, joints) s - `base` (n,) d."""

    needed: Array
    efforts: Array  # (n, joints)
    per_joint: Array  # (n, joints, instants' joints): the column of row j for the effort of joint k
    base: Array


def effort_findings(
    record: Record, inputs: Callable[[int, int], KnownInputs], before: Sequence[Finding]
) -> Iterator[Finding]:
    """Yield factors of the efforts, a pair that is swapped, and the base's mass, as far as the rows show them.

    Args:
        record: the record.
        inputs: function of first and last index of the common times: what an observer is given there.
        before: what was found before; efforts are not compared with a motion that is misread.
    """
    if "joints.effort" not in record.channels or any(one.warns and one.check not in HARMLESS for one in before):
        return
    found = _balance(record, inputs)
    if found is None:
        free = "" if record.map.use.free else "; use.free names a stretch without contact"
        yield Finding("effort against motion", "note", f"the forces sought leave no row to check efforts by{free}")
        return
    b, B = found.needed, found.efforts
    size = float(np.sum(b * b))
    here = float(np.sum((b - B.sum(axis=1)) ** 2))
    share = here / max(size, 1e-300)
    text = (
        f"weight and motion leave {100.0 * np.sqrt(share):.1f} % of what they need unexplained by "
        "efforts and known forces"
    )
    yield Finding("effort against motion", "good" if share < 0.02 else "note", text, float(np.sqrt(share)), "1")
    pair, left = _best_swap(found)
    if pair is not None and left < SWAP * here and share > 0.005:
        names = " and ".join(record.driven[j] for j in pair)
        what = (
            f"efforts of {names} in exchanged columns leave {100.0 * np.sqrt(left / size):.1f} %, as "
            f"mapped {100.0 * np.sqrt(share):.1f} %"
        )
        yield Finding("swapped joints", "warning", what, float(np.sqrt(left / size)), "1")
        return
    yield from _factors(record, found, here)


def _factors(record: Record, found: Balance, here: float) -> Iterator[Finding]:
    """Yield factors of efforts and of the base's mass that differ from what the map says."""
    b, B = found.needed, found.efforts
    with_base = record.robot.free and bool(np.any(found.base))
    table = np.column_stack([B, -found.base]) if with_base else B
    scale = np.linalg.norm(table, axis=0)
    seen = scale > 1e-6 * max(float(scale.max(initial=0.0)), 1e-300)
    if not seen.any():
        return
    normal = table[:, seen] / scale[seen]
    solution, _, rank, _ = np.linalg.lstsq(normal, b, rcond=1e-6)
    left = b - normal @ solution
    explained = 1.0 - float(left @ left) / max(here, 1e-300)
    deviation = np.sqrt(float(left @ left) / max(len(b) - rank, 1) * np.diag(np.linalg.pinv(normal.T @ normal)))
    factors, sure = np.ones(table.shape[1]), np.full(table.shape[1], np.inf)
    factors[seen], sure[seen] = solution / scale[seen], deviation / scale[seen]
    n = len(record.driven)
    good = [k for k in range(n) if sure[k] * SURE < max(abs(factors[k] - 1.0), NAMED) and np.isfinite(sure[k])]
    off = [k for k in good if abs(factors[k] - 1.0) > NAMED]
    if explained < EXPLAINED:
        return
    if float(left @ left) > UNFIT * float(b @ b) and explained < CLEAR:
        rest = 100.0 * float(np.sqrt(left @ left / (b @ b)))
        what = (
            f"no factors of the efforts explain it ({rest:.0f} % left): friction of the joints, other axes, "
            "another order of joints, another robot"
        )
        yield Finding("effort against motion", "warning", what, rest, "%")
        return
    if with_base and seen[n] and abs(factors[n]) > 0.05 and sure[n] * SURE < abs(factors[n]):
        what = f"the record wants {1.0 + factors[n]:.2f} times the believed mass of the base link"
        yield Finding("mass", "warning", what, 1.0 + float(factors[n]), "1")
    if good and len(off) == len(good) and float(np.ptp(factors[good])) < 0.15 * abs(float(np.mean(factors[good]))):
        c = float(np.mean(factors[good]))
        what = (
            f"all efforts would have to be {c:.3g} times as large: their unit (A, N m), or all masses "
            f"{c:.3g} times too large"
        )
        yield Finding("effort unit or mass", "warning", what, c, "1")
        return
    for k in off:
        what = f"the effort of {record.driven[k]} would have to be {factors[k]:.3g} times as large"
        reason = "its sign" if factors[k] < 0.0 else "its unit (A, N m): torque_per_unit"
        if 0.0 < factors[k] < 1.0:
            reason += "; or friction, of which a joint that carries little shows nothing else: joints.friction"
        yield Finding(
            "effort sign" if factors[k] < 0.0 else "effort unit", "warning", f"{what}: {reason}", float(factors[k]), "1"
        )


def _best_swap(found: Balance) -> tuple[tuple[int, int] | None, float]:
    """Return the pair of joints whose exchanged efforts leave least, and the sum of squares that is left."""
    b, table = found.needed, found.per_joint
    left = b - np.einsum("njj->n", table)
    best: tuple[int, int] | None = None
    smallest = float(np.inf)
    for j, k in itertools.combinations(range(table.shape[1]), 2):
        rest = left + table[:, j, j] + table[:, k, k] - table[:, j, k] - table[:, k, j]
        size = float(rest @ rest)
        if size < smallest:
            best, smallest = (j, k), size
    return best, smallest


def _balance(record: Record, inputs: Callable[[int, int], KnownInputs]) -> Balance | None:
    """Return the projected equations at instants spread over the record; None if the forces sought leave no row."""
    robot, model, free = record.robot, record.robot.model, record.map.use.free
    ignored = believed_rows(record)
    rows = AllBut(*ignored).kept(model) if ignored else list(range(model.nv))
    arms = 3 * [1.0] + 3 * [1.0 / MOMENT_ARM] if robot.free else []
    arms += [1.0 if robot.slides(joint) else 1.0 / MOMENT_ARM for joint in robot.joints]
    weight, at = np.array(arms)[rows], [robot.v_index(joint) for joint in record.driven]
    unit = (np.array(rows)[:, None] == np.array(at)).astype(float)
    lighter = _heavier_base(model) if robot.free else None
    data, lighter_data = model.createData(), None if lighter is None else lighter.createData()
    needed, efforts, base = [], [], []
    most = max(FEWEST_COMPARED, round(COMPARED_FOR * record.rate))
    for stretch in record.spread(most, *(free or ())):
        if stretch[1] - stretch[0] < SHORTEST:
            continue
        given = inputs(*stretch)
        block = Block(given.time, given.q, given.v, given.tau)
        a = accelerations(block, record)
        whole = required_torque(record, block, a) - sum(given.known.values())
        count = len(given.tau)
        for k in range(count // 10, count - count // 10, max(1, most // INSTANTS)):
            Q = np.eye(len(rows)) if free is not None else _beyond_forces(record, data, block.q[k], rows, weight)
            if Q.shape[1] == 0:
                return None
            project = Q.T * weight
            needed.append(project @ whole[k, rows])
            efforts.append((project @ unit)[:, :, None] * given.tau[k, at])
            base.append(np.zeros(Q.shape[1]))
            if lighter is not None:
                v = 0.5 * (block.v[k] + block.v[k + 1])
                base[-1] = project @ pin.rnea(lighter, lighter_data, block.q[k], v, a[k])[rows]
    if not needed:
        return None
    per_joint = np.concatenate(efforts)
    return Balance(np.concatenate(needed), np.einsum("njj->nj", per_joint).copy(), per_joint, np.concatenate(base))


def _heavier_base(model: pin.Model) -> pin.Model:
    """Return a model of which only the base link has mass: its rnea is the base's share."""
    alone = model.copy()
    for k in range(2, model.njoints):
        alone.inertias[k] = pin.Inertia.Zero()
    return alone


def _beyond_forces(record: Record, data: pin.Data, q: Array, rows: list[int], weight: Array) -> Array:
    """Return an orthonormal basis (rows, k) of what the forces sought cannot reach."""
    model, chosen = record.robot.model, record.map.robot
    parts = []
    for frame, size in [(name, 3) for name in chosen.points] + [(name, 6) for name in chosen.wrenches]:
        axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        jacobian = frame_jacobian(model, data, q, model.getFrameId(frame), axes)
        parts.append((jacobian[:size, rows] * weight).T)
    A = np.concatenate(parts, axis=1)
    u, values, _ = np.linalg.svd(A)
    rank = int(np.sum(values > RANK * max(float(values.max(initial=0.0)), 1e-300)))
    return np.asarray(u[:, rank:])
