"""Steps of the package's integrator for equations written as a Python function."""

from collections.abc import Callable
from typing import TypeVar

import numpy as np

from aerobat_pin.numerics import HALF_STEPS, Array, lie_step, next_state, next_tangent
from aerobat_pin.numerics.lie_runge_kutta import Retraction

Output = TypeVar("Output")
Rates = Callable[[float, Array, Array], tuple[Array, Array, Output]]


def step(
    rates: Rates[Output], retract: Retraction, t: float, q: Array, y: Array, dt: float
) -> tuple[Array, Array, tuple[Output, ...]]:
    """Integrate rates(t, q, y) -> (tangent of q, rate of y, output) over a step; return q, y, the stages' outputs."""
    start, state, slopes = np.array(y, float), np.array(y, float), np.zeros((4, len(y)))
    velocities: list[Array] = []
    outputs: list[Output] = []

    def evaluate(stage: int, here: Array) -> tuple[Array, Array]:
        velocity, slopes[stage], output = rates(t + 0.5 * HALF_STEPS[stage] * dt, here, state.copy())
        velocities.append(np.array(velocity, float))
        outputs.append(output)
        tangent = np.zeros((2, len(velocity)))
        next_tangent(stage, dt, np.array(velocities), tangent)
        next_state(stage, dt, slopes, start, state)
        return tangent[0], tangent[1]

    return lie_step(evaluate, retract, q), state, tuple(outputs)
