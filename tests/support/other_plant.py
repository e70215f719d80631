"""Another simulator of the guarded robot, which shares no code with the package: what calibration must be right about.

The package's own plant and belief share their code, so an error that both make is seen by nobody. Here everything is
different on purpose:

* rigid bodies by momentum: the state holds the robot's linear and angular momentum about the world's origin, whose
  rates are the external loads; the body's twist follows from them by a 6 x 6 system. No mass matrix, no Coriolis term,
  no accelerations, no Pinocchio. Joint torques are the loads that a subtree's change of momentum leaves open;
* air: strips with the steady coefficients of Dickinson et al. (Science 284, 1999) behind a lag of one chord of travel;
  0.8 of a flat plate's added mass, carried in the momentum; a tail and a body drag of its own;
* the outer wings twist under their own lift, 8 degrees about their mean, and the left one is 10 % softer;
* the crank's rate ripples by 4 %, twice a turn.

Only the robot's data are the same: masses and joints (URDF), planform, and the joints' angles over the crank, kept here
as the Fourier series that an encoder would have recorded. The result is a flight log.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import xarray as xr

from aerobat_pin.aerobat import FlightLog
from support.other_robot import (
    COUNT,
    DT,
    GRAVITY,
    LEFT,
    NONE,
    ON_BODIES,
    OUTER_STRIPS,
    RIPPLE,
    SOFTER,
    STIFFNESS,
    STRIPS,
    SUBTREES,
    TWIST_LAG,
    Geometry,
    State,
    cross,
)


def steady(incidence: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return lift and drag coefficients (Dickinson et al., Science 284, 1999) of incidences [rad] from -180 to 180."""
    degrees = np.degrees(np.abs(incidence))
    lift = np.sign(incidence) * (0.225 + 1.58 * np.sin(np.radians(2.13 * degrees - 7.2)))
    return lift, 1.92 - 1.55 * np.cos(np.radians(2.04 * degrees - 9.82))


Push = Callable[[float], np.ndarray]


