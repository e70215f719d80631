"""Check a free robot's efforts against what motion and weight need: units, signs, swapped joints and limbs, masses.

The factors of the efforts (and of the base link's mass) follow from the balance by least squares: 1 for each effort and
0 for the mass if map and robot are right. But noise and friction of an effort make its factor too small. So an effort
is named only if also the other way round, beside friction and a rotor, what is measured of it is not what is needed:

    x = g y + c1 + c2 tanh(v / v_s) + c3 v + c4 a + e,     c ~ N(0, t^2)

where t is what is left of the typical joint, at most the whole effort, and y takes the other efforts as mapped, but for
their signs. Where a joint carries less than its noise, or friction and rotor turn g round, it is unknown, and nothing
is said.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from aerobat_pin.estimation.checks.known_against_motion import turned_base
from aerobat_pin.estimation.checks.readings import (
    LEFT_BY_JOINTS,
    WELL,
    JointReading,
    joint_pairs,
    left_by_readings,
    limb_pairs,
    reading_of,
    swapped,
)
from aerobat_pin.estimation.checks.sensor_faults import late_efforts, zeros_of_free
from aerobat_pin.estimation.findings import Finding
from aerobat_pin.forces import Balance, FreeMotion, balance_of
from aerobat_pin.numerics import Array
from aerobat_pin.observers import SMOOTH_RATE
from aerobat_pin.records import Record

ERRORS_LAST = 0.2  # [s]: instants farther apart have independent errors, those of friction and model
NAMED, NAMED_MASS = 0.1, 0.05  # deviation of a factor from 1 that is named
AS_MILLI = 0.15  # of the logarithm: a factor so near to a thousandth is one
SURE = 4.0  # in standard deviations
EXPLAINED = 0.5  # share of what is left otherwise that factors, or another mass, must explain
UNFIT = 0.05  # of the needed square sum left by the best factors, from which they explain nothing
CLEAR = 0.9  # share of the imbalance that is explained, from which they are named all the same
LIGHTEST = 0.5  # of the base link's mass, that it may lack
SWAP = 0.5  # of the imbalance that is left if joints or limbs change places
WORTH, GOOD = 0.005, 0.02  # of the needed square sum: an imbalance for which efforts, or limbs, may be exchanged
RIGHT_PLACES = 0.25  # of the needed square sum, that joints or limbs in the right places leave at most
NO_NUMBERS = 4.0  # times what factors of all efforts and frictions leave: a reading has no numbers to fit
ABOVE_NOISE = 1.5  # times what is white in the efforts, from which an imbalance is more than noise
UNEXPLAINED = 0.25  # share of what is needed, in squares, that is left of no good record
WORTH_SIGNS = 0.25  # of the square sum of what efforts give: what other signs must gain, 4 if none holds another
WHITE_SECOND_DIFFERENCE = 0.6745 * np.sqrt(6.0)  # median magnitude of that of white noise, over its deviation
MILLI = ("mA", "mN m")  # units for each of which a torque was once given as if for A and N m


def of_free(record: Record, motion: FreeMotion | None, *, beyond: bool, readings: bool = True) -> Iterator[Finding]:
    """Yield factors of a free robot's efforts, columns that are exchanged, and its base's mass, as the rows show them.

    A record that is too short has no motion. `beyond` says whether joints are beyond their limits (before that is
    settled efforts say nothing of factors or places), `readings` whether other readings of the joints are sought, too.
    """
    balance = None if motion is None else balance_of(record, motion)
    if motion is None or balance is None:
        free = "" if record.map.use.free else "; use.free names a stretch without contact"
        yield Finding("effort against motion", "note", f"unknown forces leave no row to check efforts by{free}")
        return
    # Shares of what is needed, in squares, that efforts leave: as mapped, and if something of them is read otherwise.
    mapped, (factors, remainder) = balance.imbalance(), _least_squares(balance)
    by_factors = balance.share_of(remainder)
    idle = UNFIT * mapped > 1.0 and by_factors > UNFIT
    text = (
        f"weight and motion leave {100.0 * np.sqrt(mapped):.1f} % of what they need unexplained by "
        "efforts and known forces"
    )
    if idle:
        text = "in the rows that unknown forces leave, weight and motion need next to nothing beside what efforts give"
    if beyond and mapped < GOOD:
        text += ": they fit the angles as they are, also those of joints beyond their limits"
    yield Finding("effort against motion", "good" if mapped < GOOD else "note", text, float(np.sqrt(mapped)), "1")
    if beyond:
        yield from _read_otherwise(record, motion, balance, np.ones(len(record.driven)))
        return
    signs, pairs = _best_signs(balance), [*joint_pairs(record.robot, record.driven), *limb_pairs(record)]
    by_signs = balance.imbalance(signs=signs)
    by_exchange, pair = min(((balance.imbalance(pair), pair) for pair in pairs), default=(np.inf, ((), ())))
    zeros, by_zeros = zeros_of_free(record, motion, balance, _left_by_one_number)
    finding = late_efforts(record, balance, min(by_signs, by_factors, by_zeros))
    if finding is None and not idle and mapped > WORTH and not record.map.base.held:
        finding = turned_base(record, motion, mapped, min(SWAP * min(by_signs, by_zeros, by_exchange), RIGHT_PLACES))
    if finding is not None:
        yield finding
    if finding is not None or idle:
        return
    others = RIGHT_PLACES, by_signs, by_factors / SWAP, by_zeros
    exchanged = mapped > WORTH and by_exchange < min(SWAP * mapped, *others)
    most = min(SWAP * by_exchange if exchanged else np.inf, by_zeros)
    findings = list(_read_otherwise(record, motion, balance, signs, most)) if readings else []
    if exchanged and not findings:
        findings = [swapped(record.driven, "efforts", pair, _share_words(by_exchange, mapped))]
    findings = findings or zeros or list(_factors(record, balance, signs, factors, remainder))
    if not findings and by_factors > UNFIT and mapped > max(UNEXPLAINED, ABOVE_NOISE * _white_share(balance)):
        findings = [left_unexplained("no factors, places or zeros", 100.0 * float(np.sqrt(mapped)))]
    yield from findings


def _read_otherwise(
    record: Record, motion: FreeMotion, balance: Balance, signs: Array, most: float = np.inf
) -> Iterator[Finding]:
    """Yield how joints may have to be read, if that leaves far less beside friction than other efforts do.

    It must leave less than `most`, too, of what is needed, in squares.
    """
    scaled_efforts = balance.common_factor * balance.given.sum(axis=1)
    residuals = balance.residual, balance.needed - balance.given @ signs, balance.needed - scaled_efforts
    mapped, by_signs, by_one_factor = map(balance.beside_friction, residuals)
    if min(mapped, by_one_factor) <= max(WELL, ABOVE_NOISE * _white_share(balance)):
        return
    by_factors = balance.share_of(_least_squares(balance, balance.rubbing)[1])  # a number for each joint and friction
    as_mapped, needed = JointReading.as_mapped(record), balance.size / len(motion.q)
    readings = [as_mapped.otherwise(np.flatnonzero(signs < 0.0), sense=-1.0, effort=-1.0)]  # as efforts are reversed
    if by_signs > WELL or np.all(signs > 0.0):
        readings.append(reading_of(record, motion, needed))
    shares = left_by_readings(record, motion, readings, needed)
    by_reading, reading = min(zip(shares, readings, strict=True), key=lambda each: each[0])
    k, enough = int(np.argmax(np.abs(reading.turn))), LEFT_BY_JOINTS * mapped
    if not record.robot.knows_forces:  # else these may be wrong, and are those of the joints as mapped
        sole = reading == as_mapped.otherwise([k], reading.turn[k])  # number, which must explain it better than others
        enough = max(enough, min(EXPLAINED * mapped, max(by_factors, _left_by_one_number(balance) if sole else 0.0)))
    if by_reading < min(enough, RIGHT_PLACES, by_signs, NO_NUMBERS * by_factors, most):
        unsure = " (so much that it may be other joints, or a push)" if by_reading > GOOD else ""
        yield from reading.findings(record, _share_words(by_reading, mapped) + unsure)


def _left_by_one_number(balance: Balance) -> float:
    """Return what the best of one effort's factor, one of all, and the base's mass leaves beside friction."""
    columns = np.column_stack([balance.given, balance.given.sum(axis=1), balance.base])
    tables = [np.column_stack([balance.rubbing, column]) for column in columns.T]
    return min(balance.share_of(balance.residual + table @ balance.explained_by(table)) for table in tables)


def _share_words(after: float, before: float) -> str:
    return f"{100.0 * after**0.5:.1f} %, as mapped {100.0 * before**0.5:.1f} %"


def _best_signs(balance: Balance) -> Array:
    """Return signs of the efforts (joints,), +1 or -1, of which no other single one leaves less.

    Efforts that hold each other leave as little with all signs changed: the change must be worth what they give.
    """
    gram, along = balance.given.T @ balance.given, balance.given.T @ balance.needed
    best, most = np.ones(len(along)), 0.0
    for start in (1.0, -1.0):
        signs = np.full(len(along), start)
        while np.any((worse := signs * (along - gram @ signs) + np.diag(gram)) < -1e-9 * np.trace(gram)):
            signs[np.argmin(worse)] *= -1.0
        gained = 2.0 * along @ (signs - 1.0) - signs @ gram @ signs + np.sum(gram)
        if gained > max(most, WORTH_SIGNS * np.diag(gram)[signs < 0.0].sum()):
            best, most = signs, float(gained)
    return best


def _least_squares(balance: Balance, *more: Array) -> tuple[Array, Array]:
    """Return the factors of the efforts and the change of the base's mass (joints + 1,), and what they leave (n,).

    The mass changes only if half of it stays and the efforts alone leave far more: without most of weight and motion
    any efforts would do. Columns (n, k) of `more` may make up for some of it.
    """
    table, n = np.column_stack([balance.given, -balance.base, *more]), balance.given.shape[1]
    scale, start = np.linalg.norm(table, axis=0), np.pad(np.ones(n), (0, table.shape[1] - n))
    seen = scale > 1e-6 * max(float(scale.max()), 1e-300)

    def best(free: NDArray[np.bool_]) -> tuple[Array, Array]:
        fitted = start.copy()
        fitted[free] = np.linalg.lstsq(table[:, free] / scale[free], balance.needed, rcond=1e-6)[0] / scale[free]
        return fitted, balance.needed - table @ fitted

    alone, other = best(seen & (np.arange(len(seen)) != n)), best(seen)
    heavy = other[0][n] > -LIGHTEST and other[1] @ other[1] < EXPLAINED * (alone[1] @ alone[1])
    return other if heavy else alone


def _factors(record: Record, balance: Balance, signs: Array, fitted: Array, residual: Array) -> Iterator[Finding]:
    """Yield efforts that are reversed, and factors of efforts and of the base's mass that the map does not say."""
    n, mapped, by_factors = len(record.driven), balance.imbalance(), balance.share_of(residual)
    gain, unsure = _measured_per_needed(balance, signs, balance.needed - balance.given @ signs)
    if np.any(turned := gain + SURE * unsure < 0.0):
        after = balance.beside_friction(balance.needed - balance.given @ np.where(turned, -1.0, 1.0))
        before = balance.beside_friction(balance.residual)
        if after < RIGHT_PLACES * before:
            yield from _reversed(record, gain, np.flatnonzero(turned | np.all(signs < 0.0)))
        elif mapped > 1.0:  # more is left than is needed
            yield left_unexplained("no signs", 100.0 * float(np.sqrt(mapped)))
        return
    explained = 1.0 - by_factors / max(mapped, 1e-300)
    fit = by_factors < UNFIT  # of white efforts, unlike fast ones, factors leave more
    if explained < EXPLAINED or (not fit and mapped < ABOVE_NOISE * _white_share(balance)):
        return
    if not fit and explained < CLEAR:
        if mapped * balance.size >= UNFIT * float(np.sum(balance.given**2)):  # else efforts hold each other
            yield left_unexplained("no factors", 100.0 * float(np.sqrt(by_factors)))
        return
    common, mass = balance.common_factor, -float(balance.base @ balance.residual)  # change of the base's, alone
    mass /= max(float(balance.base @ balance.base), 1e-300)
    by_mass = balance.share_of(balance.residual + balance.base * mass)
    by_common = max(balance.share_of(balance.needed - common * balance.given.sum(axis=1)), 1e-300)
    explains = by_mass < EXPLAINED * min(mapped, by_common) and fitted[n] * mass > 0.0
    if explains and min(abs(fitted[n]), abs(mass)) > NAMED_MASS:
        what = f"the record wants {1.0 + fitted[n]:.2f} times the believed mass of the base link, or a force on it"
        what += ", or known forces of another size" * bool(record.map.known)  # which carry it in proportion
        yield Finding("mass", "warning", what, 1.0 + float(fitted[n]), "1")
    shown, deviation = _measured_per_needed(balance, fitted[:n], residual)
    factors = 1.0 / np.where(shown == 0.0, np.inf, shown)
    sure = deviation * SURE < np.abs(shown) * np.minimum(1.0, np.maximum(np.abs(1.0 - shown), NAMED))
    off = np.flatnonzero(sure & (np.abs(factors - 1.0) > NAMED))
    mean = float(np.mean(factors[off])) if len(off) else 1.0
    alike = by_factors > EXPLAINED * by_common  # no other factors explain far more
    if len(off) and alike and mean * common > 0.0 and abs(common - 1.0) > NAMED:
        if mean < 0.0:
            yield from _reversed(record, shown, off)
            return
        finding = of_all(record, record.driven, common)
        if finding.verdict == "warning" and abs(mass) > NAMED_MASS and by_mass * EXPLAINED < by_common:
            text = f"{finding.text}; or a force or a load on the base link: the record does not tell which"
            finding = replace(finding, text=text)
        yield finding
        return
    gain, unsure = _measured_per_needed(balance, np.ones(n), balance.residual)
    off = off[np.abs(gain[off] - 1.0) > np.maximum(NAMED, SURE * unsure[off])]
    changed = np.where(np.isin(range(n), off), factors, 1.0)
    after = balance.beside_friction(balance.needed - balance.given @ changed)
    if after > EXPLAINED * balance.beside_friction(balance.residual):
        return
    yield from _reversed(record, shown, off[factors[off] < 0.0])
    yield from (wrong_effort(record.driven[k], float(factors[k])) for k in off[factors[off] > 0.0])


