"""From a recording and its map to estimated forces, findings and scores."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from aerobat_pin.estimation.checks.balance import effort_findings
from aerobat_pin.estimation.checks.motion import measured_motion, motion_findings
from aerobat_pin.estimation.checks.result import result_findings
from aerobat_pin.estimation.checks.samples import sample_findings
from aerobat_pin.estimation.findings import Finding, refuse_if_certain
from aerobat_pin.estimation.fit_known_forces import fitted_forces
from aerobat_pin.estimation.known_forces import KnownForces
from aerobat_pin.estimation.map_calibration import MapCalibration
from aerobat_pin.estimation.run_observers import observers_of, run_observers
from aerobat_pin.estimation.sensor_scores import Compared, compared
from aerobat_pin.estimation.stored_estimate import StoredEstimate
from aerobat_pin.estimation.trust import warnings_about
from aerobat_pin.numerics import guarded
from aerobat_pin.observers import Estimate
from aerobat_pin.records import Map, Record, open_record

ShareDone = Callable[[float], None]


@dataclass(frozen=True)
class RecordingEstimate:
    """What was found in a recording.

    Attributes:
        log: path of the log.
        folder: where relative paths of the map begin.
        record: the recording at common times.
        forces: its known forces, with what was fitted.
        stored: observer -> estimate, which is read block by block.
        findings: what the checks found.
        notes: what was left out or assumed.
        compared: observer -> estimate beside the sensor; empty without a sensor.
    """

    log: Path
    folder: Path
    record: Record
    forces: KnownForces
    stored: dict[str, StoredEstimate]
    findings: tuple[Finding, ...]
    notes: tuple[str, ...]
    compared: dict[str, Compared]

    @cached_property
    def estimates(self) -> dict[str, Estimate]:
        """Observer -> estimate of the whole recording, in memory; of a long one read `stored` in blocks instead."""
        return {name: estimate.whole() for name, estimate in self.stored.items()}

    @property
    def warnings(self) -> list[str]:
        """Lines of text about what spoils the estimate."""
        lines = [str(finding) for finding in self.findings if finding.verdict in ("warning", "refused")]
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
            "log": self.log.name,
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
            "observers": {name: self._observer(name, estimate) for name, estimate in self.stored.items()},
        }

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
        }
        if name in self.compared:
            side = self.compared[name]
            entry[side.point] = {axis: asdict(score) for axis, score in side.scores(self.record.dt).items()}
        return entry


@guarded()
def estimate_recording(
    log: Path,
    chosen: Map,
    folder: Path,
    progress: ShareDone | None = None,
    trust: bool = False,
    calibration: MapCalibration | None = None,
) -> RecordingEstimate:
    """Estimate the unknown forces of a recording.

    Args:
        log: a table, a NetCDF file, an MCAP file, or the folder of a bag.
        chosen: the map.
        folder: where relative paths of the map begin.
        progress: called with the share of the record that is estimated.
        trust: estimate also what the checks would refuse; the findings stay.
        calibration: what another recording showed; its values are used in place of the map's fits.

    Raises:
        CalibrationError: the calibration belongs to another robot, or to a map that means something else.
        LogError, MapError: log and map do not fit together, or a check is certain that the map is wrong.
        ObserverError, FrameNotFoundError: an observer cannot be built for this robot.
    """
    record, columns = open_record(log, chosen, folder)
    if calibration is not None:
        record = calibration.applied(record)
    observers, notes = observers_of(record)
    findings = [*sample_findings(record, columns), *motion_findings(measured_motion(record))]
    del columns
    if not trust:
        refuse_if_certain(str(log), findings)
    forces = fitted_forces(record) if calibration is None else calibration.forces(record)
    findings += effort_findings(record, forces)
    estimates = run_observers(record, forces, observers, progress)
    sides = {name: compared(record, estimate) for name, estimate in estimates.items()}
    there = {name: side for name, side in sides.items() if side is not None}
    findings += result_findings(record, forces, estimates, there)
    if calibration is not None:
        findings.append(calibration.finding())
    if not trust:
        refuse_if_certain(str(log), findings)
    return RecordingEstimate(log, folder, record, forces, estimates, tuple(findings), (*record.notes, *notes), there)


def _or_none(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
