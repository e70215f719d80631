"""How a calibration was used in a flight, and the contacts that were found with it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


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
class FoundEvent:
    """A `Contact` with the largest force, or row of the residual, estimated during it [`unit`]."""

    point: str
    onset: float
    alarm: float
    end: float | None
    size: float

    @property
    def unit(self) -> str:
        """N m of a row's residual that is a moment, such as `elbow.M`; else N."""
        return "N m" if self.point.rpartition(".")[2][:1] == "M" else "N"

    def __str__(self) -> str:
        """Return the event in words."""
        until = "to the end" if self.end is None else f"to {self.end:.3f} s"
        return f"contact at {self.point} from {self.onset:.3f} s {until}, up to {1e3 * self.size:.0f} m{self.unit}"


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
