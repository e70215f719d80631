"""Flights of the other plant as observers with the plain belief about the guarded robot see them."""

from functools import cache

import numpy as np

from aerobat_pin.aerobat import FlightLog, belief_about, believed_robot, flight_record
from aerobat_pin.estimation import Calibration
from support.calibrated import FreeFlight, flight_inputs
from support.mismatch import Seen
from support.other_plant import ELBOW, SHOULDER, Push, crank_at, fly_elsewhere, series_at

FREQUENCY = 4.75  # [Hz]


def swinging(time: float) -> np.ndarray:
    """Return a force that swings at 2 Hz and its harmonic, along all axes."""
    turn = 2.0 * np.pi * 2.0 * time
    return np.array([0.02, 0.08, 0.12]) * (np.sin(turn) + 0.4 * np.sin(3.0 * turn))


def signal(time: float) -> np.ndarray:
    """Return the force of the paper without its noise, along the outer wing's normal while the body is level."""
    crank, _ = crank_at(time, FREQUENCY)
    shoulder, elbow = (series_at(table, crank)[0] for table in (SHOULDER, ELBOW))
    size = 0.2 * np.sin(elbow) + (0.15 if 1.0 < time <= 1.6 else 0.0)
    return size * np.array([0.0, -np.sin(shoulder + elbow), np.cos(shoulder + elbow)])


def contacts(time: float) -> np.ndarray:
    """Return an impulse of 5 mN s, a push of 50 ms and a step of 0.1 N, upward."""
    if 0.3 <= time < 0.31:
        return np.array([0.0, 0.0, 0.5])
    if 0.5 <= time < 0.55:
        return np.array([0.0, 0.0, 0.1 * (1.0 - np.cos(2.0 * np.pi * (time - 0.5) / 0.05))])
    return np.array([0.0, 0.0, 0.1]) if 0.7 <= time < 0.9 else np.zeros(3)


PUSHES: dict[str, Push | None] = {"nothing": None, "signal": signal, "swinging": swinging, "contacts": contacts}


@cache
def elsewhere(
    push: str, duration: float, speed: float = 3.0, frequency: float = FREQUENCY, side: bool = False
) -> tuple[FlightLog, np.ndarray]:
    """Return the log of a flight, and the force (m, 3) on the left wing; see `fly_elsewhere` for `side`."""
    settle = 0.5 if push == "nothing" else 0.6
    return fly_elsewhere(duration, PUSHES[push], speed=speed, frequency=frequency, settle=settle, side=side)


def as_believed(log: FlightLog) -> FreeFlight:
    """Return a flight with the plain belief about its robot."""
    belief = belief_about(log, "elsewhere", None, [], [])
    return FreeFlight(log, believed_robot(belief), belief.believed_air)


def seen_elsewhere(flight: tuple[FlightLog, np.ndarray], calibration: Calibration | None) -> Seen:
    """Return a flight as observers see it, with or without a calibration."""
    log, force = flight
    record = flight_record(log, as_believed(log).plugged())
    record = record if calibration is None else calibration.applied(record)
    inputs = flight_inputs(record, calibration)
    return Seen(record.robot.model, inputs, np.stack([force, np.zeros_like(force)], axis=1))
