"""How far an estimate can be trusted: sizes and deviations of its components, and warnings about it.

Deviations contain what is stated of rows and belief, noise, the lag of the filter, and a tilt of the attitude.

Rows are taken to err each by itself. Noise of a velocity errs in all rows that its joint's acceleration loads, and so
looks like a force: with a large K it is most of the error, and the estimate itself shows it, from sample to sample.

A force that changes is ahead of its filter r, by r'/K. With x what another filter of the same gain lags behind its
input, that is (x + x^2 + x^3 + ...) r. The size of the first term, and by how much the next ones exceed the errors of
rows, say how much it may be: K t e^-Kt of a step, all of a ramp, and a push that swings twice as fast as K. It hides
when something pushed, not that it did (`without_lag`). `kalman` and `smoother` are faster, but errors of rows are known
behind the same low-pass: faster ones may be in them. At its start a filter of first order lacks r / (e^Kt - 1), one of
second order, as `super_twisting` nearly is, r / (e^x / (1 + x) - 1), x = `RISE` K t.

A constant tilt cancels in the equations of motion: an accelerometer that is turned with gravity shows the same world,
turned. So the forces are right in body axes, and in world axes horizontal ones get a share of the vertical one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import comb, sqrt

import numpy as np

from aerobat_pin.forces.scores import quantity
from aerobat_pin.numerics import Array, kernel
from aerobat_pin.observers import (
    FIRST_ORDER,
    RISE,
    AllBut,
    Estimate,
    Expected,
    Identifiability,
    KalmanObserver,
    MomentumObserver,
    Observer,
    low_passed,
    row_names,
)
from aerobat_pin.records import Map

DIFFERENCE = 6  # order of the differences in which a force that changes slowly leaves nothing, and noise everything
GAUSSIAN = 1.4826  # standard deviation over median of the magnitude
NOISE_STRETCH = 32  # samples in which noise is told from that of other stretches
BURST = 0.95  # share of the time in which a component's noise is smaller than what it is judged by
MISFIT = "forces elsewhere, a moment, or a wrong model"  # what such errors may come from
NO_NOISE = 1e-9  # of the largest component's rms: no more than rounding makes of one that nothing shows
LARGEST_NOISE = 0.5  # share of a component's rms above which its noise is named
DOUBT_STRETCH = 1.0  # [s] over which k is averaged to find when the rows fit worst
ROOT_OF_NOISE = 0.822 * comb(2 * DIFFERENCE, DIFFERENCE) ** 0.25  # mean root of the differences of unit white noise
RECENT = DIFFERENCE + 2  # what a stream keeps of each component: last differences, mean root of the highest, count
LAGS = 3  # filters, one behind the other, whose lags say how far a force may be ahead of the first


@dataclass(frozen=True)
class ComponentSize:
    """Size of an estimated force component over the flight.

    Attributes:
        name: label of the component.
        rms: root mean square of the estimate, where it is seen; None where it never is.
        unit: N or N m.
        deviation: median of the standard deviation that the observer states, where the component is seen;
            None if it states none, or if it is infinite.
        unseen: whether the component belongs to a pattern that leaves no trace at some instant of the flight; if a
            force was expected, whether it is never seen.
        seen: share of the time in which the rows settle nine tenths of what was expected; None if nothing was.
    """

    name: str
    rms: float | None
    unit: str
    deviation: float | None = None
    unseen: bool = False
    seen: float | None = None

    def certainty(self, say: Callable[[float, str], str]) -> str:
        """Return the deviation as text by `say`: `infinite` if the component is unseen, `-` if none is stated."""
        if self.unseen:
            return "infinite" if self.seen is None else "not seen"
        return "-" if self.deviation is None else say(self.deviation, self.unit)


@dataclass(frozen=True)
class InnovationScore:
    """Mean normalised innovation squared `nis` of a filter (1 if it errs as it says), and their `whiteness` (0)."""

    nis: float
    whiteness: float


def sample_noise(components: Array) -> Array:
    """Return the standard deviation (c,) of what changes from sample to sample in series (m, c); 0 for short ones.

    It is the median size of the sixth differences, over that of white noise of deviation 1. Steps and pushes are rare
    and do not count. The noise of `momentum` and `force_level` is stronger at high frequencies, up to a fifth at
    K dt = 0.4, and overestimated by as much.
    """
    if len(components) <= 2 * DIFFERENCE:
        return np.zeros(components.shape[1])
    size = np.median(np.abs(np.diff(components, n=DIFFERENCE, axis=0)), axis=0)
    return np.asarray(GAUSSIAN * size / sqrt(comb(2 * DIFFERENCE, DIFFERENCE)))


def local_noise(components: Array) -> Array:
    """Return the standard deviation (m, c) of what changes from sample to sample, over each `NOISE_STRETCH` samples.

    Noise of velocity sensors reaches a force by the geometry of the moment, and may be ten times as large in an eighth
    of a wing beat as elsewhere.
    """
    if len(components) <= 2 * NOISE_STRETCH:
        return np.broadcast_to(sample_noise(components), components.shape)
    count = (len(components) - DIFFERENCE) // NOISE_STRETCH
    change = np.abs(np.diff(components, n=DIFFERENCE, axis=0))[: count * NOISE_STRETCH]
    size = GAUSSIAN * np.median(change.reshape(count, NOISE_STRETCH, -1), axis=1)
    size /= sqrt(comb(2 * DIFFERENCE, DIFFERENCE))
    return np.asarray(size[np.minimum(np.arange(len(components)) // NOISE_STRETCH, count - 1)])


def burst_noise(components: Array) -> Array:
    """Return the standard deviation (c,) of what changes from sample to sample, in the noisiest stretches."""
    return np.maximum(sample_noise(components), np.quantile(local_noise(components), BURST, axis=0))


def _noisy_components(estimate: Estimate) -> list[str]:
    """Return a warning about the components that are mostly noise, if an observer states no deviations itself."""
    if estimate.innovation is not None or not estimate.frames:  # a filter has taken it out
        return []
    noise, rms = burst_noise(estimate.components), np.sqrt(np.mean(estimate.components**2, axis=0))
    loud = [
        f"{name} {quantity(sigma, unit)} beside {quantity(size, unit)}"
        for name, unit, sigma, size in zip(estimate.identifiability.components, estimate.units, noise, rms, strict=True)
        if sigma > max(LARGEST_NOISE * size, NO_NOISE * rms.max())
    ]
    line = (
        f"mostly noise from sample to sample where that is largest, rms beside that of all: {', '.join(loud)}; kalman, "
        "smoother or a lower gain take it out, unless the force itself is that rough"
    )
    return [line] if loud else []


def worst_stretch(time: Array, doubt: Array) -> tuple[float, float]:
    """Return the largest mean over `DOUBT_STRETCH` of k (m,), in which NaN counts as 0, and when that begins [s].

    It is 0 if the edges of the intervals (m + 1,) [s], which have no hole, do not reach so far.
    """
    ends = np.searchsorted(time, time[:-1] + DOUBT_STRETCH - 1e-9)
    begins = np.flatnonzero(ends < len(time))
    if not len(begins):
        return 0.0, float(time[0])
    total = np.concatenate([[0.0], np.cumsum(np.nan_to_num(doubt))])
    means = (total[ends[begins]] - total[begins]) / (ends[begins] - begins)
    worst = int(np.argmax(means))
    return float(means[worst]), float(time[begins[worst]])


def belief_words(k: float) -> str:
    """Return in words how much larger than stated the squared errors of the rows are."""
    return f"belief: squared errors of the rows are {k:.2g} times as large as stated"


def warnings_about(estimate: Estimate) -> list[str]:
    """Return what spoils this estimate although the rows determine it."""
    lines = [*estimate.warnings, *_noisy_components(estimate)]
    if estimate.observer == MomentumObserver.name and estimate.rows == "base+power":
        lines.append(
            "filters the rows before it combines them with the motor's power, which holds at each instant only: the "
            "force between the points is wrong; force_level, kalman and smoother project first"
        )
    return lines


def rows_as_components(estimate: Estimate, observer: Observer, v: Array, expected: Expected | None) -> Estimate:
    """Return an estimate, of an observer without points, whose components are its believed rows, such as `elbow.M`.

    Their deviations, at velocities v (m + 1, nv), are what is expected where nothing touches, if that is known, or
    their noise, if that is larger, and the lag of the filter.
    """
    names, rows = row_names(observer.model), observer.believed.rows
    kept = rows.kept(observer.model) if isinstance(rows, AllBut) else list(range(len(names)))
    labels = [name if "." in name else f"{name}.{'F' if unit == 'N' else 'M'}" for name, unit in names.items()]
    units, count = tuple(np.array(list(names.values()))[kept].tolist()), len(kept)
    known = Identifiability(tuple(labels[k] for k in kept), count, np.ones(count), np.zeros((0, count)), np.ones(count))
    whole = replace(estimate, components=estimate.residual[:, kept], units=units, identifiability=known)
    if expected is None:
        return whole
    deviation = expected.row_deviation(0.5 * (v[1:] + v[:-1]))[:, kept]
    return _with_lag(whole, observer, np.maximum(deviation, local_noise(whole.components)))


def with_expected(estimate: Estimate, observer: Observer, expected: Expected) -> Estimate:
    """Return an estimate with what it shows of an expected force; its deviation has noise, lag and shared errors."""
    deviation = estimate.standard_deviation
    if deviation is None:
        return estimate
    whole = replace(estimate, expected_force=expected.force, seen=expected.seen(deviation))
    return _with_lag(whole, observer, np.maximum(deviation, recent_noise(whole.components)), expected.shared)


def _with_lag(estimate: Estimate, observer: Observer, deviation: Array, shared: Array | float = 0.0) -> Estimate:
    """Return an estimate with deviations (m, c), how far forces may be ahead of it, and shared errors."""
    size, gain, second = np.abs(estimate.components), float(np.min(observer.gain)), observer.kind != FIRST_ORDER
    lag = lag_of_filter(estimate.components, np.diff(estimate.time), gain, deviation)
    if not isinstance(observer, KalmanObserver):
        x = gain * (RISE if second else 1.0) * (estimate.time[1:, None] - estimate.time[0])
        rest = (1.0 + second * x) * np.exp(-x)
        lag = np.maximum(lag, size * rest / np.maximum(1.0 - rest, np.finfo(float).tiny))
    return replace(estimate, standard_deviation=np.sqrt(deviation**2 + lag**2 + np.square(shared)))


def with_belief_error(estimate: Estimate, deviation: Array | None) -> Estimate:
    """Return an estimate that states the errors of its belief (m, c), too; where it stated none, noise and these."""
    if deviation is None:
        return estimate
    stated = local_noise(estimate.components) if estimate.standard_deviation is None else estimate.standard_deviation
    unseen = np.isinf(estimate.identifiability.deviation)
    return replace(estimate, standard_deviation=np.where(unseen, np.inf, np.hypot(stated, deviation)))


def recent_noise(components: Array) -> Array:
    """Return the standard deviation (m, c) of what changed from sample to sample, over `NOISE_STRETCH` before each.

    Means are taken of square roots, in which steps and pushes, which are rare, hardly count.
    """
    change = np.diff(components, n=DIFFERENCE, axis=0, prepend=np.zeros((DIFFERENCE, components.shape[1])))
    share = 1.0 / np.minimum(np.arange(1.0, len(change) + 1.0), NOISE_STRETCH)
    return np.asarray((low_passed(np.sqrt(np.abs(change)), share) / ROOT_OF_NOISE) ** 2)


@kernel
def raise_to_noise(components: Array, recent: Array, deviation: Array) -> None:
    """Do in a stream what `recent_noise` does: move `recent` (RECENT, c), and raise deviations (c,) to the noise."""
    for j in range(components.shape[0]):
        change = components[j]
        for i in range(DIFFERENCE):
            change, recent[i, j] = change - recent[i, j], change
        recent[-1, j] = min(recent[-1, j] + 1.0, NOISE_STRETCH)
        recent[-2, j] += (np.sqrt(abs(change)) - recent[-2, j]) / recent[-1, j]
        deviation[j] = max(deviation[j], (recent[-2, j] / ROOT_OF_NOISE) ** 2)


def lag_of_filter(components: Array, dt: Array, gain: float, deviation: Array) -> Array:
    """Return how far (m, c) forces may be ahead of components (m, c) that a filter of gain K [1/s] gives.

    Of the components at intervals dt (m,) [s], as much as their deviation (m, c) by errors of rows and noise may be no
    force.
    """
    ahead, share = np.zeros_like(components), -np.expm1(-gain * dt)
    for lag in range(LAGS):
        components = components - low_passed(components, share)
        ahead += np.maximum(np.abs(components) - (deviation if lag > 0 else 0.0), 0.0)
    return ahead


def filters_at_start(observer: Observer) -> tuple[Array, Array]:
    """Return what a stream keeps of an observer that starts: `behind` of `add_lag_of_filter`, `recent` of the noise."""
    behind = np.zeros((LAGS + 2, len(observer.applications.components)))
    behind[LAGS:] = [[not isinstance(observer, KalmanObserver)], [observer.kind != FIRST_ORDER]]
    return behind, np.zeros((RECENT, behind.shape[1]))


def without_lag(estimate: Estimate, deviation: Array) -> Array:
    """Return deviations (m, c) of an estimate with what they contain of its filter's lag taken out."""
    if estimate.standard_deviation is None or (estimate.frames and estimate.seen is None):
        return deviation
    components, gain, dt = estimate.components, float(np.min(estimate.gain)), np.diff(estimate.time)
    components = components - components[0]
    errors = np.broadcast_to(deviation.min(axis=0), deviation.shape)  # of rows: about what they are without lag
    if estimate.seen is not None and estimate.expected_force is not None:
        errors = estimate.expected_force * np.sqrt(1.0 - estimate.seen)
    errors = np.maximum(errors, recent_noise(components))
    lag = lag_of_filter(components, dt, gain, errors)
    return np.asarray(np.sqrt(np.maximum(deviation**2 - lag**2, errors**2)))


