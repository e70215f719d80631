"""The controller: from what the sensors show to the commands of the six thrusters. This file is the whole law.

    forces     F = m (w^2 e + 2 z w e') + integral - disturbance              forward, left, up of the course
    bank       roll_ref = -asin(F_left / (m g)), limited                      the thrusters cannot push sideways
    nose       down by what they leave of F_forward / (m g), slowly, limited  they hardly push forward
    moments    M = J (w^2 e_R - 2 z w omega) + integral - disturbance + c x its force sideways
    wrench     (F_forward, 0, F_up / R_zz, M) about the nominal wrench        body axes, at the body's centre of mass
    lead       (1 + lag s) / (1 + lag s / lead) of the wrench                 against the thrusters' lag
    thrusts    bounded least squares with priorities                          see `allocation`

e is reference less measurement; e_R is twice the vector part of the quaternion from the body to its reference, which is
the rotation vector for small errors. c leads from the body's centre of mass, about which moments count, to the robot's:
about that one, an unknown force sideways that the thrusters leave has no moment. w and z are natural frequency and
share of critical damping. Mass m, inertia J, nominal wrench, lag and limits are those that are *believed*. An integral
stands still while its component cannot be realised. The disturbance is what a momentum observer sees (`disturbance`);
it may be switched off, and so may the integrals. Every gain stands in the table `control` of the scenario.
"""

from __future__ import annotations

import math
import warnings

import numpy as np

from aerobat_pin.control.allocation import Allocation
from aerobat_pin.control.disturbance import Disturbance, DisturbanceObserver, TrueDisturbance, observer_gains
from aerobat_pin.control.nominal import control_of, nominal_flight
from aerobat_pin.errors import ControlWarning, ScenarioError
from aerobat_pin.flight import LaggedThrust, Plant, ThrusterSet, thrusters_of
from aerobat_pin.numerics import Array, guarded
from aerobat_pin.robot import Aerobat, believed_robot
from aerobat_pin.scenario import Scenario

SHORT = np.array([2e-3, np.inf, 5e-3, 5e-4, 5e-4, 5e-4])  # [N, N m]: what the nominal wrench may lack, without a word
UNREALISED = 1.0e-6  # [N, N m]: more than rounding
PITCHED_IN = 0.3  # [s]: time constant with which pitch takes over a forward force that the thrusters leave


def shortfall(scenario: Scenario, wrench: Array, thrusters: ThrusterSet) -> list[str]:
    """Return a line about each part of a nominal wrench (6,) that the real thrusters cannot make; [] if they can."""
    real = Allocation(thrusters, scenario.thrusters.factor)
    left = real.unrealised(wrench, real.thrusts(wrench))
    lines = []
    for row in np.flatnonzero(np.abs(left) > SHORT):
        made, unit = wrench[row] - left[row], "N" if row < 3 else "N m"
        what = ("forward thrust", "", "lift", "rolling moment", "pitching moment", "yawing moment")[row]
        lines.append(
            f"scenario {scenario.name}: the nominal flight needs {wrench[row]:.3g} {unit} of {what}, the thrusters "
            f"make {made:.3g} {unit}: the robot will {'fall' if row == 2 else 'not keep its course'}"
        )
    return lines


