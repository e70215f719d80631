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
| `thruster` | the thrusters that flew a closed loop, by name |
| `strip`, `link`, `wrench_axis` | strips, by their arc coordinate; links; components of force and moment |
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import InitVar, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from aerobat_pin.aerobat.aerobat import JOINTS
from aerobat_pin.aerobat.channels import (
    MEASURED,
    OPTIONAL_TRUTH,
    RAW_CLOCKS,
    REQUIRED_TRUTH,
    angle_fault,
    checked_channels,
)
from aerobat_pin.errors import LogError, write_files
from aerobat_pin.numerics import Array, guarded
from aerobat_pin.records import Reference, TrueEvent, netcdf_bytes, read_netcdf
from aerobat_pin.scenario import AirSection

NAMES = ("scenario", "morphology")
TEXT_ATTRIBUTES = (*NAMES, "morphology_changes", "air")  # the last two contain JSON
LONGEST_NAME = 255
SUM = "sum"  # instead of a frame: the sum of the forces at all points


@guarded()
@dataclass(frozen=True, repr=False)
class FlightLog:
    """Channels of one flight.

    Attributes:
        measured: configuration `q` (time, q_axis), or `pose` (time, pose_axis) of the body alone, or raw samples of
            sensors, each with times of its own (`mocap_position` and others); known generalised forces or body
            wrenches `known_*`; optional channels, which a record of the flight has, too.
        truth: unknown forces `force_W`, `force_noise_free_W` (interval, point, axis) and `unknown` (interval, v_axis);
            aerodynamic forces on robot, strips and links; the aerodynamic state; powers; crank rate and torques if a
            motor turns the crank; `event_start` and `event_end` (event) if there are events. None for a recorded
            flight.
    """

    measured: xr.Dataset
    truth: xr.Dataset | None = None
    name: InitVar[str] = "flight log"

    def __post_init__(self, name: str) -> None:
        """Put labelled columns in their order, and raise LogError for what an observer could misread.

        Labels and units may be missing as a whole; the columns are then those of `channels.LABELS`, in SI units.
        """
        measured = checked_channels(self.measured, MEASURED, name, complete=False)
        object.__setattr__(self, "measured", measured)
        if not any(channel in measured for channel in ("q", "pose", "mocap_position")):
            raise LogError(f"{name}: no channel named q or pose, nor mocap_position")
        _check_clocks(measured, name)
        samples = measured.sizes["time"]
        if (intervals := measured.sizes.get("interval", samples - 1)) != samples - 1:
            raise LogError(f"{name}: {intervals} intervals between {samples} samples")
        _check_angles(measured, name)
        _check_attributes(measured.attrs, name)

    def __repr__(self) -> str:
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

    @property
    def is_raw(self) -> bool:
        """Whether the log contains raw samples of sensors, each with times of its own, instead of q and v."""
        return "mocap_position" in self.measured

    @guarded()
    def save(self, path: str | Path) -> None:
        """Write NetCDF-4: measured channels at the root, truth in the group `truth`; completely or not at all.

        Raises OutputError if the file cannot be written.
        """
        write_files({Path(path): netcdf_bytes(self.measured, self.truth)})

    @classmethod
    @guarded()
    def load(cls, path: str | Path) -> FlightLog:
        """Read a flight log from NetCDF-4.

        Raises:
            LogError: the file is missing, damaged, or not a flight log, or a label, unit or value in it is wrong.
        """
        name = f"flight log {path}"
        parts = read_netcdf(path, "flight log", ("truth",))
        measured = checked_channels(parts[""], MEASURED, name, complete=True)
        log = cls(measured, None, name)
        _check_clock(measured, log.time, name)
        return log if "truth" not in parts else cls(measured, _checked_truth(parts["truth"], log.time, name), name)


def _checked_truth(truth: xr.Dataset, time: Any, name: str) -> xr.Dataset:
    """Return the truth of a log with its columns in order. Raises LogError if it is not the truth of this flight."""
    name = f"{name}, group truth"
    truth = checked_channels(truth, REQUIRED_TRUTH | OPTIONAL_TRUTH, name, complete=True)
    for key in REQUIRED_TRUTH:
        if key not in truth:
            raise LogError(f"{name}: no channel named {key}")
    _check_clock(truth, time, name)
    if truth.sizes["interval"] != len(time) - 1:
        raise LogError(f"{name}: {truth.sizes['interval']} intervals between {len(time)} samples")
    for dim in ("point", "event"):
        if truth.sizes.get(dim) and (dim not in truth.coords or truth[dim].dtype.kind != "U"):
            raise LogError(f"{name}: {dim} has no labels: names were expected")
    if "event" in truth.dims and not {"event_point", "event_start", "event_end"} <= set(truth.variables):
        raise LogError(f"{name}: events need event_point, event_start and event_end")
    return truth


