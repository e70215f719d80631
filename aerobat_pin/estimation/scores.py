"""Estimate against truth, and what a flight was like: the numbers of `metrics.json`."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from aerobat_pin.flight import KNOWN, FlightLog
from aerobat_pin.numerics import Array
from aerobat_pin.observers import Estimate
from aerobat_pin.robot import euler_angles, world_velocity

AXES = ("Fx", "Fy", "Fz")
NO_SIGNAL = 1.0e-3  # [N]: below this standard deviation of the truth an R2 says nothing
LONGEST_LAG = 0.05  # [s]


@dataclass(frozen=True)
class AxisScore:
    """One axis of one force.

    Attributes:
        r2: coefficient of determination against the true force with its noise; None where there is no signal.
        r2_noise_free: the same against the noise-free part.
        rmse: root mean square error against the true force with its noise [N].
        lag_s: delay of the noise-free truth that fits the estimate best [s]; None where there is no signal.
    """

    r2: float | None
    r2_noise_free: float | None
    rmse: float
    lag_s: float | None


def point_label(frame: str) -> str:
    """Return the short name of a force point: `left` for `left_force_point`."""
    return frame.removesuffix("_force_point")


def r_squared(estimate: Array, truth: Array) -> float | None:
    """Return 1 - SSE/SST of two series (m,), or None where the truth's standard deviation is below 1 mN."""
    if np.std(truth) < NO_SIGNAL:
        return None
    return float(1.0 - np.sum((estimate - truth) ** 2) / np.sum((truth - np.mean(truth)) ** 2))


def lag(estimate: Array, truth: Array, dt: float) -> float | None:
    """Return the delay of `truth` (m,) that fits `estimate` (m,) best [s], between samples by a parabola.

    None without a signal, or where the best delay lies at the end of the 50 ms searched.
    """
    if np.std(truth) < NO_SIGNAL:
        return None
    longest = min(max(2, round(LONGEST_LAG / dt)), len(truth) // 4)
    # Row i of the windows is the truth delayed by longest - i samples, seen over the estimate's window.
    windows = np.lib.stride_tricks.sliding_window_view(truth, len(truth) - 1 - longest)
    errors = np.mean((estimate[longest:-1] - windows[longest + 1 :: -1]) ** 2, axis=1)
    best = int(np.argmin(errors))
    if best in (0, len(errors) - 1):
        return None
    before, here, after = errors[best - 1 : best + 2]
    bend = before - 2.0 * here + after
    offset = 0.5 * (before - after) / bend if bend > 0.0 else 0.0
    return float((best - 1 + offset) * dt)


def score(estimate: Array, truth: Array, noise_free: Array, dt: float) -> AxisScore:
    """Score one axis: series (m,) of interval means [N]."""
    return AxisScore(
        r2=r_squared(estimate, truth),
        r2_noise_free=r_squared(estimate, noise_free),
        rmse=float(np.sqrt(np.mean((estimate - truth) ** 2))),
        lag_s=lag(estimate, noise_free, dt),
    )


def true_force(log: FlightLog, frame: str) -> tuple[Array, Array]:
    """Return the true force and its noise-free part (m, 3) [N] in world axes at a frame; zero where nothing pushed."""
    assert log.truth is not None
    points = [str(name) for name in log.truth["point"].values]
    if frame not in points:
        zero = np.zeros((log.truth.sizes["interval"], 3))
        return zero, zero
    at = points.index(frame)
    return log.truth["force_W"].values[:, at], log.truth["force_noise_free_W"].values[:, at]


@dataclass(frozen=True)
class TrueEvent:
    """What came and went: its name, the frames at which it pushed, from when to when [s], infinity where it stayed."""

    name: str
    frames: tuple[str, ...]
    start: float
    end: float


def true_events(log: FlightLog) -> list[TrueEvent]:
    """Return what came and went of the true forces, in order of time; what did so at several frames at once is one."""
    if log.truth is None or "event" not in log.truth.dims:
        return []
    names, frames, starts, ends = (
        log.truth[name].values for name in ("event", "event_point", "event_start", "event_end")
    )
    found: dict[tuple[float, float, str], list[str]] = {}
    for name, frame, start, end in zip(names, frames, starts, ends, strict=True):
        found.setdefault((float(start), float(end), str(name)), []).append(str(frame))
    return [TrueEvent(name, tuple(there), start, end) for (start, end, name), there in sorted(found.items())]


def observer_metrics(estimate: Estimate, log: FlightLog) -> dict[str, Any]:
    """Return an observer's entry of `metrics.json`; scores only where the log knows the truth."""
    found = estimate.identifiability
    metrics: dict[str, Any] = {}
    if log.truth is not None:
        dt = float(np.median(np.diff(estimate.time)))
        for i, frame in enumerate(estimate.frames):
            truth, noise_free = true_force(log, frame)
            metrics[point_label(frame)] = {
                axis: asdict(score(estimate.force[:, i, k], truth[:, k], noise_free[:, k], dt))
                for k, axis in enumerate(AXES)
            }
    sizes = np.sqrt(np.mean(estimate.components**2, axis=0))
    metrics["components"] = [
        {"name": name, "rms": size, "unit": unit}
        for name, size, unit in zip(found.components, sizes.tolist(), estimate.units, strict=True)
    ]
    metrics["gain"] = estimate.gain.tolist()
    metrics["rank"] = found.rank
    metrics["condition"] = found.condition if np.isfinite(found.condition) else None
    metrics["null_direction"] = None if found.null_direction is None else found.null_direction.tolist()
    metrics["unseen"] = found.describe()
    return metrics


def flight_metrics(log: FlightLog, mass: float) -> dict[str, Any]:
    """Return the flight's entry of `metrics.json`, SI and radians.

    Args:
        log: the flight.
        mass: of the robot [kg].
    """
    measured = log.measured
    q = (measured if log.truth is None or "q" not in log.truth else log.truth)["q"].values
    angles = euler_angles(q)
    weight = mass * float(measured.attrs["gravity"])
    metrics: dict[str, Any] = {
        "duration": float(log.time[-1]),
        "position_end": q[-1, :3].tolist(),
        "z_range": [float(q[:, 2].min()), float(q[:, 2].max())],
    }
    for i, name in enumerate(("roll", "pitch", "yaw")):
        metrics[f"{name}_range"] = [float(angles[:, i].min()), float(angles[:, i].max())]
    forces = {"thrusters": measured[f"{KNOWN}thrusters"].values} if f"{KNOWN}thrusters" in measured else {}
    if log.truth is not None:
        forces["aerodynamic"] = log.truth["aerodynamic"].values + log.truth["added_mass"].values
    for name, force in forces.items():
        if weight > 0.0:
            lift = world_velocity(q[:-1], force)[:, 2]
            metrics[f"{name}_lift_over_weight"] = float(np.mean(lift) / weight)
    if log.truth is not None:
        metrics["motor_power_mean"] = float(np.mean(log.truth["motor_power"].values))
        incidence = log.truth["incidence"].values
        metrics["incidence_range"] = [float(incidence.min()), float(incidence.max())]
    return metrics
