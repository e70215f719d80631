"""From a recording and its map to estimated forces, findings and scores."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from aerobat_pin.estimation.calibration.calibration import Calibration, CalibrationWatch
from aerobat_pin.estimation.checks import effort_findings, record_findings, result_findings
from aerobat_pin.estimation.findings import Finding, refuse_if_certain
from aerobat_pin.estimation.fit_known_forces import fitted_forces
from aerobat_pin.estimation.known_forces import KnownForces
from aerobat_pin.estimation.run_observers import inputs_between, observers_of, run_observers
from aerobat_pin.estimation.sensor_scores import Compared, compared
from aerobat_pin.estimation.stored_estimate import StoredEstimate
from aerobat_pin.estimation.trust import FoundEvent, found_events, warnings_about
from aerobat_pin.estimation.use import CalibrationUse
from aerobat_pin.numerics import guarded
from aerobat_pin.observers import Estimate, Observer
from aerobat_pin.records import Map, Record, open_record

ShareDone = Callable[[float], None]


@dataclass(frozen=True)
class RecordingEstimate:
    """What was found in a recording.

    Attributes:
        record: the recording at common times.
        forces: its known forces, with what was fitted.
        stored: observer -> estimate, which is read block by block.
        findings: what the checks found.
        notes: what was left out or assumed.
        compared: observer -> estimate beside the sensor; empty without a sensor.
        use: how a calibration was used; None without one.
    """

    record: Record
    forces: KnownForces
    stored: dict[str, StoredEstimate]
    findings: tuple[Finding, ...]
    notes: tuple[str, ...]
    compared: dict[str, Compared]
    use: CalibrationUse | None = None

    @cached_property
    def estimates(self) -> dict[str, Estimate]:
        """Observer -> estimate of the whole recording, in memory; of a long one read `stored` in blocks instead."""
        return {name: estimate.whole() for name, estimate in self.stored.items()}

    @property
    def warnings(self) -> list[str]:
        """Lines of text about what spoils the estimate."""
        lines = [str(finding) for finding in self.findings if finding.warns]
        if self.use is not None and self.use.verdict == "faded":
            lines.append(self.use.words)
        for name, estimate in self.stored.items():
            if estimate.redundancy.verdict == "inconsistent":
                lines.append(f"{name}: {estimate.redundancy.describe()}")
            lines += [f"{name}: {text}" for text in warnings_about(next(estimate.blocks()))]
            lines += [f"{name} cannot see: {text}" for text in estimate.head.identifiability.describe()]
        return lines

    def metrics(self, versions: dict[str, str]) -> dict[str, Any]:
        """Return the content of `metrics.json`."""
        record = self.record
        return {
            "log": self.record.title,
            "robot": record.robot.title,
            "mass": record.robot.mass,
            "rate": record.rate,
            "used_s": record.duration,
            "parts": [[first * record.dt, last * record.dt] for first, last in record.parts],
            "versions": versions,
            "notes": list(self.notes),
            "warnings": self.warnings,
            "checks": [asdict(finding) for finding in self.findings],
            "fits": [
                {**asdict(fit), "outside": _or_none(fit.outside), "before": _or_none(fit.before)}
                for fit in self.forces.fits
            ],
            "calibration": None if self.use is None else self.use.verdict,
            "observers": {name: self._observer(name, estimate) for name, estimate in self.stored.items()},
        }

    def events(self, name: str) -> list[FoundEvent] | None:
        """Return the contacts with the force that an observer finds there; None where they were not sought."""
        if self.use is None or self.use.contacts is None:
            return None
        stored, found = self.stored[name], list[FoundEvent]()
        for contact in self.use.contacts:
            end = len(stored) if contact.end is None else stored.index(contact.end)
            found += found_events(stored.between(max(stored.index(contact.onset) - 1, 0), end), [contact])
        return found

    def _observer(self, name: str, estimate: StoredEstimate) -> dict[str, Any]:
        head, found, innovation = estimate.head, estimate.head.identifiability, estimate.innovation
        entry: dict[str, Any] = {
            "gain": head.gain.tolist(),
            "rows": head.rows,
            "rank": found.rank,
            "condition": _or_none(found.condition),
            "unseen": found.describe(),
            "components": [asdict(size) for size in estimate.component_sizes()],
            "mean": dict(zip(found.components, estimate.mean.tolist(), strict=True)),
            "redundancy": estimate.redundancy.to_json(),
            "innovation": None if innovation is None else asdict(innovation),
            "events": None if (events := self.events(name)) is None else [asdict(event) for event in events],
        }
        if name in self.compared:
            side = self.compared[name]
            entry[side.point] = {axis: asdict(score) for axis, score in side.scores(self.record.dt).items()}
        return entry


@guarded()
def estimate(
    record: Record,
    observers: Sequence[str | Observer] = (),
    calibration: Calibration | None = None,
    *,
    trust: bool = False,
    progress: ShareDone | None = None,
) -> RecordingEstimate:
    """Estimate the unknown forces of a record.

    Args:
        record: the record, of whatever source.
        observers: names of observers, or observers; those that its map names when empty.
        calibration: what other records showed; its values are used in place of the map's fits.
        trust: estimate also what the checks would refuse; the findings stay.
        progress: called with the share that is done.

    Raises:
        CalibrationError: the calibration belongs to another robot, or to a map that means something else.
        LogError, MapError: log and map do not fit together, or a check is certain that the map is wrong.
        ObserverError, FrameNotFoundError: an observer cannot be built for this robot.
    """
    name = record.title if record.log is None else str(record.log.path)
    if calibration is not None:
        record = calibration.applied(record)
    given = [one for one in observers if isinstance(one, Observer)]
    made, notes = observers_of(record, [one for one in observers if isinstance(one, str)])
    findings = list(record_findings(record))
    if not trust:
        refuse_if_certain(name, findings)
    forces = fitted_forces(record) if calibration is None else calibration.forces(record)
    findings += effort_findings(record, inputs_between(record, forces), findings)
    watch = None if calibration is None else CalibrationWatch(calibration)
    estimates = run_observers(record, forces, given or made, progress, watch)
    sides = {name: compared(record, estimate) for name, estimate in estimates.items()}
    there = {name: side for name, side in sides.items() if side is not None}
    findings += result_findings(record, forces, estimates, there)
    if calibration is not None:
        findings.append(calibration.finding())
    if not trust:
        refuse_if_certain(name, findings)
    use = None if watch is None else watch.use()
    return RecordingEstimate(record, forces, estimates, tuple(findings), (*record.notes, *notes), there, use)


def estimate_recording(
    log: Path,
    chosen: Map,
    folder: Path,
    progress: ShareDone | None = None,
    trust: bool = False,
    calibration: Calibration | None = None,
) -> RecordingEstimate:
    """Open a recording by its map, and estimate."""
    return estimate(open_record(log, chosen, folder), (), calibration, trust=trust, progress=progress)


def _or_none(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
