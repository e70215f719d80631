"""The flight log: the only door between flying and estimating.

`measured` is what an observer may see; `truth` is what only a simulation knows. Both are labelled tables with units.

| dimension | meaning |
|---|---|
| `time` | samples, n + 1 of them [s] |
| `interval` | between two samples, n of them; its coordinate is the start [s]. Forces are means over it |
| `q_axis`, `v_axis` | configuration and velocity entries, named after their joints |
| `point`, `axis` | frames of unknown forces; x, y, z |
| `event` | what comes and goes of the unknown forces |
| `strip`, `link`, `wrench_axis` | arc coordinate of the strips; links; force and moment |
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
        measured: `q` (time, q_axis), or `pose` (time, pose_axis) of the body alone; whatever else there is, see
            `motion` and `known_inputs`; known generalised forces or body wrenches `known_*`.
        truth: `force_W`, `force_noise_free_W` (interval, point, axis), `unknown` (interval, v_axis), what the air does
            to robot, strips and links, and its state, `event_start`, `event_end` (event) where something comes and
            goes; None for a recorded flight.
    """

    measured: xr.Dataset
    truth: xr.Dataset | None = None

    def __post_init__(self) -> None:
        """Raise LogError unless the channels an observer needs are there, in order of time."""
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
        """Say how long the flight is and which channels it has."""
        time, truth = self.time, self.truth
        name = self.measured.attrs.get("scenario", "recorded flight")
        return (
            f"FlightLog({str(name)!r}, {len(time)} samples from {time[0]:g} to {time[-1]:g} s\n"
            f"  measured: {', '.join(map(str, self.measured.data_vars))}\n"
            f"  truth: {'none' if truth is None else ', '.join(map(str, truth.data_vars))})"
        )

    def _repr_html_(self) -> str:
        """Show the channels with their dimensions, units and meaning."""
        import pandas as pd  # half a second that flying need not pay

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
    """Make one labelled channel. Without coordinates of its own a Dataset takes it in a tenth of the time."""
    return xr.Variable(dims, np.asarray(values), attrs={"units": unit, "long_name": meaning})
