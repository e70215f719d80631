"""Run a scenario (simulate the flight, estimate the forces, score and write the results), or a sweep of many.

Each name is imported only when it is first used, so that `aerobat list` need not wait for a simulator to load.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from aerobat_pin.experiments.experiment import RESULTS as RESULTS
    from aerobat_pin.experiments.experiment import Experiment as Experiment
    from aerobat_pin.experiments.experiment import Progress as Progress
    from aerobat_pin.experiments.experiment import run as run
    from aerobat_pin.experiments.experiment import run_recorded as run_recorded
    from aerobat_pin.experiments.experiment import write as write
    from aerobat_pin.experiments.notes import flight_note as flight_note
    from aerobat_pin.experiments.notes import recorded_note as recorded_note
    from aerobat_pin.experiments.recorded_results import RECORDED_RESULTS as RECORDED_RESULTS
    from aerobat_pin.experiments.recorded_results import write_recorded as write_recorded
    from aerobat_pin.experiments.result_tables import estimate_dataset as estimate_dataset
    from aerobat_pin.experiments.result_tables import read_estimates as read_estimates
    from aerobat_pin.experiments.sweep.plan import load_sweep as load_sweep
    from aerobat_pin.experiments.sweep.run_sweep import run_sweep as run_sweep
    from aerobat_pin.experiments.sweep.sweep_file import shipped_sweeps as shipped_sweeps

_PLACES = {
    "experiment": ["RESULTS", "Experiment", "Progress", "run", "run_recorded", "write"],
    "notes": ["flight_note", "recorded_note"],
    "recorded_results": ["RECORDED_RESULTS", "write_recorded"],
    "result_tables": ["estimate_dataset", "read_estimates"],
    "sweep.plan": ["load_sweep"],
    "sweep.run_sweep": ["run_sweep"],
    "sweep.sweep_file": ["shipped_sweeps"],
}
__all__ = [name for names in _PLACES.values() for name in names]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module = next(module for module, names in _PLACES.items() if name in names)
    return getattr(import_module(f"{__name__}.{module}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
