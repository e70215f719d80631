"""Fly with a crank of varying rate: given by a function of time, or turned by a motor that feels a blow on a wing."""

import numpy as np

from aerobat_pin.flight import simulate
from aerobat_pin.scenario import load_scenario

RATE = 2 * np.pi * 4.75  # [rad/s]
STILL = ["simulation.duration=0.8", "unknown_force.0.amplitude=0", "unknown_force.1.amplitude=0"]


def hesitant(time):
    """Return angle, rate and acceleration of a crank whose rate varies by a fifth, twice a second."""
    w = 4 * np.pi
    way = RATE * (time + 0.2 * (1 - np.cos(w * time)) / w)
    return -np.pi / 2 + way, RATE * (1 + 0.2 * np.sin(w * time)), RATE * 0.2 * w * np.cos(w * time)


for name, drive in (("steady", None), ("hesitant", hesitant)):
    power = simulate(load_scenario("paper", STILL), drive=drive).truth["motor_power"]
    print(f"{name:<9} motor power {float(power.min()):5.2f} .. {float(power.max()):.2f} W")

# A motor turns the crank: forces on the wings act back on it. The left wing is hit upward while it goes down.
MOTOR = ["crank.drive=motor", "crank.motor.start_frequency=4.75", "simulation.duration=0.8"]
BLOW = ["unknown_force.0.start=0.66", "unknown_force.0.direction=[0, 0, 1]"]
calm, struck = (
    simulate(load_scenario("impact", [*MOTOR, *BLOW, f"unknown_force.0.impulse={impulse}"])) for impulse in (0.0, 5e-3)
)
before, after = ({"time": time, "method": "nearest"} for time in (0.66, 0.67))
for name, log in (("calm", calm), ("blow", struck)):
    rate = log.truth["crank_rate"] / (2 * np.pi)
    print(f"{name:<9} flapping at {float(rate.sel(**before)):.2f}, 10 ms later at {float(rate.sel(**after)):.2f} Hz")
more = 1e3 * (struck.truth["drive_torque"] - calm.truth["drive_torque"])
print(f"          then the motor gives up to {float(more.max()):.1f} mN m more to recover its rate")
