"""A fixed-step Runge-Kutta method on a configuration manifold. It knows nothing about birds.

The commutator-free method of order four of Celledoni, Marthinsen & Owren (Future Generation Computer Systems 19,
2003), written for body velocities: `retract(q, xi)` is q exp(xi), `pinocchio.integrate` for instance. Beside the
point q on the manifold it carries a vector y, for which it is the classical Runge-Kutta method:

    q2 = q exp(h/2 k1)        q4 = q2 exp(h k3 - h/2 k1)
    q3 = q exp(h/2 k2)        q' = q exp(h (k1/4 + k2/6 + k3/6 - k4/12)) exp(h (-k1/12 + k2/6 + k3/6 + k4/4))
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np

from aerobat_pin.numerics.arrays import Array
from aerobat_pin.numerics.jit import kernel

Output = TypeVar("Output")
Rates = Callable[[float, Array, Array], tuple[Array, Array, Output]]
Retraction = Callable[[Array, Array], Array]


@kernel
def next_stage(stage: int, dt: float, k: Array, rate: Array, start: Array, state: Array, tangent: Array) -> None:
    """Prepare what follows a stage.

    Args:
        stage: 0 to 3, just evaluated.
        dt: step.
        k: (4, m) velocities of q at the stages.
        rate: (4, n) rates of y at the stages.
        start: (n,) y at the start of the step.
        state: (n,) written: y at the next stage; after stage 3 at the next step.
        tangent: (2, m or more) first m entries written: the way from q (stages 0, 1) or from q2 (stage 2) to the next
            stage in row 0; after stage 3 the two parts, one after the other, from q to the next step.
    """
    for i in range(k.shape[1]):
        if stage < 2:
            tangent[0, i] = 0.5 * dt * k[stage, i]
        elif stage == 2:
            tangent[0, i] = dt * (k[2, i] - 0.5 * k[0, i])
        else:
            middle = (k[1, i] + k[2, i]) / 6.0
            tangent[0, i] = dt * (0.25 * k[0, i] + middle - k[3, i] / 12.0)
            tangent[1, i] = dt * (0.25 * k[3, i] + middle - k[0, i] / 12.0)
    for i in range(start.shape[0]):
        if stage < 2:
            state[i] = start[i] + 0.5 * dt * rate[stage, i]
        elif stage == 2:
            state[i] = start[i] + dt * rate[2, i]
        else:
            state[i] = start[i] + dt * (rate[0, i] + 2.0 * (rate[1, i] + rate[2, i]) + rate[3, i]) / 6.0


def step(
    rates: Rates[Output], retract: Retraction, t: float, q: Array, y: Array, dt: float
) -> tuple[Array, Array, tuple[Output, ...]]:
    """Advance one step.

    Args:
        rates: (t, q, y) -> velocity of q in its tangent space, rate of y, and any output worth keeping.
        retract: (q, tangent) -> q.
        t: start time [s].
        q: point on the manifold.
        y: vector state.
        dt: step [s].

    Returns:
        q and y at t + dt, and the outputs of the four stages (at t, t + dt/2 twice, t + dt): see `stage_mean`.
    """
    here, state, start = q, np.array(y, float), np.array(y, float)
    second, outputs = q, []
    for stage in range(4):
        velocity, rate, output = rates(t + (0.0, 0.5, 0.5, 1.0)[stage] * dt, here, state)
        outputs.append(output)
        if stage == 0:
            k, slopes = np.zeros((4, len(velocity))), np.zeros((4, len(start)))
            tangent = np.zeros((2, len(velocity)))
        k[stage], slopes[stage] = velocity, rate
        state = np.empty_like(start)
        next_stage(stage, dt, k, slopes, start, state, tangent)
        if stage < 3:
            here = retract(second if stage == 2 else q, tangent[0])
        if stage == 0:
            second = here
    return retract(retract(q, tangent[0]), tangent[1]), state, tuple(outputs)


def stage_mean(stages: tuple[Array, ...]) -> Array:
    """Return the mean over the step that the method's own weights give: (s1 + 2 s2 + 2 s3 + s4) / 6."""
    return (stages[0] + 2.0 * (stages[1] + stages[2]) + stages[3]) / 6.0
