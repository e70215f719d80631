"""The crank drive that a scenario asks for."""

from __future__ import annotations

import numpy as np

from aerobat_pin.flight.crank.drives import ConstantRate, CrankDrive, SpinUp
from aerobat_pin.flight.crank.motor import RateControlledMotor
from aerobat_pin.flight.crank.wing_inertia import WingInertia
from aerobat_pin.robot import Aerobat
from aerobat_pin.scenario import Scenario


def crank_drive(robot: Aerobat, scenario: Scenario) -> CrankDrive:
    """Build a scenario's crank drive; `robot` gives the wing inertia that a motor has to turn."""
    crank = scenario.crank
    start, rate = float(np.radians(crank.start_deg)), 2.0 * np.pi * crank.frequency
    if crank.spin_up is not None:
        return SpinUp(start, rate, crank.spin_up.duration)
    if crank.motor is not None:
        motor = crank.motor
        return RateControlledMotor(
            start=start,
            rate=rate,
            start_rate=2.0 * np.pi * motor.start_frequency,
            rotor_inertia=motor.rotor_inertia,
            torque_limit=motor.torque_limit,
            lag=motor.lag,
            gain=motor.gain,
            integral_gain=motor.integral_gain,
            wings=WingInertia(robot),
        )
    return ConstantRate(start, rate)
