"""Trim: find the flapping frequency, wing offset and start for which a symmetric flight repeats every flap.

The trimmed flight is a periodic orbit of the whole plant, including the aerodynamic state. The horizontal velocity over
ground at the start of a flap is given. The unknowns are frequency, `wing.offset_x`, pitch, vertical speed, pitch rate
and aerodynamic state. The conditions are that speed, vertical speed, pitch, pitch rate, height and aerodynamic state
have the same values one flap later. The nose points along the horizontal velocity. The steady wind is included, gusts
are not; of the unknown forces only the part that depends on the elbow angle is included. The Floquet multipliers of
the orbit are the factors by which small disturbances grow per flap.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from aerobat_pin.aerobat import flown_robot
from aerobat_pin.errors import AerobatError, TrimError
from aerobat_pin.flight.plant.plant import Plant
from aerobat_pin.flight.plant.tables import State
from aerobat_pin.numerics import Array, guarded
from aerobat_pin.scenario import MOST_SECONDS, SECONDS_PER_STEP, Scenario

BODY = 5  # unknowns besides the aerodynamic state: frequency, offset, pitch, vertical speed, pitch rate
BODY_SCALE = np.array([1.0, 0.01, 0.1, 0.1, 1.0])  # Hz, m, rad, m/s, rad/s
AIR_SCALE = 0.1
DIFFERENCE_STEP = 1.0e-6  # step of the finite differences, in scaled unknowns
FLAPS_PER_STRIP = 20  # that a search flies: measured with 8 strips
CONVERGED = 1.0e-6  # largest residual of a flight that counts as periodic, in the units of `Trim.residual`


@dataclass(frozen=True)
class Trim:
    """A trimmed flight.

    The scenario does not start exactly on the orbit: its aerodynamic state is warmed up at constant body velocity.

    Attributes:
        scenario: the scenario with the frequency, the wing offset and the initial body state of the orbit.
        residual: largest difference between start and end of a flap, in m/s, rad, rad/s, m and scaled air states.
        multipliers: Floquet multipliers (n,), largest first: growth per flap of changes of attitude, twist, height and
            aerodynamic state.
        period: duration of a flap [s].
    """

    scenario: Scenario
    residual: float
    multipliers: NDArray[np.complex128]
    period: float

    @property
    def time_to_double(self) -> float:
        """Time in which the fastest growing disturbance doubles [s]; infinite if it grows by less than 1 % per flap."""
        growth = float(np.abs(self.multipliers[0]))
        return self.period * float(np.log(2.0) / np.log(growth)) if growth > 1.01 else float("inf")


@guarded()
def find_trim(scenario: Scenario) -> Trim:
    """Find the periodic flight nearest to a scenario's start.

    The scenario has robot, wind, horizontal velocity over ground, and first guesses of frequency, offset, pitch,
    vertical speed and pitch rate.

    Raises:
        TrimError: the crank does not turn steadily, a joint is elastic, another simulator flies it, the flight is not
            symmetric, or no periodic flight was found.
    """
    from scipy.optimize import root  # takes as long to import as everything else together

    _refuse_what_has_no_orbit(scenario)
    guess = flown_robot(scenario).morphology.wing.offset_x
    flight = scenario.flight
    body = [
        scenario.crank.frequency,
        guess,
        np.radians(flight.pitch_deg),
        flight.velocity[2],
        flight.angular_velocity[1],
    ]
    air = Plant(flown_robot(scenario), scenario).initial.air

    def miss(unknowns: Array) -> Array:
        try:
            return _flap_miss(scenario, unknowns)
        except AerobatError:
            return np.full_like(unknowns, 1e3)

    def slopes(unknowns: Array) -> Array:
        base = miss(unknowns)
        units = np.eye(len(unknowns))
        return np.column_stack([(miss(unknowns + DIFFERENCE_STEP * unit) - base) / DIFFERENCE_STEP for unit in units])

    solved = root(miss, np.concatenate([body / BODY_SCALE, air / AIR_SCALE]), jac=slopes, method="hybr")
    residual = float(np.max(np.abs(miss(solved.x))))
    if not residual < CONVERGED:
        raise TrimError(
            f"no periodic flight found near {body[0]:.2f} Hz and offset {1e3 * guess:.0f} mm at "
            f"{math.hypot(*flight.velocity[:2]):g} m/s: one flap misses its start by {residual:.2g}; "
            "try another frequency, offset or pitch"
        )
    plant, start = _plant(scenario, solved.x)
    end = _flap(plant, start)
    lopsided = max(abs(end.twist[i] - start.twist[i]) for i in (1, 3, 5))
    if not lopsided < 1e-6:
        raise TrimError(
            "only a symmetric flight can be trimmed: forces or wind of this scenario push it sideways or turn it, "
            f"{lopsided:.2g} m/s or rad/s in one flap"
        )
    trimmed = _trimmed(scenario, solved.x)
    return Trim(trimmed, residual, _multipliers(plant, start, end), 1.0 / trimmed.crank.frequency)


def _refuse_what_has_no_orbit(scenario: Scenario) -> None:
    """Raise TrimError for a flight that cannot be periodic, or whose search would take too long."""
    if scenario.crank.frequency <= 0.0:
        raise TrimError("crank.frequency = 0: only a flapping flight can be periodic")
    if scenario.crank.drive != "constant":
        raise TrimError(f"crank.drive = {scenario.crank.drive!r}: only a crank that turns steadily can be trimmed")
    for key in ("shoulder", "elbow", "simulator"):
        if getattr(scenario.plant, key) is not None:
            what = "only a robot with rigid joints, and in no other simulator, can be trimmed"
            raise TrimError(f"plant.{key}: {what}; no such key was expected")
    flaps = FLAPS_PER_STRIP * scenario.air.strips
    seconds = flaps * SECONDS_PER_STEP / (scenario.crank.frequency * scenario.simulation.dt)
    if seconds > MOST_SECONDS:
        raise TrimError(
            f"simulation.dt = {scenario.simulation.dt:g} s at crank.frequency = {scenario.crank.frequency:g} Hz: the "
            f"search takes some {flaps} flaps, about {seconds:.3g} s; at most {MOST_SECONDS:g} s are allowed: a longer "
            "simulation.dt was expected"
        )


def _course(scenario: Scenario) -> float:
    """Return the direction of the horizontal velocity, as an angle from world x toward world y [rad]."""
    return math.atan2(scenario.flight.velocity[1], scenario.flight.velocity[0])


def _trimmed(scenario: Scenario, unknowns: Array) -> Scenario:
    """Return the scenario with the values of scaled unknowns, the nose pointing along the horizontal velocity."""
    frequency, offset, pitch, rise, pitch_rate = (float(x) for x in unknowns[:BODY] * BODY_SCALE)
    if frequency <= 0.0:
        raise TrimError(f"crank.frequency = {frequency}: the search arrived at a flight without flapping")
    flight = scenario.flight.model_copy(
        update={
            "velocity": (*scenario.flight.velocity[:2], rise),
            "roll_deg": 0.0,
            "yaw_deg": math.degrees(_course(scenario)),
            "angular_velocity": (0.0, pitch_rate, 0.0),
            "pitch_deg": float(np.degrees(pitch)),
        }
    )
    changes = {**scenario.robot.changes, "wing": {**scenario.robot.changes.get("wing", {}), "offset_x": offset}}
    return scenario.model_copy(
        update={
            "name": f"{scenario.name}_trimmed",
            "flight": flight,
            "crank": scenario.crank.model_copy(update={"frequency": frequency}),
            "robot": scenario.robot.model_copy(update={"changes": changes}),
        }
    )


def _plant(scenario: Scenario, unknowns: Array) -> tuple[Plant, State]:
    """Build the plant and its state at the start of the flap from scaled unknowns."""
    steady = scenario.air.steady.model_copy(update={"warm_up_cycles": 0})
    flown = _trimmed(scenario, unknowns).model_copy(update={"air": steady})
    plant = Plant(flown_robot(flown), flown)
    return plant, State(plant.initial.placement, plant.initial.twist, unknowns[BODY:] * AIR_SCALE)


def _flap(plant: Plant, start: State) -> State:
    """Simulate one flap and return the state at its end."""
    period = 1.0 / plant.scenario.crank.frequency
    count = max(20, round(period / plant.scenario.simulation.dt))
    trajectory = plant.fly(count, period / count, np.zeros((2, len(plant.forces), count)), start=start)
    return State(trajectory.q[-1, :7], trajectory.v[-1, :6], trajectory.air[-1])


def _flap_miss(scenario: Scenario, unknowns: Array) -> Array:
    """Return end minus start of one flap: speed, vertical speed, pitch, pitch rate, height, scaled air state."""
    plant, start = _plant(scenario, unknowns)
    end = _flap(plant, start)
    heading = np.array([math.cos(_course(scenario)), math.sin(_course(scenario)), 0.0])
    velocity = [pin.Quaternion(state.placement[3:]).matrix() @ state.twist[:3] for state in (start, end)]
    turned = pin.XYZQUATToSE3(start.placement).actInv(pin.XYZQUATToSE3(end.placement))
    body = [
        heading @ (velocity[1] - velocity[0]),
        velocity[1][2] - velocity[0][2],
        pin.log3(turned.rotation)[1],
        end.twist[4] - start.twist[4],
        end.placement[2] - start.placement[2],
    ]
    return np.concatenate([body, (end.air - start.air) / AIR_SCALE])


def _multipliers(plant: Plant, start: State, end: State) -> NDArray[np.complex128]:
    """Return the eigenvalues of the map from small changes at the start of a flap to the changes at its end.

    A change consists of world height, rotation in body axes, twist and scaled aerodynamic state, relative to the orbit.
    The horizontal position has no influence and is left out.
    """

    def after(change: Array) -> Array:
        return _change(end, _flap(plant, _changed(start, change)))

    moved = [(after(step) - after(-step)) / 2e-5 for step in 1e-5 * np.eye(10 + len(start.air))]
    values = np.linalg.eigvals(np.array(moved).T)
    return np.asarray(values[np.argsort(-np.abs(values))])


def _changed(state: State, change: Array) -> State:
    """Return a state changed by height, rotation (3), twist (6) and scaled aerodynamic state."""
    placement = pin.XYZQUATToSE3(state.placement)
    placement.translation = placement.translation + np.array([0.0, 0.0, change[0]])
    placement.rotation = placement.rotation @ pin.exp3(change[1:4])
    twist, air = state.twist + change[4:10], state.air + change[10:] * AIR_SCALE
    return State(pin.SE3ToXYZQUAT(placement), twist, air)


def _change(start: State, end: State) -> Array:
    """Return the change from one state to another: height, rotation (3), twist (6) and scaled aerodynamic state."""
    first, second = (pin.XYZQUATToSE3(state.placement) for state in (start, end))
    turned = pin.log3(first.rotation.T @ second.rotation)
    rise = second.translation[2] - first.translation[2]
    return np.concatenate([[rise], turned, end.twist - start.twist, (end.air - start.air) / AIR_SCALE])
