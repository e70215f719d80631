"""What is known before the first sample: a state of the robot, and how far it may be off."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from aerobat_pin.aerobat.raw.layout import CRANK_ERROR, POSE_ERROR, TWIST_ERROR, Layout
from aerobat_pin.aerobat.raw.nominal import NominalMotion
from aerobat_pin.numerics import Array
from aerobat_pin.scenario import RawSection

START = (0.03,) * 3 + (0.1,) * 3 + (1.0,) * 3 + (3.0,) * 3 + (0.01, 1.0, 100.0)
BIAS_PRIOR = (0.05,) * 3 + (0.5,) * 3
SLOPE_PRIOR = 100.0  # of the robot's weight, per second
FORCE_PRIOR = 2.0  # of the robot's weight
MOUNT_PRIOR = (0.02,) * 3 + (0.05,) * 3  # of the accelerometer [m, rad]


@dataclass(frozen=True)
class Prior:
    """State at a first knot: placement, twist and crank, the other states (n,), and the covariance (n, n) of all."""

    placement: pin.SE3
    twist: Array
    crank: Array
    mean: Array
    covariance: Array

    def about(self, nominal: NominalMotion) -> Array:
        """Return the mean (n,) as errors of a nominal motion's first knot."""
        x = self.mean.copy()
        x[POSE_ERROR] = pin.log6(pin.SE3(nominal.rotation[0], nominal.position[0]).actInv(self.placement)).vector
        x[TWIST_ERROR], x[CRANK_ERROR] = self.twist - nominal.twist[0], self.crank - nominal.crank[0]
        return x

    def padded(self, spreads: Array) -> Prior:
        """Return the prior with further states of mean 0 and standard deviations `spreads` (c,)."""
        size, more = len(self.mean), len(spreads)
        covariance = np.zeros((size + more, size + more))
        covariance[:size, :size] = self.covariance
        covariance[size:, size:] = np.diag(spreads**2)
        return Prior(self.placement, self.twist, self.crank, np.append(self.mean, np.zeros(more)), covariance)


def first_prior(layout: Layout, nominal: NominalMotion, weight: float, settings: RawSection) -> Prior:
    """Return a wide prior about the first knot of a first guess; `weight` is the robot's [N]."""
    spread = np.zeros(layout.size)
    spread[: len(START)] = START
    spread[layout.walk], spread[layout.slope] = FORCE_PRIOR * weight, SLOPE_PRIOR * weight
    spread[layout.gyro_bias], spread[layout.accelerometer_bias] = BIAS_PRIOR[:3], BIAS_PRIOR[3:]
    for at, error in ((layout.mass_at, settings.mass_error), (layout.air_at, settings.air_error)):
        if at is not None:
            spread[at] = error
    if layout.mount_at is not None:
        spread[layout.mount_at] = MOUNT_PRIOR
    return prior_at(nominal, 0, np.zeros(layout.size), np.diag(spread**2))


def prior_at(nominal: NominalMotion, k: int, x: Array, covariance: Array) -> Prior:
    """Return the prior of knot k, given errors x (n,) of the nominal motion there and their covariance."""
    placement = pin.SE3(nominal.rotation[k], nominal.position[k]) * pin.exp6(x[POSE_ERROR])
    return Prior(
        placement, nominal.twist[k] + x[TWIST_ERROR], nominal.crank[k] + x[CRANK_ERROR], x.copy(), covariance.copy()
    )