@kernel
def add_lag_of_filter(components: Array, kept: float, behind: Array, deviation: Array) -> None:
    """Do in a stream what `lag_of_filter` does: move filters `behind` (LAGS + 2, c), which keep e^-K dt.

    The last rows are e^-Kt, 0 of a Kalman filter, which need not rise, and whether an observer is of second order.
    """
    for j in range(components.shape[0]):
        ahead, lagging = 0.0, components[j]
        for i in range(LAGS):
            behind[i, j] = lagging + kept * (behind[i, j] - lagging)
            lagging -= behind[i, j]
            ahead += max(abs(lagging) - (deviation[j] if i > 0 else 0.0), 0.0)
        behind[LAGS, j] = rest = kept * behind[LAGS, j]
        if behind[LAGS + 1, j] > 0.0 and rest > 0.0:
            rest = (1.0 - RISE * np.log(rest)) * rest**RISE
        ahead = max(ahead, abs(components[j]) * rest / (1.0 - rest))
        deviation[j] = np.hypot(deviation[j], ahead)


def tilt_of(chosen: Map) -> float:
    """Return the standard deviation of roll and of pitch [rad] of a map's attitude: an IMU's, else 0."""
    base = chosen.base
    return 0.0 if base.from_ == "measured" or base.held else float(np.radians(base.imu.tilt))


def with_tilt(components: Array, deviation: Array, tilt: float) -> Array:
    """Return standard deviations (..., 3 n) [N] of forces in world axes, seen in axes with a random tilt.

    A tilt (a, b, 0), each of deviation `tilt` [rad], changes F by (a, b, 0) x F, so by tilt Fz along x and y, and by
    tilt |(Fx, Fy)| along z. It comes of an accelerometer's offset, which along z makes gravity, and with it all forces
    that bear it, larger by as much. Without the tilt deviations are `deviation` (..., 3 n).
    """
    force = components.reshape(*components.shape[:-1], -1, 3)
    x, y, z = (force[..., k] ** 2 for k in range(3))
    moved = tilt**2 * np.stack([z, z, x + y + z], axis=-1)
    return np.asarray(np.sqrt(deviation**2 + moved.reshape(components.shape)))
