"""A lifting line flown through a prescribed motion: two rigid half wings hinged at the root, in still air.

Each half has its own axes: x forward, y to the left, z along its normal. Strips with y >= 0 belong to the left half.
Let (v, omega) be the twist of a half at the origin of its axes, and x the place of a section's 3/4 chord. The section
moves forward at u, and the air meets its 3/4 chord from below at w:

    u = v_x - omega_z y        w = -(v_z + omega_x y - omega_y x)        U = hypot(u, w)        q = -omega_y

U carries the wake away, and w is the input of the lifting line. The force along the normal is a0 rho b |u| w_eff at the
1/4 chord, and the suction points toward the leading edge. In steady flow this is potential flow past a flat plate at
any incidence: the circulation is a0 b w, the force across the plate rho u times the circulation, and the force along
the plate rho w times the circulation. With the added mass m of a section, the air that it accelerates has the force -m
times the normal acceleration at mid-chord, and the nose-up couples -m b^2/8 q' and -m b/2 |u| q (Theodorsen, NACA TR
496, 1935: the pitch-rate force acts at the 3/4 chord).

The robot's strips (`strip_forces`) use w |u| / U as input instead, and their suction falls as the incidence grows. They
agree with this model up to incidence^2 and give the same normal force on a steady plate at any incidence, but less
thrust.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from aerobat_pin.aerodynamics.lifting_line import LiftingLine
from aerobat_pin.errors import ShapeError
from aerobat_pin.numerics import Array, guarded, shaped

NEAR = 1e-4  # [s] largest step of these differences, even between distant instants: at 50 Hz they are exact to 3e-8


class Halves(NamedTuple):
    """Motion of the left and the right half wing, in this order; the flight's axes are x forward, y left, z up.

    `rotation` (2, 3, 3) rotates vectors from the axes of each half to the flight's axes. `twist` (2, 6) is the twist of
    each half at the origin and in the axes of that half, linear part first [m/s, rad/s]. `origin` (2, 3) is the origin
    of each half's axes, measured from the root in the flight's axes [m]; only moments depend on it.
    """

    rotation: Array
    twist: Array
    origin: Array = np.zeros((2, 3))


@guarded()
@dataclass(frozen=True)
class Stroke:
    """A wing in level flight that plunges, flaps and pitches: each as amplitude sin(2 pi frequency t + phase).

    Args:
        airspeed: forward speed [m/s].
        incidence: incidence of the wing at rest, nose up [rad].
        frequency: frequency of all three motions [Hz].
        plunge: amplitude of the height, upward [m]; its phase is 0.
        flap: amplitude of the angle of each half at the root, tips up [rad].
        pitch: amplitude of the angle of each half about a spanwise axis, nose up [rad].
        pitch_axis: x of this axis in the half's axes [m].
        flap_phase, pitch_phase: phases [rad].
    """

    airspeed: float
    incidence: float = 0.0
    frequency: float = 0.0
    plunge: float = 0.0
    flap: float = 0.0
    pitch: float = 0.0
    pitch_axis: float = 0.0
    flap_phase: float = 0.0
    pitch_phase: float = 0.0

    @guarded()
    def __call__(self, time: float) -> Halves:
        """Return the motion at a time [s]."""
        omega = 2.0 * np.pi * self.frequency
        flap, flap_rate = self.flap * _oscillation(omega, time, self.flap_phase)
        pitch, pitch_rate = self.pitch * _oscillation(omega, time, self.pitch_phase)
        velocity = np.array([self.airspeed, 0.0, self.plunge * omega * np.cos(omega * time)])
        axis, turn = np.array([self.pitch_axis, 0.0, 0.0]), _nose_up(pitch)
        rotation, twist, origin = np.empty((2, 3, 3)), np.empty((2, 6)), np.empty((2, 3))
        for i, side in enumerate((1.0, -1.0)):
            cosine, sine = np.cos(flap), side * np.sin(flap)
            hinge = _nose_up(self.incidence) @ [[1.0, 0.0, 0.0], [0.0, cosine, -sine], [0.0, sine, cosine]]
            rotation[i] = hinge @ turn
            origin[i] = hinge @ (axis - turn @ axis)
            # A point on the pitch axis moves with the hinge: flapping about x leaves it where it is.
            spin = turn.T @ [side * flap_rate, 0.0, 0.0] - [0.0, pitch_rate, 0.0]
            twist[i] = *(rotation[i].T @ velocity - self.pitch_axis * np.array([0.0, spin[2], -spin[1]])), *spin
        return Halves(rotation, twist, origin)


def _oscillation(omega: float, time: float, phase: float) -> Array:
    """Return a sine and its rate."""
    return np.array([np.sin(omega * time + phase), omega * np.cos(omega * time + phase)])


def _nose_up(angle: float) -> Array:
    """Return the rotation by an angle [rad] that lifts the nose."""
    return np.array([[np.cos(angle), 0.0, -np.sin(angle)], [0.0, 1.0, 0.0], [np.sin(angle), 0.0, np.cos(angle)]])


@dataclass(frozen=True)
class LineFlight:
    """Aerodynamic loads along a motion, at each time (T,) [s].

    `force` (T, 3) [N] is the total force, `moment` (T, 3) [N m] the total moment about `about`, `strip_force` (T, N, 3)
    [N] the force on each strip, all in the flight's axes. `wrench` (T, 2, 6) [N, N m] acts on the left and the right
    half, at the origin and in the axes of that half, force first. `power` (T,) [W] is the power of the aerodynamic
    forces on the wing. `incidence` (T, N) [rad] is the incidence of the strips at the 3/4 chord, without downwash.
    `circulation` (T, N) [m2/s] is the bound circulation of the strips.
    """

    time: Array
    force: Array
    moment: Array
    strip_force: Array
    wrench: Array
    power: Array
    incidence: Array
    circulation: Array


@guarded(time=("2+",), added_mass="not negative", about=(3,))
def fly(
    line: LiftingLine,
    motion: Callable[[float], Halves],
    time: ArrayLike,
    *,
    added_mass: float = 1.0,
    about: ArrayLike = (0.0, 0.0, 0.0),
) -> LineFlight:
    """Compute the loads on a lifting line along a motion.

    The air is at rest at the first time, so a steady or periodic flow develops only after a while. Accelerations are
    differences of the motion's twists, for which the motion is also called shortly (at most 2 `NEAR`) before and after
    each time.

    Args:
        line: the wing.
        motion: function from a time [s] to the motion of both halves; a `Stroke`, or any function like it.
        time: times (T,) at which loads are returned [s], rising.
        added_mass: factor on the line's added mass; 0 leaves it out.
        about: point (3,) for the moment, measured from the root in the flight's axes [m].

    Raises:
        ShapeError: the time does not rise, a motion or the point is not finite or has the wrong shape, or the factor is
            negative.
    """
    from scipy.integrate import solve_ivp  # takes as long to import as everything else together

    instants, point = np.asarray(time, float), np.asarray(about, float)
    if not np.all(np.diff(instants) > 0.0):
        raise ShapeError("time: rising instants in seconds were expected")
    half = np.where(line.y > -1e-9 * line.span, 0, 1)
    near = min(0.1 * float(np.min(np.diff(instants))), NEAR)

    def section(now: Halves) -> tuple[Array, Array, Array]:
        vx, _, vz, wx, wy, wz = now.twist[half].T
        return vx - wz * line.y, -(vz + wx * line.y - wy * line.three_quarter_chord), -wy

    def rates(t: float, state: Array) -> Array:
        u, w, _ = section(_halves(motion, t))
        speed = np.hypot(u, w)
        return line.rates(state, speed, *line.effective_velocity(state, speed, w))

    def twist_rate(t: float) -> Array:
        far, close = (_halves(motion, t + s).twist - _halves(motion, t - s).twist for s in (2 * near, near))
        return np.asarray((8.0 * close - far) / (12.0 * near))

    states = solve_ivp(
        rates, (instants[0], instants[-1]), np.zeros(3 * line.strips), t_eval=instants, rtol=1e-8, atol=1e-10
    ).y.T
    count = len(instants)
    force, moment, wrench, power = np.zeros((count, 3)), np.zeros((count, 3)), np.zeros((count, 2, 6)), np.zeros(count)
    incidence, strip_force = np.zeros((count, line.strips)), np.zeros((count, line.strips, 3))
    mass = added_mass * line.added_mass
    for k, (t, state) in enumerate(zip(instants, states, strict=True)):
        now = _halves(motion, t)
        u, w, q = section(now)
        incidence[k] = np.arctan2(w, u)
        w_eff, _ = line.effective_velocity(state, np.hypot(u, w), w)
        loads = _strip_wrenches(line, mass, u, q, w_eff, twist_rate(t)[half].T)
        strip_force[k] = np.einsum("nij,jn->ni", now.rotation[half], loads[:3])
        for i in range(2):
            wrench[k, i] = loads[:, half == i].sum(axis=1)
            pushed = now.rotation[i] @ wrench[k, i, :3]
            moment[k] += now.rotation[i] @ wrench[k, i, 3:] + np.cross(now.origin[i] - point, pushed)
        force[k] = strip_force[k].sum(axis=0)
        power[k] = np.sum(wrench[k] * now.twist)
    circulation = states[:, 2 * line.strips :]
    return LineFlight(instants, force, moment, strip_force, wrench, power, incidence, circulation)


def _strip_wrenches(line: LiftingLine, mass: Array, u: Array, q: Array, w_eff: Array, rates: Array) -> Array:
    """Return the wrenches (6, N) of the strips on their halves, at the origin and in the axes of these.

    Speed u forward, nose-up rate q and effective velocity (N,) are those of the file's head, the added mass (N,) is per
    span, and `rates` (6, N) are those of the halves' twists.
    """
    _, _, az, bx, by, _ = rates
    reaction = -mass * (az + bx * line.y - by * line.mid_chord)
    fx, lift = np.sign(u) * line.suction(w_eff, q), line.lift(np.abs(u), w_eff)
    couple = -mass * line.semichord * (0.5 * np.abs(u) * q - 0.125 * line.semichord * by)
    pitching = -(line.quarter_chord * lift + line.mid_chord * reaction + couple)
    fz, zero = lift + reaction, np.zeros(line.strips)
    return np.asarray(line.width * np.array([fx, zero, fz, line.y * fz, pitching, -line.y * fx]))


def _halves(motion: Callable[[float], Halves], time: float) -> Halves:
    """Return a motion at a time [s] after checking its shapes, and that its numbers are finite."""
    sizes = {"rotation": (2, 3, 3), "twist": (2, 6), "origin": (2, 3)}
    parts = zip(motion(time), sizes.items(), strict=True)
    halves = Halves(*(shaped(part, size, f"motion at {time:g} s: {name}") for part, (name, size) in parts))
    if not all(np.all(np.isfinite(part)) for part in halves):
        raise ShapeError(f"motion at {time:g} s holds NaN or infinity")
    return halves
