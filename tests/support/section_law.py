"""The section law of the robot's strips, on two links without a robot, by the memory kernels read; gliding wings."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from aerobat_description.morphology import Morphology
from aerobat_pin.aerobat import LINKS, RobotAir, Wing, air_loads, air_memory
from aerobat_pin.aerodynamics import STRIP_ROWS, AirConstants, LiftingLine, Pieces, StripLoads, Stroke, strips_of
from aerobat_pin.numerics import Array, fields_of, kernel

HALVES = [1, 3]  # the links that carry a wing's left and right half
CYCLES, STEPS = 5, 200  # flown, of which the last is looked at; steps of a cycle
ENDLESS = 1e9  # [m], a span that leaves no downwash


class Loads(NamedTuple):
    """Force (n, 3) [N] and moment (n, 3) [N m] about the root, in a flight's axes, at instants (n,) of a cycle."""

    force: Array
    moment: Array


def memory_of(line: LiftingLine, **options: float) -> Array:
    """Put a lifting line's halves on two links that share the root's axes; no drag, tail, body; see `air_memory`."""
    strips = np.arange(line.strips)
    link = np.where(line.y > -1e-9 * line.span, *HALVES).astype(np.intp)
    damping = 0.5 * line.semichord * line.added_mass * line.width
    pieces = Pieces(strips, link, line.mid_chord, line.y, 0.0 * line.y, np.ones(line.strips), damping)
    return air_memory(line, pieces, **options)


def loads_of(air: Array, twists: Array, state: Array) -> tuple[Array, Array, StripLoads]:
    """Return wrenches (5, 6) on the links, rates of the state and the strips' loads, from the memory of the strips."""
    wrenches, rates = np.empty((len(LINKS), 6)), np.zeros(len(state))  # quasi-steady loads write no rates
    loads = np.empty((STRIP_ROWS, len(fields_of(air, AirConstants).downwash)))
    twists, state = np.ascontiguousarray(twists, float), np.ascontiguousarray(state, float)
    air_loads_in(air, twists, state, wrenches, rates, loads)
    return wrenches, rates, strips_of(loads)


def settled_state(air: Array, twists: Array, size: int) -> Array:
    """Return the aerodynamic state (size,) that no longer changes under steady twists: its rates are affine in it."""
    offset = loads_of(air, twists, np.zeros(size))[1]
    matrix = np.column_stack([loads_of(air, twists, unit)[1] - offset for unit in np.eye(size)])
    return -np.linalg.solve(matrix, offset)


def fly_strips(air: Array, twists: Array, step: float, last: int) -> tuple[Array, Array]:
    """Fly by Runge-Kutta, twists (2n + 1, 5, 6) at half steps: last loads (last, 9, N) and wrenches (last, 5, 6)."""
    count, steps = len(fields_of(air, AirConstants).downwash), len(twists) // 2
    loads, wrenches = np.empty((last + 1, STRIP_ROWS, count)), np.empty((last + 1, len(LINKS), 6))
    state, rates = np.zeros(3 * count), np.empty(3 * count)

    def slope(k: int, here: Array, row: int = last) -> Array:  # the row after the last one is scratch
        air_loads_in(air, twists[k], here, wrenches[row], rates, loads[row])
        return rates.copy()

    for k in range(steps):
        row = k - steps + last
        first = slope(2 * k, state, row if row >= 0 else last)
        second = slope(2 * k + 1, state + 0.5 * step * first)
        third = slope(2 * k + 1, state + 0.5 * step * second)
        fourth = slope(2 * k + 2, state + step * third)
        state = state + step / 6.0 * (first + 2.0 * second + 2.0 * third + fourth)
    return loads[:last], wrenches[:last]


