"""A Kalman filter of momentum and forces, and its smoother; both know the standard deviations of their estimates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, ClassVar, NoReturn

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from aerobat_pin.errors import ObserverError, ShapeError
from aerobat_pin.numerics import (
    LARGEST_REAL,
    Array,
    announce_compilation,
    checked,
    fields_of,
    guarded,
    new_state,
    shown,
)
from aerobat_pin.observers.analysis.noise_and_lag import SensorNoise
from aerobat_pin.observers.applications import Application
from aerobat_pin.observers.estimate import Estimate, Innovation, Sample
from aerobat_pin.observers.expected import Expected
from aerobat_pin.observers.kalman import kernels
from aerobat_pin.observers.kalman.kalman_state import KalmanState, new_steps
from aerobat_pin.observers.kalman.learning import DIFFERENCE_GAIN, LEAST_INFORMATION, ROOT_MEAN
from aerobat_pin.observers.kalman.noisy_sample import inertias_at, kinship_of
from aerobat_pin.observers.kalman.smoother_kernels import smooth_all
from aerobat_pin.observers.momentum_equations import Observed, Samples
from aerobat_pin.observers.observer import DEFAULT_GAIN, Observer
from aerobat_pin.observers.rows import Rows, moving_weight
from aerobat_pin.observers.samples import Sampled

SENSOR_NOISE = (0.02, 0.01, 0.05)  # per sample: linear velocity [m/s], gyro [rad/s], joint rates [rad/s]
WORLD = pin.Convention.WORLD
RISE_PULSATION = 1.75  # w / K: a second-order Butterworth filter of pulsation w [rad/s] rises to 1 - 1/e in 1.753 / w
WALK, PRIOR = 2.2, 0.33  # of a robot's weight [1/sqrt(s), 1]: how much a force changes in 1 s, and its size at first
LEAST_MISFIT = 0.004  # of a robot's weight: no model is better than that
KNOWN_NOISE = 0.02  # of a robot's weight: limit for the noise of known forces in a row, moments over `MOMENT_ARM`
HEAD_START = 2.5  # [1 / pulsation] of random walk before the first interval, so that a step at the start rises as later


def compute_inertias(model: pin.Model, data: pin.Data, q: Array, _: Array) -> None:
    """Let Pinocchio compute M, the inertias of the subtrees about the world's origin, the Jacobians and placements."""
    pin.crba(model, data, q, WORLD)


