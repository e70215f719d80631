"""Run a sweep, or resume an interrupted one: in this process, in several of this machine, or on a Dask cluster."""

from __future__ import annotations

import os
import signal
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from multiprocessing import resource_tracker
from pathlib import Path
from typing import Any

import xarray as xr

from aerobat_pin.errors import WorkersLostError, write_files
from aerobat_pin.estimation import versions
from aerobat_pin.experiments.sweep.checkpoint import GRID, TABLE, Checkpoint
from aerobat_pin.experiments.sweep.plan import Sweep, outcome_of
from aerobat_pin.experiments.sweep.results import check_labels, results_csv, results_grid
from aerobat_pin.numerics import guarded
from aerobat_pin.records import netcdf_bytes
from aerobat_pin.scenario import Scenario

Outcomes = Iterator[tuple[int, str]]
CONNECT = 20.0  # [s]: longest wait for the connection to a cluster
SweepProgress = Callable[[int, int, int], None]


def in_this_process(runs: Mapping[int, Scenario]) -> Outcomes:
    """Simulate runs one after the other; yields (run number, outcome) as each run ends."""
    for number, scenario in runs.items():
        yield number, outcome_of(scenario)


def on_this_machine(runs: Mapping[int, Scenario], jobs: int) -> Outcomes:
    """Simulate runs in several processes; yields (run number, outcome) as each run ends.

    When a process dies, new ones simulate the runs that are left; WorkersLostError if none of the last had finished.
    """
    from joblib import Parallel, delayed
    from joblib.externals.loky.process_executor import TerminatedWorkerError

    waiting = dict(runs)
    while waiting:
        before = len(waiting)
        try:
            pool = Parallel(
                n_jobs=min(jobs, before),
                return_as="generator_unordered",
                batch_size=1,
                initializer=_end_with,
                initargs=(os.getpid(),),
            )
            with _started(pool, [delayed(_numbered)(*item) for item in waiting.items()]) as outcomes:
                for number, outcome in outcomes:
                    waiting.pop(number)
                    yield number, outcome
        except TerminatedWorkerError as error:
            if len(waiting) == before:
                raise WorkersLostError(
                    f"the processes die at run {min(waiting)} or one soon after it (no memory left?); what is finished "
                    "is kept: the same command with fewer --jobs goes on"
                ) from error


def on_cluster(runs: Mapping[int, Scenario], address: str) -> Outcomes:
    """Simulate runs on a Dask cluster; yields (run number, outcome) as each run ends.

    Dask repeats runs that are lost when a worker dies.

    Raises:
        WorkersLostError: the cluster cannot be reached, `distributed` is not installed on this machine, the cluster
            has other package versions, or Dask gave up on some runs.
    """
    try:
        from distributed import Client, as_completed
    except ImportError as error:
        raise WorkersLostError("--cluster takes dask.distributed: pip install 'aerobat-pinocchio[cluster]'") from error
    try:
        client = Client(address, timeout=CONNECT)
    except (OSError, TimeoutError, ValueError) as error:
        raise WorkersLostError(
            f"cluster {address}: cannot be reached: {error}; the address of a Dask scheduler was expected, such as "
            "tcp://10.0.0.1:8786"
        ) from error
    with client:
        for worker, installed in client.run(versions, on_error="return").items():
            if installed != versions():
                raise WorkersLostError(
                    f"cluster {address}: worker {worker} has {installed}; the versions here were expected: {versions()}"
                )
        futures = {client.submit(outcome_of, scenario, pure=False): number for number, scenario in runs.items()}
        lost = {}
        for future in as_completed(list(futures)):
            number = futures.pop(future)  # once no future refers to a result, the cluster frees its memory
            if future.status == "finished":
                yield number, future.result()
            else:
                lost[number] = future.exception() if future.status == "error" else future.status
        if lost:
            number, reason = next(iter(lost.items()))
            raise WorkersLostError(
                f"cluster {address}: {len(lost)} runs were lost; the first, run {number}: {reason}; what is finished "
                "is kept: the same command goes on"
            )


@contextmanager
def _started(pool: Any, tasks: list[Any]) -> Iterator[Outcomes]:
    """Start tasks and provide their outcomes as they come; close the generator of outcomes at the end.

    A terminal sends Ctrl-C to all processes, but only this process can handle it; the worker processes therefore start
    with the signal blocked. Joblib's warnings about an interruption are not shown, nor what a thread of its own raises
    while its tasks are taken away; that begins inside its generator, before the caller hears of the interruption.
    """
    resource_tracker.ensure_running()  # otherwise it starts later, and unblocks the signal
    report = threading.excepthook
    threading.excepthook = partial(_unless_of_joblib, report)
    before, outcomes = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT}), None  # new processes inherit it
    try:
        outcomes = pool(tasks)
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        yield outcomes
        threading.excepthook = report
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            if outcomes is not None:
                outcomes.close()


def _unless_of_joblib(hook: Callable[[Any], Any], error: Any) -> None:
    """Report an error in a thread, unless it is joblib's own, which can fail while its tasks are taken away."""
    if not str(getattr(error.thread, "name", "")).startswith("ExecutorManagerThread"):
        hook(error)


def _numbered(number: int, scenario: Scenario) -> tuple[int, str]:
    return number, outcome_of(scenario)


def _end_with(parent: int) -> None:
    """End this worker process when its parent process is killed; nothing else would end it."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(0.5)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


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
        waiting = {number: run for number, run in enumerate(sweep.scenarios) if number not in checkpoint.finished}
        if progress is not None:
            progress(len(checkpoint.finished), count, failed)
        if cluster is not None and waiting:
            outcomes = on_cluster(waiting, cluster)
        else:
            outcomes = in_this_process(waiting) if min(jobs, len(waiting)) < 2 else on_this_machine(waiting, jobs)
        for number, outcome in outcomes:
            checkpoint.add(number, outcome)
            failed += "failed" in checkpoint.finished[number]
            if progress is not None:
                progress(len(checkpoint.finished), count, failed)
        grid = results_grid(sweep, checkpoint.finished)
        table = results_csv(sweep, checkpoint.finished).encode()
        write_files({checkpoint.folder / GRID: netcdf_bytes(grid), checkpoint.folder / TABLE: table})
    return grid
