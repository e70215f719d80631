"""Two series that must agree: how the second follows the first, which column is off, by how much, and by which slip.

And what agrees with an attitude: how the quaternion's columns must be read, and whether the accelerometer is upright.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

import numpy as np

from aerobat_pin.estimation.findings import LOST_SAMPLES, Finding, FindingVerdict
from aerobat_pin.numerics import COMPARED_OVER, Array, CrossCorrelation, compare_rates, compare_series, lost_samples
from aerobat_pin.observers import rotation_matrices
from aerobat_pin.records import Agreement, G, Map, QuaternionSection, Record, as_attitude, sampled_turns

FOLLOWS = 0.8  # correlation from which one series is taken to follow the other
CONFUSED = 0.5  # correlation below which one does not follow the other
FACTOR_OFF = 0.1  # deviation of a factor from 1 that counts, if the factor explains most of the difference
LOST_SHARE = 5e-3  # share of samples that are missing under even stamps, from which it is said
LEAST_MOTION = 5e-4  # [rad, m] in a window: a column that moves less shows no factor
SEEN_MOTION = 2e-3  # [rad, m] in a window: series that move less are not said to differ in kind
UNIT_FACTORS = {  # second per first -> the slip that makes it
    57.2958: "degrees are read as radians",
    1.0 / 57.2958: "degrees of the position or pose are read as radians",
    1000.0: "thousandths are read as units",
    1e-3: "thousandths of the position (mm) are read as units",
    100.0: "hundredths are read as units",
    0.01: "hundredths of the position (cm) are read as units",
    9.5493: "revolutions a minute are read as rad/s",
}
Reading = tuple[str, str]  # order and sense of a quaternion, as a map says them, or names of three angles and sense
OTHER_ANGLES = (  # what an attitude's columns may be -> which are roll, pitch and yaw, with which signs
    ("yaw, pitch, roll", [2, 1, 0], [1.0, 1.0, 1.0]),
    ("-roll, pitch, yaw", [0, 1, 2], [-1.0, 1.0, 1.0]),
    ("roll, -pitch, yaw", [0, 1, 2], [1.0, -1.0, 1.0]),
    ("roll, pitch, -yaw", [0, 1, 2], [1.0, 1.0, -1.0]),
    ("roll, -pitch, -yaw", [0, 1, 2], [1.0, -1.0, -1.0]),
)
BETTER, FITS = 0.6, 0.7  # share of the own misfit, and of the motion, below which another reading fits
CERTAINLY_FITS = 0.05  # of the motion: what the map's reading leaves, where no other one is tried
MISREAD = 0.9  # of the motion: what a reading leaves that is certainly wrong
WORSE, WORSE_FROM = 1.5, 0.1  # of the own share of gyro or velocity: a reading that spoils one does not fit
ALIKE = 1.3  # of the smallest misfit: readings that the motion does not tell apart
SIDEWAYS = 10.0  # [deg] about 90: another axis is up
UPWARD = 0.5  # share of gravity, or mean cosine of the tilt


def slip_of(factor: float, correlation: float) -> str:
    """Return the slip of unit or sign that explains a least-squares factor, which noise dilutes; or nothing."""
    if correlation < FOLLOWS:
        return "its sign is wrong" if correlation < -FOLLOWS else ""
    low, high = 0.94 * factor, 1.06 * factor / correlation**2
    return next((slip for known, slip in UNIT_FACTORS.items() if low < known < high), "")


def agreement_findings(pair: Agreement) -> Iterator[Finding]:
    """Yield lost samples; or a delay between the two series, exchanged columns, and those off; or that they agree."""
    comparison = comparison_of(pair)
    if comparison is None:
        return
    if pair.kind == "rates" and (missing := lost_samples(pair.first, pair.second, pair.time)) > LOST_SHARE:
        moves = f"{pair.names[0]} move{'s' if pair.names[0][-1] != 's' else ''} on as if {100.0 * missing:.2g} %"
        text = f"{moves} of the samples were lost under stamps that do not show it: write when each was taken"
        yield Finding(LOST_SAMPLES, "warning", text, missing, "1")
        return
    yield from _late(pair, comparison)
    swapped = exchanged(comparison) if pair.apart else []
    for j, k in swapped:
        names = " and ".join(pair.labels[i].removeprefix("at ") for i in (j, k))
        text = f"{pair.names[1]} of {names} fit {pair.names[0]} the other way round"
        yield Finding("swapped joints", "warning", text)
    skip = {column for columns in swapped for column in columns}
    limit = np.maximum(pair.floor, pair.share * comparison.sizes[0])
    factor = np.array([comparison.follows(column)[0] for column in range(len(limit))])  # as it is told
    likely = np.abs([comparison.follows(column)[1] for column in range(len(limit))]) > CONFUSED  # or it is noise
    explained = likely & (np.abs(factor - 1.0) > FACTOR_OFF) & (comparison.scaled < 0.5 * comparison.unlike)
    wrong = (comparison.residual > limit) | (explained & (comparison.swings.max(axis=0) > LEAST_MOTION))
    slips: dict[str, list[int]] = {}
    for column in np.flatnonzero(wrong).tolist():
        if column not in skip:
            slips.setdefault(slip_of(*comparison.follows(column)), []).append(column)
    moving = int(np.sum(comparison.swings.max(axis=0) > LEAST_MOTION))
    for slip, columns in slips.items():
        certain = bool(slip) and (pair.apart or len(columns) >= max(moving, 1))
        text = _sentence(pair, comparison, limit, columns, slip)
        yield Finding(pair.check, "refused" if certain else "warning", text, float(factor[columns[0]]), "1")
    if not slips and pair.kind == "rates":
        yield _whole_channel(pair, comparison)


def comparison_of(pair: Agreement) -> CrossCorrelation | None:
    """Return how the two series compare; None if they are too short."""
    return (compare_rates if pair.kind == "rates" else compare_series)(pair.first, pair.second, pair.time)


def exchanged(comparison: CrossCorrelation) -> list[tuple[int, int]]:
    """Return pairs of columns that fit each other's far better than their own."""
    match = comparison.match
    return [
        (j, k)
        for j, k in itertools.combinations(range(len(match)), 2)
        if min(match[j, k], match[k, j]) > FOLLOWS
        and max(match[j, j], match[k, k]) < min(match[j, k], match[k, j]) - 0.1
    ]