def of_all(record: Record, names: Sequence[str], factor: float) -> Finding:
    """Return that all efforts are wrong by a factor."""
    if factor < 0.0:
        what = f"all efforts are reversed ({', '.join(names)}): torque_per_unit"
        what += ", or known forces are: known.NAME.sign" * bool(record.map.known)
        return Finding("effort sign", "warning", what, factor, "1")
    what, effort = f"all efforts would have to be {factor:.3g} times as large: ", record.map.joints.effort
    milli = abs(np.log(1e3 * factor)) < AS_MILLI
    if milli and effort is not None and effort.torque_per_unit and effort.unit in MILLI:
        what += f"torque_per_unit counts for each {effort.unit}, as the map states: a thousandth was expected"
        return Finding("effort unit or mass", "refused", what, factor, "1")
    what += f"their unit (A, N m), or all masses {1.0 / factor:.3g} times what is believed"
    what += ", or the forces that the robot knows itself of another size" * record.robot.knows_forces
    return Finding("effort unit or mass", "warning", what, factor, "1")


def reversed_effort(name: str, factor: float) -> Finding:
    """Return that an effort is reversed."""
    what = f"the effort of {name} is reversed: it would have to be {factor:.3g} times as large: torque_per_unit"
    return Finding("effort sign", "warning", what + "; or a centre of mass beyond it" * (factor > -0.5), factor, "1")


