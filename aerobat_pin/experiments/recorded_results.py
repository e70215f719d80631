"""Write what was estimated from a recording: estimate.nc, estimate.csv, metrics.json, and the map that was used."""

from __future__ import annotations

import errno
import shutil
from collections.abc import Iterable, Iterator
from pathlib import Path

import h5netcdf
import tomli_w
import xarray as xr

from aerobat_pin.estimation import RecordingEstimate
from aerobat_pin.experiments.experiment import versions, write_metrics
from aerobat_pin.experiments.result_tables import estimate_dataset, estimate_table
from aerobat_pin.numerics import guarded
from aerobat_pin.observers import Estimate
from aerobat_pin.records import netcdf_bytes, seal_netcdf

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
    write_netcdf(_datasets(found), len(next(iter(found.stored.values()))), folder / "estimate.nc")
    with (folder / "estimate.csv").open("w", encoding="utf-8", newline="") as file:
        for blocks in _together(found):
            text = estimate_table(blocks)
            file.write(text.partition("\n")[2] if file.tell() else text)
    values = found.record.map.model_dump(exclude_none=True, exclude_defaults=True, by_alias=True, mode="json")
    (folder / "map.toml").write_text(tomli_w.dumps(values), encoding="utf-8")
    write_metrics(found.metrics(versions()), folder)


def write_netcdf(blocks: Iterable[xr.Dataset], count: int, path: Path) -> None:
    """Write blocks of intervals into one NetCDF-4 file.

    Args:
        blocks: datasets that follow each other along `interval`; one that has them all is written at once.
        count: number of intervals of all blocks together.
        path: the file; its folder must have room for it, because the HDF5 library ends the process on a full disk.

    Raises:
        OSError: the disk is full.
    """
    done = 0
    for block in blocks:
        size = block.sizes["interval"]
        if size == count:
            path.write_bytes(netcdf_bytes(block))
            return
        if not done:
            if shutil.disk_usage(path.parent).free < 1.5 * block.nbytes * count / size:
                raise OSError(errno.ENOSPC, "no room for the estimates", str(path))
            block.to_netcdf(path, engine="h5netcdf", unlimited_dims=["interval"])
            done = size
            continue
        with h5netcdf.File(path, "a") as file:
            file.resize_dimension("interval", done + size)
            for name, values in block.variables.items():
                if "interval" in values.dims:
                    rows = tuple(slice(done, done + size) if dim == "interval" else slice(None) for dim in values.dims)
                    file[str(name)][rows] = values.values
        done += size
    seal_netcdf(path)


def _together(found: RecordingEstimate) -> Iterator[dict[str, Estimate]]:
    """Yield blocks of the estimates of all observers, for the same intervals."""
    names = list(found.stored)
    for blocks in zip(*(estimate.blocks() for estimate in found.stored.values()), strict=True):
        yield dict(zip(names, blocks, strict=True))


def _datasets(found: RecordingEstimate) -> Iterator[xr.Dataset]:
    """Yield the content of `estimate.nc`: the forces, and beside them the sensor's where the map names one."""
    first = 0
    for blocks in _together(found):
        data = estimate_dataset(blocks)
        rows = slice(first, first + data.sizes["interval"])
        first = rows.stop
        for side in list(found.compared.values())[:1]:
            words = f"force sensor at {side.point}, behind the filter of the map, world axes"
            attributes = {"units": "N, N m", "long_name": words}
            data = data.assign_coords(sensor_component=[f"{side.point}.{label}" for label in side.labels])
            data["sensor"] = (("interval", "sensor_component"), side.sensor[rows], attributes)
        yield data.assign_attrs(log=found.record.title, robot=found.record.robot.title)
