"""Bias of an estimate, measured in a free run; its noise and lag, predicted in closed form; gains for wanted ones.

A free run is a record without unknown forces. White noise n of the momentum, independent at each sample, enters an
interval's mean as (n_1 - n_0)/dt. Let x = K dt for the first-order filter and x = 2.146 K dt for the second-order
filter, d = exp(-x) and e = 1 - d. The filtered responses to noise in one sample, times dt, are

    first order      e, then  -e^2 d^j                                          j = 0, 1, 2 ...
    second order     b, then   e d^j (2 x d - e - j x e)     b = e - x d

and the sum of their squares gives the variance. The responses to a force have the mean delay d/e intervals (first
order) and d (x - e)/e^2 + 2 d/e intervals (second order). The estimate of a slowly varying force lags behind the
force's interval means by this delay.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from aerobat_pin.errors import ObserverError, ShapeError
from aerobat_pin.numerics import Array, checked, guarded
from aerobat_pin.observers.identifiability import RANK_TOLERANCE, judge
from aerobat_pin.observers.kernels.filters import RISE
from aerobat_pin.observers.observer import Observer
from aerobat_pin.observers.rows import BASE_ROWS, has_free_base

WINDOW = 2.5  # correlation lengths up to which the autocorrelation is summed; Sokal's 5, with a length twice his
ORDERS = {"momentum": 1, "force_level": 1, "second_order": 2}  # filter order; only these have a closed form
GAIN_RANGE = (1.0e-5, 50.0)  # smallest and largest K dt


@dataclass(frozen=True)
class Bias:
    """Mean of an estimate in a free run, in which no unknown force acts.

    Attributes:
        mean: (c,) or one number, the bias [unit of the estimate].
        standard_error: (c,) or one number, standard error of the mean, from the effective number of samples.
        effective_samples: (c,) or one number: number of independent samples with the same standard error.
    """

    mean: Array
    standard_error: Array
    effective_samples: Array

    @guarded()
    def remove(self, values: ArrayLike) -> Array:
        """Return the values (m,) or (m, c) minus the bias."""
        return np.asarray(np.asarray(values, float) - self.mean)


@guarded()
def bias_of(free: ArrayLike) -> Bias:
    """Measure the bias in a free run.

    Args:
        free: (m,) or (m, c) evenly sampled estimates of the free run, such as `estimate.components`.

    Raises:
        ShapeError: there are fewer than two samples, or a number is not finite.
    """
    values: Array = np.asarray(free, float)
    if values.ndim not in (1, 2) or len(values) < 2 or not np.all(np.isfinite(values)):
        raise ShapeError(f"free run of shape {values.shape}: two finite samples (m,) or (m, c) or more were expected")
    columns = values.reshape(len(values), -1).T
    count = np.array([len(values) / correlation_length(column) for column in columns]).reshape(values.shape[1:])
    spread = np.std(values, axis=0, ddof=1)
    return Bias(np.mean(values, axis=0), spread / np.sqrt(count), count)


def correlation_length(series: ArrayLike) -> float:
    """Return tau = 1 + 2 sum rho_k, with rho_k the autocorrelation at lag k.

    The variance of the mean of a correlated series is tau times the variance of the mean of independent samples. The
    sum ends at the first lag that is at least `WINDOW` times the sum so far, because later lags contain only noise
    (A. Sokal, Monte Carlo Methods in Statistical Mechanics, 1989). White noise has tau = 1. White noise after a
    first-order filter has tau = (1 + a)/(1 - a) with a = exp(-K dt). The mean of the series (m,) or (m, c) is
    subtracted; for several columns the largest tau is returned.
    """
    values: Array = np.asarray(series, float).reshape(len(np.asarray(series)), -1)
    return max(_column_length(column - column.mean()) for column in values.T)


def _column_length(centred: Array) -> float:
    count = len(centred)
    spectrum = np.fft.rfft(centred, 2 * count)  # padded with zeros, so that lags do not wrap around
    products = np.fft.irfft(spectrum * spectrum.conj())[:count]
    if not products[0] > 0.0:
        return 1.0
    sums = 2.0 * np.cumsum(products / products[0]) - 1.0
    covered = np.arange(count) >= WINDOW * sums
    return float(max(1.0, sums[int(np.argmax(covered)) if np.any(covered) else -1]))


@guarded(linear_velocity="not negative", gyro="not negative", joint_rate="not negative")
@dataclass(frozen=True)
class SensorNoise:
    """Standard deviation of white noise on each sample of the velocity.

    Attributes:
        linear_velocity: standard deviation for the linear velocity of a free base, per axis [m/s].
        gyro: standard deviation for the angular velocity of a free base, per axis [rad/s].
        joint_rate: standard deviation for the velocity of every joint [rad/s or m/s].
    """

    linear_velocity: float = 0.0
    gyro: float = 0.0
    joint_rate: float = 0.0

    @guarded()
    def deviations(self, model: pin.Model) -> Array:
        """Return the standard deviation of the noise of each measured velocity coordinate of a model (nv,)."""
        free = BASE_ROWS if has_free_base(model) else 0
        base = [self.linear_velocity] * 3 + [self.gyro] * 3
        return np.array(base[:free] + [self.joint_rate] * (model.nv - free))


@dataclass(frozen=True)
class Prediction:
    """Predicted noise and lag of an observer's estimate.

    Attributes:
        labels: labels of the components.
        covariance: (c, c) covariance of the components [N and N m]; infinite if a component cannot be determined.
        lag: lag of the estimate of a slowly varying force behind the force's interval means [s].
    """

    labels: tuple[str, ...]
    covariance: Array
    lag: float

    @property
    def deviation(self) -> Array:
        """(c,) standard deviations of the components."""
        return np.sqrt(np.diag(self.covariance))


@guarded(dt="positive")
def predict(observer: Observer, q: ArrayLike, dt: float, noise: SensorNoise) -> Prediction:
    """Predict noise and lag of an observer near rest at a configuration.

    In motion, sensor noise also enters through C^T v and through the projection. The prediction omits this, which
    matters at low gains. On a wing that flaps at 6 Hz, the prediction averaged over the flight is within 13 % at
    K >= 200 1/s. At 20 1/s it is within 21 % for the first-order filters, but `second_order` has two to four times the
    small noise that is predicted. Noise of q, of torques and of known forces is not included.

    Args:
        observer: `momentum`, `force_level` or `second_order`, with one gain.
        q: (nq,) configuration.
        dt: sample interval [s].
        noise: noise of the sensors.

    Raises:
        ObserverError: the observer has no closed form, or it has several gains.
        ShapeError: q does not fit the model.
    """
    _order(observer)
    if observer.gain.ndim:
        raise ObserverError(f"gain of shape {observer.gain.shape}: one number was expected")
    model, q = observer.model, checked(q, observer.model.nq, "q")
    root = pin.crba(model, model.createData(), q) * noise.deviations(model)
    momentum = root @ root.T
    J, still = observer.applications.jacobian(q), np.zeros(model.nv)
    believed, scale = observer.believed.map(still), observer.applications.scale
    P = scale[:, None] * np.linalg.pinv((scale[:, None] * (J @ believed)).T, rcond=RANK_TOLERANCE) @ believed.T
    factor = noise_gain(observer, float(observer.gain), dt) ** 2
    components = factor * P @ momentum @ P.T
    hidden = np.isinf(judge(observer.applications, J[None], still[None], observer.believed).deviation)
    components[hidden, :] = components[:, hidden] = np.inf
    return Prediction(observer.applications.components, components, lag_of(observer, float(observer.gain), dt))


def noise_gain(observer: Observer | type[Observer], gain: float, dt: float) -> float:
    """Return the standard deviation of the residual divided by that of the momentum noise per sample [1/s]."""
    order = _order(observer)
    x = gain * dt * (1.0 if order == 1 else RISE)
    d, e, D = np.exp(-x), -np.expm1(-x), np.exp(-2.0 * x)
    if order == 1:
        return float(np.sqrt(2.0 / (1.0 + d)) * e / dt)
    once, twice, thrice = (1.0 / (-np.expm1(-2.0 * x)) ** i for i in (1, 2, 3))
    P, Q = 2.0 * x * d - e, x * e
    tail = P * P * once - 2.0 * P * Q * D * twice + Q * Q * D * (1.0 + D) * thrice
    return float(np.sqrt((e - x * d) ** 2 + e * e * tail) / dt)


def lag_of(observer: Observer | type[Observer], gain: float, dt: float) -> float:
    """Return the lag of the estimate of a slowly varying force behind the force's interval means [s]."""
    order = _order(observer)
    x = gain * dt * (1.0 if order == 1 else RISE)
    d, e = np.exp(-x), -np.expm1(-x)
    return float(dt * (d / e if order == 1 else d * (x - e) / (e * e) + 2.0 * d / e))