def wrong_effort(name: str, factor: float) -> Finding:
    """Return that an effort is wrong by a factor."""
    what = f"the effort of {name} would have to be {factor:.3g} times as large: its unit (A, N m): torque_per_unit"
    what += "; friction: joints.friction" * (factor < 1.0) + "; or a centre of mass beyond it"
    return Finding("effort unit", "warning", what, factor, "1")


def no_effort(what: str) -> Finding:
    """Return that one effort, or all, show nothing: `what` says which."""
    why = "another unit (A, N m): torque_per_unit; or nobody measures it: robot.rows.ignore"
    return Finding("effort unit", "warning", f"{what} nothing of what motion and weight need: {why}", 0.0, "1")


def left_unexplained(what: str, percent: float) -> Finding:
    """Return that no change explains what is left."""
    text = (
        f"{what} of the efforts explain it ({percent:.0f} % left): friction of the joints, a load or push "
        "elsewhere, known forces of another size, other axes, another order of joints, one motor for several "
        "(joints.coupling), another robot"
    )
    return Finding("effort against motion", "warning", text, percent, "%")


def _reversed(record: Record, gain: Array, which: NDArray[np.intp]) -> Iterator[Finding]:
    """Yield efforts that show the opposite of what is needed, `gain` (joints,) times it."""
    if len(which) == len(record.driven) > 1:
        yield of_all(record, record.driven, float(1.0 / np.median(gain)))
        return
    yield from (reversed_effort(record.driven[k], float(1.0 / gain[k])) for k in which)


