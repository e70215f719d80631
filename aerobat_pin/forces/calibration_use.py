"""How a calibration was used in a flight, and the contacts that were found with it."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from math import isnan
from typing import Any, Literal

from aerobat_pin.forces.scores import quantity
from aerobat_pin.observers import force_size

CHANGED = 1.3  # of what was expected: what no force explains is larger only if something has changed
CHANGED_NEAR = 2.0  # the same over a tenth of a second; unchanged flights of another simulator reach 1.65
LEAST_START = 5e-4  # [s] from which a log's stamps are told beside times after its start
SURE_OF_CONTACT = 5.0  # stated deviations, errors of the belief among them, which noise alone does not reach


@dataclass(frozen=True)
class Contact:
    """Something that pushed.

    Attributes:
        point: where it did: a frame, its label, or a row of the residual.
        onset: when the force left what is normal [s].
        alarm: when it was first sure, by samples until then [s].
        end: when it went [s]; None if it lasts.
        size: the largest force, or row, estimated during it [`unit`].
    """

    point: str
    onset: float
    alarm: float
    end: float | None
    size: float = float("nan")

    @property
    def frame(self) -> str:
        """The point, under its earlier name."""
        return self.point

    @property
    def unit(self) -> str:
        """N m of a row's residual that is a moment, such as `elbow.M`; else N."""
        body, _, axis = self.point.rpartition(".")
        return "N m" if body and axis[:1] == "M" else "N"

    def __str__(self) -> str:
        return self.told(0.0)

    def told(self, start: float) -> str:
        """Return the contact in words, with its times after a start [s] and, where they differ, those of the log."""

        def times(zero: float) -> str:
            until = "to the end" if self.end is None else f"to {self.end - zero:.3f} s"
            return f"from {self.onset - zero:.3f} s {until}"

        stamps = f" (by the log's stamps {times(0.0)})" if abs(start) >= LEAST_START else ""
        size = "" if isnan(self.size) else f", up to {quantity(self.size, self.unit)}"  # before it is estimated
        return f"contact at {self.point} {times(start)}{stamps}{size}"


@dataclass(frozen=True)
class Cause:
    """What changed after a calibration, by name.

    Attributes:
        name: such as `air_density`.
        estimate: how much, in words of `labels` and `units`.
        deviation: standard deviation of each.
        labels: what each of the numbers is.
        units: unit of each.
        share: of what no force explains, how much this explains.
    """

    name: str
    estimate: tuple[float, ...]
    deviation: tuple[float, ...]
    labels: tuple[str, ...]
    units: tuple[str, ...]
    share: float

    def __str__(self) -> str:
        numbers = zip(self.labels, self.estimate, self.deviation, self.units, strict=True)
        parts = [f"{label} {value:+.3g} +- {sure:.2g} {unit}" for label, value, sure, unit in numbers]
        return f"{CAUSES.get(self.name, self.name)}: {', '.join(parts)}"


CAUSES = {
    "payload": "payload or steady force on the body",
    "crank_zero": "zero of the crank",
    "air_density": "density of the air",
}


@dataclass(frozen=True)
class ModelCheck:
    """Whether the belief is still that of its calibration: what no force explains, over what was to be expected.

    Attributes:
        ratio: of both root mean squares; None where nothing can tell, for the reason `why`.
        size: what no force explains, per redundant row [N]; by blocks, `ratio` times what was expected.
        expected: root mean square that the calibration predicted for it [N].
        peak: the largest ratio over a tenth of a second; 0 where that was not asked.
        peak_time: when that was, after the start of the record [s].
        cause: what changed; None if nothing that has a name explains it.
        corrected: whether the cause was corrected, and ratio and size are those of what is left.
        why: nothing can tell where `ratio` is None; else empty.
    """

    ratio: float | None
    size: float
    expected: float
    peak: float = 0.0
    peak_time: float = 0.0
    cause: Cause | None = None
    corrected: bool = False
    why: str = ""

    @property
    def verdict(self) -> Literal["unchanged", "changed", "unverified"]:
        """Whether the belief has changed since it was calibrated."""
        if self.ratio is None:
            return "unverified"
        larger = self.ratio > CHANGED or self.peak > CHANGED_NEAR
        return "changed" if larger or self.cause is not None else "unchanged"

    @property
    def limit(self) -> float:
        """Largest root mean square of what no force explains, per redundant row, of an unchanged belief [N]."""
        return CHANGED * self.expected

    @property
    def factor(self) -> float:
        """How many times as large as predicted the errors of the belief are, at least 1."""
        return max(1.0, self.ratio or 1.0)

    def __str__(self) -> str:
        if self.ratio is None:
            return f"model: unverified, as {self.why}"
        sizes = f"{force_size(self.size)} a row that no force explains, {self.ratio:.2g} times what was expected"
        if self.verdict == "unchanged":
            return f"model: unchanged since the calibration ({sizes})"
        if self.peak > max(CHANGED_NEAR, self.ratio):
            sizes += f", {self.peak:.2g} times at {self.peak_time:.2f} s"
        why = "cause unknown" if self.cause is None else str(self.cause)
        return f"model: changed since the calibration, {why}{', corrected' if self.corrected else ''} ({sizes})"

    def to_json(self) -> dict[str, Any]:
        """Return the entry `model` of `metrics.json`."""
        return {"verdict": self.verdict, **asdict(self), "words": str(self)}


@dataclass(frozen=True)
class CalibrationUse:
    """How a calibration was used.

    Attributes:
        words: where it comes from, in words.
        contacts: alarms of single samples, some of which errors make up; None where they were not sought.
        model: whether the belief is still that of the calibration; None where that was not asked.
        warnings: what makes the calibration doubtful, in words.
    """

    words: str
    contacts: tuple[Contact, ...] | None = None
    model: ModelCheck | None = None
    warnings: tuple[str, ...] = ()