class Controller:
    """Flies a believed robot along the course of a scenario's start.

    Args:
        scenario: its table `control`, and what is believed of robot, air and thrusters.
        robot: the believed robot; loaded when omitted.
        disturbance: what takes the place of the observer, for comparisons.

    Attributes:
        modelled: (6,) mean wrench that the thrusters make over the coming interval, as believed; observers are told it.
        wanted: (6,) wrench that the last commands were to make, lead included.
        unrealised: (6,) what the thrusters' limits leave of it.
        disturbance: (6,) unknown wrench that was seen last.
        trim: (m,) thrusts of the nominal flight [N].
        loop_times: (n,) what each step of the loop took [s], see `aerobat_pin.flight.Pilot`.

    Issues a `ControlWarning` if the real thrusters cannot make the nominal wrench.

    Raises:
        ScenarioError: the scenario has no table `control`, or its robot no thrusters.
    """

    loop_times: Array

    @guarded(disturbance="free")
    def __init__(
        self, scenario: Scenario, robot: Aerobat | None = None, disturbance: Disturbance | None = None
    ) -> None:
        """Compute the nominal flight and all gains."""
        self.scenario, self.control = scenario, control_of(scenario)
        robot = believed_robot(scenario) if robot is None else robot
        believed, flight, step = scenario.believed_thrusters, scenario.flight, scenario.simulation.dt
        self.nominal = nominal = nominal_flight(scenario, robot)
        self.morphology, self.thrusters = robot.morphology, thrusters_of(robot.morphology)
        self.allocation = Allocation(self.thrusters, believed.factor)
        self.trim = self.allocation.thrusts(nominal.wrench)
        self._step, self.warnings = step, shortfall(scenario, nominal.wrench, self.thrusters)
        for line in self.warnings:
            warnings.warn(ControlWarning(line), stacklevel=2)
        self.loop_times = np.zeros(0)
        self.dt = step if self.control.rate is None else 1.0 / self.control.rate
        self._robot, self._crank_rate = robot, 2.0 * np.pi * scenario.crank.frequency
        self._observer = disturbance
        if disturbance is None and self.control.feedforward:
            self._observer = DisturbanceObserver(
                robot, scenario.believed_air, self.control, nominal, self.dt, self._crank_rate
            )
        lead = believed.lag / self.control.lead
        self._follow = 1.0 - math.exp(-self.dt / lead) if lead > 0.0 else 1.0
        self._weight = max(nominal.mass * flight.gravity, 1e-9)
        heading = math.radians(flight.yaw_deg)
        self._course = math.cos(heading), math.sin(heading)
        self._velocity, self._start = flight.velocity, flight.position
        self._bank_limit = math.sin(math.radians(self.control.bank_limit_deg))
        self._pitch_limit = math.sin(math.radians(self.control.pitch_limit_deg))
        self._level: list[float] = nominal.quaternion.tolist()
        self._nominal_wrench, self._centre = nominal.wrench.tolist(), nominal.centre.tolist()
        self._gains = self._stiffness_damping_integral()
        self._restart()

    def __repr__(self) -> str:
        """Name the scenario, what acts, and the thrusts of the nominal flight."""
        parts = ["PD", *(["integral"] if self.control.integral else [])]
        parts += [type(self._observer).__name__] if self._observer is not None and self.control.feedforward else []
        thrusts = ", ".join(f"{1e3 * thrust:.0f}" for thrust in self.trim)
        return f"Controller({self.scenario.name!r}: {' + '.join(parts)}; nominal thrusts {thrusts} mN)"

    def _stiffness_damping_integral(self) -> list[tuple[float, float, float]]:
        """Return stiffness, damping and share of the integral [1/s]: forward, left, up; roll, pitch, yaw."""
        control, mass = self.control, self.nominal.mass
        axes = [(mass, frequency, control.position_integral) for frequency in (control.forward, control.lateral)]
        axes.append((mass, control.height, control.position_integral))
        turning = zip(self.nominal.inertia.tolist(), (control.roll, control.pitch, control.yaw), strict=True)
        axes += [(inertia, frequency, control.attitude_integral) for inertia, frequency in turning]
        return [(m * w * w, 2.0 * control.damping * m * w, share) for m, w, share in axes]

    def _restart(self) -> None:
        self.thrust = LaggedThrust(self.thrusters, self.scenario.believed_thrusters, self._step, self.trim)
        self.modelled: Array = self.nominal.wrench
        self.wanted: Array = self.nominal.wrench
        self.unrealised: Array = np.zeros(6)
        self.disturbance: Array = np.zeros(6)
        self._pushed: Array = np.zeros(6)
        self._pushes, self._ticks, self._begun = 0, 0, 0.0
        self._command: Array = self.trim
        self._integral = [0.0] * 6  # forward, left, up [N]; roll, pitch, yaw [N m]
        self._slow: Array | None = None
        self._nose_down = 0.0  # [rad]

    @guarded()
    def board(self, plant: Plant) -> None:
        """Learn which plant is to be flown; needed where `control.source` says that the truth is to be compensated.

        Raises ScenarioError if the law has a rate of its own then: the truth is known by the interval.
        """
        control = self.control
        if not control.feedforward or control.source == "observer":
            return
        if control.rate is not None:
            raise ScenarioError(f"control.source = {control.source!r}: no control.rate was expected")
        gains, air = observer_gains(control) if control.source == "filtered_truth" else None, self.scenario.believed_air
        centre = self.nominal.centre
        self._observer = TrueDisturbance(plant, self._robot, air, centre, gains, self.dt, self._crank_rate)

    @guarded(q=("nq",), v=("nv",))
    def begin(self, time: float, q: Array, v: Array, crank_angle: float) -> None:
        """Start at the first sample of a flight."""
        self._restart()
        self._begun = time
        if self._observer is not None:
            self._observer.reset(time, q, v, crank_angle)

    def command(self, time: float, q: Array, v: Array) -> Array:
        """Take a sample: configuration q (nq,) and velocity v (nv,) as the sensors show them.

        Returns:
            Commanded thrusts (m,) [N] for the next interval.
        """
        since = time - self._begun
        if since * (1.0 + 1e-9) + 1e-9 >= self._ticks * self.dt:
            self._ticks += 1
            if self._observer is not None and self._pushes:
                self.disturbance = self._observer.update(time, q, v, self._pushed / self._pushes)
            self._pushed, self._pushes = np.zeros(6), 0
            self.wanted = self._with_lead(self.wrench(since, q, v))
            self._command = self.allocation.thrusts(self.wanted)
            self.unrealised = self.allocation.unrealised(self.wanted, self._command)
        self.modelled = self.thrust.advance(self._command)
        self._pushed, self._pushes = self._pushed + self.modelled, self._pushes + 1
        return self._command

    def wrench(self, since: float, q: Array, v: Array) -> Array:
        """Return the wrench (6,) that is wanted `since` seconds after the begin: the law without its lead."""
        integral = self._integral
        px, py, pz, x, y, z, w = q[:7].tolist()
        vx, vy, vz, roll_rate, pitch_rate, yaw_rate = v[:6].tolist()
        R = (
            (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)),
            (2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)),
            (2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)),
        )
        push = self.disturbance.tolist() if self.control.feedforward else [0.0] * 6

        # Errors of position and velocity, and the disturbance, along the course: forward, left, up.
        along, across = self._course
        (ux, uy, uz), (sx, sy, sz) = self._velocity, self._start
        ex, ey, ez = sx + ux * since - px, sy + uy * since - py, sz + uz * since - pz
        dx, dy, dz = (
            ux - _along_row(R[0], vx, vy, vz),
            uy - _along_row(R[1], vx, vy, vz),
            uz - _along_row(R[2], vx, vy, vz),
        )
        fx, fy, fz = _along_row(R[0], *push[:3]), _along_row(R[1], *push[:3]), _along_row(R[2], *push[:3])
        errors = (
            (along * ex + across * ey, along * dx + across * dy, along * fx + across * fy),
            (along * ey - across * ex, along * dy - across * dx, along * fy - across * fx),
            (ez, dz, fz),
        )
        force = [0.0] * 3
        for i in range(3):
            (error, rate, disturbance), (stiffness, damping, share) = errors[i], self._gains[i]
            self._integrate(i, share * stiffness * error)
            force[i] = stiffness * error + damping * rate + integral[i] - disturbance

        # Pushing to the left takes a roll to the left, which is negative: the right wing is up then.
        limit = self._bank_limit
        half = -0.5 * math.asin(min(max(force[1] / self._weight, -limit), limit))
        ax, ay, az, aw = self._pitched()
        s, c = math.sin(half), math.cos(half)
        tx, ty, tz, tw = ax * c + aw * s, ay * c + az * s, az * c - ay * s, aw * c - ax * s
        turn = 2.0 if w * tw + x * tx + y * ty + z * tz >= 0.0 else -2.0
        errors_R = (
            turn * (w * tx - x * tw - y * tz + z * ty),
            turn * (w * ty - y * tw - z * tx + x * tz),
            turn * (w * tz - z * tw - x * ty + y * tx),
        )
        moment = [0.0] * 3
        rates = roll_rate, pitch_rate, yaw_rate
        for i in range(3):
            stiffness, damping, share = self._gains[3 + i]
            self._integrate(3 + i, share * stiffness * errors_R[i])
            moment[i] = stiffness * errors_R[i] - damping * rates[i] + integral[3 + i] - push[3 + i]

        # The thrusters make no force sideways, so the unknown one turns the robot about its own centre of mass.
        Fx, _, Fz, Mx, My, Mz = self._nominal_wrench
        cx, _, cz = self._centre
        roll, pitch, yaw = Mx + moment[0] - cz * push[1], My + moment[1], Mz + moment[2] + cx * push[1]
        upright = max(R[2][2], 0.5)
        return np.array([Fx + force[0], 0.0, (Fz + force[2]) / upright, roll, pitch, yaw])

    def _pitched(self) -> list[float]:
        """Return the attitude to keep, xyzw: nose down for a forward force that the thrusters leave, within limits."""
        limit = self._pitch_limit
        asked = min(max(float(self.unrealised[0]) / self._weight, -limit), limit)
        self._nose_down += self.dt / PITCHED_IN * (asked - self._nose_down)
        s = math.sin(0.5 * self._nose_down)
        c = math.sqrt(1.0 - s * s)
        x, y, z, w = self._level
        return [x * c - z * s, y * c + w * s, z * c + x * s, w * c - y * s]

    def _integrate(self, i: int, rate: float) -> None:
        """Add to an integral, unless that asks for more of what the limits leave already; left is made by rolling."""
        left = -self.unrealised[3] if i == 1 else self.unrealised[i]
        if self.control.integral and not (abs(left) > UNREALISED and left * rate > 0.0):
            self._integral[i] += rate * self.dt

    def _with_lead(self, wrench: Array) -> Array:
        """Return the wrench with a lead against the thrusters' lag: lead w - (lead - 1) (w through lag / lead)."""
        lead = self.control.lead
        if self._slow is None:
            self._slow = wrench
        ahead: Array = lead * wrench - (lead - 1.0) * self._slow
        self._slow = self._slow + self._follow * (wrench - self._slow)
        return ahead


def _along_row(row: tuple[float, float, float], x: float, y: float, z: float) -> float:
    return row[0] * x + row[1] * y + row[2] * z
