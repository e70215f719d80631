"""What was estimated from a record, simulated or recorded: forces, scores, findings; `metrics.json` and its table."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from functools import cache, cached_property
from html import escape
from importlib import metadata
from typing import Any

import numpy as np

from aerobat_pin.estimation.findings import Finding, verdict_of
from aerobat_pin.forces import (
    CalibrationUse,
    KnownForces,
    ModelCheck,
    ObserverScores,
    PairedEstimate,
    Stance,
    StoredEstimate,
    point_label,
    quantity,
    score_table,
    size_table,
    stances_on_ground,
    text_table,
)
from aerobat_pin.observers import Estimate
from aerobat_pin.records import Record, Reference, SmoothedMotion, TrueEvent

VERSIONED_PACKAGES = ("aerobat-pinocchio", "pin", "numpy", "scipy", "xarray", "h5netcdf", "pydantic")
VERSION = 2  # of `metrics.json`
MOST_EVENTS = 6  # that the table shows of each observer
MARKS = {"good": "ok", "note": "  ", "warning": "warning:", "refused": "warning:"}
NOISY_TRUTH = "R2 noise-free is lower where the estimate follows the noise of the true force, which is no error of it"
WORSE_THAN_NOTHING = "R2 below 0 is worse than no estimate, as the mean of the true force would be closer"


@cache
def versions() -> dict[str, str]:
    """Return the versions of the packages that can change the results: package -> version."""
    return {name: metadata.version(name) for name in VERSIONED_PACKAGES}


LEVEL = 0.95  # share of gravity along z from which that is up
NUMBERS = re.compile(r"[-+]?\d[\d.e+-]*")  # of a message, by which two that say the same may differ


@dataclass(frozen=True, repr=False)
class Result:
    """What was found in a record; `print` shows it as the table that the commands print.

    Attributes:
        name: name of the scenario, or of the log.
        title: one line about the record.
        robot: name of the believed robot.
        mass: its mass [kg].
        dt: typical length of an interval [s].
        stored: observer -> estimate, which is read block by block.
        references: what the estimates are compared with.
        findings: what the checks found.
        notes: what was left out or assumed, or how the record came about.
        inputs: input of the observers -> its source, such as `measured`.
        calibration: how a calibration was used; None without one.
        events: events of the true forces.
        changes: one line about what differs from the shipped scenario of this name; empty if nothing does.
        advice: what may help where an R2 is below 0; empty for nothing.
        record: the record at common times.
        forces: its known forces, with what was fitted.
        smoothed: motion and forces that the robot found together; None where the channels gave the motion.
        more: further entries of `metrics.json`, such as those of a simulated flight.
    """

    name: str
    title: str
    robot: str
    mass: float
    dt: float
    stored: Mapping[str, StoredEstimate]
    references: tuple[Reference, ...] = ()
    findings: tuple[Finding, ...] = ()
    notes: tuple[str, ...] = ()
    inputs: Mapping[str, str] = field(default_factory=dict)
    calibration: CalibrationUse | None = None
    events: tuple[TrueEvent, ...] = ()
    changes: str = ""
    advice: str = ""
    record: Record | None = None
    forces: KnownForces | None = None
    smoothed: SmoothedMotion | None = None
    more: Mapping[str, Any] = field(default_factory=dict)

    @cached_property
    def estimates(self) -> dict[str, Estimate]:
        """Observer -> estimate of the whole record, in memory; of a long one read `stored` in blocks instead."""
        return {name: estimate.whole() for name, estimate in self.stored.items()}

    @cached_property
    def compared(self) -> dict[str, list[PairedEstimate]]:
        """Observer -> its estimate beside each reference of what it estimates."""
        sides = {
            name: [PairedEstimate.of(estimate, reference, self.dt) for reference in self.references]
            for name, estimate in self.stored.items()
        }
        return {name: [side for side in paired if side is not None] for name, paired in sides.items()}

    @cached_property
    def observers(self) -> dict[str, ObserverScores]:
        """Observer -> scores."""
        return {
            name: ObserverScores.of(estimate, self.start, self.compared[name], self.calibration)
            for name, estimate in self.stored.items()
        }

    @property
    def start(self) -> float:
        """Time from which figures count [s]: the first common time of a record, or 0 of a flight."""
        return 0.0 if self.record is None else self.record.start

    @property
    def parts(self) -> list[tuple[float, float]]:
        """Begin and end [s] of each used part."""
        if self.record is not None:
            after_start = self.record.after_start
            return [(after_start(first), after_start(last)) for first, last in self.record.parts]
        return [(estimate.start[0], estimate.end) for estimate in list(self.stored.values())[:1]]

    @cached_property
    def risen(self) -> dict[str, float]:
        """Observer -> time [s] from which its estimate is not what filters show that still rise."""
        return {name: estimate.risen for name, estimate in self.stored.items()}

    @cached_property
    def verdict(self) -> str:
        """What pushed, how much, how sure that is and what could not be seen, in a sentence, by the first observer."""
        name, estimate = next(iter(self.stored.items()))
        kind = self.references[0].kind if self.references else ""
        down = np.array([0.0, 0.0, -1.0]) if self.record is None else self.record.robot.model.gravity.linear
        level = bool(-down[2] >= LEVEL * np.linalg.norm(down))
        return verdict_of(estimate, self.observers[name], self.start, kind, self.findings, self.model, level=level)

    @cached_property
    def stances(self) -> dict[str, tuple[Stance, ...]]:
        """Observer -> when each point is in contact with the ground, of a robot that walks."""
        return {} if self.record is None else stances_on_ground(self.record, self.stored)

    @property
    def model(self) -> ModelCheck | None:
        """Whether the belief is still that of its calibration; None without one."""
        return self.calibration.model if self.calibration else None

    @property
    def judgements(self) -> dict[str, list[str]]:
        """What no force explains says about the belief: line of text -> observers that say it."""
        lines: dict[str, list[str]] = {}
        for name, scores in self.observers.items():
            lines.setdefault(scores.judgement[0], []).append(name)
        return lines

    @property
    def warnings(self) -> list[str]:
        """Lines of text about what spoils the estimates: a log that contradicts itself, a wrong belief, an observer."""
        lines = [str(finding) for finding in self.findings if finding.warns]
        if self.calibration is not None:
            lines += [f"calibration: {line}" for line in self._of_calibration]
            if self.model is not None and self.model.verdict == "changed":
                lines.append(str(self.model))
        lines += [
            f"{', '.join(names)}: {words}"
            for words, names in self.judgements.items()
            if self.observers[names[0]].judgement[1]
        ]
        for name, scores in self.observers.items():
            lines += [f"{name}: {line}" for line in scores.warnings]
            lines += [f"{name} cannot see: {pattern}" for pattern in scores.unseen]
        return lines

    @property
    def _of_calibration(self) -> list[str]:
        """Warnings of the calibration, but those that a finding says in the same words, with numbers of its own."""
        findings = {NUMBERS.sub("", str(finding)) for finding in self.findings if finding.warns}
        return [
            line
            for line in (self.calibration.warnings if self.calibration else ())
            if NUMBERS.sub("", line) not in findings
        ]

    def metrics(self) -> dict[str, Any]:
        """Return the content of `metrics.json`."""
        return {
            "version": VERSION,
            "scenario": self.name,
            "verdict": self.verdict,
            "seed": None,
            "changed": {},
            "log": None if self.record is None else self.name,
            "robot": self.robot,
            "mass": self.mass,
            "rate": 1.0 / self.dt,
            "used_s": float(sum(end - begin for begin, end in self.parts)),
            "parts": [list(part) for part in self.parts],
            "versions": versions(),
            "inputs": dict(self.inputs),
            "notes": list(self.notes),
            "warnings": self.warnings,
            "calibration": None if self.calibration is None else self.calibration.words,
            "model": None if self.model is None else self.model.to_json(),
            "checks": [asdict(finding) for finding in self.findings],
            "fits": [
                {**asdict(fit), "outside": _or_none(fit.outside), "before": _or_none(fit.before)} for fit in self.fits
            ],
            "observers": {name: scores.to_json() for name, scores in self.observers.items()},
            "contacts": {
                name: {point_label(stance.point): stance.numbers() for stance in stances}
                for name, stances in self.stances.items()
            },
            **self.more,
        }

    @property
    def fits(self) -> tuple[Any, ...]:
        """What was fitted, as `Fit`."""
        return () if self.forces is None else self.forces.fits

    @property
    def header(self) -> tuple[str, ...]:
        """Names of the columns of `rows`."""
        return score_table(self.observers)[0]

    def rows(self) -> Iterator[tuple[str, ...]]:
        """Yield the rows of the table of scores; none without a reference."""
        yield from score_table(self.observers)[1]

    @property
    def sizes(self) -> list[tuple[str, ...]]:
        """The table of sizes, with its header: a row for each component."""
        return size_table(self.stored)

    @property
    def hints(self) -> list[str]:
        """Lines of text that help to read the table: noise of the truth, an R2 below 0, and what may help."""
        scored = {name: scores.scored for name, scores in self.observers.items()}
        lines = []
        for name, scores in scored.items():
            best = {label: next(filter(None, (s.r2_seen, s.r2_noise_free, s.r2)), 0.0) for label, s in scores.items()}
            worse = [label for label, r2 in best.items() if r2 < 0.0]
            lines += [f"{name}, {', '.join(worse)}: {WORSE_THAN_NOTHING}"] if worse else []
        lines += [self.advice] if lines and self.advice else []
        for name, scores in scored.items():
            still = {label: score.rmse for label, score in scores.items() if not score.tells}
            if still and len(still) < len(scores):
                error = quantity(max(still.values()), "N")
                lines.append(f"{name}, {', '.join(still)}: no true force to compare with; errors up to {error} rms")
        noisy = any((s.r2_noise_free or 1.0) < (s.r2 or 0.0) for scores in scored.values() for s in scores.values())
        return [*lines, *([NOISY_TRUTH] if noisy else [])]

    def __repr__(self) -> str:
        """Return verdict, title, findings, tables and judgements as text."""
        lines = [self.verdict, self.title, *filter(None, [self.changes]), *(f"note: {note}" for note in self.notes)]
        sources = (f"{name} {source}" for name, source in self.inputs.items())
        lines += [f"inputs: {', '.join(sources)}"]
        simulated = any(reference.kind == "truth" for reference in self.references)  # where what is right is no news
        lines += [f"{MARKS[finding.verdict]} {finding}" for finding in self.findings if finding.warns or not simulated]
        lines += [f"fit: {fit}" for fit in self.fits]
        header, rows = score_table(self.observers)
        lines += text_table([header, *rows]) if rows else []
        if any(len(scores.scored) < len(scores.components) for scores in self.observers.values()):
            lines += text_table(self.sizes)
        lines += self.hints
        for name, scores in self.observers.items():
            lines += [f"{name}: rank {scores.rank}; cannot be seen at all: {pattern}" for pattern in scores.unseen]
            if scores.innovation is not None:
                lines.append(
                    f"{name}: innovations {scores.innovation.nis:.2g} of their variance (1 if exact), correlation of "
                    f"neighbours {scores.innovation.whiteness:.2f} (0 if exact)"
                )
            lines += [f"{name}: {line}" for line in [*scores.warnings, *scores.notes]]
            events = scores.events or []
            lines += [f"{name}: {event.told(self.start)}" for event in events[:MOST_EVENTS]]
            if len(events) > MOST_EVENTS:
                lines.append(f"{name}: {len(events) - MOST_EVENTS} more contacts, in metrics.json")
        if self.calibration is not None:
            lines.append(self.calibration.words)
            lines += [f"warning: calibration: {line}" for line in self._of_calibration]
        lines += [str(self.model)] * (self.model is not None)
        for words, names in self.judgements.items():
            lines.append(words if len(self.judgements) == 1 else f"{', '.join(names)}: {words}")
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        """Return verdict, title and table as HTML, for notebooks."""
        header, rows = score_table(self.observers)
        cells = [header, *rows] if rows else self.sizes
        kinds = ("th", *("td" for _ in cells[1:]))
        table = (
            "<tr>" + "".join(f"<{kind}>{escape(cell)}</{kind}>" for cell in row) + "</tr>"
            for kind, row in zip(kinds, cells, strict=True)
        )
        return f"<p><b>{escape(self.verdict)}</b></p><p>{escape(self.title)}</p><table>{''.join(table)}</table>"


def _or_none(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
