"""A fixed-step Runge-Kutta method on a configuration manifold. It does not depend on the robot.

The commutator-free method of order four of Celledoni, Marthinsen & Owren (Future Generation Computer Systems 19,
2003), written for body velocities: `retract(q, xi)` is q exp(xi), for example `pinocchio.integrate`. With stage
velocities k1 to k4 and step h, the stages q2 to q4 and the result q' are

    q2 = q exp(h/2 k1)        q4 = q2 exp(h k3 - h/2 k1)
    q3 = q exp(h/2 k2)        q' = q exp(h (k1/4 + k2/6 + k3/6 - k4/12)) exp(h (-k1/12 + k2/6 + k3/6 + k4/4))

Beside the point q on the manifold, the method integrates a vector y, for which it is the classical Runge-Kutta method.

Stages are counted from 0. `lie_step` goes from stage to stage on the manifold. At each stage it calls a function of the
caller, which calls `next_tangent` for q, `next_state` for y, and `add_stage` for quantities to be averaged over the
step.
"""

from __future__ import annotations

from collections.abc import Callable

from aerobat_pin.numerics.arrays import Array
from aerobat_pin.numerics.jit import kernel

Evaluation = Callable[[int, Array], tuple[Array, Array]]
Retraction = Callable[[Array, Array], Array]

HALF_STEPS = (0, 1, 1, 2)  # time of each stage, in half steps from the start
DEPARTURES = (0, 0, 1, 0)  # for each stage, where the tangent to the next stage starts: 0 at q, 1 at q2
WEIGHTS = (1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0)  # weights of the stages in the mean over the step


@kernel
def next_tangent(stage: int, dt: float, k: Array, tangent: Array) -> None:
    """Write the tangent from a stage to the next stage.

    Args:
        stage: the stage that was just evaluated.
        dt: time step.
        k: (4, m) velocities of q at the stages; rows after `stage` are not read.
        tangent: (2, m or more) the first m columns are written. Row 0 is the tangent to the next stage. After the last
            stage, rows 0 and 1 are the two tangents that lead to the next step, applied in this order.
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


@kernel
def next_state(stage: int, dt: float, rate: Array, start: Array, state: Array) -> None:
    """Write y at the next stage; after the last stage, write y at the next step.

    Args:
        stage: the stage that was just evaluated.
        dt: time step.
        rate: (4, n) rates of y at the stages.
        start: (n,) y at the start of the step.
        state: (n,) written: y at the next stage or step.
    """
    for i in range(start.shape[0]):
        if stage < 2:
            state[i] = start[i] + 0.5 * dt * rate[stage, i]
        elif stage == 2:
            state[i] = start[i] + dt * rate[2, i]
        else:
            state[i] = start[i] + dt * (rate[0, i] + 2.0 * (rate[1, i] + rate[2, i]) + rate[3, i]) / 6.0


@kernel
def add_stage(stage: int, values: Array, mean: Array) -> None:
    """Add the values (n,) of a stage, times the weight of the stage, to their mean over the step (n,)."""
    for i in range(values.shape[0]):
        mean[i] += WEIGHTS[stage] * values[i]


def lie_step(evaluate: Evaluation, retract: Retraction, q: Array) -> Array:
    """Advance one step on the manifold.

    Args:
        evaluate: function (stage, q) that evaluates a stage at q and returns the two rows of `next_tangent`.
        retract: function (q, tangent) -> q.
        q: point on the manifold at the start of the step.

    Returns:
        The point q at the next step.
    """
    q2 = retract(q, evaluate(0, q)[0])
    q3 = retract(q, evaluate(1, q2)[0])
    q4 = retract(q2, evaluate(2, q3)[0])
    first, second = evaluate(3, q4)
    return retract(retract(q, first), second)
