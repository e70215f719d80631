"""Write what was estimated from a recording: estimate.nc, estimate.csv, metrics.json, and the map that was used."""

from __future__ import annotations

from pathlib import Path

import tomli_w
import xarray as xr

from aerobat_pin.estimation import RecordingEstimate
from aerobat_pin.experiments.experiment import versions, write_metrics
from aerobat_pin.experiments.result_tables import estimate_dataset, estimate_table
from aerobat_pin.flight import netcdf_bytes
from aerobat_pin.numerics import guarded

RECORDED_RESULTS = (  # all that an estimate of a recording writes, as glob patterns
    "map.toml",
    "estimate.nc",
    "estimate.csv",
    "metrics.json",
    *(f"figures/{name}.{kind}" for name in ("forces", "sensor", "motion", "unexplained") for kind in ("png", "pdf")),
    "report.html",
    "replay.html",
    "forces.mcap",
)


@guarded()
def write_recorded(found: RecordingEstimate, folder: Path) -> None:
    """Write estimate.nc, estimate.csv, metrics.json and map.toml into an existing folder."""
    (folder / "estimate.nc").write_bytes(netcdf_bytes(recorded_dataset(found)))
    (folder / "estimate.csv").write_text(estimate_table(found.estimates), encoding="utf-8")
    values = found.record.map.model_dump(exclude_none=True, exclude_defaults=True, by_alias=True, mode="json")
    (folder / "map.toml").write_text(tomli_w.dumps(values), encoding="utf-8")
    write_metrics(found.metrics(versions()), folder)


def recorded_dataset(found: RecordingEstimate) -> xr.Dataset:
    """Return the content of `estimate.nc`: the forces, and beside them the sensor's where the map names one."""
    data = estimate_dataset(found.estimates)
    for side in list(found.compared.values())[:1]:
        words = f"force sensor at {side.point}, behind the filter of the map, world axes"
        attributes = {"units": "N, N m", "long_name": words}
        data = data.assign_coords(sensor_component=[f"{side.point}.{label}" for label in side.labels])
        data["sensor"] = (("interval", "sensor_component"), side.sensor, attributes)
    return data.assign_attrs(log=found.log.name, robot=found.record.robot.title)
