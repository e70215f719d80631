"""The observers' filters, which smooth the interval means of the residual or of the forces."""

from __future__ import annotations

import numpy as np

from aerobat_pin.numerics import Array, inner
from aerobat_pin.observers.kernels.observer_state import ObserverState

FIRST_ORDER, SECOND_ORDER, SUPER_TWISTING = 0, 1, 2
# A critically damped second-order low-pass has risen to 1 - 1/e at rate x time = RISE: (1 + x) exp(-x) = exp(-1).
RISE = 2.1461932206205825


@inner
def rotate(basis: Array, value: Array, out: Array, back: bool) -> None:
    """Write the coordinates of a vector (size,) in an orthonormal basis, or with `back` the vector of coordinates."""
    for i in range(value.shape[0]):
        out[i] = 0.0
        for j in range(value.shape[0]):
            out[i] += (basis[i, j] if back else basis[j, i]) * value[j]


@inner
def low_pass(observer: ObserverState, dt: float, value: Array) -> None:
    """Filter a value (size,) in place, constant over an interval dt [s]; exact for the linear filters."""
    first, second, kind = observer.filtered[0], observer.filtered[1], observer.sizes.filter
    decay = 0.0
    for i in range(value.shape[0]):
        gain = observer.gain[i]
        if kind == FIRST_ORDER:
            if i == 0 or gain != observer.gain[i - 1]:
                decay = np.exp(-gain * dt)
            first[i] = value[i] + decay * (first[i] - value[i])  # r = phi + exp(-K dt) (r - phi)
        elif kind == SECOND_ORDER:
            rate = RISE * gain
            decay = np.exp(-rate * dt)
            gap = first[i] - value[i]
            drive = second[i] + rate * gap
            first[i] = value[i] + (gap + drive * dt) * decay
            second[i] = (second[i] - rate * drive * dt) * decay
        else:
            super_twist(RISE * gain, observer.slope[0], dt, value[i], observer.filtered[:, i])
        value[i] = first[i]


@inner
def super_twist(rate: float, slope: float, dt: float, value: float, state: Array) -> None:
    """Advance z [N] and e [N s], the state (2,), of `momentum_equations._super_twisting` by one implicit Euler step.

    The equations stand there. The linear part is critically damped at a rate [1/s], and f is followed exactly up to a
    slope |f'| [N/s]; over the step dt [s] its mean is the value [N].
    """
    pushed = state[1] + dt * (value - state[0])
    reach = 1.1 * slope * dt * dt
    if abs(pushed) <= reach:  # on the sliding surface, where `sign e` takes the value that keeps e at zero
        state[0] += pushed / dt
        state[1] = 0.0
        return
    a, b = 1.0 + 2.0 * rate * dt + (rate * dt) ** 2, 1.5 * np.sqrt(slope) * dt
    root = (np.sqrt(b * b + 4.0 * a * (abs(pushed) - reach)) - b) / (2.0 * a)
    sign = 1.0 if pushed > 0.0 else -1.0
    state[1] = sign * root * root
    state[0] += dt * (1.1 * slope * sign + rate * rate * state[1])
