"""One interface for all observers: `reset` and `update` on a stream, `run` on arrays; the result is an `Estimate`.

With p = M v and Mdot = C + C^T, a robot under known generalised forces u and unknown ones u_f obeys
p' = u + u_f + C^T v - g. Every observer starts from the mean of u_f over one sample interval; see `kernels`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import pinocchio as pin
from numpy import empty
from numpy.typing import ArrayLike
from pinocchio import computeCoriolisMatrix, computeGeneralizedGravity, crba

from aerobat_pin.arrays import Array, checked
from aerobat_pin.errors import ObserverError, ShapeError
from aerobat_pin.jit import addresses, check_views, lock, motions, placements
from aerobat_pin.observers import kernels
from aerobat_pin.observers.force_points import ROWS, ForcePoints, Identifiability, Rows
from aerobat_pin.observers.kernels import update

DEFAULT_GAIN = 1000.0  # [1/s]


class Sample:
    """One estimate: forces (n, 3) [N] in world axes at the frames, and the generalised residual (nv,)."""

    __slots__ = ("_nv", "_values")

    def __init__(self, values: Array, nv: int) -> None:
        """Keep residual and forces, one after the other (nv + 3n,)."""
        self._values, self._nv = values, nv

    @property
    def force(self) -> Array:
        """Forces (n, 3) [N] in world axes."""
        return self._values[self._nv :].reshape(-1, 3)

    @property
    def residual(self) -> Array:
        """Generalised residual (nv,)."""
        return self._values[: self._nv]


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


class Observer:
    """A first-order momentum observer of forces at given frames.

    Args:
        model: any model, free-flyer or fixed base.
        frames: names of the frames at which the unknown forces act; none for the generalised residual alone.
        gain: K [1/s], one number or one per filtered quantity.
        rows: which rows of the generalised residual to believe when looking for forces: `"all"`; `"base"` where no
            joint torque is known; `"base+power"` where one motor drives all joints and its power alone is known.
            `force_level` then takes any `tau` with the right power v . tau; `momentum` filters the rows before it
            combines them, and keeps a part of what `tau` has wrong (2 % at 1000 1/s on a flapping wing).

    Raises:
        FrameNotFoundError: a frame is not in the model.
        ObserverError: rows other than `"all"` without a free-flyer base, or a gain that is not finite and positive or
            has the wrong length.
    """

    name: ClassVar[str]
    project_first: ClassVar[bool]

    def __init__(
        self, model: pin.Model, frames: Sequence[str] = (), gain: ArrayLike = DEFAULT_GAIN, rows: Rows = "all"
    ) -> None:
        """Prepare the filter; `reset` starts it."""
        if self.project_first and not frames:
            raise ObserverError(f"observer {self.name} filters forces: one frame or more was expected")
        self.model, self.data = model, model.createData()
        self.points = ForcePoints(model, frames)
        self.gain = np.array(gain, float)
        n, nv = len(self.points.frames), int(model.nv)
        size = 3 * n if self.project_first else nv
        if self.gain.shape not in ((), (size,)):
            raise ObserverError(f"gain of shape {self.gain.shape}: one number or {size} numbers were expected")
        if not (np.all(np.isfinite(self.gain)) and np.all(self.gain > 0.0)):
            raise ObserverError(f"gain = {self.gain}: a finite positive gain in 1/s was expected")
        data = self.data
        oMi = placements(data.oMi)
        check_views(model, data, oMi, placements(data.liMi), motions(data.v))
        points = self.points
        gains = np.broadcast_to(self.gain, (size,))
        if rows not in ROWS or (rows != "all" and not points.floating):
            raise ObserverError(f"rows = {rows!r}: one of {', '.join(ROWS)}; all on a fixed base")
        self.rows = rows
        places = np.append(addresses(data.M, data.C, data.g, data.J, oMi), model.njoints)
        self._store = kernels.new_store(
            places,
            gains,
            points.weight,
            points.table,
            points.support,
            project_first=self.project_first,
            rows=ROWS.index(rows),
        )
        self._width, self._nv = nv + 3 * n, nv
        # From here on other arguments than arrays of doubles raise, instead of compiling the kernel once more for them.
        lock(update, self._store, np.zeros(nv), np.zeros(nv), 1.0, np.zeros(self._width))
        self._time = float("nan")
        self._latest = Sample(np.zeros(self._width), nv)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle and copy as a fresh observer: the views of Pinocchio's results cannot travel."""
        return type(self), (self.model, self.points.frames, self.gain, self.rows)

    def reset(self, q: ArrayLike, v: ArrayLike, time: float = 0.0) -> None:
        """Start anew from a sample, at rest or in flight: the estimate is zero and p0 is this sample's momentum.

        Raises:
            ShapeError: an array does not fit the model or is not finite.
        """
        q, v = checked(q, self.model.nq, "q"), checked(v, self.model.nv, "v")
        _compute(self.model, self.data, q, v)
        kernels.start(self._store, v)
        self._time = float(time)
        self._latest = Sample(np.zeros(self._width), self._nv)

    def update(
        self, time: float, q: ArrayLike, v: ArrayLike, tau: ArrayLike, known: Mapping[str, ArrayLike] | None = None
    ) -> Sample:
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
        dt = time - self._time
        if not dt > 0.0:
            if dt == 0.0:
                return self._latest
            self._refuse_time(time)
        model, data = self.model, self.data
        out = empty(self._width)
        u: Any = tau
        try:
            if known:
                force: Any
                for force in known.values():
                    if force.shape != u.shape:  # numpy would stretch one number over all rows
                        raise TypeError
                    u = u + force
            crba(model, data, q)
            computeCoriolisMatrix(model, data, q, v)
            computeGeneralizedGravity(model, data, q)
            good = update(self._store, v, u, dt, out)  # type: ignore[arg-type]
        except (AttributeError, TypeError, ValueError):  # not arrays of doubles of the right shape
            good = False
        if not good:
            q, v, u = self._checked(q, v, tau, known or {})
            _compute(model, data, q, v)
            if not update(self._store, v, u, dt, out):
                raise ShapeError(f"the residual at {time} s is not finite: q, v or a force is too large")
        self._time = time
        self._latest = latest = Sample(out, self._nv)
        return latest

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
        time = np.ascontiguousarray(time, float)
        count = len(time) - 1
        if time.ndim != 1 or count < 1:
            raise ShapeError(f"time has shape {time.shape}: two samples or more were expected")
        nq, nv = int(self.model.nq), int(self.model.nv)
        q, v = _record(q, count + 1, nq, "q"), _record(v, count + 1, nv, "v")
        u = _record(tau, count, nv, "tau")
        for name, force in (known or {}).items():
            u = u + _record(force, count, nv, name)
        if not np.all(np.diff(time) >= 0.0):
            at = int(np.argmin(np.diff(time) >= 0.0))
            self._time = time[at]
            self._refuse_time(time[at + 1])
        model, data, collect = self.model, self.data, kernels.collect
        store = self._store.copy()  # a stream that is under way goes on undisturbed
        memory = np.empty((count + 1, 3 + 3 * len(self.points.frames), nv))
        for k, (one_q, one_v) in enumerate(zip(list(q), list(v), strict=True)):
            crba(model, data, one_q)
            computeCoriolisMatrix(model, data, one_q, one_v)
            computeGeneralizedGravity(model, data, one_q)
            collect(store, v, k, memory)
        out = np.empty((count, self._width))
        bad = kernels.observe_all(memory, time, u, store, out)
        if bad >= 0:
            raise ShapeError(f"the residual after {time[bad]} s is not finite: q, v or a force is too large")
        return Estimate(
            observer=self.name,
            gain=self.gain.copy(),
            frames=self.points.frames,
            time=time,
            force=out[:, nv:].reshape(count, -1, 3),
            residual=out[:, :nv],
            identifiability=self.points.identifiability(memory[:, 3:], memory[:, 2], self.rows),
        )

    def _checked(
        self, q: ArrayLike, v: ArrayLike, tau: ArrayLike, known: Mapping[str, ArrayLike]
    ) -> tuple[Array, Array, Array]:
        """Return q, v and the sum of the known forces as a kernel takes them. Raises ShapeError naming what is not."""
        u = checked(tau, self._nv, "tau")
        for name, force in known.items():
            u = u + checked(force, self._nv, name)
        return checked(q, self.model.nq, "q"), checked(v, self._nv, "v"), u

    def _refuse_time(self, time: float) -> None:
        if np.isnan(self._time):
            raise ObserverError("reset(q, v) must come before the first update")
        raise ObserverError(f"time went from {self._time} s to {time} s: stamps must not decrease")


def _compute(model: pin.Model, data: pin.Data, q: Any, v: Any) -> None:
    """Let Pinocchio fill M, C, g, the world Jacobians and the placements that the kernels look at."""
    crba(model, data, q)
    computeCoriolisMatrix(model, data, q, v)
    computeGeneralizedGravity(model, data, q)


def _record(values: ArrayLike, rows: int, columns: int, name: str) -> Array:
    """Return a record as a contiguous (rows, columns) array of finite doubles. Raises ShapeError naming it."""
    table = np.ascontiguousarray(values, float)
    if table.ndim != 2 or table.shape[1] != columns:
        raise ShapeError(f"{name} has shape {table.shape}: ({rows}, {columns}) was expected")
    if len(table) != rows:
        raise ShapeError(f"{name} has {len(table)} rows: {rows} were expected")
    if not np.all(np.isfinite(table)):
        raise ShapeError(f"{name} holds NaN or infinity in row {int(np.argmin(np.all(np.isfinite(table), axis=1)))}")
    return table
