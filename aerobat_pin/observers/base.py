"""One interface for all observers: `reset` and `update` on a stream, `run` on arrays; the result is an `Estimate`."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from aerobat_pin.arrays import Array
from aerobat_pin.errors import ObserverError, ShapeError
from aerobat_pin.observers.force_points import RANK_TOLERANCE, ForcePoints
from aerobat_pin.observers.residual import IntervalResidual, Known

DEFAULT_GAIN = 1000.0  # [1/s]


@dataclass(frozen=True)
class Identifiability:
    """What the geometry lets an observer know, at the worst configuration of a run.

    Attributes:
        rank: number of force components that can be told apart.
        singular_values: (3n,) of the weighted map from forces to generalised forces, largest first.
        null_direction: (n, 3) unit pattern of forces that leaves no trace, in world axes; None at full rank.
    """

    rank: int
    singular_values: Array
    null_direction: Array | None

    @property
    def condition(self) -> float:
        """Largest over smallest singular value; infinite where the rank is not full."""
        smallest = self.singular_values[-1]
        return float(self.singular_values[0] / smallest) if self.null_direction is None else float("inf")


@dataclass(frozen=True)
class Sample:
    """One estimate: forces (n, 3) [N] in world axes at the frames, and the generalised residual (nv,)."""

    force: Array
    residual: Array


@dataclass(frozen=True)
class Estimate:
    """A run of estimates; number k belongs to the interval [time_k, time_k+1].

    Attributes:
        observer: name of the observer.
        gain: its gain [1/s].
        frames: names of the n frames the forces act at.
        time: (m + 1,) sample times [s].
        force: (m, n, 3) [N] in world axes.
        residual: (m, nv) estimated generalised force.
        identifiability: what could be known at all.
    """

    observer: str
    gain: Array
    frames: tuple[str, ...]
    time: Array
    force: Array
    residual: Array
    identifiability: Identifiability


class Observer(ABC):
    """A first-order momentum observer of forces at given frames.

    Args:
        model: any model, free-flyer or fixed base.
        frames: names of the frames at which the unknown forces act.
        gain: K [1/s], one number or one per filtered quantity.

    Raises:
        FrameNotFoundError: a frame is not in the model.
        ObserverError: the gain is not finite and positive, or has the wrong length.
    """

    name: ClassVar[str]

    def __init__(self, model: pin.Model, frames: Sequence[str], gain: ArrayLike = DEFAULT_GAIN) -> None:
        """Prepare the filter; `reset` starts it."""
        self.model = model
        self.points = ForcePoints(model, frames)
        self.gain = np.array(gain, float)
        size = self._filtered_size
        if self.gain.shape not in ((), (size,)):
            raise ObserverError(f"gain of shape {self.gain.shape}: one number or {size} numbers were expected")
        if not (np.all(np.isfinite(self.gain)) and np.all(self.gain > 0.0)):
            raise ObserverError(f"gain = {self.gain}: a finite positive gain in 1/s was expected")
        self._interval = IntervalResidual(model)
        self._filtered = np.zeros(size)
        self._latest = Sample(np.zeros((len(self.points.frames), 3)), np.zeros(model.nv))

    @property
    @abstractmethod
    def _filtered_size(self) -> int:
        """Number of filtered quantities."""

    @abstractmethod
    def _observe(self, decay: Array, phi: Array, q_middle: Array) -> Sample:
        """Filter one interval's mean external generalised force phi (nv,) and turn it into forces."""

    def reset(self, q: ArrayLike, v: ArrayLike, time: float = 0.0) -> None:
        """Start anew from a sample, at rest or in flight: the estimate is zero and p0 is this sample's momentum."""
        self._interval.reset(q, v, time)
        self._filtered[:] = 0.0
        self._latest = Sample(np.zeros_like(self._latest.force), np.zeros_like(self._latest.residual))

    def update(self, time: float, q: ArrayLike, v: ArrayLike, tau: ArrayLike, known: Known | None = None) -> Sample:
        """Take the next sample and return the estimate for the interval since the last one.

        Args:
            time: of the sample [s]; steps may vary, and a repeated stamp changes nothing.
            q: (nq,) configuration at that time.
            v: (nv,) velocity at that time.
            tau: (nv,) measured joint torque, mean over the interval.
            known: name -> (nv,) other known generalised forces, means over the interval.

        Raises:
            ObserverError: no reset before, or time runs backwards.
            ShapeError: an array does not fit the model or is not finite.
        """
        advanced = self._interval.advance(time, q, v, tau, known or {})
        if advanced is not None:
            dt, phi, q_middle = advanced
            self._latest = self._observe(np.exp(-self.gain * dt), phi, q_middle)
        return self._latest

    def run(
        self, time: ArrayLike, q: ArrayLike, v: ArrayLike, tau: ArrayLike, known: Mapping[str, ArrayLike] | None = None
    ) -> Estimate:
        """Estimate over a whole record.

        Args:
            time: (m + 1,) sample times [s].
            q: (m + 1, nq) configurations.
            v: (m + 1, nv) velocities.
            tau: (m, nv) measured joint torque, interval means.
            known: name -> (m, nv) other known generalised forces, interval means.

        Raises:
            ObserverError, ShapeError: as in `update`.
        """
        time, q, v, tau = (np.asarray(x, float) for x in (time, q, v, tau))
        channels = {name: np.asarray(force, float) for name, force in (known or {}).items()}
        intervals = len(time) - 1
        if intervals < 1:
            raise ShapeError(f"{len(time)} samples: at least two are needed")
        for name, rows, expected in (
            ("q", len(q), intervals + 1),
            ("v", len(v), intervals + 1),
            *((name, len(force), intervals) for name, force in {"tau": tau, **channels}.items()),
        ):
            if rows != expected:
                raise ShapeError(f"{name} has {rows} rows: {expected} were expected for {len(time)} samples")
        force = np.empty((intervals, len(self.points.frames), 3))
        residual = np.empty((intervals, self.model.nv))
        self.reset(q[0], v[0], time[0])
        for k in range(intervals):
            known_k = {name: values[k] for name, values in channels.items()}
            sample = self.update(time[k + 1], q[k + 1], v[k + 1], tau[k], known_k)
            force[k], residual[k] = sample.force, sample.residual
        return Estimate(self.name, self.gain.copy(), self.points.frames, time, force, residual, self.identifiability(q))

    def identifiability(self, q: ArrayLike, samples: int = 64) -> Identifiability:
        """Find the worst of up to `samples` configurations (m, nq) spread evenly over a run."""
        q = np.atleast_2d(np.asarray(q, float))
        chosen = q[np.unique(np.linspace(0, len(q) - 1, samples).astype(int))]
        found = [self.points.singular_values(one) for one in chosen]
        values, vectors = min(found, key=lambda item: float(item[0][-1] / item[0][0]))
        rank = int(np.sum(values > RANK_TOLERANCE * values[0]))
        null = None if rank == len(values) else vectors[-1].reshape(-1, 3)
        return Identifiability(rank, values, null)
