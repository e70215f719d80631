"""A lifting line flown through a prescribed motion: two rigid half wings hinged at the root, in still air.

Each half has its own axes: x forward, y to the left, z along its normal. Strips with y >= 0 belong to the left half.
Let (v, omega) be the twist of a half at the root, and x the place of a section's 3/4 chord. The section moves forward
at u, and the air meets its 3/4 chord from below at w:

    u = v_x - omega_z y        w = -(v_z + omega_x y - omega_y x)        U = hypot(u, w)

U carries the wake away, and w is the input of the lifting line. The force along the normal is a0 rho b |u| w_eff at the
1/4 chord, and the suction points toward the leading edge. In steady flow this is potential flow past a flat plate at
any incidence: the circulation is a0 b w, the force across the plate rho u times the circulation, and the force along
the plate rho w times the circulation. The force of the added mass acts at mid-chord and opposes the normal acceleration
there; the added moment of inertia of a section, pi rho b^4 / 8, is left out.

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


class Halves(NamedTuple):
    """Motion of the left and the right half wing, in this order; the flight's axes are x forward, y left, z up.

    `rotation` (2, 3, 3) rotates vectors from the axes of each half to the flight's axes. `twist` (2, 6) is the twist of
    each half at the root, in the axes of that half, linear part first [m/s, rad/s]. `twist_rate` (2, 6) is the time
    derivative of these components.
    """

    rotation: Array
    twist: Array
    twist_rate: Array


@guarded()
@dataclass(frozen=True)
class Stroke:
    """A wing in level flight that plunges and flaps: height and root angle vary as sin(2 pi frequency t).

    Args:
        airspeed: forward speed [m/s].
        incidence: incidence of the wing without plunging and flapping, nose up [rad].
        frequency: frequency of plunging and flapping [Hz].
        plunge: amplitude of the height [m].
        flap: amplitude of the angle of each half at the root, tips up [rad].
    """

    airspeed: float
    incidence: float = 0.0
    frequency: float = 0.0
    plunge: float = 0.0
    flap: float = 0.0

    @guarded()
    def __call__(self, time: float) -> Halves:
        """Return the motion at a time [s]."""
        omega = 2.0 * np.pi * self.frequency
        position, speed = np.sin(omega * time), omega * np.cos(omega * time)
        acceleration = -(omega**2) * position
        velocity = np.array([self.airspeed, 0.0, self.plunge * speed])
        climb = np.array([0.0, 0.0, self.plunge * acceleration])
        cosine, sine = np.cos(self.incidence), np.sin(self.incidence)
        tilt = np.array([[cosine, 0.0, -sine], [0.0, 1.0, 0.0], [sine, 0.0, cosine]])
        rotation, twist, rate = np.empty((2, 3, 3)), np.zeros((2, 6)), np.zeros((2, 6))
        for i, side in enumerate((1.0, -1.0)):
            cosine, sine = np.cos(self.flap * position), side * np.sin(self.flap * position)
            rotation[i] = tilt @ np.array([[1.0, 0.0, 0.0], [0.0, cosine, -sine], [0.0, sine, cosine]])
            twist[i, :3], twist[i, 3] = rotation[i].T @ velocity, side * self.flap * speed
            rate[i, :3] = rotation[i].T @ climb - np.cross(twist[i, 3:], twist[i, :3])
            rate[i, 3] = side * self.flap * acceleration
        return Halves(rotation, twist, rate)


@dataclass(frozen=True)
class LineFlight:
    """Aerodynamic loads along a motion, at each time (T,) [s].

    `force` (T, 3) [N] is the total force in the flight's axes. `wrench` (T, 2, 6) [N, N m] acts on the left and the
    right half, at the root and in the axes of that half, force first. `power` (T,) [W] is the power of the aerodynamic
    forces on the wing. `incidence` (T, N) [rad] is the incidence of the strips at the 3/4 chord, without downwash.
    `circulation` (T, N) [m2/s] is the bound circulation of the strips.
    """

    time: Array
    force: Array
    wrench: Array
    power: Array
    incidence: Array
    circulation: Array


@guarded(time="any", added_mass="not negative")
def fly(
    line: LiftingLine,
    motion: Callable[[float], Halves],
    time: ArrayLike,
    *,
    added_mass: float = 1.0,
) -> LineFlight:
    """Compute the loads on a lifting line along a motion.

    The air is at rest at the first time, so a steady or periodic flow develops only after a while.

    Args:
        line: the wing.
        motion: function from a time [s] to the motion of both halves; a `Stroke`, or any function like it.
        time: times (T,) at which loads are returned [s], rising.
        added_mass: factor on the line's added mass pi rho b^2; 0 leaves it out.

    Raises:
        ShapeError: the time does not rise, a motion is not finite or has the wrong shape, or the factor is negative.
    """
    from scipy.integrate import solve_ivp  # takes as long to import as everything else together

    instants = np.asarray(time, float)
    if instants.ndim != 1 or len(instants) < 2 or not (np.all(np.isfinite(instants)) and np.all(np.diff(instants) > 0)):
        raise ShapeError("time: at least two finite, rising instants in seconds were expected")
    if not (np.isfinite(added_mass) and added_mass >= 0.0):
        raise ShapeError(f"added_mass = {added_mass}: a factor, not negative, was expected; 0 leaves it out")
    half = np.where(line.y > -1e-9 * line.span, 0, 1)

    def section(now: Halves) -> tuple[Array, Array]:
        vx, _, vz, wx, wy, wz = now.twist[half].T
        return vx - wz * line.y, -(vz + wx * line.y - wy * line.three_quarter_chord)

    def rates(t: float, state: Array) -> Array:
        u, w = section(_checked(motion(t), t))
        speed = np.hypot(u, w)
        return line.rates(state, speed, *line.effective_velocity(state, speed, w))

    states = solve_ivp(
        rates, (instants[0], instants[-1]), np.zeros(3 * line.strips), t_eval=instants, rtol=1e-8, atol=1e-10
    ).y.T
    count = len(instants)
    force, wrench, power = np.zeros((count, 3)), np.zeros((count, 2, 6)), np.zeros(count)
    incidence = np.zeros((count, line.strips))
    for k, (t, state) in enumerate(zip(instants, states, strict=True)):
        now = _checked(motion(t), t)
        u, w = section(now)
        incidence[k] = np.arctan2(w, u)
        w_eff, _ = line.effective_velocity(state, np.hypot(u, w), w)
        _, _, az, bx, by, _ = now.twist_rate[half].T
        reaction = -added_mass * line.added_mass * (az + bx * line.y - by * line.mid_chord)
        fx, lift = np.sign(u) * line.suction(w_eff), line.lift(np.abs(u), w_eff)
        pitching = -(line.quarter_chord * lift + line.mid_chord * reaction)
        fz, zero = lift + reaction, np.zeros(line.strips)
        loads = line.width * np.array([fx, zero, fz, line.y * fz, pitching, -line.y * fx])
        for i in range(2):
            wrench[k, i] = loads[:, half == i].sum(axis=1)
        force[k] = np.einsum("hij,hj->i", now.rotation, wrench[k, :, :3])
        power[k] = np.sum(wrench[k] * now.twist)
    return LineFlight(instants, force, wrench, power, incidence, states[:, 2 * line.strips :])


def _checked(now: Halves, time: float) -> Halves:
    """Return a motion after checking its shapes, and that its numbers are finite."""
    found = Halves(
        *(
            shaped(part, (2, *size), f"motion at {time:g} s: {name}")
            for part, name, size in zip(now, Halves._fields, ((3, 3), (6,), (6,)), strict=True)
        )
    )
    if not all(np.all(np.isfinite(part)) for part in found):
        raise ShapeError(f"motion at {time:g} s holds NaN or infinity")
    return found
