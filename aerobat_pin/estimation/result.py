"""What was estimated from a record, simulated or recorded: forces, scores, findings; `metrics.json` and its table."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cache, cached_property
from html import escape
from importlib import metadata
from typing import Any

import numpy as np

from aerobat_pin.estimation.compared import Compared
from aerobat_pin.estimation.contacts import Stance, stances_on_ground
from aerobat_pin.estimation.findings import Finding
from aerobat_pin.estimation.known_forces import KnownForces
from aerobat_pin.estimation.observer_scores import ObserverScores
from aerobat_pin.estimation.scores import Score, point_label
from aerobat_pin.estimation.stored_estimate import StoredEstimate
from aerobat_pin.estimation.use import CalibrationUse, ModelCheck
from aerobat_pin.observers import Estimate
from aerobat_pin.records import Record, Reference, SmoothedMotion, TrueEvent

VERSIONED_PACKAGES = ("aerobat-pinocchio", "pin", "numpy", "scipy", "xarray", "h5netcdf", "pydantic")
VERSION = 2  # of `metrics.json`
MOST_EVENTS = 6  # that the table shows of each observer
MARKS = {"good": "ok", "note": "  ", "warning": "warning:", "refused": "warning:"}
WORSE_THAN_NOTHING = "R2 below 0 is worse than no estimate, as the mean of the true force would be closer"


ScoreTable = tuple[tuple[str, ...], list[tuple[str, ...]]]  # header and rows
TEXT_COLUMNS = ("observer", "point", "axis", "component")  # which begin at the left
SIZE_HEADER = ("observer", "component", "mean", "rms", "least", "largest", "deviation", "seen")


@cache
def versions() -> dict[str, str]:
    """Return the versions of the packages that can change the results: package -> version."""
    return {name: metadata.version(name) for name in VERSIONED_PACKAGES}


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
    def compared(self) -> dict[str, list[Compared]]:
        """Observer -> its estimate beside each reference of what it estimates."""
        sides = {name: [Compared.of(own, one, self.dt) for one in self.references] for name, own in self.stored.items()}
        return {name: [side for side in found if side is not None] for name, found in sides.items()}

    @cached_property
    def observers(self) -> dict[str, ObserverScores]:
        """Observer -> scores."""
        return {
            name: ObserverScores.of(estimate, self.compared[name], self.calibration)
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
            return [(first * self.record.dt, last * self.record.dt) for first, last in self.record.parts]
        return [(estimate.start[0], estimate.end) for estimate in list(self.stored.values())[:1]]

    @cached_property
    def stances(self) -> dict[str, tuple[Stance, ...]]:
        """Observer -> when each point is in contact with the ground, of a robot that walks."""
        return {} if self.record is None else stances_on_ground(self.record, self.stored)

    @property
    def model(self) -> ModelCheck | None:
        """Whether the belief is still that of its calibration; None without one."""
        return self.calibration.model if self.calibration else None

    @property
    def verdicts(self) -> dict[str, list[str]]:
        """What no force explains says about the belief: line of text -> observers that say it."""
        lines: dict[str, list[str]] = {}
        for name, found in self.observers.items():
            lines.setdefault(found.judgement[0], []).append(name)
        return lines

    @property
    def warnings(self) -> list[str]:
        """Lines of text about what spoils the estimates: a log that contradicts itself, a wrong belief, an observer."""
        lines = [str(finding) for finding in self.findings if finding.warns]
        if self.calibration is not None:
            lines += [f"calibration: {line}" for line in self.calibration.warnings]
            if self.model is not None and self.model.verdict == "changed":
                lines.append(str(self.model))
        lines += [
            f"{', '.join(names)}: {words}"
            for words, names in self.verdicts.items()
            if self.observers[names[0]].judgement[1]
        ]
        for name, found in self.observers.items():
            lines += [f"{name}: {line}" for line in found.warnings]
            lines += [f"{name} cannot see: {pattern}" for pattern in found.unseen]
        return lines

    def metrics(self) -> dict[str, Any]:
        """Return the content of `metrics.json`."""
        return {
            "version": VERSION,
            "scenario": self.name,
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
            "observers": {name: found.to_json() for name, found in self.observers.items()},
            "contacts": {
                name: {point_label(one.point): one.numbers() for one in found} for name, found in self.stances.items()
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
        return _score_table(self.observers)[0]

    def rows(self) -> Iterator[tuple[str, ...]]:
        """Yield the rows of the table of scores; none without a reference."""
        yield from _score_table(self.observers)[1]

    @property
    def sizes(self) -> list[tuple[str, ...]]:
        """The table of sizes, with its header: a row for each component."""
        return _size_table(self.stored)

    @property
    def hints(self) -> list[str]:
        """Lines of text that help to read the table: an R2 below 0, and what may help."""
        lines = []
        for name, found in self.observers.items():
            worse = [
                f"{point} {axis}"
                for point, axes in found.points.items()
                for axis, score in axes.items()
                if next(filter(None, (score.r2_seen, score.r2_noise_free, score.r2)), 0.0) < 0.0
            ]
            lines += [f"{name}, {', '.join(worse)}: {WORSE_THAN_NOTHING}"] if worse else []
        return lines + ([self.advice] if lines and self.advice else [])

    def __repr__(self) -> str:
        """Return title, findings, tables and judgements as text."""
        lines = [self.title, *filter(None, [self.changes]), *(f"note: {note}" for note in self.notes)]
        sources = (f"{name} {source}" for name, source in self.inputs.items())
        lines += [f"inputs: {', '.join(sources)}"]
        told = any(one.kind == "truth" for one in self.references)  # of a simulation, what is right is no news
        lines += [f"{MARKS[one.verdict]} {one}" for one in self.findings if one.warns or not told]
        lines += [f"fit: {fit}" for fit in self.fits]
        header, rows = _score_table(self.observers)
        lines += _text_table([header, *rows]) if rows else []
        if len(rows) < sum(len(found.components) for found in self.observers.values()):
            lines += _text_table(self.sizes)
        for name, found in self.observers.items():
            lines += [f"{name}: rank {found.rank}; cannot be seen at all: {pattern}" for pattern in found.unseen]
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
            lines += [f"warning: calibration: {line}" for line in self.calibration.warnings]
        lines += [str(self.model)] * (self.model is not None)
        for words, names in self.verdicts.items():
            lines.append(words if len(self.verdicts) == 1 else f"{', '.join(names)}: {words}")
        return "\n".join([*lines, *self.hints])

    def _repr_html_(self) -> str:
        """Return title and table as HTML, for notebooks."""
        header, rows = _score_table(self.observers)
        cells = [header, *rows] if rows else self.sizes
        kinds = ("th", *("td" for _ in cells[1:]))
        table = (
            "<tr>" + "".join(f"<{kind}>{escape(cell)}</{kind}>" for cell in row) + "</tr>"
            for kind, row in zip(kinds, cells, strict=True)
        )
        return f"<p>{escape(self.title)}</p><table>{''.join(table)}</table>"


def _or_none(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _score_table(observers: Mapping[str, ObserverScores]) -> ScoreTable:
    """Return the table of scores; columns that have no meaning for these references are left out."""
    rows = []
    for name, found in observers.items():
        sizes = {_short(size.name): size for size in found.components}
        for point, axes in found.points.items():
            for axis, score in axes.items():
                own = sizes[f"{point}.{axis}"]
                cells = {"observer": name, "point": point, "axis": axis, **_score_cells(score, own.unit)}
                rows.append({**cells, "deviation": own.certainty})
    header = tuple(dict.fromkeys(key for row in rows for key in row))
    header = (*(key for key in header if key != "deviation"), "deviation")
    return header, [tuple(row.get(key, "-") for key in header) for row in rows]


def _score_cells(score: Score, unit: str) -> dict[str, str]:
    """Return the cells of a score, without those that have no meaning."""

    def r2(value: float | None) -> str:
        return "no signal" if value is None else f"{value:.5f}"

    def size(value: float) -> str:
        return f"{1e3 * value:.2f} m{unit}"

    cells = {"R2": r2(score.r2)}
    if score.factor is None and score.offset is None:
        cells["R2 noise-free"] = r2(score.r2_noise_free)
    cells["error rms"] = size(score.rmse)
    if score.rmse_seen is not None:
        cells |= {"R2 where seen": r2(score.r2_seen), "rms where seen": size(score.rmse_seen)}
    if score.rmse_outside_fit is not None:
        cells |= {"R2 unfitted": r2(score.r2_outside_fit), "unfitted rms": size(score.rmse_outside_fit)}
    if score.offset is not None:
        cells["factor"] = "-" if score.factor is None else f"{score.factor:.4f}"
        cells["offset"] = size(score.offset)
    return {**cells, "lag": "-" if score.lag_s is None else f"{1e3 * score.lag_s:.2f} ms"}


def _size_table(stored: Mapping[str, StoredEstimate]) -> list[tuple[str, ...]]:
    """Return the header, and a row for each component."""
    rows: list[tuple[str, ...]] = [SIZE_HEADER]
    for name, estimate in stored.items():
        least, most = estimate.extremes
        sizes = zip(estimate.component_sizes(), estimate.mean, least, most, strict=True)
        for size, mean, low, high in sizes:
            numbers = ("" if size.rms is None else f"{value:.4g} {size.unit}" for value in (mean, size.rms, low, high))
            rows.append((name, size.name, *numbers, size.certainty, "-" if size.seen is None else f"{size.seen:.0%}"))
    return rows


def _text_table(cells: Sequence[tuple[str, ...]]) -> list[str]:
    """Return a table, its header first, as lines of text with columns as wide as they need to be."""
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return [
        " ".join(
            cell.ljust(width) if name in TEXT_COLUMNS else cell.rjust(width + 1)
            for name, cell, width in zip(cells[0], row, widths, strict=True)
        )
        for row in cells
    ]


def _short(component: str) -> str:
    """Return the label of a component with the short name of its point: `left.Fx`."""
    frame, _, axis = component.rpartition(".")
    return f"{point_label(frame)}.{axis}"
