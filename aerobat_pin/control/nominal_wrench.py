"""The nominal flight: which wrench of the thrusters a believed robot needs on its course, and how it swings about it.

The wings heave and pitch the body in each flap. No thruster can stop the heaving; the pitching is steered against, at
the rate of the flaps, as it is known in advance. So the thrusters make a constant wrench w and a pitching moment s,
and the body moves about its course and comes back to where it was after each flap. The rows of the base of inverse
dynamics and air say all three, w, s and the motion:

    (M a + C v + g - u_air)_base = w + s        over a flap, with a velocity and a position without drift

Beginning with a body that keeps still, `PASSES` corrections of its acceleration by M_bb^-1 of what the left side misses
of w + s find them; each is some five times smaller than the one before. s is a sine of the crank angle, as large as it
must be, and as thrusters with a lag can make it within `STEERED` of their room; overtones are left to the body.

Gravity is in w: the body's centre of mass, about which thrusters count, is not the robot's, and so the wrench has a
moment. An observer counts gravity as known and does not see it; nominal flight and observer share one belief.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from aerobat_pin.aerobat import BASE_SIZE, Aerobat, AirStream
from aerobat_pin.control.allocation import Allocation
from aerobat_pin.errors import ScenarioError
from aerobat_pin.flight import thrusters_of
from aerobat_pin.numerics import Array, guarded
from aerobat_pin.observers import rotation_matrices, world_velocity
from aerobat_pin.scenario import ControlSection, Scenario

FLAP_SAMPLES = 240  # in a flap
PASSES = 4
OVERTONES = 6  # up to this multiple of the crank angle, the swing is kept
PITCHING = 4  # row of a wrench
PITCH_STEP = 1e-4  # [N m]
STEERED = 0.75  # of what a thruster can change until it meets a limit; the rest is the law's


@dataclass(frozen=True)
class Nominal:
    """The nominal flight of a believed robot.

    Attributes:
        wrench: (6,) mean wrench that the thrusters must make, at the body's centre of mass, body axes [N, N m].
        air: (6,) mean wrench of the air, added mass included, the same way.
        inertia: (3,) of the whole robot about its centre of mass, body axes, mean over a flap [kg m2].
        centre: (3,) the robot's centre of mass from the body's, body axes, mean over a flap [m].
        mass: of the robot [kg].
        momentum: (6, 6) momentum about `centre` per body twist, body axes; root mean square of each entry over a flap.
        quaternion: (4,) attitude xyzw to keep: heading of the start, and the pitch of the table `control`.
        swing: (2 OVERTONES, 12) the body's motion about its course: rows as `waves` has them of the crank angle;
            columns position and velocity over ground, world axes, turn and body rate, body axes [m, m/s, rad, rad/s].
        steering: (2,) the pitching moment against the flaps, as cosine and sine of the crank angle [N m].
    """

    wrench: Array
    air: Array
    inertia: Array
    centre: Array
    mass: float
    momentum: Array
    quaternion: Array
    swing: Array
    steering: Array


@guarded()
def control_of(scenario: Scenario) -> ControlSection:
    """Return the table `control` of a scenario. Raises ScenarioError if it has none."""
    if scenario.control is None:
        raise ScenarioError(f"scenario {scenario.name}: no table control; a closed loop needs one")
    return scenario.control


@guarded()
def nominal_flight(scenario: Scenario, robot: Aerobat) -> Nominal:
    """Return the nominal flight of a scenario's believed robot in believed air, at the start's velocity and heading.

    Raises ScenarioError if the scenario has no table `control`.
    """
    control = control_of(scenario)
    flight, crank, model = scenario.flight, scenario.crank, robot.model
    attitude = pin.rpy.rpyToMatrix(0.0, -np.radians(control.pitch_deg), np.radians(flight.yaw_deg))
    quaternion = pin.Quaternion(attitude).coeffs()
    placement = np.concatenate([flight.position, quaternion])
    twist = np.concatenate([attitude.T @ np.array(flight.velocity), np.zeros(3)])
    rate = 2.0 * np.pi * crank.frequency
    dt = 1.0 / (FLAP_SAMPLES * crank.frequency) if rate > 0.0 else 1e-3
    time = np.arange(FLAP_SAMPLES + 1) * dt
    angle = np.radians(crank.start_deg) + rate * time
    closed = robot.linkage.solve(angle, rate)
    twists, accelerations = np.tile(twist, (len(time), 1)), np.zeros((len(time), BASE_SIZE))
    placements = np.tile(placement, (len(time), 1))
    placements[:, :3] += time[:, None] * np.array(flight.velocity)
    steady = scenario.believed_air.steady
    stream = AirStream(robot, steady, dt)
    beat = waves(angle[:-1]) if rate > 0.0 else np.zeros((FLAP_SAMPLES, 2 * OVERTONES))
    for remaining in reversed(range(PASSES)):
        q = robot.configuration(placements, closed.theta_s, closed.theta_e)
        v = robot.velocity(twists, closed.theta_s_dot, closed.theta_e_dot)
        a = robot.velocity(accelerations, closed.theta_s_ddot, closed.theta_e_ddot)
        air = _blown(stream, time, q, v, angle[0], rate)
        needed, inertias, inertia, centre = _base_dynamics(model, q, v, a, attitude)
        wrench = np.mean(needed - air, axis=0)
        lasting = (needed - air)[:, PITCHING] - np.mean(inertias[:, PITCHING, PITCHING]) * accelerations[:-1, PITCHING]
        steering = _of_waves(lasting, beat)[:2]  # what holds the pitch still
        steering *= min(1.0, most_steering(scenario, robot, wrench) / max(float(np.hypot(*steering)), 1e-12))
        if remaining:
            miss = needed - air - wrench
            miss[:, PITCHING] -= beat[:, :2] @ steering
            accelerations[:-1] -= np.linalg.solve(inertias, miss[:, :, None])[:, :, 0]
            accelerations[-1] = accelerations[0]
            twists, placements = _without_drift(accelerations, twist, placement, np.array(flight.velocity), time)
    about_centre = np.eye(BASE_SIZE)
    about_centre[3:, :3] = -pin.skew(centre)
    swing = _about_the_course(placements, twists, quaternion, np.array(flight.velocity), time)
    return Nominal(
        wrench=wrench,
        air=np.mean(air, axis=0),
        inertia=inertia,
        centre=centre,
        mass=robot.mass,
        momentum=np.sqrt(np.mean((about_centre @ inertias) ** 2, axis=0)),
        quaternion=quaternion,
        swing=_of_waves(swing[:-1], beat),
        steering=steering,
    )


def _base_dynamics(
    model: pin.Model, q: Array, v: Array, a: Array, attitude: Array
) -> tuple[Array, Array, Array, Array]:
    """Return the base's rows of inverse dynamics (FLAP_SAMPLES, 6) and inertia (FLAP_SAMPLES, 6, 6) along a flap.

    Then follow means over it: `inertia` and `centre` of `Nominal`.
    """
    data, needed, inertias = model.createData(), np.zeros((FLAP_SAMPLES, 6)), np.zeros((FLAP_SAMPLES, 6, 6))
    inertia, centre = np.zeros(3), np.zeros(3)
    for k in range(FLAP_SAMPLES):
        needed[k] = pin.rnea(model, data, q[k], v[k], a[k])[:BASE_SIZE]
        pin.ccrba(model, data, q[k], v[k])
        inertia += np.diag(attitude.T @ data.Ig.inertia @ attitude) / FLAP_SAMPLES
        centre += data.oMi[1].actInv(data.com[0]) / FLAP_SAMPLES
        inertias[k] = pin.crba(model, data, q[k])[:BASE_SIZE, :BASE_SIZE]
    return needed, inertias, inertia, centre


def most_steering(scenario: Scenario, robot: Aerobat, wrench: Array) -> float:
    """Return the largest amplitude [N m] of a pitching moment with the crank that leaves thrusters room for the law."""
    believed = scenario.believed_thrusters
    thrusters = thrusters_of(robot.morphology)
    allocation = Allocation(thrusters, believed.factor)
    thrust = allocation.thrusts(wrench)
    each = np.abs(allocation.thrusts(wrench + PITCH_STEP * np.eye(BASE_SIZE)[PITCHING]) - thrust) / PITCH_STEP
    ahead = abs(1.0 + 2j * np.pi * scenario.crank.frequency * believed.lag)
    return float(np.min(STEERED * np.minimum(thrust, thrusters.limit - thrust) / np.maximum(each * ahead, 1e-12)))


def waves(angle: Array) -> Array:
    """Return cosine and sine of an angle (n,), then of twice the angle, up to `OVERTONES` times: (n, 2 OVERTONES)."""
    turned = np.outer(angle, np.arange(1, OVERTONES + 1))
    return np.stack([np.cos(turned), np.sin(turned)], axis=2).reshape(len(angle), -1)


def _blown(stream: AirStream, time: Array, q: Array, v: Array, angle: float, rate: float) -> Array:
    """Return the wrench of the air (FLAP_SAMPLES, 6) at the samples of a flap; a flap is flown before, for the wake.

    A stream gives means over intervals; the mean of the two neighbours is the value at a sample, to second order.
    """
    stream.reset(0.0, q[0], v[0], angle, rate)
    ahead = q[-1, :3] - q[0, :3]
    wrenches = np.zeros((2 * FLAP_SAMPLES, BASE_SIZE))
    for k in range(2 * FLAP_SAMPLES):
        at = k % FLAP_SAMPLES + 1
        placed = q[at].copy()
        placed[:3] += ahead if k >= FLAP_SAMPLES else 0.0
        wrenches[k] = stream.update(time[at], placed, v[at]).sum(axis=0)[:BASE_SIZE]
    return np.asarray(0.5 * (wrenches[FLAP_SAMPLES - 1 : -1] + wrenches[FLAP_SAMPLES:]))


def _without_drift(
    accelerations: Array, twist: Array, placement: Array, velocity: Array, time: Array
) -> tuple[Array, Array]:
    """Integrate base accelerations over a flap to twists and placements that come back; accelerations are corrected."""
    accelerations -= _mean(accelerations)
    swing = _integral(accelerations, time)
    swing -= _mean(swing)
    turn = _integral(swing[:, 3:], time)
    turn -= _mean(turn)
    course = pin.Quaternion(placement[3:])
    attitudes = np.array([(course * pin.Quaternion(pin.exp3(row))).coeffs() for row in turn])
    twists, R = twist + swing, rotation_matrices(attitudes)
    over_ground = np.einsum("mij,mj->mi", R, twists[:, :3])
    extra = _mean(over_ground) - velocity
    twists[:, :3] -= extra @ R
    places = _integral(over_ground - extra - velocity, time)
    places += placement[:3] - _mean(places) + time[:, None] * velocity
    return twists, np.concatenate([places, attitudes], axis=1)


def _about_the_course(placements: Array, twists: Array, level: Array, velocity: Array, time: Array) -> Array:
    """Return position, velocity over ground, turn and body rate (n, 12) of a body, less those of its course."""
    places, speeds = placements[:, :3] - time[:, None] * velocity, world_velocity(placements, twists) - velocity
    turns = [pin.log3(turn) for turn in pin.Quaternion(level).matrix().T @ rotation_matrices(placements[:, 3:])]
    return np.concatenate([places, speeds, turns, twists[:, 3:]], axis=1)


def _of_waves(rows: Array, beat: Array) -> Array:
    """Return the waves' coefficients (2 OVERTONES, ...) in rows (FLAP_SAMPLES, ...) of a whole flap."""
    return np.asarray(2.0 / FLAP_SAMPLES * beat.T @ rows)


def _mean(rows: Array) -> Array:
    """Return the mean over a flap, whose first and last rows are the same sample."""
    return np.asarray(np.mean(rows[:-1], axis=0))


def _integral(rows: Array, time: Array) -> Array:
    """Integrate rows over time, from 0, by trapezia."""
    steps = 0.5 * (rows[1:] + rows[:-1]) * np.diff(time)[:, None]
    return np.concatenate([np.zeros((1, rows.shape[1])), np.cumsum(steps, axis=0)])
