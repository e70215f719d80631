"""What the MCAP file of an estimate, or of a simulated flight, tells."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pinocchio as pin
import xarray as xr

from aerobat_pin.aerobat import FlightLog
from aerobat_pin.errors import LogError
from aerobat_pin.estimation import Result
from aerobat_pin.experiments.mcap_messages import McapStretch, write_mcap_stretches
from aerobat_pin.flight import log_with_motion
from aerobat_pin.forces import blocks_of
from aerobat_pin.numerics import Array, guarded
from aerobat_pin.observers import Estimate


@guarded()
def write_mcap(result: Result, path: Path) -> None:
    """Write forces, joints, pose and arrows of an estimated recording. Raises OutputError if it cannot be written."""
    largest = 0.0
    for estimate in result.stored.values():
        for columns in force_columns(estimate.head).values():
            for block in estimate.blocks():
                largest = max(largest, _largest_force(block.components[:, columns]))
    write_mcap_stretches(_mcap_stretches(result, largest), path)


def _mcap_stretches(result: Result, largest: float) -> Iterator[McapStretch]:
    """Yield the stretches of an estimated recording, short enough for memory."""
    record = result.record
    assert record is not None
    for part in record.parts:
        for first, last in blocks_of(*part):
            block = record.block(first, last)
            forces: dict[str, tuple[str, Array]] = {}
            for name, estimate in result.stored.items():
                low = estimate.index(block.time[0])
                window = estimate.between(low, low + last - first)
                for frame, columns in force_columns(window).items():
                    forces[f"/force/{name}/{frame}"] = (frame, window.components[:, columns])
            low = next(iter(result.stored.values())).index(block.time[0])
            for reference in result.references:
                forces[f"/truth/{reference.frame}"] = (reference.frame, reference.values[low : low + last - first])
            tau = result.forces.torque(block) if result.forces and "joints.effort" in record.channels else None
            yield McapStretch(record.robot.model, block.time, block.q, block.v, tau, forces, largest)


@guarded()
def force_columns(estimate: Estimate) -> dict[str, list[int]]:
    """Return frame -> columns of its force, or of its force and moment, where these are in world axes."""
    columns: dict[str, list[int]] = {}
    for k, label in enumerate(estimate.identifiability.components):
        frame, _, axis = label.rpartition(".")
        if frame in estimate.frames and axis in ("Fx", "Fy", "Fz", "Mx", "My", "Mz"):
            columns.setdefault(frame, []).append(k)
    return columns


def _largest_force(forces: Array) -> float:
    """Return the largest size of forces (m, 3 or 6)."""
    return float(np.max(np.linalg.norm(forces[:, :3], axis=1), initial=0.0))


@guarded()
def write_flight_mcap(model: pin.Model, log: FlightLog, estimates: xr.Dataset, path: Path) -> None:
    """Write a simulated flight with its estimates and true forces.

    Args:
        model: the robot that flew.
        log: the flight log.
        estimates: content of `estimate.nc`, with `force_W`.
        path: the MCAP file.

    Raises:
        LogError: the log has no configuration, nor raw samples with their true motion.
        OutputError: the file cannot be written.
    """
    log = log_with_motion(log)
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
    largest = max((_largest_force(force) for _, force in forces.values()), default=0.0)
    write_mcap_stretches([McapStretch(model, log.time, q, v, None, forces, largest)], path)