class KalmanObserver(Observer):
    """A Kalman filter that estimates momentum and random-walk forces from noisy velocities.

        p' = u + J^T f + C^T v - g + model errors,   f' = white noise,   measured: M v + M (sensor noise)

    Known forces and the mass can be wrong by unknown, slowly changing factors. The filter estimates these factors
    together with the forces. If the rows cannot distinguish a factor from a force, the standard deviations are large.
    Other errors of the model are white noise on every row, as large as what no force explains (see `redundancy`), and
    the sum of torques and other known forces has the white noise that the record shows, in each row up to a fiftieth of
    the robot's weight (moments over 50 mm).
    Patterns of forces that leave no trace in the rows are held at zero, with infinite standard deviations, unless it is
    `expected` how large forces are: then they fade to zero, and their deviations grow to what is expected. C^T v is
    taken at the filter's own velocity, not at the measured one: on a tumbling robot the noise of the measured velocity
    passes it with a gain of about 3.

    Args:
        model: any model, free-flyer or fixed base.
        applications: where unknown forces act, as in `Observer`; at least one.
        gain: K [1/s], one number; used only if `force_walk` is `"gain"`.
        rows: which rows to use; in the other rows any torque is considered possible.
        sensor_noise: standard deviations per sample of linear velocity [m/s], gyro [rad/s] and joint rates [rad/s;
            m/s where a joint slides]. On a fixed base the last one applies to all velocities. If the record shows less
            noise, that is believed.
        force_walk: standard deviation of the change of a force in one second [N/sqrt(s)], one number or one per
            component; when omitted, 2.2 times the robot's weight (on a fixed base: of all that moves). One number is
            multiplied by a lever arm of 50 mm for moments. With `"gain"` the filter follows every pattern of forces
            like a second-order Butterworth filter that rises to 63 % in 1/K, if the model is exact: this walk is
            computed anew in every interval, and of the stated sensor noise only the ratios matter, whatever the record.
        prior: standard deviation [N] of the forces at the start; when omitted, a third of the robot's weight, or
            what is `expected`.
        known_error: name of a known force -> standard deviation of the error of its factor: 0.2 for "right to 20 %".
        mass_error: the same for the mass; the inertias change in proportion.
        error_time: correlation time of these factors, and of what is `expected` [s].
        misfit: size of fast errors of the same forces [sqrt(s)]. Every row gets white noise of `misfit` times the
            running root mean square of the row's possible error, which is `known_error` and `mass_error` times the
            forces to which they apply.
        frequency: flapping frequency [Hz]. If given, each force is a0 + a1 cos + b1 sin at this frequency, and all
            three coefficients are random walks.
        expected: how large forces and lasting errors of the rows are. An error of a row that lasts is then not taken
            for noise, and a force that the pose does not show stays within its size; a given `force_walk` stays a walk.

    Raises:
        FrameNotFoundError: a frame is not in the model.
        ObserverError: as for `Observer`, or there is more than one gain, or a setting is not finite and positive.
    """

    name = "kalman"
    _smooths: ClassVar[bool] = False  # whether a smoother walks back over a record
    _compute = staticmethod(compute_inertias)

    @guarded(
        gain="any",
        rows="free",
        force_walk="any",
        known_error="any",
        prior="any",
        mass_error="any",
        error_time="any",
        misfit="any",
        frequency="any",
    )
    def __init__(
        self,
        model: pin.Model,
        applications: Sequence[str | Application] = (),
        gain: ArrayLike = DEFAULT_GAIN,
        rows: Rows = "all",
        *,
        sensor_noise: Sequence[float] = SENSOR_NOISE,
        force_walk: ArrayLike | str | None = None,
        prior: float | None = None,
        known_error: Mapping[str, float] | None = None,
        mass_error: float = 0.0,
        error_time: float = 1.0,
        misfit: float = 0.01,
        frequency: float | None = None,
        expected: Expected | None = None,
    ) -> None:
        """Prepare the filter; `reset` starts it."""
        super().__init__(model, applications, gain, rows)
        given = {"sensor_noise": sensor_noise, "force_walk": force_walk, "prior": prior, "misfit": misfit}
        errors_given = {"known_error": known_error, "mass_error": mass_error, "error_time": error_time}
        self._settings = {**given, **errors_given, "frequency": frequency}
        if self.gain.shape != ():
            raise ObserverError(f"gain of shape {self.gain.shape}: observer {self.name} takes one number")
        nv, scale, blocks = self._nv, self.applications.scale, 1 if frequency is None else 3
        if np.shape(sensor_noise) != (3,):
            raise ObserverError(f"sensor_noise = {sensor_noise}: three numbers were expected: linear, gyro, joints")
        noise = SensorNoise(*(_positive("sensor_noise", size) for size in sensor_noise)).deviations(self.model)
        self._errors = tuple(known_error or ())
        errors = [_positive(f"known_error of {name}", size) for name, size in (known_error or {}).items()]
        if mass_error != 0.0:
            errors.append(_positive("mass_error", mass_error))
        hidden, lasting = self._hidden(), 0 if expected is None else nv
        uncertain = len(self._errors) + lasting
        coefficients = blocks * len(scale) + uncertain + int(mass_error != 0.0)
        self._step_sizes = {"nv": nv, "c": len(scale), "blocks": blocks, "nz": coefficients}
        sizes = {"ne": uncertain, "nr": lasting, "nh": len(hidden), "mass_in_doubt": mass_error != 0.0}
        sizes |= {"power_known": rows == "base+power", **self._step_sizes, **self._sizes._asdict()}
        self._memory = new_state(KalmanState, **sizes)
        self._kalman = fields_of(self._memory, KalmanState)
        self._fill(self._kalman.observer)
        filter_ = self._kalman.filter
        filter_.noise[:], filter_.hidden[:] = noise, hidden
        filter_.inertias[:] = inertias_at(self.model, self.data)
        filter_.tree[:] = kinship_of(self.model)
        filter_.gravity[:] = self.model.gravity.vector
        if frequency is not None:
            filter_.pulsation[:] = 2.0 * np.pi * _positive("frequency", frequency)
        filter_.scale[:] = scale
        self._walks = blocks * len(scale)
        factors = [*range(len(self._errors)), *range(len(self._errors) + lasting, len(errors) + lasting)]
        filter_.variance[self._walks :][factors] = np.square(errors)
        filter_.rate[self._walks :] = 1.0 / _positive("error_time", error_time)
        filter_.misfit[:] = _positive("misfit", misfit)
        self._by_gain, weight = isinstance(force_walk, str), moving_weight(model)
        first = _positive("prior", PRIOR * weight if prior is None else prior)
        filter_.doubtful[:] = first, LEAST_MISFIT * weight
        filter_.known_noise[:] = KNOWN_NOISE * weight / self.believed.weight
        self._prior = np.tile(np.square(first * scale), blocks)
        filter_.walk[:] = self._walk(WALK * weight if force_walk is None else force_walk)
        if expected is not None:
            expected.refuse_unusable(len(scale), nv)
            self.expected = expected
            self._expect(expected)
        self._width = nv + 2 * len(scale) + nv + 1 + nv
        self._update = kernels.update_filter

    def _walk(self, given: ArrayLike | str) -> Array:
        """Return the covariance (c, c) that a walk adds to the components in a second; zero if the gain sets it."""
        scale = self.applications.scale
        if isinstance(given, str):
            if given != "gain":
                raise ObserverError(f"force_walk = {given!r}: a number in N/sqrt(s) or 'gain' was expected")
            return np.zeros((len(scale), len(scale)))
        walk = np.array(given, float)
        if walk.shape not in ((), scale.shape) or not (np.all(walk > 0.0) and np.all(walk <= LARGEST_REAL)):
            raise ObserverError(f"force_walk = {given}: one finite positive number or {len(scale)} were expected")
        return np.diag(np.square(walk * scale if walk.shape == () else walk))

    @guarded()
    def trust_model(self, misfit: float) -> None:
        """Assume smaller errors of the model, which somebody else states: at least `misfit` [N] a row, over 10 ms."""
        self._kalman.filter.doubtful[1] = _positive("misfit", misfit)

    def __reduce__(self) -> tuple[Any, ...]:
        return (*super().__reduce__(), float(self._kalman.filter.doubtful[1]))

    def __setstate__(self, misfit: float) -> None:
        self._kalman.filter.doubtful[1] = misfit

    def update(
        self, time: float, q: ArrayLike, v: ArrayLike, tau: ArrayLike, known: Mapping[str, ArrayLike] | None = None
    ) -> Sample:
        """Take the next sample as `Observer.update` does, and return a `Sample` with deviations.

        Raises:
            ObserverError: for the same reasons as in `Observer.update`, or a force named in `known_error` is missing.
            ShapeError: for the same reasons as in `Observer.update`.
        """
        for row, name in zip(self._kalman.filter.errors, self._errors, strict=False):  # row errors follow
            row[:] = checked(self._of(known, name), self._nv, name)
        return super().update(time, q, v, tau, known)

    def _expect(self, expected: Expected) -> None:
        filter_, first = self._kalman.filter, self._walks + len(self._errors)
        filter_.rows[:] = expected.row_error**2, expected.stiction**2 / 3.0, expected.stiction_rate
        filter_.variance[first : first + self._nv] = expected.doubt
        if self._settings["force_walk"] is None:
            filter_.rate[: self._walks], filter_.walk[:] = filter_.rate[first], 0.0
            filter_.variance[: self._walks] = np.tile(expected.force**2, self._walks // self._count)
            if self._settings["prior"] is None:
                self._prior[:] = filter_.variance[: self._walks]

    @property
    def doubted_forces(self) -> tuple[str, ...]:
        """Names of the known forces whose factors can be wrong."""
        return self._errors

    def _of(self, known: Mapping[str, ArrayLike] | None, name: str) -> ArrayLike:
        """Return the known force of a given name. Raises ObserverError if it is missing."""
        known = {} if known is None else known
        if not isinstance(known, Mapping):
            raise ObserverError(f"known = {shown(known)}: a mapping from names to forces was expected")
        if name not in known:
            names = ", ".join(map(str, known)) or "none"
            raise ObserverError(f"known_error names '{name}': the known forces are {names}")
        return known[name]

    def _hidden(self) -> Array:
        """Return the projector (nv, nv) onto generalised forces that do not change the rows in use; (0, 0) if none."""
        shown = self.believed.map(np.zeros(self._nv))
        basis, sizes, _ = np.linalg.svd(shown)
        hidden = basis[:, int(np.sum(sizes > LEAST_INFORMATION * sizes[0])) :]
        return hidden @ hidden.T if hidden.shape[1] else np.zeros((0, 0))

    def _start(self, v: Array) -> None:
        sample = self._kalman.filter.samples[0]
        kernels.record_noisy_sample(self._memory, v, sample)
        self._begin(self._kalman, sample)

    def _begin(self, kalman: KalmanState, sample: Array) -> None:
        """Start the filter at a sample, with zero estimated forces and the initial uncertainty from the settings."""
        filter_ = kalman.filter
        spread = filter_.variance.copy()
        kalman.observer.newest[:] = 0
        for start in (filter_.elapsed, filter_.intervals, filter_.disbelief, filter_.slow):
            start[:] = 0.0
        filter_.sensed[:], filter_.known_sensed[:] = filter_.noise, filter_.known_noise
        filter_.differences[0], filter_.known_differences[:] = sample[2], 0.0
        filter_.roots[:] = ROOT_MEAN * np.sqrt(DIFFERENCE_GAIN * filter_.noise)
        filter_.known_roots[:] = ROOT_MEAN * np.sqrt(DIFFERENCE_GAIN * filter_.known_noise)
        if self._by_gain:
            pulsation = RISE_PULSATION * float(self.gain)
            filter_.head_start[:] = HEAD_START / pulsation
            filter_.walk_gain[:] = pulsation**4
        else:
            spread[: self._walks] = self._prior
        filter_.x[:] = 0.0
        filter_.P[:] = np.diag(np.concatenate([np.square(filter_.noise), spread]))

    def _run(
        self, time: Array, q: Array, v: Array, u: Array, known: Mapping[str, ArrayLike], sampled: list[Sampled]
    ) -> tuple[Observed, Samples]:
        announce_compilation(kernels.filter_all)
        memory = self._memory.copy()  # so that a running stream is not disturbed
        kalman, nv, c, model, data = fields_of(memory, KalmanState), self._nv, self._count, self.model, self.data
        samples = np.empty((len(time), *kalman.filter.samples.shape[1:]))
        for configuration, velocity, sample in zip(q, v, samples, strict=True):
            self._compute(model, data, configuration, velocity)
            kernels.record_noisy_sample(memory, velocity, sample)
        self._begin(kalman, samples[0])
        errors = np.array([np.asarray(self._of(known, name), float) for name in self._errors])
        out, steps = np.empty((len(u), self._width)), new_steps(len(u) * self._smooths, **self._step_sizes)
        bad = kernels.filter_all(samples, time, u, errors.reshape(-1, len(u), nv), memory, steps, out)
        if bad >= 0:
            raise ShapeError(f"the residual after {time[bad]} s is not finite: q, v or a force is too large")
        if self._smooths:
            smooth_all(time, self._memory, steps, out)
            for k in np.flatnonzero(np.diff(time) == 0.0):
                out[k] = out[k - 1] if k > 0 else 0.0
        residual, f, deviation, unexplained, pivot, innovation = np.split(out, np.cumsum([nv, c, c, nv, 1]), axis=1)
        prior = np.nan if self.expected is None or self.believed.count <= c else self.expected.doubt  # by rows to spare
        doubt = None if self.expected is None else np.full(len(u), prior)
        observed = Observed(residual, f, unexplained, pivot[:, 0], deviation, doubt, innovation)
        return observed, Samples(samples[:, 0], samples[:, 1], samples[:, 2], samples[:, 3 : 3 + c])

    def _estimate(self, time: Array, observed: Observed, samples: Samples) -> Estimate:
        whitened = observed.innovation
        assert whitened is not None
        power, along = float(np.sum(whitened[:-1] ** 2)), float(np.sum(whitened[1:] * whitened[:-1]))
        nis = np.sum(whitened**2, axis=1) / self.believed.count
        innovation = Innovation(nis, along / power if power > 0.0 else 0.0)
        return replace(super()._estimate(time, observed, samples), innovation=innovation)


class SmootherObserver(KalmanObserver):
    """The Kalman filter run forward over a record, then a smoother run backward; the estimate has no lag.

    The smoother is Rauch-Tung-Striebel's in the form of Bryson and Frazier. The arguments are those of
    `KalmanObserver`. Only `run` works; `update` raises an error.
    """

    name = "smoother"
    _smooths = True

    def update(
        self, time: float, q: ArrayLike, v: ArrayLike, tau: ArrayLike, known: Mapping[str, ArrayLike] | None = None
    ) -> NoReturn:
        """Raise ObserverError: the smoother needs a whole record and cannot take single samples."""
        raise ObserverError("observer smoother needs a whole record: use run, or the observer kalman for a stream")


def _positive(name: str, value: float) -> float:
    """Return the value if it is finite and positive. Raises ObserverError with its name otherwise."""
    if not 0.0 < value <= LARGEST_REAL:
        raise ObserverError(f"{name} = {value}: a finite positive number was expected")
    return float(value)