def _late(pair: Agreement, comparison: CrossCorrelation) -> Iterator[Finding]:
    """Yield that one series is late, if a half of the record alone says so, too, and none the other way.

    A short or slow motion follows from itself at another time about as well.
    """
    if comparison.certain and abs(comparison.lag) > pair.latest:
        half = len(pair.time) // 2
        halves = (
            replace(pair, time=pair.time[part], first=pair.first[part], second=pair.second[part])
            for part in (slice(half), slice(half, None))
        )
        alone = [each.lag for each in map(comparison_of, halves) if each is not None and each.certain]
        if not alone or any(lag * np.sign(comparison.lag) <= pair.latest for lag in alone):
            return
        early, late = pair.names if comparison.lag > 0.0 else pair.names[::-1]
        text = (
            f"{late} come{'s' if late[-1] != 's' else ''} {1e3 * abs(comparison.lag):.1f} ms after {early}, "
            f"{1e3 * pair.latest:g} ms are allowed; shift one of them (in a map: delay = {abs(comparison.lag):.4f})"
        )
        yield Finding("late channel", "warning", text, comparison.lag, "s")


def _sentence(pair: Agreement, comparison: CrossCorrelation, limit: Array, columns: list[int], slip: str) -> str:
    """Return what is wrong with columns that have the same slip: the figures of the worst of them."""
    worst = max(columns, key=lambda column: float(comparison.residual[column] / limit[column]))
    others = [pair.labels[column] for column in columns if column != worst]
    place = pair.labels[worst] + (f" (and {', '.join(others)})" if others else "")
    residual, allowed = float(comparison.residual[worst]), float(limit[worst])
    if pair.kind == "values":
        return f"{place} is {residual:.2f} {pair.unit} (rms) off, {allowed:.2f} are allowed; {pair.expected}"
    if residual < allowed:
        allowed = FACTOR_OFF * float(comparison.sizes[0, worst])
    follows = _follows(pair, *comparison.follows(worst))
    return (
        f"in {COMPARED_OVER:g} s they differ by {residual:.3g} {pair.unit} (rms) {place}, {allowed:.2g} are allowed; "
        f"{follows}{f': {slip}' if slip else ''}; {pair.expected}"
    )


