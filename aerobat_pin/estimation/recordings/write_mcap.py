"""What the MCAP file of an estimate, or of a simulated flight, tells."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import xarray as xr

from aerobat_pin.errors import LogError
from aerobat_pin.estimation.recordings.estimate_recording import RecordingEstimate
from aerobat_pin.estimation.recordings.mcap_file import Telling, joint_rows, write_telling
from aerobat_pin.flight import FlightLog
from aerobat_pin.numerics import Array, guarded


@guarded()
def write_mcap(found: RecordingEstimate, path: Path) -> None:
    """Write forces, joints, pose and arrows of an estimated recording. Raises OutputError if it cannot be written."""
    record, parts = found.record, []
    for first, last in record.parts:
        block = record.block(first, last)
        forces: dict[str, tuple[str, Array]] = {}
        for name, estimate in found.estimates.items():
            low = int(np.searchsorted(estimate.time[:-1], block.time[0] - 1e-9))
            labels = estimate.identifiability.components
            for frame in estimate.frames:
                columns = [
                    labels.index(f"{frame}.{axis}")
                    for axis in ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
                    if f"{frame}.{axis}" in labels
                ]
                if len(columns) in (3, 6):
                    values = estimate.components[low : low + last - first][:, columns]
                    forces[f"/force/{name}/{frame}"] = (frame, values)
        for side in list(found.compared.values())[:1]:
            low = int(np.searchsorted(side.start, block.time[0] - 1e-9))
            forces[f"/truth/{side.point}"] = (side.point, side.sensor[low : low + last - first])
        tau = found.forces.torque(block) if "joints.effort" in record.channels else None
        parts.append(
            Telling(record.robot.model, block.time, block.q, block.v, tau, forces, joint_rows(record.robot.model))
        )
    write_telling(parts, path)


@guarded()
def write_flight_mcap(model: pin.Model, log: FlightLog, estimates: xr.Dataset, path: Path) -> None:
    """Write a simulated flight with its estimates and true forces.

    Args:
        model: the robot that flew.
        log: the flight log.
        estimates: content of `estimate.nc`, with `force_W`.
        path: the MCAP file.

    Raises:
        LogError: the log has no configuration.
        OutputError: the file cannot be written.
    """
    if "q" not in log.measured or "v" not in log.measured:
        raise LogError("convert: the flight log has no channels q and v")
    q, v = log.measured["q"].values, log.measured["v"].values
    forces: dict[str, tuple[str, Array]] = {}
    points = [str(point) for point in estimates["point"].values]
    for name in map(str, estimates["observer"].values):
        for point in points:
            forces[f"/force/{name}/{point}"] = (point, estimates["force_W"].sel(observer=name, point=point).values)
    if log.truth is not None and "force_W" in log.truth:
        for point in map(str, log.truth["point"].values):
            forces[f"/truth/{point}"] = (point, log.truth["force_W"].sel(point=point).values)
    write_telling([Telling(model, log.time, q, v, None, forces, joint_rows(model))], path)
