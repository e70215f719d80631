"""Convert estimates to labelled tables, for NetCDF and CSV files."""

from __future__ import annotations

import pandas as pd
import xarray as xr

from aerobat_pin.numerics import guarded
from aerobat_pin.observers import Estimate


@guarded()
def estimate_dataset(estimates: dict[str, Estimate]) -> xr.Dataset:
    """Join the estimates of several observers into one dataset, the content of `estimate.nc`.

    All estimates must belong to the same log and have the same components.
    """
    return xr.concat([estimate.to_xarray() for estimate in estimates.values()], "observer", join="exact")


def estimate_table(estimates: dict[str, Estimate]) -> str:
    """Return the estimates as CSV text, with a row for each interval and a column for each observer and component."""
    first = next(iter(estimates.values()))
    columns = {"start [s]": first.time[:-1], "end [s]": first.time[1:]}
    for name, estimate in estimates.items():
        for i, (label, unit) in enumerate(zip(estimate.identifiability.components, estimate.units, strict=True)):
            columns[f"{name}.{label} [{unit}]"] = estimate.components[:, i]
            if estimate.standard_deviation is not None:
                columns[f"{name}.{label} deviation [{unit}]"] = estimate.standard_deviation[:, i]
    table = pd.DataFrame(columns)
    return str(table.to_csv(index=False, float_format="%.9g", na_rep="nan", lineterminator="\n"))
