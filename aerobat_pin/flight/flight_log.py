"""The flight log: the only data that pass from a flight to the estimators.

`measured` holds the channels that an observer may use; `truth` holds the exact quantities that only a simulation
provides. Both are labelled tables with units.

| dimension | meaning |
|---|---|
| `time` | the n + 1 samples; the coordinate is their time [s] |
| `interval` | the n intervals between samples; the coordinate is their start [s]. Forces are interval means |
| `q_axis`, `v_axis` | entries of configuration and velocity; joint entries are named after their joints |
| `point`, `axis` | frames at which unknown forces act; components x, y, z |
| `event` | steps, pushes and impulses of unknown forces, with a start and an end |
| `strip`, `link`, `wrench_axis` | strips, by their arc coordinate; links; components of force and moment |
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from aerobat_pin.errors import LogError

KNOWN = "known_"
POSE_AXIS = ("x", "y", "z", "qx", "qy", "qz", "qw")
TWIST_AXIS = ("vx", "vy", "vz", "wx", "wy", "wz")


@dataclass(frozen=True, repr=False)
class FlightLog:
    """Channels of one flight.

    Attributes:
        measured: configuration `q` (time, q_axis), or `pose` (time, pose_axis) of the body alone; known generalised
            forces or body wrenches `known_*`; optional channels, which `motion` and `known_inputs` of
            `aerobat_pin.estimation` read.
        truth: unknown forces `force_W`, `force_noise_free_W` (interval, point, axis) and `unknown` (interval, v_axis);
            aerodynamic forces on robot, strips and links; the aerodynamic state; powers; crank rate and torques if a
            motor turns the crank; `event_start` and `event_end` (event) if there are events. None for a recorded
            flight.
    """

    measured: xr.Dataset
    truth: xr.Dataset | None = None

    def __post_init__(self) -> None:
        """Raise LogError unless the log has the channels that an observer needs, in order of time."""
        if "q" not in self.measured and "pose" not in self.measured:
            raise LogError("flight log: no channel named q or pose")
        if "time" not in self.measured.coords:
            raise LogError("flight log: no coordinate named time")
        time = self.measured["time"].values
        if len(time) < 2 or not np.all(np.isfinite(time)) or np.any(np.diff(time) < 0.0):
            raise LogError("flight log: time must be finite and must not decrease, with two samples or more")
        intervals = self.measured.sizes.get("interval", len(time) - 1)
        if intervals != len(time) - 1:
            raise LogError(f"flight log: {intervals} intervals between {len(time)} samples")

    def __repr__(self) -> str:
        """Name the flight, its duration and its channels."""
        time, truth = self.time, self.truth
        name = self.measured.attrs.get("scenario", "recorded flight")
        return (
            f"FlightLog({str(name)!r}, {len(time)} samples from {time[0]:g} to {time[-1]:g} s\n"
            f"  measured: {', '.join(map(str, self.measured.data_vars))}\n"
            f"  truth: {'none' if truth is None else ', '.join(map(str, truth.data_vars))})"
        )

    def _repr_html_(self) -> str:
        """Show the channels with their dimensions, units and meaning."""
        import pandas as pd  # takes half a second to import; a flight does without

        rows = [
            (name, side, " x ".join(map(str, values.dims)), values.attrs.get("units"), values.attrs.get("long_name"))
            for side, data in (("measured", self.measured), ("truth", self.truth))
            for name, values in ({} if data is None else data.data_vars).items()
        ]
        columns = ["channel", "side", "dimensions", "unit", "meaning"]
        return str(pd.DataFrame(rows, columns=columns).to_html(index=False))

    @property
    def time(self) -> np.ndarray[Any, np.dtype[np.float64]]:
        """Sample times (n + 1,) [s]."""
        return np.asarray(self.measured["time"].values, float)

    def save(self, path: str | Path) -> None:
        """Write NetCDF-4: measured channels at the root, truth in the group `truth`."""
        self.measured.to_netcdf(path, mode="w", engine="h5netcdf")
        if self.truth is not None:
            self.truth.to_netcdf(path, mode="a", group="truth", engine="h5netcdf")

    @classmethod
    def load(cls, path: str | Path) -> FlightLog:
        """Read what `save` wrote. Raises LogError when the file is missing or not a flight log."""
        try:
            measured = xr.load_dataset(path, engine="h5netcdf")
        except (OSError, ValueError) as error:
            raise LogError(f"flight log {path}: cannot be read as NetCDF-4: {error}") from error
        try:
            truth = xr.load_dataset(path, group="truth", engine="h5netcdf")
        except OSError:
            truth = None
        return cls(measured, truth)


def channel(values: Any, dims: tuple[str, ...], unit: str, meaning: str) -> xr.Variable:
    """Make one labelled channel. A Variable has no coordinates, so adding it to a Dataset is ten times faster."""
    return xr.Variable(dims, np.asarray(values), attrs={"units": unit, "long_name": meaning})
