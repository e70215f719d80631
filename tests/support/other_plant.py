"""Another simulator of the guarded robot, which shares no code with the package: calibration must be right about it."""

# Rigid bodies by momentum about the world's origin: no mass matrix, no Coriolis term, no Pinocchio; air: Dickinson et
# al. (Science 284, 1999) behind a lag of one chord, 0.8 of a plate's added mass; outer wings twist, the left one is
# 10 % softer; the crank ripples by 4 %. Masses, joints, planform and the crank's Fourier series are the robot's.

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import xarray as xr
from scipy.spatial.transform import Rotation

from aerobat_pin.aerobat import FlightLog

GRAVITY, DENSITY, DT = 9.81, 1.225, 1e-3
OFFSET = -0.060  # [m] x of the wing, as in the scenario `paper`
# Angle over the crank: mean, cosines 1 to 8, then sines 1 to 8 [rad].
SHOULDER = (
    (-0.40329, -0.68963, -0.010818, 0.001807, 0.003429, 0.005442, 0.001047, 0.000998, 0.000121),
    (-0.63402, -0.061841, -0.049728, -0.005395, -0.003391, -4.4e-05, 0.000494, 0.000177),
)
ELBOW = (
    (-0.653002, 1.320401, 0.100766, 0.029078, 0.00382, -0.011186, -9.9e-05, -0.000654, -0.000749),
    (-0.166266, -0.020473, 0.109013, 0.009581, 0.002818, 0.002107, -0.000747, 0.000115),
)
RIPPLE = 0.04 / 2.0  # [rad] of the crank: 4 % of its rate, twice a turn
ADDED = 0.8
STIFFNESS, SOFTER = 1.3, 0.9  # [N per rad] of the outer wing's twist by its lift; the left wing's share of it
TWIST_LAG, SPAN = 0.008, 0.132  # [s], [m] of the outer wing

NONE = np.zeros(3)
LEVI = np.zeros((3, 3, 3))  # (LEVI . d) w = w x d
for _i, _j, _k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
    LEVI[_i, _j, _k], LEVI[_i, _k, _j] = 1.0, -1.0
NEXT, LAST = [1, 2, 0], [2, 0, 1]

BODY = (0.0813, np.zeros(3), np.diag([1.905e-3, 6.872e-4, 2.261e-3]))


def _symmetric(xx: float, yy: float, zz: float, xy: float, xz: float, yz: float) -> np.ndarray:
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


INNER = (
    1.70505e-3,
    np.array([-0.020706, 0.02476, 0.001642]),
    _symmetric(3.2715e-7, 3.6326e-6, 3.9489e-6, 6.792e-8, -2.633e-8, 3.07e-9),
)
OUTER = (
    3.71107e-3,
    np.array([0.003797, 0.052524, -0.004401]),
    _symmetric(4.1145e-6, 8.64045e-6, 1.27045e-5, -2.84805e-6, 1.053e-8, 3.99e-8),
)
SHOULDER_AT, ELBOW_AT = np.array([OFFSET, 0.0206732, 0.0075244]), np.array([0.0, 0.0484471, 0.0057956])


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return a x b of vectors in the last axis, a few times faster than numpy's own."""
    return a[..., NEXT] * b[..., LAST] - a[..., LAST] * b[..., NEXT]


def series_at(table: tuple[tuple[float, ...], tuple[float, ...]], angle: float) -> tuple[float, float]:
    """Return a joint's angle and its derivative with respect to the crank's angle."""
    k = np.arange(1, 9)
    cosine, sine = np.cos(k * angle), np.sin(k * angle)
    a, b = np.array(table[0][1:]), np.array(table[1])
    return table[0][0] + a @ cosine + b @ sine, k @ (b * cosine - a * sine)


