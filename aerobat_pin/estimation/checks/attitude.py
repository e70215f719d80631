"""How the quaternion's columns must be read, and whether the accelerometer shows gravity."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import numpy as np

from aerobat_pin.estimation.checks.compare import FOLLOWS, LEAST_MOTION, comparison_of
from aerobat_pin.estimation.findings import Finding, FindingVerdict
from aerobat_pin.numerics import COMPARED_OVER, Array
from aerobat_pin.observers import rotation_matrices
from aerobat_pin.records import Agreement, G

Reading = tuple[str, str]  # order and sense, as a map says them

BETTER, FITS = 0.6, 0.7  # share of the own misfit, and of the motion, below which another reading fits
CERTAINLY_FITS = 0.05  # of the motion: what the map's reading leaves, where no other one is tried
MISREAD = 0.9  # of the motion: what a reading leaves that is certainly wrong
WORSE, WORSE_FROM = 1.5, 0.1  # of the own share of gyro or velocity: a reading that spoils one does not fit
ALIKE = 1.3  # of the smallest misfit: readings that the motion does not tell apart
SIDEWAYS = 10.0  # [deg] about 90: another axis is up
UPWARD = 0.5  # share of gravity, or mean cosine of the tilt


def turned_so_far(attitude: Array) -> Array:
    """Return the sum (m, 3) of the small turns, body axes [rad], by which an attitude (m, 4) goes on."""
    a, b = attitude[:-1], attitude[1:]
    vector = a[:, 3:] * b[:, :3] - b[:, 3:] * a[:, :3] - np.cross(a[:, :3], b[:, :3])
    scalar = np.einsum("ij,ij->i", a, b)
    sine = np.maximum(np.linalg.norm(vector, axis=1), 1e-12)
    angle = 2.0 * np.arctan2(sine, np.abs(scalar)) * np.where(scalar < 0.0, -1.0, 1.0)
    return np.concatenate([np.zeros((1, 3)), np.cumsum(vector * (angle / sine)[:, None], axis=0)])


def reading_findings(
    attitudes: Mapping[Reading, Array],
    pairs: Callable[[Array], list[Agreement]],
    specific_force: Array | None,
    weightless: bool,
) -> Iterator[Finding]:
    """Yield that another reading of the quaternion (m, 4), body to world, fits motion or gravity better than the first.

    That is the map's. `pairs` returns what must agree with an attitude: gyro and velocity, as far as they are measured.
    Without a specific force (m, 3) in body axes, the body is taken to fly upright, unless nothing is up.
    """
    mapped, *others = attitudes
    low, gain = (UPWARD, UPWARD) if specific_force is not None else (-UPWARD, 2.0 * UPWARD)
    low = -np.inf if weightless else low
    shares, misfit, upward = dict[Reading, Array](), dict[Reading, float](), dict[Reading, float]()
    for reading, turns in attitudes.items():
        made = pairs(turns)
        shares[reading] = share = _shares(made)
        misfit[reading] = float(np.linalg.norm(share)) / max(len(share), 1) ** 0.5
        upward[reading] = _upward(turns, specific_force)
        fits = len(share) > 0 and misfit[mapped] < CERTAINLY_FITS and upward[mapped] > low
        if reading == mapped:
            seem = [_other_way(pair) for pair in made]
            if fits or any(alone for _, alone in seem):
                others = []
                break
    moving, worst = len(shares[mapped]) > 0, np.maximum(WORSE * shares[mapped], WORSE_FROM)
    text = (
        f"read as {_words(mapped)}, it leaves {misfit[mapped]:.2g} of the motion and points up by {upward[mapped]:.2f}"
    )
    least = min(misfit.values())
    alike = [name for name in others if misfit[name] <= ALIKE * least and np.all(shares[name] <= worst)]
    best = max(alike, key=lambda reading: upward[reading], default=mapped)
    certain = misfit[mapped] > MISREAD if moving else specific_force is not None and upward[mapped] < 0.0
    motion_says = misfit[best] < min(BETTER * misfit[mapped], FITS)
    if motion_says or (upward[mapped] < low and upward[best] > upward[mapped] + gain):
        what = (
            f"{text}, as {_words(best)} {misfit[best]:.2g} and {upward[best]:.2f}: the columns seem to be "
            f'{_words(best)} (order = "{best[0]}", sense = "{best[1]}")' + "".join(words for words, _ in seem)
        )
        yield Finding("quaternion order", "refused" if certain else "warning", what, misfit[mapped], "1")
    elif not moving and specific_force is None:
        yield Finding("quaternion order", "note", "it is not checked: neither gyro nor accelerometer", None, "1")
    else:
        yield Finding("quaternion order", "good" if misfit[mapped] < FITS else "note", text, misfit[mapped], "1")


def _words(reading: Reading) -> str:
    return f"{', '.join(reading[0])}, {reading[1].replace('_', ' ')}"


def _shares(pairs: list[Agreement]) -> Array:
    """Return what an attitude leaves of gyro and velocity (k,), over windows and over their own size."""
    comparisons = filter(None, map(comparison_of, pairs))
    norms = [(np.linalg.norm(each.residual), float(np.linalg.norm(each.sizes[1]))) for each in comparisons]
    return np.array([residual / max(size, 1e-12) for residual, size in norms])


def _other_way(pair: Agreement) -> tuple[str, bool]:
    """Return in words which columns of the second series count the other way, and whether certainly just one does.

    No reading of a quaternion turns one axis alone, if the others follow.
    """
    comparison = comparison_of(pair)
    if comparison is None:
        return "", False
    moving = comparison.swings.max(axis=0) > LEAST_MOTION
    wrong, clear = moving & (comparison.correlation < -FOLLOWS), np.abs(comparison.correlation[moving]) > FOLLOWS
    labels = ", ".join(label for label, one in zip(pair.labels, wrong, strict=True) if one)
    words = f"; or {pair.names[1]} counts the other way {labels}" if labels else ""
    return words, bool(clear.all()) and len(clear) > 2 and int(wrong.sum()) == 1


def _upward(attitude: Array, specific_force: Array | None) -> float:
    """Return the mean share of the specific force that points up, or the mean cosine of the tilt."""
    up = rotation_matrices(attitude)[:, 2]
    if specific_force is None:
        return float(np.mean(up[:, 2]))
    size = float(np.mean(np.linalg.norm(specific_force, axis=1)))
    return float(np.mean(np.einsum("mj,mj->m", up, specific_force))) / max(size, 1e-9)


def accelerometer_findings(
    specific_force: Array, attitude: Array, position: Array, time: Array, gravity: float, weight: float
) -> Iterator[Finding]:
    """Yield how an accelerometer (m, 3), turned to the world, agrees with gravity and the pose's acceleration."""
    size = float(np.median(np.linalg.norm(specific_force, axis=1))) / gravity
    off = min(abs(np.log(size * G)), abs(np.log(size / G))) if size > 0.0 else np.inf
    if off < np.log(2.0):
        slip = "g is read as m/s2" if size < 1.0 else "m/s2 is read as g"
        text = f"its median is {size:.3g} of gravity: {slip}"
        yield Finding("accelerometer against gravity", "refused" if off < 0.1 else "warning", text, size, "1")
        return
    n = 2 * min(max(1, round(0.25 * COMPARED_OVER * (len(time) - 1) / float(time[-1] - time[0]))), len(time) // 6)
    inside = slice(n // 2, len(time) - n // 2)  # between the middles of the first and the last n steps
    speeds = [(position[k + n] - position[k]) / (time[k + n] - time[k]) for k in (0, len(time) - 1 - n)]
    world = np.einsum("nij,nj->ni", rotation_matrices(attitude[inside]), specific_force[inside]).mean(axis=0)
    world = world - (speeds[1] - speeds[0]) / (time[inside][-1] - time[inside][0])
    tilt = float(np.degrees(np.arccos(np.clip(world[2] / np.linalg.norm(world), -1.0, 1.0))))
    seeming = 2.0 * weight * np.sin(np.radians(0.5 * tilt))  # between the weight and the turned weight
    text = (
        f"turned to the world it is {np.linalg.norm(world) / gravity:.3f} of gravity and {tilt:.2f} deg off the "
        f"vertical: {f'{seeming:.3g} N' if seeming >= 1.0 else f'{1e3 * seeming:.3g} mN'} of seeming force"
    )
    if abs(tilt - 90.0) < SIDEWAYS:
        text += "; up is sideways: is the log's y axis up? z was expected, or down by log.world"
    elif tilt > 90.0:
        text += "; up is down: log.world or base.axes"
    verdict: FindingVerdict = "refused" if tilt > 90.0 else "good" if tilt < 5.0 else "warning"
    yield Finding("accelerometer against gravity", verdict, text, tilt, "deg")
