"""A readable twin of the controller's law: the same equations by Pinocchio's rotations, with nothing kept in place."""

from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from aerobat_pin.control import Controller
from aerobat_pin.control.controller import PITCHED_IN, integral_shares
from aerobat_pin.control.nominal_wrench import waves

Vector = np.ndarray


@dataclass
class Law:
    """The law of a controller, from its scenario and nominal flight."""

    pilot: Controller
    integral: Vector = field(default_factory=lambda: np.zeros(6))
    nose_down: float = 0.0
    slow: Vector | None = None
    place: Vector | None = None
    ticks: int = 0
    bias: Vector = field(default_factory=lambda: np.zeros(3))
    smooth: Vector | None = None

    def gains(self) -> tuple[Vector, Vector, Vector]:
        """Return stiffness, damping and the integral's rate: forward, left, up; roll, pitch, yaw."""
        control, nominal = self.pilot.control, self.pilot.nominal
        inertia = np.append([nominal.mass] * 3, nominal.inertia)
        w = np.array([control.forward, control.lateral, control.height, control.roll, control.pitch, control.yaw])
        return inertia * w**2, 2.0 * np.array(control.damping) * inertia * w, integral_shares(control) * inertia * w**2

    def unbiased(self, place: Vector, velocity: Vector) -> Vector:
        """Return a velocity less the bias that an observer with both poles at beta finds beside the position."""
        dt, beta = self.pilot.dt, self.pilot.control.bias * self.pilot.control.integral
        self.ticks += 1
        self.place = place if self.place is None else self.place
        ahead, share = place - self.place, max(2.0 * beta * dt, 1.0 / self.ticks)
        if share == 2.0 * beta * dt:
            self.bias = self.bias - dt * beta**2 * ahead
        self.place = self.place + dt * (velocity - self.bias) + share * ahead
        return velocity - self.bias

    def integrate(self, error: Vector, rows: slice, left: Vector) -> None:
        """Add to integrals that do not ask for more of what is left."""
        rate = self.gains()[2][rows] * error
        stands = (np.abs(left) > 1e-6) & (left * rate > 0.0)
        self.integral[rows] += np.where(stands, 0.0, rate * self.pilot.dt)

    def wrench(self, since: float, q: Vector, v: Vector, crank: float, push: Vector, left: Vector) -> Vector:
        """Return the wanted wrench, before lead and steering; `left` is what limits left of the one before."""
        control, nominal, flight = self.pilot.control, self.pilot.nominal, self.pilot.scenario.flight
        stiffness, damping, _ = self.gains()
        swing = waves(np.array([crank]))[0] @ nominal.swing
        R = pin.Quaternion(q[3:7]).matrix()
        course = pin.rpy.rpyToMatrix(0.0, 0.0, np.radians(flight.yaw_deg)).T
        velocity = np.array(flight.velocity)
        error = course @ (np.array(flight.position) + velocity * since + swing[:3] - q[:3])
        rate = course @ (velocity + swing[3:6] - self.unbiased(q[:3], R @ v[:3]))
        self.integrate(error, slice(0, 3), np.array([left[0], -left[3], left[2]]))
        force = stiffness[:3] * error + damping[:3] * rate + self.integral[:3] - course @ R @ push[:3]

        share = 1.0 - np.exp(-control.smoothing * self.pilot.dt)
        self.smooth = force[1:] if self.smooth is None else self.smooth + share * (force[1:] - self.smooth)
        force[1:] = self.smooth
        weight = nominal.mass * flight.gravity
        tilt, dive = np.sin(np.radians([control.bank_limit_deg, control.pitch_limit_deg]))
        bank = -np.arcsin(np.clip(force[1] / weight, -tilt, tilt))
        asked = np.clip(left[0] / weight, -dive, dive)
        self.nose_down += self.pilot.dt / PITCHED_IN * (asked - self.nose_down)
        level = pin.Quaternion(nominal.quaternion).matrix() @ pin.exp3(np.array([0.0, self.nose_down, 0.0]))
        reference = level @ pin.exp3(np.array([bank, 0.0, 0.0])) @ pin.exp3(swing[6:9])
        turn = pin.Quaternion(R.T @ reference)
        turned = 2.0 * np.sign(turn.w) * turn.vec()
        self.integrate(turned, slice(3, 6), left[3:])
        moment = stiffness[3:] * turned + damping[3:] * (swing[9:] - v[3:6]) + self.integral[3:] - push[3:]
        moment += np.cross(nominal.centre, [0.0, push[1], 0.0])
        total = nominal.wrench + np.concatenate([[force[0], 0.0, 0.0], moment])
        total[1], total[2] = 0.0, (nominal.wrench[2] + force[2]) / max(R[2, 2], 0.5)
        return total

    def wanted(self, wrench: Vector, crank: float) -> Vector:
        """Return a wrench with its lead and the steering against the flaps, as it is after delay and lag of both."""
        pilot, believed = self.pilot, self.pilot.scenario.believed_thrusters
        rate = 2.0 * np.pi * pilot.scenario.crank.frequency
        slow = wrench if self.slow is None else self.slow
        ahead = wrench + (pilot.control.lead - 1.0) * (wrench - slow)
        self.slow = slow + (1.0 - np.exp(-pilot.dt * pilot.control.lead / believed.lag)) * (wrench - slow)
        then = crank + rate * (believed.delay + 0.5 * pilot.dt)
        cosine, sine = np.cos(then), np.sin(then)
        moment = pilot.nominal.steering @ [cosine, sine]
        its_rate = pilot.nominal.steering @ [-rate * sine, rate * cosine]
        return ahead + np.array([0.0, 0.0, 0.0, 0.0, moment + believed.lag * its_rate, 0.0])
