"""The aerodynamic model and the wind that a scenario's `air` table describes."""

from __future__ import annotations

import numpy as np

from aerobat_pin.aerodynamics import Gust, RobotAir, Tones, Wind, dryden
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
    """Return a scenario's wind, with its gust, its turbulence and its waves."""
    gust, blown = air.gust, air.turbulence
    tones = [] if blown is None else [dryden(blown.deviation, blown.length, blown.airspeed, blown.seed)]
    for one in air.wave:
        rate, phase = 2.0 * np.pi * one.frequency, np.radians(one.phase_deg)
        tones.append(Tones(np.array([one.amplitude]), np.full((1, 3), rate), np.full((1, 3), phase)))
    given = None if gust is None else Gust(gust.amplitude, gust.start, gust.duration)
    return Wind(air.wind, given, tuple(tones))
