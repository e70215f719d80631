"""Draw records of a robot on rails from the statistics that `kalman` and `smoother` assume, to judge deviations."""

# Torques keep the given motion, so that over each interval the trapezoid of the equations of motion is exact.

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from support.observer_twins import remembered

Vector = NDArray[np.float64]
LEAST_MISFIT, MISFIT_TIME, WALK, PRIOR, LEVER = 0.004, 0.01, 2.2, 0.33, 0.05  # of the weight; of the weight; [m]
KNOWN_NOISE = 0.02  # of the weight
SENSORS = (0.02, 0.01, 0.05)


@dataclass(frozen=True)
class Rails:
    """A true motion, and what observers keep of its samples; `misfit`: the rows err as they expect at least."""

    model: pin.Model
    time: Vector
    q: Vector
    v: Vector
    frames: Sequence[str]
    misfit: bool = True

    def draw(self, seed: int) -> tuple[Vector, Vector, Vector]:
        """Return measured velocities (m + 1, nv), torques (m, nv) and true forces (m, 3 frames)."""
        rng, dt, nv = np.random.default_rng(seed), np.diff(self.time)[:, None], self.model.nv
        weight = 9.81 * float(pin.computeTotalMass(self.model))
        kept = np.array([remembered(self.model, self.frames, *one) for one in zip(self.q, self.v, strict=True)])
        mean, count = 0.5 * (kept[1:] + kept[:-1]), 3 * len(self.frames)
        walk = np.cumsum(WALK * weight * np.sqrt(dt) * rng.normal(size=(len(dt), count)), axis=0)
        force = PRIOR * weight * rng.normal(size=count) + walk
        tau = np.diff(kept[:, 0], axis=0) / dt - mean[:, 1] - np.einsum("kci,kc->ki", mean[:, 3:], force)
        arms = np.where(np.arange(nv) < 3, 1.0, LEVER)
        error = LEAST_MISFIT * weight * arms * np.sqrt(MISFIT_TIME / dt) * rng.normal(size=tau.shape)
        noise = np.repeat(SENSORS, [3, 3, nv - 6]) * rng.normal(size=self.v.shape)
        told = KNOWN_NOISE * weight * arms * rng.normal(size=tau.shape)
        return self.v + noise, tau - error * self.misfit + told, force
