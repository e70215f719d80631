"""The section law of the robot's strips on a wing without a robot: a lifting line on two links that share an origin."""

from __future__ import annotations

import numpy as np

from aerobat_pin.aerodynamics import (
    STRIP_ROWS,
    LiftingLine,
    Pieces,
    Stroke,
    air_in,
    air_loads_in,
    air_memory,
    strips_of,
)
from aerobat_pin.numerics import Array, fields_of
from aerobat_pin.robot import LINKS
from support import references

HALVES = [1, 3]  # the links that carry a wing's left and right half
RECTANGLE = Stroke(4.0, frequency=5.0, flap=np.radians(30.0))  # the lattice's
ENDLESS = 1e9  # [m], a span that leaves no downwash


def memory_of(line: LiftingLine, **options: float) -> Array:
    """Put a lifting line's halves on two links that share the root's axes; no drag, no tail, no body.

    The options are those of `air_memory`.
    """
    strips = np.arange(line.strips)
    link = np.where(line.y > -1e-9 * line.span, *HALVES).astype(np.intp)
    damping = 0.5 * line.semichord * line.added_mass * line.width
    pieces = Pieces(strips, link, line.mid_chord, line.y, 0.0 * line.y, np.ones(line.strips), damping)
    return air_memory(line, pieces, **options)


def fly_strips(air: Array, twists: Array, step: float, last: int) -> Array:
    """Fly the strips from air at rest with the classical Runge-Kutta method.

    Args:
        air: memory of the strips.
        twists: (2n + 1, 5, 6) of the links against the air at every half step.
        step: [s].
        last: how many steps to report.

    Returns:
        Loads (last, 9, N) at the beginnings of the last steps.
    """
    count = len(fields_of(air_in, air).downwash)
    wrenches, rates, loads = np.empty((len(LINKS), 6)), np.empty(3 * count), np.empty((last, STRIP_ROWS, count))
    state, steps = np.zeros(3 * count), len(twists) // 2
    scratch = np.empty((STRIP_ROWS, count))

    def slope(k: int, here: Array, found: Array = scratch) -> Array:
        air_loads_in(air, twists[k], here, wrenches, rates, found)
        return rates.copy()

    for k in range(steps):
        first = slope(2 * k, state, loads[k - steps + last] if k >= steps - last else scratch)
        second = slope(2 * k + 1, state + 0.5 * step * first)
        third = slope(2 * k + 1, state + 0.5 * step * second)
        fourth = slope(2 * k + 2, state + step * third)
        state = state + step / 6.0 * (first + 2.0 * second + 2.0 * third + fourth)
    return loads


def plate(incidence: float) -> tuple[float, float]:
    """Return normal force and drag of a steady plate without ends, over rho V Gamma of the attached one."""
    line, speed = LiftingLine(ENDLESS, 0.1, strips=1), 4.0
    air, twists = memory_of(line), np.zeros((len(LINKS), 6))
    twists[HALVES, 0], twists[HALVES, 2] = speed * np.cos(incidence), -speed * np.sin(incidence)
    wrenches, rates, loads = np.empty((len(LINKS), 6)), np.empty(3), np.empty((STRIP_ROWS, 1))

    def slope(state: Array) -> Array:
        air_loads_in(air, twists, state, wrenches, rates, loads)
        return rates.copy()

    offset = slope(np.zeros(3))  # the rates are affine in the state
    slope(-np.linalg.solve(np.column_stack([slope(unit) - offset for unit in np.eye(3)]), offset))
    attached = line.air_density * speed * np.pi * line.chord[0] * speed * np.sin(incidence) * line.width[0]
    found = strips_of(loads)
    fx, fz = found.force_x[0] / attached, found.force_z[0] / attached
    return float(fz), float(fz * np.sin(incidence) - fx * np.cos(incidence))


def plate_drag(incidence: Array | float) -> Array:
    """Return the closed form of that drag: s c (1 - c^3 (3 - c^2) / 2), the cube of a small incidence; c >= 0."""
    s, c = np.sin(incidence), np.cos(incidence)
    return np.asarray(s * c * (1.0 - c**3 * (3.0 - c**2) / 2.0))


def rectangle_loads() -> tuple[references.FlapLoads, Array]:
    """Fly the lattice's rectangle through the robot's kernel: its loads, and lift and thrust (200, 2) over a flap [N].

    Normal force and suction of the strips, and the added mass as `fly` has it.
    """
    line, last = LiftingLine(0.40, 0.10), 200
    half = np.where(line.y > 0.0, 0, 1)
    motion = [RECTANGLE(t) for t in np.linspace(0.0, 1.0, 2001)]
    twists = np.zeros((len(motion), len(LINKS), 6))
    twists[:, HALVES] = [now.twist for now in motion]
    found, force = strips_of(fly_strips(memory_of(line), twists, 1e-3, last)), np.empty((last, 2))
    for k, now in enumerate(motion[-2 * last - 1 : -1 : 2]):
        _, _, az, bx, by, _ = now.twist_rate[half].T
        reaction = -line.width * line.added_mass * (az + bx * line.y - by * line.mid_chord)
        normal = found.force_z[k] + reaction
        thrust, _, lift = sum(
            now.rotation[i] @ [found.force_x[k, half == i].sum(), 0.0, normal[half == i].sum()] for i in range(2)
        )
        force[k] = lift, thrust
    lift, thrust = force.T
    return references.FlapLoads(np.sqrt(np.mean(lift**2)), np.abs(lift).max(), thrust.mean()), force
