"""The inputs of an observer for a stretch of a record: motion, and the generalised forces that are known."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from aerobat_pin.estimation.use import CalibrationUse
from aerobat_pin.numerics import Array
from aerobat_pin.observers import Rows


@dataclass(frozen=True, repr=False)
class KnownInputs:
    """The inputs of an observer.

    Attributes:
        time: (m + 1,) times of the samples [s].
        q: (m + 1, nq) configurations.
        v: (m + 1, nv) velocities.
        tau: (m, nv) motor torque at the joints, interval means.
        known: name -> (m, nv) other known generalised forces, interval means.
        rows: rows of the equations of motion that the observer can use.
        source: input -> its source. This is `measured` or `reconstructed` for `q`, `v`, `wind` and the known forces
            (the wind can also be `believed`, that is, assumed), and the chosen kind of torque for `motor_torque`.
        calibration: how a calibration was used, if there is one.
        crank: (m + 1,) crank angle [rad], if it was estimated together with the motion; else None.
    """

    time: Array
    q: Array
    v: Array
    tau: Array
    known: Mapping[str, Array]
    rows: Rows
    source: Mapping[str, str]
    calibration: CalibrationUse | None = None
    crank: Array | None = None

    def __repr__(self) -> str:
        sources = ", ".join(f"{name} {source}" for name, source in self.source.items())
        span = f"{self.time[0]:.4g} to {self.time[-1]:.4g} s"
        return f"KnownInputs of {len(self.tau)} intervals, {span}; rows {self.rows}\n  {sources}"
