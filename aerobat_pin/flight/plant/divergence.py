"""When a flight has diverged, and what is said then."""

from __future__ import annotations

import numpy as np

from aerobat_pin.aerodynamics import LARGEST_AIRSPEED, StripLoads
from aerobat_pin.errors import SimulationError
from aerobat_pin.flight.plant.tables import FlightTables, Flown
from aerobat_pin.numerics import Array
from aerobat_pin.robot import BASE_SIZE

# Beyond these limits a flight has diverged.
LIMITS = {
    "velocity": (1e3, "m/s"),
    "angular velocity": (1e4, "rad/s"),
    "aerodynamic state": (1e3, "m or m2/s"),
    "airspeed of a strip": (LARGEST_AIRSPEED, "m/s"),
}
HOPELESS = max(limit for limit, _ in LIMITS.values())  # no number of a state within the limits is larger


def checked_flight(tables: FlightTables, samples: int) -> Flown:
    """Return the first samples of a flight, of which there are `samples`.

    Raises:
        SimulationError: the flight diverged; its attribute `kept` is the flight before that.
    """
    air = BASE_SIZE + tables.plant.air.state_size
    states, loads = tables.states[:samples, :air], tables.loads[: samples - 1]
    sizes = [np.abs(part).max(axis=1, initial=0.0) for part in np.split(states, [3, 6], axis=1)]
    strips = StripLoads(*loads.swapaxes(0, 1))  # unlike `strips_of`, takes what is not finite
    sizes.append(np.append(strips.airspeed.max(axis=1, initial=0.0), 0.0))
    inside = [size <= limit for size, (limit, _) in zip(sizes, LIMITS.values(), strict=True)]
    outside = ~np.all(inside, axis=0)
    kept = int(np.argmax(outside)) if outside.any() else samples
    flown = tables.flown(kept)
    if kept < samples:
        name = next(name for name, fine in zip(LIMITS, inside, strict=True) if not fine[kept])
        value, when, last = dict(zip(LIMITS, sizes, strict=True))[name][kept], kept * tables.dt, max(kept - 1, 0)
        told = _divergence(when, name, value, tables.placement[last], tables.states[last])
        title = f"scenario {tables.plant.scenario.name}: {told}"
        raise SimulationError(title, when, flown if kept > 1 else None)
    return flown


def _divergence(time: float, name: str, value: float, placement: Array, state: Array) -> str:
    """Say when a flight diverged, which limit it passed, and the placement and state one step before."""
    limit, unit = LIMITS[name]
    x, v, w = (", ".join(f"{number:.3g}" for number in row[:3]) for row in (placement, state, state[3:]))
    return (
        f"the flight diverged at t = {time:.4f} s: {name} {value:.3g} {unit} is beyond the limit of {limit:g} {unit}; "
        f"before, the body was at {x} m, with {v} m/s and {w} rad/s in its axes; try a smaller simulation.dt, fewer "
        "air.strips, or gentler forces and speeds"
    )
