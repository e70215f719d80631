"""One interface for all observers: `reset` and `update` for a stream of samples, `run` for a whole record.

With p = M v and Mdot = C + C^T, a robot under known generalised forces u and unknown generalised forces u_f obeys
p' = u + u_f + C^T v - g. Every observer first computes the mean of u_f over one sample interval; see `kernels`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
import pinocchio as pin
from numpy import empty
from numpy.typing import ArrayLike

from aerobat_pin.errors import ObserverError, ShapeError
from aerobat_pin.numerics import (
    Array,
    addresses,
    check_views,
    checked,
    fields_of,
    guarded,
    lock,
    model_bytes,
    motions,
    new_state,
    number,
    placements,
    rebuilt,
)
from aerobat_pin.observers.applications import Application, Applications
from aerobat_pin.observers.estimate import Estimate, Sample
from aerobat_pin.observers.expected import Expected
from aerobat_pin.observers.identifiability import judge
from aerobat_pin.observers.kernels import residual as kernels
from aerobat_pin.observers.kernels.filters import FIRST_ORDER
from aerobat_pin.observers.kernels.observer_state import ObserverSizes, ObserverState
from aerobat_pin.observers.momentum_equations import Equations, Observed, Samples, observe_record, sample_robot
from aerobat_pin.observers.rows import BelievedRows, Rows, moving_weight, serial_model
from aerobat_pin.observers.samples import (
    Sampled,
    check_configurations,
    checked_inputs,
    compute_dynamics,
    directions_of,
    modes,
)

DEFAULT_GAIN = 1000.0  # [1/s]


class Observer:
    """A momentum observer: estimates the unknown forces at given frames.

    Args:
        model: any model, free-flyer or fixed base, of joints that `rows` knows.
        applications: where unknown forces act: names of frames, at whose origins a force acts, or `Application`s for a
            wrench, a force along a line, or frame axes. Leave it empty to estimate only the generalised residual.
        gain: K [1/s]: one number, one number per filtered quantity, or a symmetric positive definite matrix.
        rows: which rows of the generalised residual to use when computing forces: `"all"`; `"base"` if no joint
            torque is known; `"base+power"` if one motor drives all joints and only its power is known; a `Tie`; or
            `AllBut("rail")` to believe all rows but those named.
            With `"base+power"` only the power v . tau of `tau` must be right if the observer projects first.
            `momentum` filters the rows before it combines them, so part of an error in `tau` remains (2 % at 1000 1/s
            on a flapping wing).
        expected: how large forces and errors of the rows are expected to be. The estimate is then the posterior mean,
            which states its deviation and is small where the pose shows little; when omitted, any size is expected:
            the rows alone decide.

    Raises:
        FrameNotFoundError: a frame is not in the model.
        ObserverError: the model lacks these rows or has a joint that observers cannot use, or the gain has the wrong
            shape or is not finite and positive.
    """

    name: ClassVar[str]
    project_first: ClassVar[bool] = True
    kind: ClassVar[int] = FIRST_ORDER
    slope: float = 0.0  # [N/s], used by the super-twisting filter only
    _result: ClassVar[type[Sample]] = Sample
    _compute: ClassVar[Any] = staticmethod(compute_dynamics)  # what Pinocchio does at a sample
    _settings: Mapping[str, Any] = MappingProxyType({})  # arguments that only one kind of observer has

    @guarded(gain="any", rows="free")
    def __init__(
        self,
        model: pin.Model,
        applications: Sequence[str | Application] = (),
        gain: ArrayLike = DEFAULT_GAIN,
        rows: Rows = "all",
        expected: Expected | None = None,
    ) -> None:
        """Prepare the filter; `reset` starts it."""
        if self.project_first and len(applications) == 0:
            raise ObserverError(f"applications: observer {self.name} filters forces: one frame or more was expected")
        self.model = model = serial_model(model)
        self.data = model.createData()
        self.applications = Applications(model, applications)
        self.believed = BelievedRows(model, rows)
        count, nv, self._directions = len(self.applications.components), int(model.nv), directions_of(model)
        if expected is not None:
            expected.refuse_unusable(count, nv)
        self.expected = expected if count else None
        self.gain = np.array(gain, float)
        self._gains, self._basis = modes(self.gain, count if self.project_first else nv)
        self._sizes = ObserverSizes(
            nv=nv,
            joints=int(model.njoints),
            components=count,
            filtered=len(self._gains),
            basis=len(self._basis),
            tied=self.believed.tied.shape[1],
            project_first=int(self.project_first),
            rows=self.believed.number,
            filter=self.kind,
            directions=len(self._directions),
            believed=self.believed.count,
            expected=int(self.expected is not None),
        )
        self._nv, self._count = nv, count
        self._width = nv + count if self.expected is None else nv + 2 * count + 1
        self._memory = new_state(ObserverState, **self._sizes._asdict())
        self._fill(fields_of(self._memory, ObserverState))
        self._update: Any = kernels.update_observer
        self._time = float("nan")
        self._latest = self._result(np.zeros(self._width), self._nv, self._count)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle and copy as a new observer that is not yet reset: views of Pinocchio's results cannot be pickled."""
        arguments = (model_bytes(self.model), self.applications.given, self.gain, self.believed.rows)
        settings = {**self._settings} if self.expected is None else {**self._settings, "expected": self.expected}
        return rebuilt, (partial(type(self), **settings), *arguments)

    def __repr__(self) -> str:
        gain = np.array2string(self.gain, precision=4, threshold=12)
        components = ", ".join(self.applications.components) or "nothing: the generalised residual alone"
        return (
            f"{type(self).__name__} '{self.name}' on '{self.model.name}', {self._nv} velocities\n"
            f"  rows '{self.believed.name}', gain {gain} 1/s\n  looks for {components}"
        )

    def _fill(self, memory: ObserverState) -> None:
        """Write the constants into a new memory."""
        self._look_at(self.data, memory)
        memory.directions[:], memory.slope[:] = np.reshape(self._directions, (-1, 2)), self.slope
        memory.gain[:], memory.basis[:] = self._gains, self._basis
        memory.weight[:], memory.tied[:] = self.believed.weight, self.believed.tied
        if self.expected is not None:
            self.expected.write(memory.posterior)
        memory.components[:], memory.support[:] = self.applications.table, self.applications.support

    def _look_at(self, data: pin.Data, memory: ObserverState) -> None:
        """Let the kernels read Pinocchio's results in some data."""
        check_views(self.model, data, oMi := placements(data.oMi), placements(data.liMi), motions(data.v))
        memory.robot[:] = addresses(data.M, data.C, data.g, data.J, oMi)

    @guarded()
    def expect(self, expected: Expected) -> None:
        """Expect other sizes from now on. Raises ObserverError if none were expected, or they do not fit the robot."""
        if self.expected is None:
            raise ObserverError("expect: this observer was made without sizes that are expected")
        expected.refuse_unusable(self._count, self._nv)
        self.expected = expected
        self._expect(expected)

    def _expect(self, expected: Expected) -> None:
        """Let the kernels expect these sizes."""
        expected.write(fields_of(self._memory, ObserverState).posterior)

    @guarded()
    def reset(self, q: ArrayLike, v: ArrayLike, time: float = 0.0) -> None:
        """Start again from a sample, at rest or in flight: the estimate is zero and p0 is the momentum of this sample.

        Raises:
            ShapeError: an array does not fit the model or is not finite, a quaternion does not have length one, or a
                coordinate is beyond a million metres or radians.
        """
        q, v = checked(q, self.model.nq, "q"), checked(v, self.model.nv, "v")
        check_configurations(self._directions, q[None])
        # Only streams need this kernel compiled. From here on, it accepts only arrays of doubles and raises otherwise.
        lock(self._update, self._memory.copy(), q, v, v, 1.0, np.zeros(self._width))
        self._compute(self.model, self.data, q, v)
        self._start(v)
        self._time = time
        self._latest = self._result(np.zeros(self._width), self._nv, self._count)

    def update(
        self, time: float, q: ArrayLike, v: ArrayLike, tau: ArrayLike, known: Mapping[str, ArrayLike] | None = None
    ) -> Sample:
        """Take the next sample and return the estimate for the interval since the previous sample.

        Args:
            time: time of the sample [s]. Steps can vary; a sample with the same time as the previous one is ignored.
            q: (nq,) configuration at that time.
            v: (nv,) velocity at that time.
            tau: (nv,) measured joint torque, mean over the interval.
            known: name -> (nv,) other known generalised forces, means over the interval.

        Raises:
            ObserverError: `reset` was not called before, or the time decreased.
            ArgumentError, ShapeError: as in `reset`.
        """
        try:
            dt = time - self._time
            if not dt > 0.0:
                if dt == 0.0:
                    return self._latest
                self._refuse_time(time)
        except (TypeError, ValueError, OverflowError):
            number(time, "time", "any")
            raise
        model, data, out = self.model, self.data, empty(self._width)
        u: Any = tau
        try:
            if known:
                force: Any
                for force in known.values():
                    if force.shape != u.shape:  # numpy would broadcast one number to all rows
                        raise TypeError
                    u = u + force
            self._compute(model, data, q, v)
            good = self._update(self._memory, q, v, u, dt, out)
        except (AttributeError, TypeError, ValueError):  # not arrays of doubles of the right shape
            good = False
        if not good:
            time = number(time, "time")
            q, v, u = self._checked(q, v, tau, known)
            self._compute(model, data, q, v)
            if not self._update(self._memory, q, v, u, dt, out):
                raise ShapeError(f"the residual at {time} s is not finite: q, v or a force is too large")
        self._time = time
        self._latest = latest = self._result(out, self._nv, self._count)
        return latest

    @guarded(q="any", v="any", tau="any", known="any", sampled="free")
    def run(
        self,
        time: ArrayLike,
        q: ArrayLike,
        v: ArrayLike,
        tau: ArrayLike,
        known: Mapping[str, ArrayLike] | None = None,
        sampled: list[Sampled] | None = None,
    ) -> Estimate:
        """Estimate over a whole record.

        Args:
            time: (m + 1,) sample times [s].
            q: (m + 1, nq) configurations.
            v: (m + 1, nv) velocities.
            tau: (m, nv) measured joint torque, interval means.
            known: name -> (m, nv) other known generalised forces, interval means.
            sampled: what others took from this very record, used where robot and forces are the same, else added to.

        Raises:
            ObserverError, ShapeError: for the same reasons as `update` and `reset`.
        """
        time, q, v, u = checked_inputs(self.model, self._directions, time, q, v, tau, known or {})
        if not np.all(np.diff(time) >= 0.0):
            at = int(np.argmin(np.diff(time) >= 0.0))
            self._time = time[at]
            self._refuse_time(time[at + 1])
        return self._estimate(time, *self._run(time, q, v, u, known or {}, [] if sampled is None else sampled))

    def _start(self, v: Array) -> None:
        """Start the filter at the sample for which Pinocchio has just computed M, C and g."""
        kernels.start_observer(self._memory, v)

    def _run(
        self, time: Array, q: Array, v: Array, u: Array, known: Mapping[str, ArrayLike], sampled: list[Sampled]
    ) -> tuple[Observed, Samples]:
        """Filter a checked record; return the results, and the samples from which they follow."""
        of = self.model, self.applications.given
        samples = next((each.samples for each in sampled if each[:2] == of), None)
        if samples is None:
            samples = sample_robot(self.model, self.data, self._compute, self.applications, q, v)
            sampled.append(Sampled(*of, samples))
        kind = self.project_first, self.kind
        equations = Equations(*kind, self._gains, self._basis, self.slope, self.believed, self.expected)
        return observe_record(equations, samples, time, u), samples

    def _estimate(self, time: Array, observed: Observed, samples: Samples) -> Estimate:
        expected, deviation = self.expected, observed.deviation
        return Estimate(
            observer=self.name,
            gain=self.gain.copy(),
            rows=self.believed.name,
            frames=self.applications.frames,
            time=time.copy(),
            components=observed.components,
            units=self.applications.units,
            residual=observed.residual,
            identifiability=judge(self.applications, samples.J, samples.v, self.believed, observed.pivot),
            unexplained=observed.unexplained,
            rows_in_use=self.believed.count,
            weight=moving_weight(self.model),
            standard_deviation=deviation,
            expected_force=None if expected is None else expected.force,
            seen=None if expected is None or deviation is None else expected.seen(deviation),
            doubt=observed.k,
        )

    @guarded()
    def _checked(
        self, q: ArrayLike, v: ArrayLike, tau: ArrayLike, known: Mapping[str, ArrayLike] | None
    ) -> tuple[Array, Array, Array]:
        """Return q, v and the sum of the known forces, checked for a kernel. Raises the errors of `reset`."""
        u = checked(tau, self._nv, "tau")
        for name, force in (known or {}).items():
            u = u + checked(force, self._nv, name)
        q, v = checked(q, self.model.nq, "q"), checked(v, self._nv, "v")
        check_configurations(self._directions, q[None])
        return q, v, u

    def _refuse_time(self, time: float) -> None:
        if np.isnan(self._time):
            raise ObserverError("reset(q, v) must come before the first update")
        raise ObserverError(f"time went from {self._time} s to {time} s: stamps must not decrease")
