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

from aerobat_pin.arrays import Array

Output = TypeVar("Output")
Rates = Callable[[float, Array, Array], tuple[Array, Array, Output]]
Retraction = Callable[[Array, Array], Array]


def step(
    rates: Rates[Output], retract: Retraction, t: float, q: Array, y: Array, dt: float
) -> tuple[Array, Array, tuple[Output, Output, Output, Output]]:
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
    k1, l1, out1 = rates(t, q, y)
    q2 = retract(q, 0.5 * dt * k1)
    k2, l2, out2 = rates(t + 0.5 * dt, q2, y + 0.5 * dt * l1)
    q3 = retract(q, 0.5 * dt * k2)
    k3, l3, out3 = rates(t + 0.5 * dt, q3, y + 0.5 * dt * l2)
    q4 = retract(q2, dt * (k3 - 0.5 * k1))
    k4, l4, out4 = rates(t + dt, q4, y + dt * l3)
    half = retract(q, dt * (k1 / 4.0 + (k2 + k3) / 6.0 - k4 / 12.0))
    q_next = retract(half, dt * (-k1 / 12.0 + (k2 + k3) / 6.0 + k4 / 4.0))
    y_next = y + dt * stage_mean((l1, l2, l3, l4))
    return q_next, y_next, (out1, out2, out3, out4)


def stage_mean(stages: tuple[Array, Array, Array, Array]) -> Array:
    """Return the mean over the step that the method's own weights give: (s1 + 2 s2 + 2 s3 + s4) / 6."""
    return (stages[0] + 2.0 * (stages[1] + stages[2]) + stages[3]) / 6.0
