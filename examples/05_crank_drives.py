"""Fly with a crank of varying rate: given by a function of time, or by a motor with the load of a steady flight."""

import numpy as np

from aerobat_pin.flight import RateControlledMotor, WingInertia, simulate
from aerobat_pin.robot import load_robot
from aerobat_pin.scenario import load_scenario

RATE = 2 * np.pi * 4.75  # [rad/s]
SETTINGS = ["simulation.duration=0.8", "unknown_force.0.amplitude=0", "unknown_force.1.amplitude=0"]
scenario = load_scenario("paper", SETTINGS)
robot = load_robot(scenario)


def crank_torque(log):
    """Return mid-interval crank angle and crank torque of a flight; the torque equals the joint motors' torques."""
    angle = log.measured["crank_angle"].values
    middle = 0.5 * (angle[1:] + angle[:-1])
    closed = robot.linkage.solve(middle)
    left, right = (log.measured["motor_torque"].values[:, list(robot.idx_v[i : i + 2])].T for i in (0, 2))
    return middle, closed.crank_torque(*left) + closed.crank_torque(*right)


def hesitant(time):
    """Return angle, rate and acceleration of a crank whose rate varies by a fifth, twice a second."""
    w = 4 * np.pi
    way = RATE * (time + 0.2 * (1 - np.cos(w * time)) / w)
    return -np.pi / 2 + way, RATE * (1 + 0.2 * np.sin(w * time)), RATE * 0.2 * w * np.cos(w * time)


for name, drive in (("steady", None), ("hesitant", hesitant)):
    angle, torque = crank_torque(simulate(scenario, drive=drive))
    print(f"{name:<9} crank torque {1e3 * torque.min():6.1f} .. {1e3 * torque.max():5.1f} mN m")

# The load of the steady flight: its crank torque minus the part due to wing inertia, as a Fourier series over t1.
wings = WingInertia(robot)
angle, torque = crank_torque(simulate(scenario))
load = torque - 0.5 * wings(angle)[1] * RATE**2
orders = np.arange(1, 13)


def basis(t1):
    """Return 1, cos(k t1) and sin(k t1) for all k in `orders`, at crank angles t1."""
    waves = np.multiply.outer(t1, orders)
    return np.concatenate([np.ones_like(waves[..., :1]), np.cos(waves), np.sin(waves)], axis=-1)


series = np.linalg.lstsq(basis(angle), load, rcond=None)[0]
motor = RateControlledMotor(
    start=-np.pi / 2, rate=RATE, start_rate=RATE, rotor_inertia=5e-5, torque_limit=0.15, lag=0.005, gain=0.01,
    integral_gain=0.1, wings=wings, load=lambda t1: basis(t1) @ series,
)  # fmt: skip
time = np.arange(0.0, 0.8, 1e-3) + 0.5e-3
turning, given = motor(time), motor.torque(time)
rate = turning.rate / (2 * np.pi)
print(f"motor     crank torque {1e3 * given.min():6.1f} .. {1e3 * given.max():5.1f} mN m")
print(f"          flapping at {rate[400:].min():.2f} .. {rate[400:].max():.2f} Hz instead of 4.75")
taken = crank_torque(simulate(scenario, drive=motor))[1] + 5e-5 * turning.acceleration
print(f"          the flight with it takes another torque by {1e3 * np.std(taken - given):.1f} mN m rms")