def _check_clock(data: xr.Dataset, time: Any, name: str) -> None:
    """Raise LogError unless the coordinates of a dataset are the times (n + 1,) [s] of the flight."""
    for key, expected in (("time", time), ("interval", time[:-1])):
        if key in data.dims:
            if key not in data.coords:
                raise LogError(f"{name}: no coordinate named {key}")
            stamps, unit = data[key].values, data[key].attrs.get("units")
            if unit != "s":
                raise LogError(f"{name}: coordinate {key} has units = {str(unit)[:40]!r}: 's' was expected")
            if len(stamps) == len(expected) and not np.allclose(stamps, expected, rtol=0.0, atol=1e-9):
                at = int(np.argmax(~(np.abs(stamps - expected) <= 1e-9)))
                raise LogError(f"{name}: {key} {at} is {stamps[at]:g} s: {expected[at]:g} s was expected")


def _check_clocks(measured: xr.Dataset, name: str) -> None:
    """Raise LogError unless the samples, and those of every raw channel, have two or more finite times, which rise.

    Times of a log without raw samples may repeat.
    """
    raw = "mocap_position" in measured
    if raw and "mocap_quaternion" not in measured:
        raise LogError(f"{name}: mocap_position without mocap_quaternion: both or none were expected")
    for clock in ("time", *(clock for clock in RAW_CLOCKS if clock in measured.dims)):
        if clock not in measured.coords:
            raise LogError(f"{name}: no coordinate named {clock}")
        time = measured[clock].values
        if time.dtype.kind not in "fiu":
            raise LogError(f"{name}: the coordinate {clock} has no numbers: seconds were expected")
        if len(time) < 2:
            raise LogError(f"{name}: {len(time)} samples along {clock}: two or more were expected")
        repeats, step = clock == "time" and not raw, np.diff(time, prepend=-np.inf)
        wrong = ~np.isfinite(time) | (step < 0.0 if repeats else step <= 0.0)
        if np.any(wrong):
            at, rule = int(np.argmax(wrong)), "must not decrease" if repeats else "rise"
            raise LogError(f"{name}: {clock}, sample {at} = {time[at]:g} s: time must be finite and {rule}")


def _check_angles(measured: xr.Dataset, name: str) -> None:
    """Raise LogError for angles that are in degrees."""
    time = measured["time"].values
    crank = measured["crank_angle"].values if "crank_angle" in measured else None
    for key in ("q", "joint_angle", None):
        joints = measured[key].values[:, -len(JOINTS) :] if key in measured else None
        if (fault := angle_fault(time, crank, joints)) is not None:
            raise LogError(f"{name}: {fault}")


def _check_attributes(attributes: dict[Any, Any], name: str) -> None:
    """Raise LogError for a wrong note about the robot or the air."""
    for key in TEXT_ATTRIBUTES:
        if key in attributes and not isinstance(attributes[key], str):
            raise LogError(f"{name}: attribute {key} = {str(attributes[key])[:60]!r}: text was expected")
        if key in NAMES and len(attributes.get(key, "")) > LONGEST_NAME:
            raise LogError(f"{name}: attribute {key} has {len(attributes[key])} letters: a name was expected")
    if "gravity" in attributes:
        gravity = attributes["gravity"]
        if not isinstance(gravity, (int, float, np.number)) or not 0.0 <= float(gravity) <= 100.0:
            raise LogError(f"{name}: attribute gravity = {str(gravity)[:60]!r}: a number in m/s2 was expected")
    try:
        if not isinstance(json.loads(attributes.get("morphology_changes", "{}")), dict):
            raise ValueError
    except (ValueError, RecursionError):
        raise LogError(f"{name}: attribute morphology_changes: a JSON object was expected") from None
    try:
        AirSection.model_validate_json(attributes.get("air", "{}"))
    except ValueError as error:
        reason = " ".join(str(error).split("For further")[0].split())[:200]
        raise LogError(f"{name}: attribute air: {reason}") from None


@guarded()
def true_force(log: FlightLog, frame: str) -> tuple[Array, Array]:
    """Return the true unknown force at a frame and its noise-free part, (m, 3) each, in world axes [N].

    Both are zero if no unknown force acts at the frame. The frame `sum` stands for all points together.
    """
    assert log.truth is not None
    points = [str(name) for name in log.truth["point"].values]
    chosen = [frame in (point, SUM) for point in points]
    noisy, clean = (log.truth[name].values[:, chosen].sum(axis=1) for name in ("force_W", "force_noise_free_W"))
    return noisy, clean


@guarded()
def truth_of(log: FlightLog, frames: Sequence[str]) -> tuple[Reference, ...]:
    """Return the true forces at frames as references of estimates; none if the log has no truth."""
    if log.truth is None:
        return ()
    return tuple(Reference(frame, "truth", ("Fx", "Fy", "Fz"), *true_force(log, frame)) for frame in frames)


@guarded()
def true_events(log: FlightLog) -> list[TrueEvent]:
    """Return the events of the true forces, sorted by time; an event at several frames is listed once."""
    if log.truth is None or "event" not in log.truth.dims:
        return []
    names, frames, starts, ends = (
        log.truth[name].values for name in ("event", "event_point", "event_start", "event_end")
    )
    frames_of: dict[tuple[float, float, str], list[str]] = {}
    for name, frame, start, end in zip(names, frames, starts, ends, strict=True):
        frames_of.setdefault((float(start), float(end), str(name)), []).append(str(frame))
    return [TrueEvent(name, tuple(where), start, end) for (start, end, name), where in sorted(frames_of.items())]
