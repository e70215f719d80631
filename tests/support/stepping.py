"""The mean that the package's integrator makes of its stages."""

from __future__ import annotations

from typing import Any

import numpy as np

from aerobat_pin.numerics.lie_runge_kutta import add_stage


def stage_mean(stages: tuple[Any, ...]) -> np.ndarray:
    """Return the mean over the step that the method's own weights give."""
    mean = np.zeros(np.shape(stages[0]))
    for stage, values in enumerate(stages):
        add_stage(stage, np.ravel(np.asarray(values, float)), mean.reshape(-1))
    return mean