def _follows(pair: Agreement, factor: float, correlation: float) -> str:
    first, second = pair.names
    verb = "are" if second[-1] == "s" else "is"
    return f"{second} {verb} {factor:.3g} times what follows from {first}, correlation {correlation:.2f}"


def _whole_channel(pair: Agreement, comparison: CrossCorrelation) -> Finding:
    """Return what all columns together say of two series of which no column is off."""
    first, second = (float(np.linalg.norm(swing)) for swing in comparison.swings)
    if (min(first, second) if second > 0.0 else first) < SEEN_MOTION:  # a sensor that shows nothing at all is seen
        return Finding(pair.check, "note", "hardly any motion to compare")
    cross = float(np.sum(comparison.correlation * comparison.swings[0] * comparison.swings[1]))
    factor, correlation = cross / max(first**2, 1e-300), cross / max(first * second, 1e-300)
    text = _follows(pair, factor, correlation)
    if abs(correlation) < CONFUSED:
        why = "does not follow it (other axes, columns in another order, another clock)"
        return Finding(pair.check, "warning", f"{text}: {why}", factor, "1")
    good = correlation > FOLLOWS and abs(factor - 1.0) < FACTOR_OFF
    return Finding(pair.check, "good" if good else "note", text, factor, "1")


def turned_so_far(attitude: Array) -> Array:
    """Return the sum (m, 3) of the small turns, body axes [rad], by which an attitude (m, 4) goes on."""
    a, b = attitude[:-1], attitude[1:]
    vector = a[:, 3:] * b[:, :3] - b[:, 3:] * a[:, :3] - np.cross(a[:, :3], b[:, :3])
    scalar = np.einsum("ij,ij->i", a, b)
    sine = np.maximum(np.linalg.norm(vector, axis=1), 1e-12)
    angle = 2.0 * np.arctan2(sine, np.abs(scalar)) * np.where(scalar < 0.0, -1.0, 1.0)
    return np.concatenate([np.zeros((1, 3)), np.cumsum(vector * (angle / sine)[:, None], axis=0)])


def read_attitudes(record: Record, time: Array, raw: Array) -> dict[Reading, Array]:
    """Return reading of the quaternion, or of three angles -> attitude (m, 4), the map's reading first.

    At times (m,) [s] of a record, with its channel's samples (m, 4) there.
    """
    if record.channels["base.quaternion"].time is not record.knots:
        raw = sampled_turns(*record.cut("base.quaternion", time), time)
    mapped = record.map.base.quaternion or QuaternionSection()
    turns = {"xyzw": raw, "wxyz": raw}
    if len(mapped.columns) == 3:
        from scipy.spatial.transform import Rotation  # slow to import

        R, angles = rotation_matrices(raw), np.zeros((len(raw), 3))  # scipy warns where the nose is straight up
        angles[:, 0], angles[:, 2] = np.arctan2(R[:, 2, 1], R[:, 2, 2]), np.arctan2(R[:, 1, 0], R[:, 0, 0])
        angles[:, 1] = -np.arcsin(np.clip(R[:, 2, 0], -1.0, 1.0))
        others = ((order, signs * angles[:, columns]) for order, columns, signs in OTHER_ANGLES)
        turns = {"roll, pitch, yaw": raw, **{order: Rotation.from_euler("xyz", a).as_quat() for order, a in others}}
    first = mapped.order if "xyzw" in turns else next(iter(turns)), mapped.sense
    readings = dict.fromkeys([first, *itertools.product(turns, ("body_to_world", "world_to_body"))])
    return {reading: as_attitude(_read_as(record.map, mapped, reading), turns[reading[0]]) for reading in readings}


