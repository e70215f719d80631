"""The inputs of an observer for a stretch of a record: motion, known forces, and how a calibration was used for them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from aerobat_pin.numerics import Array
from aerobat_pin.observers import Rows


@dataclass(frozen=True)
class Contact:
    """Something that pushed.

    Attributes:
        frame: where it did.
        onset: when the force left what is normal [s].
        alarm: when it was first sure, by samples until then [s].
        end: when it went [s]; None if it lasts.
    """

    frame: str
    onset: float
    alarm: float
    end: float | None


@dataclass(frozen=True)
class CalibrationUse:
    """How a calibration was used.

    Attributes:
        verdict: `inside` if it counted fully, `faded` if it faded out beyond the learnt range.
        words: the same in words.
        contacts: those that were found; None where they were not sought, as beyond the learnt range.
    """

    verdict: Literal["inside", "faded"]
    words: str
    contacts: tuple[Contact, ...] | None = None


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
