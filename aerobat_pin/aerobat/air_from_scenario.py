"""The aerodynamic model and the wind that a scenario's `air` table describes."""

from __future__ import annotations

from aerobat_pin.aerodynamics import Gust, RobotAir, Wind
from aerobat_pin.numerics import guarded
from aerobat_pin.robot import Wing
from aerobat_pin.scenario import AirSection


@guarded()
def robot_air(wing: Wing, air: AirSection) -> RobotAir:
    """Return the aerodynamic model of a wing with a scenario's air settings. Raises the same errors as `RobotAir`."""
    return RobotAir(
        wing,
        strips=air.strips,
        air_density=air.density,
        model=air.model,
        lift_limit=air.lift_limit,
        added_mass=air.added_mass,
    )


@guarded()
def wind_of(air: AirSection) -> Wind:
    """Return a scenario's wind, with its gust if it has one."""
    gust = air.gust
    return Wind(air.wind, None if gust is None else Gust(gust.amplitude, gust.start, gust.duration))
