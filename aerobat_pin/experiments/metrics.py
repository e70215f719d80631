"""The scores of a run: all of `metrics.json`, and the table that the commands print."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields
from typing import Any

from aerobat_pin.estimation import CalibrationUse, ObserverScores
from aerobat_pin.experiments.flight_summary import FlightSummary
from aerobat_pin.scenario import changes_text

MOST_EVENTS = 6  # that the table shows of each observer
TABLE_HEADER = ("observer", "point", "axis", "R2", "R2 noise-free", "error rms", "lag", "deviation")
WORSE_THAN_NOTHING = "R2 below 0 is worse than no estimate, as the mean of the true force would be closer"
NOISE_ADVICE = "a smaller observers.gain follows the sensors' noise less"


@dataclass(frozen=True, repr=False)
class Scores:
    """The content of `metrics.json`; `print` shows it as the table that the commands print.

    Attributes:
        scenario: name of the scenario, or of the recorded flight.
        seed: seed of the random numbers; None for a recorded flight.
        versions: package -> version.
        torque: which joint torque the observers knew, as `observers.torque` of the scenario.
        inputs: input of the observers -> its source, such as `measured`.
        note: a line about the flight.
        observers: name -> scores of the observer.
        findings: lines of text about what the checks of the log warn of.
        calibration: how a calibration was used; None without one.
        flight: summary of the flight; None for a recorded flight.
        changed: dotted key -> value that differs from the shipped scenario of this name.
        noisy: whether the scenario's sensors have errors.
        control: how the flight was controlled, as plain values; None if no controller flew it.
        notices: lines of text about a flight that could not go as it was asked to.
    """

    scenario: str
    seed: int | None
    versions: Mapping[str, str]
    torque: str
    inputs: Mapping[str, str]
    note: str
    observers: Mapping[str, ObserverScores]
    findings: tuple[str, ...] = ()
    calibration: CalibrationUse | None = None
    flight: FlightSummary | None = None
    changed: Mapping[str, Any] = field(default_factory=dict)
    noisy: bool = False
    control: Mapping[str, Any] | None = None
    notices: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Return the content of `metrics.json`."""
        values: dict[str, Any] = {item.name: getattr(self, item.name) for item in fields(self)}
        values |= {"versions": dict(self.versions), "inputs": dict(self.inputs), "changed": dict(self.changed)}
        values["observers"] = {name: found.to_json() for name, found in self.observers.items()}
        values["warnings"] = self.warnings
        values["calibration"] = None if self.calibration is None else self.calibration.verdict
        del values["findings"], values["notices"], values["noisy"]
        flight, control = values.pop("flight"), values.pop("control")
        if control is not None:
            values["control"] = dict(control)
        return values if flight is None else {**values, "flight": flight.to_json()}

    @property
    def verdicts(self) -> dict[str, list[str]]:
        """What the redundancy says about the belief: line of text -> observers that say it."""
        lines: dict[str, list[str]] = {}
        for name, found in self.observers.items():
            lines.setdefault(found.redundancy.describe(), []).append(name)
        return lines

    @property
    def warnings(self) -> list[str]:
        """Lines of text about what spoils the estimates: a log that contradicts itself, a wrong belief, an observer."""
        lines = [*self.notices, *self.findings]
        if self.calibration is not None and self.calibration.verdict == "faded":
            lines.append(self.calibration.words)
        lines += [
            f"{', '.join(names)}: {words}"
            for words, names in self.verdicts.items()
            if self.observers[names[0]].redundancy.verdict == "inconsistent"
        ]
        return lines + [f"{name}: {line}" for name, found in self.observers.items() for line in found.warnings]

    def rows(self) -> Iterator[tuple[str, ...]]:
        """Yield the rows of the table, with the columns of `TABLE_HEADER`; none if the true forces are unknown."""
        for name, found in self.observers.items():
            yield from _table_rows(name, found)

    @property
    def title(self) -> str:
        """One line about the flight: scenario, seed, note and joint torque."""
        seed = "" if self.seed is None else f", seed {self.seed}"
        return f"{self.scenario}{seed}: {self.note}; motor torque {self.torque}"

    @property
    def changes(self) -> str:
        """One line about what differs from the shipped scenario of this name; empty if nothing does."""
        return changes_text(self.scenario, self.changed)

    @property
    def hints(self) -> list[str]:
        """Lines of text that help to read the table: an R2 below 0, and what may help."""
        worse: dict[str, list[str]] = {}
        for name, found in self.observers.items():
            for point, axes in found.points.items():
                where = [f"{point} {axis}" for axis, score in axes.items() if (score.r2_noise_free or 0.0) < 0.0]
                worse.setdefault(name, []).extend(where)
        lines = [f"{name}, {', '.join(where)}: {WORSE_THAN_NOTHING}" for name, where in worse.items() if where]
        return lines + ([NOISE_ADVICE] if lines and self.noisy else [])

    def __repr__(self) -> str:
        """Return title, warnings and table as text; forces that cannot be estimated precede an observer's rows."""
        lines = [
            self.title,
            *filter(None, [self.changes]),
            *(f"warning: {finding}" for finding in self.findings),
        ]
        if any(found.points for found in self.observers.values()):
            lines.append(_line(TABLE_HEADER))
        for name, found in self.observers.items():
            lines += [f"{name}: rank {found.rank}; cannot be seen at all: {pattern}" for pattern in found.unseen]
            lines += [_line(row) for row in _table_rows(name, found)]
            if found.innovation is not None:
                lines.append(
                    f"{name}: innovations {found.innovation.nis:.2g} of their variance (1 if exact), correlation of "
                    f"neighbours {found.innovation.whiteness:.2f} (0 if exact)"
                )
            lines += [f"{name}: {line}" for line in [*found.warnings, *found.notes]]
            events = found.events or []
            lines += [f"{name}: {event}" for event in events[:MOST_EVENTS]]
            if len(events) > MOST_EVENTS:
                lines.append(f"{name}: {len(events) - MOST_EVENTS} more contacts, in metrics.json")
        if self.calibration is not None:
            lines.append(self.calibration.words)
        for words, names in self.verdicts.items():
            lines.append(words if len(self.verdicts) == 1 else f"{', '.join(names)}: {words}")
        return "\n".join([*lines, *self.hints])


def _table_rows(observer: str, found: ObserverScores) -> Iterator[tuple[str, ...]]:
    certainties = iter(size.certainty for size in found.components)
    for point, axes in found.points.items():
        for axis, score in axes.items():
            yield (observer, point, axis, *score.texts(), next(certainties))


def _line(cells: tuple[str, ...]) -> str:
    name, point, axis, r2, noise_free, error, lag, sure = cells
    return f"{name:<12} {point:<12} {axis:<4} {r2:>9} {noise_free:>14} {error:>10} {lag:>9} {sure:>10}"
