"""The robot's aerodynamics, called from Python with the memory that kernels read; only tests have a use for that."""

from __future__ import annotations

from aerobat_pin.aerodynamics import air_loads
from aerobat_pin.aerodynamics.strip_forces import air_in
from aerobat_pin.numerics import Array, kernel


@kernel
def air_loads_in(memory: Array, twists: Array, state: Array, wrenches: Array, rates: Array, loads: Array) -> None:
    """Compute what `air_loads` does, reading the aerodynamic constants from `RobotAir.memory`."""
    air_loads(air_in(memory), twists, state, wrenches, rates, loads)