def _strips() -> dict[str, np.ndarray]:
    """Return the strips of both wings: body 1 to 4 (left inner, left outer, right inner, right outer), place, size."""
    rows = []
    for side, first in ((1.0, 1), (-1.0, 3)):
        length = np.hypot(*ELBOW_AT[1:])
        for s in (np.arange(4) + 0.5) / 4.0:
            lead, trail = np.interp(s, [0, 1], [0.0635, 0.0765]), np.interp(s, [0, 1], [-0.0956, -0.111])
            at = ELBOW_AT * s
            rows.append([first, 0.5 * (lead + trail), side * at[1], at[2], lead - trail, length / 4.0, 0.0])
        for s in SPAN * (np.arange(7) + 0.5) / 7.0:
            lead = np.interp(s, [0.0, 0.0085, 0.084, 0.132], [0.0765, 0.0807, 0.118, 0.101])
            trail = np.interp(s, [0.0, 0.0085, 0.084, 0.132], [-0.111, -0.115, 0.01705, 0.101])
            chord = max(lead - trail, 0.02)
            rows.append([first + 1, 0.5 * (lead + trail), side * s, 0.0, chord, SPAN / 7.0, s / SPAN])
    body, x, y, z, chord, width, share = np.array(rows).T
    mass = ADDED * np.pi / 4.0 * DENSITY * chord**2 * width
    place = np.column_stack([x, y, z])
    return {"body": body.astype(int), "place": place, "chord": chord, "width": width, "share": share, "mass": mass}


STRIPS = _strips()
COUNT = len(STRIPS["chord"])
LEFT = STRIPS["body"] <= 2
OUTER_STRIPS = STRIPS["share"] > 0.0
SUBTREES = ((1, 2), (2,), (3, 4), (4,))  # bodies that each joint moves
ON_BODIES = (np.arange(5)[:, None] == STRIPS["body"]).astype(float)  # sums strips over their bodies
AXES = np.array([[1.0, 0, 0], [1.0, 0, 0], [-1.0, 0, 0], [-1.0, 0, 0]])


@dataclass
class State:
    """Place and attitude of the body, momenta about the world's origin, lift coefficients, twists of both wings."""

    x: np.ndarray
    R: np.ndarray
    P: np.ndarray
    H: np.ndarray
    lift: np.ndarray
    twist: np.ndarray


