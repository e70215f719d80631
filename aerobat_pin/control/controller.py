"""The controller: a scenario becomes the numbers of the law, which `law` computes, with an observer beside it.

Everything in it is *believed*: mass and inertia, the nominal flight, lag and limits of the thrusters. The disturbance
is what a momentum observer sees (`disturbance`); it may be switched off, and so may the integrals. Every gain stands in
the table `control` of the scenario.

An observer and an integral both answer a push that stays; the two together would answer a gust twice, and the robot
would be on its way back after it. So beside an observer only the integral of the forward position acts, whose push the
nose makes slowly. What no observer sees, a constant error of the attitude, shows as a bias of the velocity (`law`).

Samples are checked and carried to now (`sensed`), and the flight is watched (`monitor`): `state` says how it is.
"""

from __future__ import annotations

import math
import warnings

import numpy as np
import pinocchio as pin

from aerobat_pin.aerobat import BASE_SIZE, Aerobat, believed_robot
from aerobat_pin.control.allocation import Allocation
from aerobat_pin.control.disturbance import (
    Disturbance,
    DisturbanceObserver,
    TrueDisturbance,
    observer_gains,
    sample_variance,
)
from aerobat_pin.control.law import Law, law_wrench, write_commands
from aerobat_pin.control.monitor import LoopState, Monitor
from aerobat_pin.control.nominal_wrench import PITCHING, control_of, nominal_flight, waves
from aerobat_pin.control.sensed import SensedMotion
from aerobat_pin.errors import ControlWarning, ScenarioError, ShapeError
from aerobat_pin.flight import LaggedThrust, Plant, ThrusterSet, thrusters_of
from aerobat_pin.numerics import Array, Viewed, fields_of, guarded, new_state
from aerobat_pin.scenario import ControlSection, Scenario

SHORT = np.array([2e-3, np.inf, 5e-3, 5e-4, 5e-4, 5e-4])  # [N, N m]: what the nominal wrench may lack, without a word
AS_NOMINAL = 4.0  # standard deviations within which the first sample's velocity is taken for the nominal one
PITCHED_IN = 0.3  # [s]: time constant with which pitch takes over a forward force that the thrusters leave


def integral_shares(control: ControlSection) -> Array:
    """Return which share of the stiffness the integrals add in a second (6,) [1/s]; rows as the axes of the law."""
    shares = np.concatenate(
        [np.broadcast_to(gains, 3) for gains in (control.position_integral, control.attitude_integral)]
    )
    shares[1 if control.feedforward else 6 :] = 0.0
    return shares * control.integral


def follow_share(rate: float, dt: float) -> float:
    """Return the share by which one pole at a rate [rad/s] follows in a time dt [s]; rate 0 is no filter."""
    return 1.0 - math.exp(-rate * dt) if rate > 0.0 else 1.0


def shortfall(scenario: Scenario, wrench: Array, thrusters: ThrusterSet) -> list[str]:
    """Return a line about each part of a nominal wrench (6,) that the real thrusters cannot make; [] if they can."""
    real = Allocation(thrusters, scenario.thrusters.factor)
    lacking = real.unrealised(wrench, real.thrusts(wrench))
    lines = []
    for row in np.flatnonzero(np.abs(lacking) > SHORT):
        reached, unit = wrench[row] - lacking[row], "N" if row < 3 else "N m"
        what = ("forward thrust", "", "lift", "rolling moment", "pitching moment", "yawing moment")[row]
        lines.append(
            f"scenario {scenario.name}: the nominal flight needs {wrench[row]:.3g} {unit} of {what}, the thrusters "
            f"make {reached:.3g} {unit}: the robot will {'fall' if row == 2 else 'not keep its course'}"
        )
    return lines


