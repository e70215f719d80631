"""What a belief leaves unexplained in a flight: the generalised residual of each interval, not filtered."""

from __future__ import annotations

import pinocchio as pin

from aerobat_pin.estimation.known_inputs import KnownInputs
from aerobat_pin.numerics import Array
from aerobat_pin.observers import MomentumObserver

AT_ONCE = 1.0e9  # [1/s]: with so large a gain the filter of an observer passes every interval unchanged


def interval_residual(model: pin.Model, inputs: KnownInputs) -> Array:
    """Return phi (m, nv): mean unknown generalised force of each interval, in N and N m."""
    observer = MomentumObserver(model, (), AT_ONCE)
    return observer.run(inputs.time, inputs.q, inputs.v, inputs.tau, inputs.known).residual
