"""The motion of a log without configurations, for figures and replays, which need them."""

from __future__ import annotations

import xarray as xr

from aerobat_pin.aerobat import KNOWN, LABELS, FlightLog, filled
from aerobat_pin.numerics import Array, guarded


@guarded(q="any", v="any", crank="any")
def log_with_motion(
    log: FlightLog, q: Array | None = None, v: Array | None = None, crank: Array | None = None
) -> FlightLog:
    """Return a log with q and v, and a crank angle in place of raw samples; a log that has q and v stays as it is.

    The true motion of raw samples is shown where the log has it.

    Args:
        log: the flight log.
        q: (m + 1, nq) estimated configurations.
        v: (m + 1, nv) estimated velocities.
        crank: (m + 1,) estimated crank angle [rad].
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
    made = {name: filled(name, value) for name, value in values.items() if value is not None}
    coords = {name: log.measured[name] for name in ("time", "interval")}
    kept = {name: values.variable for name, values in measured.data_vars.items()}
    return FlightLog(xr.Dataset({**kept, **made}, coords={**coords, **labels}, attrs=log.measured.attrs), truth)