def _read_as(chosen: Map, mapped: QuaternionSection, reading: Reading) -> Map:
    section = mapped.model_copy(update={"order": reading[0], "sense": reading[1]})
    return chosen.model_copy(update={"base": chosen.base.model_copy(update={"quaternion": section})})


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

    def judge(reading: Reading, agreements: list[Agreement]) -> None:
        shares[reading] = share = _shares(agreements)
        misfit[reading] = float(np.linalg.norm(share)) / max(len(share), 1) ** 0.5
        upward[reading] = _upward(attitudes[reading], specific_force)

    judge(mapped, agreements := pairs(attitudes[mapped]))
    seem = [_other_way(pair) for pair in agreements]
    fits = len(shares[mapped]) > 0 and misfit[mapped] < CERTAINLY_FITS and upward[mapped] > low
    angles = "roll" in mapped[0]  # of which one alone may count the other way
    others = [] if fits or (any(alone for _, alone in seem) and not angles) else others
    for reading in others:
        judge(reading, pairs(attitudes[reading]))
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
        how = f'order = "{best[0]}", sense = "{best[1]}"'
        how = f'the order of base.quaternion.columns, sense = "{best[1]}"; a sign: in the log' if angles else how
        what = (
            f"{text}, as {_words(best)} {misfit[best]:.2g} and {upward[best]:.2f}: the columns seem to be "
            f"{_words(best)} ({how})" + "".join(words for words, _ in seem)
        )
        yield Finding("quaternion order", "refused" if certain else "warning", what, misfit[mapped], "1")
    elif not moving and specific_force is None:
        yield Finding("quaternion order", "note", "it is not checked: neither gyro nor accelerometer", None, "1")
    else:
        yield Finding("quaternion order", "good" if misfit[mapped] < FITS else "note", text, misfit[mapped], "1")


def _words(reading: Reading) -> str:
    order = reading[0] if "roll" in reading[0] else ", ".join(reading[0])
    return f"{order}, {reading[1].replace('_', ' ')}"


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
    labels = ", ".join(label for label, is_wrong in zip(pair.labels, wrong, strict=True) if is_wrong)
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
    n = 2 * min(max(1, round(0.25 * COMPARED_OVER * (len(time) - 1) / float(time[-1] - time[0]))), len(time) // 6)
    inside = slice(n // 2, len(time) - n // 2)  # between the middles of the first and the last n steps
    speeds = [(position[k + n] - position[k]) / (time[k + n] - time[k]) for k in (0, len(time) - 1 - n)]
    world = np.einsum("nij,nj->ni", rotation_matrices(attitude[inside]), specific_force[inside]).mean(axis=0)
    world = world - (speeds[1] - speeds[0]) / (time[inside][-1] - time[inside][0])
    least, size = (np.quantile(np.linalg.norm(specific_force, axis=1), [0.05, 0.5]) / gravity).tolist()
    off = min(abs(np.log(size * G)), abs(np.log(size / G))) if size > 0.0 else np.inf
    mean = float(np.linalg.norm(world)) / gravity
    if least < UPWARD * max(size, 1.0) and mean < UPWARD * min(size, 1.0):  # a misread attitude keeps its size near 1
        text = f"its median is {size:.3g} of gravity, its mean in the world {mean:.2g}: gravity seems to be taken off "
        text += "it; at rest an accelerometer shows g upward"
        yield Finding("accelerometer against gravity", "warning", text, size, "1")
        return
    if off < np.log(2.0):
        slip = "g is read as m/s2" if size < 1.0 else "m/s2 is read as g"
        text = f"its median is {size:.3g} of gravity: {slip}"
        yield Finding("accelerometer against gravity", "refused" if off < 0.1 else "warning", text, size, "1")
        return
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