def loads(
    state: State, g: Geometry, twist: tuple[np.ndarray, np.ndarray], wrench: np.ndarray, force: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return external force and moment about the origin of each body (5, 3), the body's twist, the rates of the air."""
    v, w = twist
    F = g.mass[:, None] * np.array([0.0, 0.0, -GRAVITY])
    M = cross(g.com, F)
    air = g.air_velocity(v, w, state.x)
    ahead, up = np.sum(air * g.forward, axis=1), np.sum(air * g.normal, axis=1)
    speed = np.maximum(np.hypot(ahead, up), 1e-3)
    lift, drag = steady(np.arctan2(-up, ahead))
    pressure = 0.5 * g.density * speed**2 * STRIPS["chord"] * STRIPS["width"]
    flow = (ahead[:, None] * g.forward + up[:, None] * g.normal) / speed[:, None]
    side = (ahead[:, None] * g.normal - up[:, None] * g.forward) / speed[:, None]
    strip = pressure[:, None] * (state.lift[:, None] * side - drag[:, None] * flow)
    turning = w + g.spin[STRIPS["body"]]
    carried = (g.carried * up)[:, None] * cross(turning, g.normal)
    quarter = g.place + 0.25 * STRIPS["chord"][:, None] * g.forward
    F += ON_BODIES @ (strip + carried)
    M += ON_BODIES @ (cross(quarter, strip) + cross(g.place, carried))
    tail_at = state.x + state.R @ [-0.12, 0.0, 0.01]
    tail = state.R.T @ (v + cross(w, tail_at - state.x))
    plate = state.R @ [0.0, 0.0, -0.5 * g.density * 0.006 * 2.4 * abs(tail[0]) * tail[2]]
    body = -0.5 * g.density * 5.0e-3 * np.linalg.norm(v) * v
    thrust = state.R @ wrench[:3]
    F[0] += plate + body + thrust
    M[0] += cross(tail_at, plate) + cross(state.x, body + thrust) + state.R @ wrench[3:]
    F[2] += force
    M[2] += cross(g.com[2], force)
    growth = (lift - state.lift) * speed / STRIPS["chord"]
    push = np.array([np.sum((strip * g.normal)[OUTER_STRIPS & part]) for part in (LEFT, ~LEFT)])
    bending = (-push / (STIFFNESS * np.array([SOFTER, 1.0])) - state.twist) / TWIST_LAG
    return F, M, v, w, growth, bending


def advanced(state: State, dt: float, rates: tuple[np.ndarray, ...]) -> State:
    """Return the state after a step with constant rates."""
    F, M, v, w, growth, twist = rates
    turn = np.linalg.norm(w) * dt
    axis = w / max(np.linalg.norm(w), 1e-12)
    K = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    R = (np.eye(3) + np.sin(turn) * K + (1.0 - np.cos(turn)) * K @ K) @ state.R
    P, H = state.P + dt * np.sum(F, axis=0), state.H + dt * np.sum(M, axis=0)
    return State(state.x + dt * v, R, P, H, state.lift + dt * growth, state.twist + dt * twist)


def crank_at(time: float, frequency: float) -> tuple[float, float]:
    """Return angle and rate of the crank, which ripples twice a turn."""
    pulsation = 2.0 * np.pi * frequency
    even = -0.5 * np.pi + pulsation * time
    return even + RIPPLE * np.sin(2.0 * even), pulsation * (1.0 + 2.0 * RIPPLE * np.cos(2.0 * even))


def held(state: State, v: np.ndarray, w: np.ndarray, speed: float, side: bool) -> np.ndarray:
    """Return the thrusters' wrench on the body, in body axes: it keeps attitude, height, speed and perhaps the side."""
    E = state.R.T
    error = 0.5 * np.array([E[2, 1] - E[1, 2], E[0, 2] - E[2, 0], E[1, 0] - E[0, 1]])
    torque = np.array([0.29, 0.11, 0.35]) * error - np.array([0.039, 0.0144, 0.047]) * (state.R.T @ w)
    lift = 0.85 - 2.3 * state.x[2] - 0.74 * v[2]
    across = -0.37 * v[1] if side else 0.0
    return np.concatenate([state.R.T @ [0.37 * (speed - v[0]), across, lift], torque])


def _quaternion(R: np.ndarray) -> np.ndarray:
    """Return the quaternion xyzw of a rotation that turns by less than 180 degrees."""
    w = 0.5 * np.sqrt(max(1.0 + np.trace(R), 1e-12))
    vector = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / (4.0 * w)
    return np.array([*vector, w])


def fly_elsewhere(
    duration: float,
    push: Push | None = None,
    *,
    speed: float = 3.0,
    frequency: float = 4.75,
    settle: float = 0.5,
    air: float = 1.0,
    side: bool = False,
) -> tuple[FlightLog, np.ndarray]:
    """Fly, after a while that is not recorded.

    Args:
        duration: of the record [s].
        push: time -> force (3,) [N] on the left outer wing's centre of mass, world axes; none by default.
        speed: forward speed that is held [m/s].
        frequency: of the crank [Hz].
        settle: time before the record [s].
        air: share of the air's density; 0 for a vacuum.
        side: whether the thrusters also oppose a speed to the side.

    Returns:
        The log with exact sensors and no truth, and the mean force (m, 3) of each interval.
    """
    state = State(np.zeros(3), np.eye(3), np.zeros(3), np.zeros(3), np.zeros(COUNT), np.zeros(2))
    g = Geometry(state, *crank_at(-settle, frequency), air)
    P, H = g.momenta(np.array([speed, 0.0, 0.0]), NONE, state.x)
    state.P, state.H = np.sum(P, axis=0), np.sum(H, axis=0)
    skipped, count = round(settle / DT), round((settle + duration) / DT)
    samples, known, torques, forces, before = [], [], [], [], None
    for k in range(count + 1):
        t = k * DT - settle
        pushing = NONE if push is None or t < 0.0 else push(t + 0.5 * DT)
        g = Geometry(state, *crank_at(t, frequency), air)
        v, w = g.twist_of_body(state)
        wrench = held(state, v, w, speed, side)
        if k >= skipped:
            parts = g.momenta(v, w, state.x)
            if before is not None:
                torques.append(_torques(before, parts))
            q = np.concatenate([state.x, _quaternion(state.R), g.angles])
            samples.append(np.concatenate([q, state.R.T @ v, state.R.T @ w, g.rates, [crank_at(t, frequency)[0]]]))
        if k == count:
            break
        halfway = advanced(state, 0.5 * DT, loads(state, g, (v, w), wrench, pushing))
        middle = Geometry(halfway, *crank_at(t + 0.5 * DT, frequency), air)
        rates = loads(halfway, middle, middle.twist_of_body(halfway), wrench, pushing)
        state = advanced(state, DT, rates)
        if k >= skipped:
            before = parts, rates, middle
            known.append(np.concatenate([wrench, np.zeros(4)]))
            forces.append(pushing)
    return _log(np.array(samples), np.array(known), np.array(torques)), np.array(forces)


def _torques(before: tuple, after: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Return the mean motor torque (10,) of an interval, from what the loads leave of the change of momentum."""
    (P, H), (F, M, *_), middle = before
    torque = np.zeros(10)
    for joint, bodies in enumerate(SUBTREES):
        force = np.sum((after[0] - P)[list(bodies)] / DT - F[list(bodies)], axis=0)
        moment = np.sum((after[1] - H)[list(bodies)] / DT - M[list(bodies)], axis=0)
        torque[6 + joint] = middle.axis[joint] @ (moment - cross(middle.pin[joint], force))
    return torque


def _log(samples: np.ndarray, known: np.ndarray, torques: np.ndarray) -> FlightLog:
    """Return the log as a laboratory would hand it over."""
    measured = xr.Dataset(
        {
            "q": (("time", "q_axis"), samples[:, :11]),
            "v": (("time", "v_axis"), samples[:, 11:21]),
            "crank_angle": (("time",), samples[:, 21]),
            "airspeed": (("time",), samples[:, 11]),
            "motor_torque": (("interval", "v_axis"), torques),
            "known_thrusters": (("interval", "v_axis"), known),
        },
        coords={"time": DT * np.arange(len(samples)), "interval": DT * np.arange(len(samples) - 1)},
        attrs={
            "morphology": "aerobat_guard",
            "morphology_changes": '{"wing": {"offset_x": -0.06}}',
            "gravity": GRAVITY,
        },
    )
    return FlightLog(measured)
