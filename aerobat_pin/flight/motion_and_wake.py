"""What figures and replays show of a flight: the motion of a log without configurations, and the wake that was shed.

The wake tells where each strip shed vorticity, and how much. When a strip's bound circulation Gamma changes, the wake
receives the opposite change (Kelvin): between samples k and k + 1 a strip sheds a vortex of strength
-(Gamma_k+1 - Gamma_k) across the flow, at its trailing edge. Where the circulation differs between neighbouring strips
i - 1 and i, a vortex of strength Gamma_i - Gamma_i-1 trails along the flow; outside the tips the circulation counts as
zero.

The wake is frozen: it drifts with the wind and does not move itself, so it does not roll up. This wake is computed
after the flight. The forces in flight come from the lifting line's own wake model (Wagner and Prandtl), in which the
wake lies straight behind the wing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
import xarray as xr

from aerobat_pin.aerobat import KNOWN, LABELS, LINKS, Aerobat, FlightLog, filled, robot_air, wind_of
from aerobat_pin.aerodynamics import Wind
from aerobat_pin.errors import LogError
from aerobat_pin.numerics import Array, guarded
from aerobat_pin.scenario import AirSection


@guarded(q="any", v="any", crank="any")
def log_with_motion(
    log: FlightLog, q: Array | None = None, v: Array | None = None, crank: Array | None = None
) -> FlightLog:
    """Return a log with q (m + 1, nq), v (m + 1, nv) and a crank angle (m + 1,) [rad] in place of raw samples.

    A log that has q and v stays as it is. The true motion of raw samples is shown where the log has it, the estimated
    one that is given elsewhere.
    """
    if {"q", "v"} <= set(log.measured) or not (log.is_raw or (q is not None and v is not None)):
        return log
    labels = {dim: list(LABELS[dim]) for dim in ("q_axis", "v_axis")}
    if not log.is_raw:
        motion = {name: filled(name, values) for name, values in (("q", q), ("v", v)) if values is not None}
        return FlightLog(log.measured.assign_coords(labels).assign(motion), log.truth)
    truth = log.truth
    exact = {} if truth is None else {name: truth[name].values for name in ("q", "v", "crank_angle") if name in truth}
    values = {"q": q, "v": v, "crank_angle": crank} | exact
    measured = log.measured[[str(name) for name in log.measured.data_vars if str(name).startswith(KNOWN)]]
    measured = measured.drop_dims([dim for dim in measured.dims if dim not in ("time", "interval", "v_axis")])
    channels = {name: filled(name, value) for name, value in values.items() if value is not None}
    coords = {name: log.measured[name] for name in ("time", "interval")}
    kept = {name: values.variable for name, values in measured.data_vars.items()}
    return FlightLog(xr.Dataset({**kept, **channels}, coords={**coords, **labels}, attrs=log.measured.attrs), truth)


@dataclass(frozen=True)
class Wake:
    """A frozen wake at m samples and N strips, left tip first.

    Attributes:
        time: (m,) time of shedding [s].
        position: (m, N, 3) position of the strips' trailing edges at that time, world axes [m].
        bound: (m, N) bound circulation of the strips [m2/s].
        wind: wind with which the wake drifts.
    """

    time: Array
    position: Array
    bound: Array
    wind: Wind

    @property
    def shed(self) -> Array:
        """Circulation (m - 1, N) shed across the flow between samples [m2/s]: minus the change of bound circulation."""
        return -np.diff(self.bound, axis=0)

    @property
    def trailing(self) -> Array:
        """Circulation (m, N + 1) of the vortices along the flow, between strips and outside the tips [m2/s].

        Positive is the sense of rotation of a positive bound vortex bent backward at the left end of its strip.
        """
        return np.diff(self.bound, axis=1, prepend=0.0, append=0.0)

    @guarded()
    def mean_trailing(self, start: float, end: float) -> Array:
        """Return the mean strength (N + 1,) [m2/s] of the trailing vortices shed from `start` to `end` [s].

        Over whole flaps of a steady flight, the vortices shed across the flow cancel and these mean trailing vortices
        remain: minus the spanwise change of the mean bound circulation.
        """
        chosen = (self.time >= start - 1e-9) & (self.time < end - 1e-9)
        return np.asarray(self.trailing[chosen].mean(axis=0))


@guarded()
def wake_of(log: FlightLog, robot: Aerobat, air: AirSection) -> Wake:
    """Read the wake from a simulated flight; of the air that it was flown in, strips and wind are used.

    Raises:
        LogError: the log has no truth, or its number of strips differs from `air.strips`.
    """
    if log.truth is None:
        raise LogError("the wake needs the bound circulation: this log has no group 'truth'; only simulated flights do")
    bound, incidence = (np.asarray(log.truth[name].values, float) for name in ("circulation", "incidence"))
    placed = robot_air(robot.wing, air)
    if bound.shape[1] != air.strips:
        raise LogError(f"the log has {bound.shape[1]} strips, air.strips = {air.strips}")
    # The trailing edge is the rear edge, or the front edge where the flow comes from behind.
    aft = np.where(np.cos(incidence) >= 0.0, -0.5, 0.5) * placed.line.chord
    data, joints = robot.model.createData(), [robot.model.getFrameId(link) for link in LINKS]
    position, pieces = np.zeros((*bound.shape, 3)), placed.pieces
    for k, q in enumerate(np.asarray(log.measured["q"].values, float)[: len(bound)]):
        pin.framesForwardKinematics(robot.model, data, q)
        for i, link, x, y, z, share in zip(*pieces[:6], strict=True):
            position[k, i] += share * data.oMf[joints[link]].act(np.array([x + aft[k, i], y, z]))
    return Wake(log.time[: len(bound)], position, bound, wind_of(air))
