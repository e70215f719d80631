"""Estimates as labelled tables: NetCDF and text."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from aerobat_pin.flight import channel
from aerobat_pin.observers import Estimate


def estimate_dataset(estimates: dict[str, Estimate]) -> xr.Dataset:
    """Label the estimates of several observers on one log for `estimate.nc`; all have the same components.

    Forces in world axes are `force_W` (observer, interval, point, axis). Where other components are estimated, all are
    `components` (observer, interval, component), each with its `unit`.
    """
    first, all_of = next(iter(estimates.values())), list(estimates.values())
    coords: dict[str, Any] = {
        "observer": list(estimates),
        "interval": channel(first.time[:-1], ("interval",), "s", "start of the interval"),
        "interval_end": channel(first.time[1:], ("interval",), "s", "end of the interval"),
    }
    if first.are_world_forces:
        name, meaning = "force_W", "force in world axes"
        dims: tuple[str, ...] = ("point", "axis")
        coords |= {"point": list(first.frames), "axis": ["x", "y", "z"]}
    else:
        name, meaning, dims = "components", "component", ("component",)
        coords |= {"component": list(first.identifiability.components), "unit": (dims, list(first.units))}
    unit, every = ", ".join(dict.fromkeys(first.units)), ("observer", "interval")
    shape = (len(estimates), len(first.components), *(len(coords[dim]) for dim in dims))
    unknown = np.full_like(first.components, np.nan)
    found = np.stack([one.components for one in all_of]).reshape(shape)
    sure = np.stack([unknown if one.standard_deviation is None else one.standard_deviation for one in all_of])
    residual = np.stack([one.residual for one in all_of])
    return xr.Dataset(
        {
            name: channel(found, (*every, *dims), unit, f"estimated {meaning}, mean over the interval"),
            "standard_deviation": channel(
                sure.reshape(shape), (*every, *dims), unit, f"of the estimated {meaning}, where the observer knows it"
            ),
            "residual": channel(residual, (*every, "v_axis"), "N, N m", "estimated generalised force"),
        },
        coords=coords,
    )


def estimate_table(estimates: dict[str, Estimate]) -> str:
    """Return the estimates as CSV: a row per interval, a column per observer and component."""
    first = next(iter(estimates.values()))
    columns = {"start [s]": first.time[:-1], "end [s]": first.time[1:]}
    for name, estimate in estimates.items():
        for i, (label, unit) in enumerate(zip(estimate.identifiability.components, estimate.units, strict=True)):
            columns[f"{name}.{label} [{unit}]"] = estimate.components[:, i]
            if estimate.standard_deviation is not None:
                columns[f"{name}.{label} deviation [{unit}]"] = estimate.standard_deviation[:, i]
    table = pd.DataFrame(columns)
    return str(table.to_csv(index=False, float_format="%.9g", na_rep="nan", lineterminator="\n"))