class Geometry:
    """Everything that follows from place, attitude, crank and twist, in world axes."""

    def __init__(self, state: State, crank: float, rate: float, air: float) -> None:
        """Place bodies, joints and strips; `air` is the share of the air's density, 0 for a vacuum."""
        self.density, self.carried = air * DENSITY, air * STRIPS["mass"]
        (s, ds), (e, de) = (series_at(table, crank) for table in (SHOULDER, ELBOW))
        self.angles, self.rates = np.array([s, e, s, e]), rate * np.array([ds, de, ds, de])
        R, origin, spin, moving = [state.R], [state.x], [np.zeros(3)], [np.zeros(3)]
        self.axis, self.pin = [], []
        mass, com, inertia = [BODY[0]], [BODY[1]], [BODY[2]]
        for side, (first, second) in ((1.0, (0, 1)), (-1.0, (2, 3))):
            mirror = np.array([1.0, side, 1.0])
            flip = np.diag(mirror)
            about_x = Rotation.from_rotvec(side * np.outer([s, e], [1.0, 0.0, 0.0])).as_matrix()
            Ri, p = state.R @ about_x[0], state.x + state.R @ (SHOULDER_AT * mirror)
            axis = state.R @ AXES[first]
            wi = axis * self.rates[first]
            Ro, q = Ri @ about_x[1], p + Ri @ (ELBOW_AT * mirror)
            wo, vo = wi + axis * self.rates[second], cross(wi, q - p)
            R, origin = [*R, Ri, Ro], [*origin, p, q]
            spin, moving = [*spin, wi, wo], [*moving, np.zeros(3), vo]
            self.axis += [axis, axis]
            self.pin += [p, q]
            for m, c, inner in (INNER, OUTER):
                mass, com, inertia = [*mass, m], [*com, c * mirror], [*inertia, flip @ inner @ flip]
        self.R, self.origin, self.spin, moving_at = np.array(R), np.array(origin), np.array(spin), np.array(moving)
        self.mass, arm = np.array(mass), np.einsum("bij,bj->bi", self.R, np.array(com))
        self.com = self.origin + arm
        self.moving = moving_at + cross(self.spin, arm)  # velocity of the centres of mass by the joints alone
        self.inertia = np.einsum("bij,bjk,blk->bil", self.R, np.array(inertia), self.R)
        b = STRIPS["body"]
        place = np.einsum("sij,sj->si", self.R[b], STRIPS["place"])
        self.place = self.origin[b] + place
        self.place_moving = moving_at[b] + cross(self.spin[b], place)
        turn = STRIPS["share"] * np.where(LEFT, state.twist[0], state.twist[1])  # nose up
        self.forward = np.einsum("sij,sj->si", self.R[b], _nose(turn, 0))
        self.normal = np.einsum("sij,sj->si", self.R[b], _nose(turn, 1))

    def momenta(self, v: np.ndarray, w: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return linear momentum and that about the world's origin of each body (5, 3), with the air it carries."""
        velocity = v + cross(w, self.com - x) + self.moving
        P = self.mass[:, None] * velocity
        H = cross(self.com, P) + np.einsum("bij,bj->bi", self.inertia, w + self.spin)
        across = self.carried * np.sum(self.normal * self.air_velocity(v, w, x), axis=1)
        air = across[:, None] * self.normal
        return P + ON_BODIES @ air, H + ON_BODIES @ cross(self.place, air)

    def air_velocity(self, v: np.ndarray, w: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Return the velocity of the strips' mid-chord points (N, 3)."""
        return v + cross(w, self.place - x) + self.place_moving

    def twist_of_body(self, state: State) -> tuple[np.ndarray, np.ndarray]:
        """Return velocity and angular velocity of the body that give the state's momenta."""
        still = np.concatenate([np.sum(part, axis=0) for part in self.momenta(NONE, NONE, state.x)])
        d, m, n = self.com - state.x, self.mass, self.normal
        skew = np.einsum("ijk,bk->bij", LEVI, m[:, None] * d)  # m d x, with the sign of -(d x w) = w x d
        first = np.concatenate([n, cross(self.place, n)], axis=1)
        second = np.concatenate([n, cross(self.place - state.x, n)], axis=1)
        A = np.einsum("si,s,sj->ij", first, self.carried, second)
        A[:3, :3] += np.sum(m) * np.eye(3)
        A[:3, 3:] += np.sum(skew, axis=0)
        at = -np.einsum("ijk,bk->bij", LEVI, self.com)
        A[3:, :3] += np.einsum("bij,b->ij", at, m)
        A[3:, 3:] += np.einsum("bij,bjk->ik", at, skew) + np.sum(self.inertia, axis=0)
        found = np.linalg.solve(A, np.concatenate([state.P, state.H]) - still)
        return found[:3], found[3:]


def _nose(turn: np.ndarray, which: int) -> np.ndarray:
    """Return the chord's forward direction (0) or normal (1) of strips that are turned nose up by an angle (N,)."""
    zero = np.zeros_like(turn)
    rows = ([np.cos(turn), zero, np.sin(turn)], [-np.sin(turn), zero, np.cos(turn)])
    return np.column_stack(rows[which])


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
    R = Rotation.from_rotvec(w * dt).as_matrix() @ state.R
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


def fly_elsewhere(
    duration: float, push=None, *, speed=3.0, frequency=4.75, settle=0.5, air=1.0, side=False
) -> tuple[FlightLog, np.ndarray]:
    """Fly at a speed [m/s], frequency [Hz] after `settle` [s]; return exact sensors, mean force (m, 3) of steps."""
    # `push`: time -> force [N] on the left outer wing, world axes; `air`: share of its density; `side`: speed opposed.
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
            q = np.concatenate([state.x, Rotation.from_matrix(state.R).as_quat(canonical=True), g.angles])
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
