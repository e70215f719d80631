"""Where a frozen wake is, and the impulse of a shed wake, which is the lift of the wing that sheds it."""

import numpy as np

from aerobat_pin.aerodynamics import LiftingLine, Stroke, Wind, fly
from aerobat_pin.flight import Wake
from aerobat_pin.numerics import Array

DENSITY = 1.225  # [kg/m3]


def impulse_lift(wake: Wake) -> float:
    """Return the mean rate of the wake's vertical impulse [N], while it sheds in still air."""
    # rho Gamma times a ring's area: what a strip leaves in a second is around what its trailing edge sweeps.
    ends = wake.position[:, :1], wake.position[:, -1:]
    edges = np.concatenate([ends[0], 0.5 * (wake.position[:, 1:] + wake.position[:, :-1]), ends[1]], axis=1)
    swept = np.cross(np.gradient(wake.position, wake.time, axis=0), edges[:, :-1] - edges[:, 1:])
    return float(DENSITY * np.mean(np.sum(wake.bound * swept[..., 2], axis=1)))


def rectangle_wake(stroke: Stroke, time: Array, last: int) -> tuple[float, Wake]:
    """Fly the lattice's rectangle: its mean lift [N] without added mass, and what it sheds, over the last instants."""
    line = LiftingLine(0.40, 0.10)
    flight, half = fly(line, stroke, time, added_mass=0.0), np.where(line.y > 0.0, 0, 1)
    points = np.column_stack([np.full(line.strips, -0.05), line.y, np.zeros(line.strips)])
    position = np.array([np.einsum("nij,nj->ni", stroke(t).rotation[half], points) for t in time[-last:]])
    position[..., 0] += stroke.airspeed * time[-last:, None]
    wake = Wake(time[-last:], position, flight.circulation[-last:], Wind())
    return float(flight.force[-last:, 2].mean()), wake


def wake_at(wake: Wake, time: float) -> tuple[np.ndarray, np.ndarray]:
    """Return where the k samples shed until a time [s] are then (k, N, 3), oldest first, with their circulation."""
    old = int(np.searchsorted(wake.time, time, side="right"))
    moved = wake.wind.drift(np.array([time])) - wake.wind.drift(wake.time[:old])
    return wake.position[:old] + moved[:, None], wake.bound[:old]
