"""What an estimate does not tell of forces: whether one pushes for a moment elsewhere, and what no row to spare tests.

What no force explains leans one way while something pushes where no force is sought. Errors of a belief go with the
motion: over two tenths of a second those of sensors cancel, and so do those of feet that touch the ground in turn; what
is left is alike whenever the robot moves. A push at another place does not cancel. So the largest of such means is
compared with those that are usual in the same record. How large errors are need not be known: where that is found
beside the forces, a push passes for one. But a mean must be as large as what is stated for an instant, too: as a robot
that stood begins to move, errors are others for a moment, and smaller. A push that lasts is usual itself, and raises
what is stated beside it: there, where nothing stands out of four fifths of the record, half of that is enough, if the
mean stands out of half of it. A push at a point makes rows err, too, as by friction that grows with the load: by a
tenth of what it does to them. What carries a free robot does so all the time, so that this is usual.

Rows to spare may all belong to other components than those that are seen: what is wrong with the rows that show these
would look like a force. Of a gantry each slide alone shows a force along it; that its last joint feels none tests
nothing.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from aerobat_pin.estimation.findings import UNTESTED, WOULD_LOOK, Finding
from aerobat_pin.forces import (
    CHECKED,
    EFFORT_ERROR,
    MISFIT,
    ROWS_READ,
    Instants,
    KnownForces,
    StoredEstimate,
    believed_rows,
    checked_share,
    points_of,
    settled,
    shared_error,
    short_label,
)
from aerobat_pin.numerics import Array
from aerobat_pin.observers import Expected, MomentumObserver, row_names
from aerobat_pin.records import Record

LEANS_FOR = 0.2  # [s] over which rows are averaged
PIECES = 4  # of this time, by which it moves on
IN_MOTION = 0.25  # of the mean square speed: a robot that is slower rests, and friction hides its errors
AT_REST = 3.0  # times as far as in motion a mean must lean where the joints of its rows stop, and stick
NO_ERROR = (  # share of the time in motion that tells what is usual; times the usual, and times what is stated
    (0.8, 3.0, 1.0),
    (0.5, 10.0, 0.5),
)
FEWEST_MEANS = 40  # means in motion that tell what is usual
PART = 0.1  # of what errors make of a component: a row's that is named
COMPONENTS_NAMED = 3  # in a sentence


def elsewhere_findings(record: Record, estimate: StoredEstimate, expected: Expected | None) -> Iterator[Finding]:
    """Yield when what no force explains leans one way, farther than errors of the belief do."""
    if expected is None or estimate.redundancy.redundant < 1:
        return
    time, means, speeds = _leaning(record, estimate, expected)
    if not len(time):
        return
    moving = speeds / np.maximum(speeds.mean(axis=0), 1e-12)
    moves = settled(record, time) & (moving.mean(axis=1) > IN_MOTION)
    if moves.sum() < FEWEST_MEANS:
        return
    squares = (means - np.median(means[moves], axis=0)) ** 2
    lean = np.sqrt(squares.sum(axis=1))
    doubtful = lean / np.where(np.sum(squares * moving, axis=1) > IN_MOTION * lean**2, 1.0, AT_REST)
    worst = int(np.argmax(np.where(settled(record, time), doubtful, 0.0)))
    usual = usual_beside(float(doubtful[worst]), lean[moves], np.sqrt(estimate.redundancy.redundant))
    if usual is not None:
        times = float(lean[worst] / usual)
        text = (
            f"from {time[worst] - record.start:.2f} s on, what no force explains leans one way for {LEANS_FOR:g} s, "
            f"{times:.2g} times as far as usual: {MISFIT}"
        )
        yield Finding("push elsewhere", "warning", text, times, "1")


def usual_beside(mean: float, lean: Array, stated: float) -> float | None:
    """Return what is usual among means of rows (n,) in motion, if one stands out of it and of what is stated."""
    for share, times, size in NO_ERROR:
        usual = float(np.quantile(lean, share))
        if mean > times * usual:
            return usual if mean > size * stated else None
    return None


def _leaning(record: Record, estimate: StoredEstimate, expected: Expected) -> tuple[Array, Array, Array]:
    """Return starts (n,) [s] of means of rows over their errors, these means and squares of speeds (n, k)."""
    model, piece, done = record.robot.model, max(1, round(LEANS_FOR * record.rate / PIECES)), 0
    observer = MomentumObserver(model, points_of(record.map), float(record.map.observer.gain), believed_rows(record))
    by_load = 0.0 if record.robot.free else EFFORT_ERROR
    believed, applications, stretches = observer.believed, observer.applications, list[tuple[Array, Array, Array]]()
    for first, last in record.parts:
        pieces: list[tuple[Array, Array]] = []
        for begin in range(first, last - piece + 1, size := max(ROWS_READ // piece, 1) * piece):
            count = min(size, last - begin) // piece
            block, estimated = record.block(begin, begin + count * piece), estimate.between(done, done + count * piece)
            at, done = np.arange(count) * piece + piece // 2, done + count * piece
            v, J = block.v[at], applications.jacobian(block.q[at])
            force = estimated.components.reshape(count, piece, -1).mean(axis=1)
            carried, B = np.einsum("mcv,mc->mv", J, force), believed.of(J, v)
            square = expected.row_deviation(v) ** 2 + (by_load * carried) ** 2
            error = np.sqrt(believed.of(square, v, power=2))
            y = estimated.unexplained.reshape(count, piece, -1)[:, :, : believed.count].mean(axis=1) / error
            B /= error[:, None]
            A = B @ np.swapaxes(B, 1, 2) + np.diag(expected.force**-2.0)
            y -= np.einsum("mck,mc->mk", B, np.linalg.solve(A, np.einsum("mck,mk->mc", B, y)[..., None])[..., 0])
            pieces.append((y, believed.of(v**2, v, power=2)))
        done += (last - first) % piece
        if sum(len(y) for y, _ in pieces) >= PIECES:
            y, squares = (
                np.lib.stride_tricks.sliding_window_view(np.concatenate(part), PIECES, axis=0).mean(axis=2)
                for part in zip(*pieces, strict=True)
            )
            stretches.append((record.times(first, last)[: len(y) * piece : piece], y, squares))
    if not stretches:
        return np.zeros(0), *np.zeros((2, 0, 1))
    times, means, speeds = (np.concatenate(part) for part in zip(*stretches, strict=True))
    return times, means, speeds


def untested_findings(
    forces: KnownForces, instants: Instants | None, expected: Expected | None, estimate: StoredEstimate
) -> Iterator[Finding]:
    """Yield which of the components that are seen nothing tests, and the rows that show them.

    Where nothing touched the robot its rows were tested: nothing is said of a record with `use.free`. Nor of one with
    no row to spare at all, which `error bar` says.
    """
    answered = forces.record.map.use.free is not None or estimate.redundancy.verdict == "blind"
    if answered or expected is None or instants is None or not len(instants.rows):
        return
    some, kept = instants.weighed, instants.kept
    error = expected.row_deviation(instants.v[some])[:, None, kept]
    checked, shares = checked_share(instants.jacobians[some][..., kept], expected.force, error)
    names = np.array(list(row_names(forces.record.robot.model)))[kept]
    words = [
        f"{short_label(size.name)} (by {', '.join(names[share > PART])} alone)"
        for size, tested, share in zip(estimate.component_sizes(), checked, shares, strict=True)
        if size.seen and tested < CHECKED
    ]
    if words:
        more = f" and {len(words) - COMPONENTS_NAMED} more" * (len(words) > COMPONENTS_NAMED)
        yield Finding(UNTESTED, "note", f"nothing tests {', '.join(words[:COMPONENTS_NAMED])}{more}: {WOULD_LOOK}")
    yield from _masses(forces, instants, expected, estimate)


def _masses(forces: KnownForces, instants: Instants, expected: Expected, estimate: StoredEstimate) -> Iterator[Finding]:
    """Yield which components the masses of links may spoil by more than is stated, as no row to spare shows it."""
    spoilt = shared_error(forces.record.robot.model, instants, expected).untested
    words = [
        f"{spoilt[k]:.2g} {size.unit} of {short_label(size.name)}, where +-{size.deviation:.2g} is stated"
        for k, size in enumerate(estimate.component_sizes())
        if size.seen and size.deviation is not None and spoilt[k] > size.deviation
    ]
    if words:
        more = f" and {len(words) - COMPONENTS_NAMED} more" * (len(words) > COMPONENTS_NAMED)
        text = f"errors of a tenth would look like {', '.join(words[:COMPONENTS_NAMED])}{more}"
        yield Finding(UNTESTED, "note", f"nothing tests the masses of all links: {text}")