@guarded(dt="positive")
def gain_for_lag(observer: Observer | type[Observer], dt: float, lag: float) -> float:
    """Return the gain K [1/s] at which an estimate has a wanted lag [s]. Raises ObserverError if no gain has it."""
    return _solve(lambda gain: lag_of(observer, gain, dt), lag, dt, "lag", "s")


@guarded(dt="positive")
def gain_for_deviation(
    observer: Observer, q: ArrayLike, dt: float, noise: SensorNoise, label: str, deviation: float
) -> float:
    """Return the gain K [1/s] at which a component has a wanted standard deviation.

    Args:
        observer: as in `predict`; the result does not depend on its present gain.
        q: (nq,) configuration.
        dt: sample interval [s].
        noise: noise of the sensors.
        label: label of the component, such as `tool.Fx`.
        deviation: wanted standard deviation [N or N m].

    Raises:
        ObserverError: for the same reasons as `predict`, or there is no such component, or the component cannot be
            determined, or no gain gives this deviation.
    """
    now = predict(observer, q, dt, noise)
    if label not in now.labels:
        raise ObserverError(f"no component '{label}'; there are {', '.join(now.labels)}")
    current = float(now.deviation[now.labels.index(label)])
    if not np.isfinite(current):
        raise ObserverError(
            f"component '{label}' cannot be determined with any gain: it belongs to a pattern that leaves no trace"
        )
    unit = current / noise_gain(observer, float(observer.gain), dt)
    unit_name = "N m" if label.rstrip("'")[-2] == "M" else "N"
    return _solve(lambda gain: unit * noise_gain(observer, gain, dt), deviation, dt, "deviation", unit_name)


def _solve(value: Callable[[float], float], wanted: float, dt: float, name: str, unit: str) -> float:
    """Return the gain K at which a monotone function of K has a wanted value, for K dt from 1e-5 to 50."""
    from scipy.optimize import brentq  # takes a third of a second to import; only this function needs it

    ends = sorted(value(x / dt) for x in GAIN_RANGE)
    if not ends[0] < wanted < ends[1]:
        raise ObserverError(
            f"{name} = {wanted} {unit}: with samples every {dt} s, gains give {ends[0]:.3g} to {ends[1]:.3g} {unit}"
        )
    exponent = brentq(lambda s: value(np.exp(s) / dt) - wanted, *np.log(GAIN_RANGE), xtol=1e-12)
    return float(np.exp(exponent) / dt)


def _order(observer: Observer | type[Observer]) -> int:
    """Return the order of the observer's filter. Raises ObserverError for an observer without a closed form."""
    if observer.name not in ORDERS:
        raise ObserverError(f"observer {observer.name} has no closed form; there is one for {', '.join(ORDERS)}")
    return ORDERS[observer.name]
