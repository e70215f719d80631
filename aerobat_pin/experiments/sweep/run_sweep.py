"""Run a sweep, or resume one that was interrupted."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import xarray as xr

from aerobat_pin.experiments.sweep.checkpoint import GRID, TABLE, Checkpoint
from aerobat_pin.experiments.sweep.executors import in_this_process, on_cluster, on_this_machine
from aerobat_pin.experiments.sweep.plan import Sweep
from aerobat_pin.experiments.sweep.results import check_labels, results_csv, results_grid
from aerobat_pin.numerics import guarded
from aerobat_pin.records import netcdf_bytes

SweepProgress = Callable[[int, int, int], None]


@guarded()
def run_sweep(
    sweep: Sweep,
    folder: str | Path,
    *,
    jobs: int = 1,
    cluster: str | None = None,
    force: bool = False,
    progress: SweepProgress | None = None,
) -> xr.Dataset:
    """Simulate all runs that are not finished yet, save each as it ends, and finally write the results of all runs.

    Args:
        sweep: the sweep.
        folder: folder for the results; if it contains an interrupted run of this sweep, that run is resumed.
        jobs: number of processes on this machine.
        cluster: address of a Dask scheduler whose workers simulate in place of this machine.
        force: start from the beginning even if the folder is not empty.
        progress: called with three numbers of runs (finished, total, failed): once at the start, then after each run.

    Returns:
        The grid of results, as in `results.nc`.

    Raises:
        SweepError: the tables cannot hold the labels of a dimension.
        OutputError: the folder contains something else, or cannot be written.
        WorkersLostError: the processes that simulated some of the runs died; finished runs are kept.
    """
    check_labels(sweep)
    count = len(sweep.scenarios)
    with Checkpoint(Path(folder), sweep, force=force) as checkpoint:
        failed = sum("failed" in outcome for outcome in checkpoint.finished.values())
        left = {number: run for number, run in enumerate(sweep.scenarios) if number not in checkpoint.finished}
        if progress is not None:
            progress(len(checkpoint.finished), count, failed)
        if cluster is not None and left:
            outcomes = on_cluster(left, cluster)
        else:
            outcomes = in_this_process(left) if min(jobs, len(left)) < 2 else on_this_machine(left, jobs)
        for number, outcome in outcomes:
            checkpoint.add(number, outcome)
            failed += "failed" in checkpoint.finished[number]
            if progress is not None:
                progress(len(checkpoint.finished), count, failed)
        grid = results_grid(sweep, checkpoint.finished)
        checkpoint.write({GRID: netcdf_bytes(grid), TABLE: results_csv(sweep, checkpoint.finished).encode()})
    return grid
