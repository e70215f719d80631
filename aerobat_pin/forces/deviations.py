"""What deviations contain: what is stated of rows and belief, noise, the lag of the filter, a tilt of the attitude.

Rows are taken to err each by itself. Noise of a velocity errs in all rows that its joint's acceleration loads, and so
looks like a force: with a large K it is most of the error, and the estimate itself shows it, from sample to sample.

A force that changes is ahead of its filter r, by r'/K. With x what another filter of the same gain lags behind its
input, that is (x + x^2 + x^3 + ...) r. The size of the first term, and by how much the next ones exceed the errors of
rows, say how much it may be: K t e^-Kt of a step, all of a ramp, and a push that swings twice as fast as K. It hides
when something pushed, not that it did (`without_lag`). `kalman` and `smoother` are faster, but errors of rows are known
behind the same low-pass: faster ones may be in them.

A constant tilt cancels in the equations of motion: an accelerometer that is turned with gravity shows the same world,
turned. So the forces are right in body axes, and in world axes horizontal ones get a share of the vertical one.
"""

from __future__ import annotations

from dataclasses import replace
from math import comb

import numpy as np

from aerobat_pin.forces.trust import DIFFERENCE, NOISE_STRETCH, local_noise
from aerobat_pin.numerics import Array, kernel
from aerobat_pin.observers import AllBut, Estimate, Expected, Identifiability, Observer, low_passed, row_names
from aerobat_pin.records import Map

ROOT_OF_NOISE = 0.822 * comb(2 * DIFFERENCE, DIFFERENCE) ** 0.25  # mean root of the differences of unit white noise
RECENT = DIFFERENCE + 2  # what a stream keeps of each component: last differences, mean root of the highest, count
LAGS = 3  # filters, one behind the other, whose lags say how far a force may be ahead of the first


def rows_as_components(estimate: Estimate, observer: Observer, v: Array, expected: Expected | None) -> Estimate:
    """Return an estimate, of an observer without points, whose components are its believed rows, such as `elbow.M`.

    Their deviations, at velocities v (m + 1, nv), are what is expected where nothing touches, if that is known.
    """
    names, rows = row_names(observer.model), observer.believed.rows
    kept = rows.kept(observer.model) if isinstance(rows, AllBut) else list(range(len(names)))
    labels = [name if "." in name else f"{name}.{'F' if unit == 'N' else 'M'}" for name, unit in names.items()]
    units, count = tuple(np.array(list(names.values()))[kept].tolist()), len(kept)
    deviation = None if expected is None else expected.row_deviation(0.5 * (v[1:] + v[:-1]))[:, kept]
    known = Identifiability(tuple(labels[k] for k in kept), count, np.ones(count), np.zeros((0, count)), np.ones(count))
    return replace(
        estimate,
        components=estimate.residual[:, kept],
        units=units,
        identifiability=known,
        standard_deviation=deviation,
    )


def with_expected(estimate: Estimate, observer: Observer, expected: Expected) -> Estimate:
    """Return an estimate with what it shows of an expected force; its deviation has noise, lag and shared errors."""
    deviation = estimate.standard_deviation
    if deviation is None:
        return estimate
    whole = replace(estimate, expected_force=expected.force, seen=expected.seen(deviation))
    deviation = np.maximum(deviation, recent_noise(estimate.components))
    lag = lag_of_filter(estimate.components, np.diff(estimate.time), float(np.min(observer.gain)), deviation)
    return replace(whole, standard_deviation=np.sqrt(deviation**2 + lag**2 + np.square(expected.shared)))


def with_belief_error(estimate: Estimate, deviation: Array | None) -> Estimate:
    """Return an estimate that states the errors of its belief (m, c), too; where it stated none, noise and these."""
    if deviation is None:
        return estimate
    stated = estimate.standard_deviation
    stated = local_noise(estimate.components) if stated is None else stated
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
    """Do the same in a stream: move `recent` (RECENT, c) and raise deviations (c,) to the noise."""
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


def without_lag(estimate: Estimate, deviation: Array) -> Array:
    """Return deviations (m, c) of an estimate with what they contain of its filter's lag taken out."""
    if estimate.seen is None or estimate.expected_force is None:
        return deviation
    components, gain, dt = estimate.components, float(np.min(estimate.gain)), np.diff(estimate.time)
    components = components - components[0]
    errors = np.maximum(estimate.expected_force * np.sqrt(1.0 - estimate.seen), recent_noise(components))
    lag = lag_of_filter(components, dt, gain, errors)
    return np.asarray(np.sqrt(np.maximum(deviation**2 - lag**2, errors**2)))


@kernel
def add_lag_of_filter(components: Array, kept: float, behind: Array, deviation: Array) -> None:
    """Do the same in a stream: move filters `behind` (LAGS, c), which keep e^-K dt, and enlarge deviations (c,)."""
    for j in range(components.shape[0]):
        ahead, lagging = 0.0, components[j]
        for i in range(LAGS):
            behind[i, j] = lagging + kept * (behind[i, j] - lagging)
            lagging -= behind[i, j]
            ahead += max(abs(lagging) - (deviation[j] if i > 0 else 0.0), 0.0)
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