def fly_on_links(line: LiftingLine, stroke: Stroke, cycles: int = CYCLES) -> Loads:
    """Fly a stroke through the robot's kernel: loads of its last cycle; G's added mass by rates of Fourier's series."""
    now = [stroke(k / (2 * STEPS * stroke.frequency)) for k in range(2 * STEPS)]
    twist = np.array([each.twist for each in now])
    twists = np.zeros((2 * STEPS * cycles + 1, len(LINKS), 6))
    twists[:, HALVES] = np.concatenate([np.tile(twist, (cycles, 1, 1)), twist[:1]])
    _, wrenches = fly_strips(memory_of(line), twists, 1.0 / STEPS / stroke.frequency, STEPS)
    omega = 2j * np.pi * stroke.frequency * np.arange(STEPS + 1)
    rate = np.fft.irfft(omega[:, None, None] * np.fft.rfft(twist[..., 2:5], axis=0), axis=0)
    rotation, origin = (np.array([getattr(each, name) for each in now[::2]]) for name in ("rotation", "origin"))
    force, moment = np.zeros((2, STEPS, 3))
    for i, half in enumerate((line.y > -1e-9 * line.span, line.y < -1e-9 * line.span)):
        rows = np.column_stack([np.ones(line.strips), line.y, -line.mid_chord])[half]
        G = np.einsum("n,ni,nj->ij", (line.added_mass * line.width)[half], rows, rows)
        G[2, 2] += ((line.added_mass * line.width * line.semichord**2) / 8.0)[half].sum()
        wrench = wrenches[:, HALVES[i]].copy()
        wrench[:, 2:5] -= rate[::2, i] @ G
        push, turn = (np.einsum("tij,tj->ti", rotation[:, i], part) for part in np.split(wrench, 2, axis=1))
        force += push
        moment += turn + np.cross(origin[:, i], push)
    return Loads(force, moment)


def plate(incidence: float) -> tuple[float, float]:
    """Return normal force and drag of a steady plate without ends, over rho V Gamma of the attached one."""
    line, speed = LiftingLine(ENDLESS, 0.1, strips=1), 4.0
    air, twists = memory_of(line), np.zeros((len(LINKS), 6))
    twists[HALVES, 0], twists[HALVES, 2] = speed * np.cos(incidence), -speed * np.sin(incidence)
    attached = line.air_density * speed * np.pi * line.chord[0] * speed * np.sin(incidence) * line.width[0]
    found = loads_of(air, twists, settled_state(air, twists, 3))[2]
    fx, fz = found.force_x[0] / attached, found.force_z[0] / attached
    return float(fz), float(fz * np.sin(incidence) - fx * np.cos(incidence))


def plate_drag(incidence: Array | float) -> Array:
    """Return the closed form of that drag: s c (1 - c^3 (3 - c^2) / 2), the cube of a small incidence; c >= 0."""
    s, c = np.sin(incidence), np.cos(incidence)
    return np.asarray(s * c * (1.0 - c**3 * (3.0 - c**2) / 2.0))


@kernel
def air_loads_in(memory: Array, twists: Array, state: Array, wrenches: Array, rates: Array, loads: Array) -> None:
    """Compute what `air_loads` does, reading the aerodynamic constants from `RobotAir.memory`."""
    air_loads(fields_of(memory, AirConstants), twists, state, wrenches, rates, loads)


SHAPE = Morphology.load("aerobat")
WING = Wing(SHAPE)
AIR = RobotAir(WING)
NO_DRAG = replace(SHAPE.aerodynamics, profile_drag=0.0, body_drag_area=0.0)
BARE = RobotAir(Wing(replace(SHAPE, tail=None, aerodynamics=NO_DRAG)), air_density=1.0)


def gliding(speed: float, incidence: float) -> np.ndarray:
    """Return the twists of a spread wing that glides straight at an incidence [rad] of the body."""
    twist = np.array([speed * np.cos(incidence), 0.0, -speed * np.sin(incidence), 0.0, 0.0, 0.0])
    return np.tile(twist, (5, 1))


def evaluate(air: RobotAir, twists: np.ndarray, state: np.ndarray) -> tuple[np.ndarray, np.ndarray, StripLoads]:
    """Return wrenches (5, 6) on the links, rates of the state and the strips' loads, without added mass."""
    return loads_of(air.memory, twists, state)


def settled(air: RobotAir, twists: np.ndarray) -> np.ndarray:
    """Return the aerodynamic state that no longer changes under steady twists."""
    return settled_state(air.memory, twists, air.state_size)
