"""The crank drive that a scenario asks for."""

from __future__ import annotations

import numpy as np

from aerobat_pin.flight.crank.drives import ConstantRate, CrankDrive, SpinUp
from aerobat_pin.flight.crank.motor import RateControlledMotor
from aerobat_pin.scenario import Scenario


def crank_drive(scenario: Scenario) -> CrankDrive | RateControlledMotor:
    """Build a scenario's crank drive, or its motor."""
    crank = scenario.crank
    start, rate = float(np.radians(crank.start_deg)), 2.0 * np.pi * crank.frequency
    if crank.spin_up is not None:
        return SpinUp(start, rate, crank.spin_up.duration)
    if crank.motor is not None:
        constants = crank.motor.model_dump()
        return RateControlledMotor(
            start=start, rate=rate, start_rate=2.0 * np.pi * constants.pop("start_frequency"), **constants
        )
    return ConstantRate(start, rate)