class Controller(Viewed):
    """Flies a believed robot along the course of a scenario's start.

    Args:
        scenario: its table `control`, and what is believed of robot, air and thrusters.
        robot: the believed robot; loaded when omitted.
        disturbance: what takes the place of the observer, for comparisons.

    Attributes:
        modelled: (6,) mean wrench that the thrusters make over the coming interval, as believed; observers are told it.
        wanted: (6,) wrench that the last commands were to make, lead included.
        unrealised: (6,) what the thrusters' limits leave of it.
        disturbance: (6,) unknown wrench that was seen last; like the two above, the next command writes it anew.
        trim: (m,) thrusts of the nominal flight at its start [N].
        loop_times: (n,) what each step of the loop took [s], see `aerobat_pin.flight.Pilot`.
        sensed: the motion that the law works with, and which samples were not used for it.

    Issues a `ControlWarning` if the real thrusters cannot make the nominal wrench.

    Raises:
        ScenarioError: the scenario has no table `control`, or its robot no thrusters.
    """

    loop_times: Array

    @guarded(disturbance="free")
    def __init__(
        self, scenario: Scenario, robot: Aerobat | None = None, disturbance: Disturbance | None = None
    ) -> None:
        self.scenario, self.control = scenario, control_of(scenario)
        robot = believed_robot(scenario) if robot is None else robot
        step = scenario.simulation.dt
        self.nominal = nominal = nominal_flight(scenario, robot)
        self.morphology, self.thrusters = robot.morphology, thrusters_of(robot.morphology)
        self.allocation = Allocation(self.thrusters, scenario.believed_thrusters.factor)
        steered = nominal.steering @ waves(np.radians([scenario.crank.start_deg]))[0, : len(nominal.steering)]
        self.trim = self.allocation.thrusts(nominal.wrench + steered * np.eye(BASE_SIZE)[PITCHING])
        self._step, self.warnings = step, shortfall(scenario, nominal.wrench, self.thrusters)
        for line in self.warnings:
            warnings.warn(ControlWarning(line), stacklevel=2)
        self.loop_times = np.zeros(0)
        self.dt = step if self.control.rate is None else 1.0 / self.control.rate
        self._shapes = (robot.model.nq,), (robot.model.nv,)
        self._robot, self._crank_rate = robot, 2.0 * np.pi * scenario.crank.frequency
        self._observer = disturbance
        if disturbance is None and self.control.feedforward:
            self._observer = DisturbanceObserver(robot, scenario, nominal, self.dt)
        self.sensed = SensedMotion(scenario, robot, nominal)
        self._monitor = Monitor(self.thrusters.limit, step, self.sensed)
        self._memory = new_state(Law, m=len(self.thrusters.limit), waves=len(nominal.swing) // 2)
        self._view()
        self._fill()
        self._restart()

    def _view(self) -> None:
        self._law = law = fields_of(self._memory, Law)
        self.disturbance, self.wanted, self.unrealised = law.disturbance, law.wanted, law.unrealised

    def __repr__(self) -> str:
        parts = ["PD", *(["integral"] if self.control.integral else [])]
        parts += [type(self._observer).__name__] if self._observer is not None and self.control.feedforward else []
        thrusts = ", ".join(f"{1e3 * thrust:.0f}" for thrust in self.allocation.thrusts(self.nominal.wrench))
        return f"Controller({self.scenario.name!r}: {' + '.join(parts)}; nominal thrusts {thrusts} mN)"

    def _fill(self) -> None:
        """Write the constants of the law."""
        law, control, flight, nominal = self._law, self.control, self.scenario.flight, self.nominal
        believed = self.scenario.believed_thrusters
        heading = math.radians(flight.yaw_deg)
        law.start[:], law.velocity[:] = flight.position, flight.velocity
        law.heading[:], law.level[:] = (math.cos(heading), math.sin(heading)), nominal.quaternion
        law.nominal[:], law.centre[:], law.swing[:] = nominal.wrench, nominal.centre, nominal.swing
        law.weight[...] = max(nominal.mass * flight.gravity, 1e-9)
        inertia, w = np.append([nominal.mass] * 3, nominal.inertia), np.array(control.frequencies)
        law.gains[:, 0] = inertia * w**2
        law.gains[:, 1] = 2.0 * np.broadcast_to(control.damping, 6) * inertia * w
        law.gains[:, 2] = integral_shares(control) * law.gains[:, 0]
        law.beta[...] = control.bias if control.integral else 0.0
        law.smoothing[...] = follow_share(control.smoothing, self.dt)
        law.limits[:] = np.sin(np.radians([control.bank_limit_deg, control.pitch_limit_deg]))
        # Thrusters with a lag T make a(t) of a(t) + T a'(t); a command is constant until the next one, half of it late.
        turn = self._crank_rate * (believed.delay + 0.5 * self.dt)
        ahead = complex(*nominal.steering) * (1.0 - 1j * self._crank_rate * believed.lag) * np.exp(-1j * turn)
        law.steering[:] = ahead.real, ahead.imag
        law.compensates[...], law.tick[...] = float(control.feedforward), self.dt
        law.settled[...], law.lead[...] = self.dt / PITCHED_IN, control.lead
        law.follow[...] = follow_share(control.lead / believed.lag, self.dt) if believed.lag > 0.0 else 1.0
        self.allocation.fill(law.limited)

    def _restart(self) -> None:
        law = self._law
        self.thrust = LaggedThrust(self.thrusters, self.scenario.believed_thrusters, self._step, self.trim)
        self.modelled: Array = self.nominal.wrench
        for state in (law.integral, law.slow, law.disturbance, law.unrealised, law.bias):
            state[:] = 0.0
        self.sensed.restart()
        self._monitor.restart()
        law.begun[...] = law.nose_down[...] = 0.0
        law.wanted[:], law.command[:] = self.nominal.wrench, self.trim
        self._pushed: Array = np.zeros(6)
        self._pushes, self._ticks, self._begun = 0, 0, 0.0
        self._command: Array = self.trim

    @property
    def state(self) -> LoopState:
        """How the flight is, as the controller sees it."""
        return self._monitor.state

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
        """Start at the first sample of a flight; its velocity is the nominal one unless more than noise is between."""
        self._restart()
        self._begun = time
        if self._observer is not None:
            crank_angle = self.sensed.take(q, v, crank_angle, self.modelled, self.disturbance)
            v = self._nearly_nominal(self.sensed.q, self.sensed.v.copy(), crank_angle)
            self._observer.reset(time, self.sensed.q, v, crank_angle)
            self.sensed.restart()

    def _nearly_nominal(self, q: Array, v: Array, crank_angle: float) -> Array:
        """Return velocities (nv,) with the nominal twist of the body for one that differs by noise alone."""
        swing = waves(np.array([crank_angle]))[0] @ self.nominal.swing
        ground = np.array(self.scenario.flight.velocity) + swing[3:6]
        twist = np.append(pin.Quaternion(q[3:7]).matrix().T @ ground, swing[9:])
        sensors = self.scenario.believed_sensors
        noise = np.sqrt(
            np.concatenate([sample_variance(sensor, 1.0)[0] for sensor in (sensors.velocity, sensors.gyro)])
        )
        near = np.abs(v[:6] - twist) <= AS_NOMINAL * noise
        v[:6] = np.where(near, twist, v[:6])
        return v

    def command(self, time: float, q: Array, v: Array, crank_angle: float) -> Array:
        """Take a sample: configuration q (nq,), velocity v (nv,) and crank angle [rad], as the sensors show them.

        Returns:
            Commanded thrusts (m,) [N] for the next interval.
        """
        if q.shape != self._shapes[0] or v.shape != self._shapes[1]:
            raise ShapeError(
                f"q, v have shapes {q.shape}, {v.shape}: {self._shapes[0]}, {self._shapes[1]} were expected"
            )
        since = time - self._begun
        crank_angle = self.sensed.take(q, v, crank_angle, self.modelled, self.disturbance)
        q, v = self.sensed.q, self.sensed.v
        if since * (1.0 + 1e-9) + 1e-9 >= self._ticks * self.dt:
            self._ticks += 1
            if self._observer is not None and self._pushes:
                unbiased = v.copy()
                unbiased[:3] -= pin.Quaternion(q[3:7]).matrix().T @ self._law.bias
                self.disturbance[:] = self._observer.update(time, q, unbiased, self._pushed / self._pushes)
            self._pushed, self._pushes = np.zeros(6), 0
            write_commands(self._memory, self.wrench(since, q, v, crank_angle), crank_angle)
            self._command = self._law.command.copy()
        self._monitor.take(self._command, self.unrealised)
        self.modelled = self.thrust.advance(self._command)
        self._pushed, self._pushes = self._pushed + self.modelled, self._pushes + 1
        return self._command

    def wrench(self, since: float, q: Array, v: Array, crank_angle: float) -> Array:
        """Return the wrench (6,) that the law wants `since` seconds after the begin, before its lead and steering.

        Another law overrides this.
        """
        wanted = np.empty(6)
        law_wrench(self._memory, since, q, v, crank_angle, wanted)
        return wanted
