"""Observers of external forces on any `pinocchio.Model`. They see samples and known inputs, and know nothing of air."""

from aerobat_pin.observers.base import DEFAULT_GAIN, Estimate, Observer, Sample
from aerobat_pin.observers.force_level import ForceLevelObserver
from aerobat_pin.observers.force_points import Identifiability
from aerobat_pin.observers.momentum import MomentumObserver

OBSERVERS: dict[str, type[Observer]] = {kind.name: kind for kind in (MomentumObserver, ForceLevelObserver)}

__all__ = [
    "DEFAULT_GAIN",
    "OBSERVERS",
    "Estimate",
    "ForceLevelObserver",
    "Identifiability",
    "MomentumObserver",
    "Observer",
    "Sample",
]
