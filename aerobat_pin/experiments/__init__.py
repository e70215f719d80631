"""Run a scenario (simulate the flight, estimate the forces, score and write the results), or a sweep of many."""

from aerobat_pin.experiments.experiment import RESULTS, Experiment, Progress, run, run_recorded, write
from aerobat_pin.experiments.notes import flight_note, recorded_note
from aerobat_pin.experiments.result_tables import estimate_dataset, read_estimates
from aerobat_pin.experiments.sweep import load_sweep, run_sweep, shipped_sweeps

__all__ = [
    "RESULTS",
    "Experiment",
    "Progress",
    "estimate_dataset",
    "flight_note",
    "load_sweep",
    "read_estimates",
    "recorded_note",
    "run",
    "run_recorded",
    "run_sweep",
    "shipped_sweeps",
    "write",
]