def _measured_per_needed(balance: Balance, factors: Array, residual: Array) -> tuple[Array, Array]:
    """Return what is measured of each effort per what the rows need of it, g (joints,), and its standard deviation.

    `factors` (joints,) are those of the other efforts, `residual` (n,) is what all together leave.
    """
    remainder, weight = balance.of_joints(residual)
    weight = weight / np.maximum(weight.sum(axis=0), 1e-300)
    needed, count = balance.effort * factors + remainder, max(1.0, balance.span / ERRORS_LAST)
    whole = np.sqrt(np.mean(balance.effort**2, axis=0))
    priors = np.minimum(np.median(np.sqrt(np.sum(weight * remainder**2, axis=0))), whole)  # no joint is all friction
    gain, deviation = np.zeros((2, len(factors)))
    for k, x in enumerate(balance.effort.T):
        v, a, w = balance.v[:, k], balance.a[:, k], weight[:, k]
        v_size, a_size = (max(float(np.sqrt(np.mean(values**2))), 1e-12) for values in (v, a))
        X = np.column_stack([needed[:, k], np.ones_like(v), np.tanh(v / SMOOTH_RATE), v / v_size, a / a_size])
        noise = x - X @ np.linalg.lstsq(X * np.sqrt(w)[:, None], x * np.sqrt(w), rcond=1e-9)[0]
        least = 1e-12 + 1e-12 * float(w @ x**2)
        share = count / (float(w @ noise**2) + least)
        prior = np.diag([0.0, *(4 * [1.0 / (priors[k] ** 2 + least)])])
        inverse = np.linalg.pinv(share * (X.T * w) @ X + prior, rcond=1e-18)
        gain[k], deviation[k] = (inverse @ (share * (X.T * w) @ x))[0], np.sqrt(max(inverse[0, 0], 0.0))
        if gain[k] * ((w * x) @ needed[:, k]) < 0.0:
            deviation[k] = np.inf
    return gain, deviation


def _white_share(balance: Balance) -> float:
    """Return the square sum of what is white in the efforts and the motion, over the needed one."""
    x = balance.effort  # means over intervals, of which only every other one has noise of its own
    if len(x) < 5:
        return 0.0
    white = np.median(np.abs(x[4:] - 2.0 * x[2:-2] + x[:-4]), axis=0) / WHITE_SECOND_DIFFERENCE
    return (float(np.sum((balance.reach * white) ** 2)) + balance.shaken()) / balance.size
