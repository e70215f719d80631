"""The air on Aerobat: a lifting line whose strips ride on the links, a quasi-steady tail, and the body's drag.

A strip lives in its link's frame: chord along x, normal along z. It sees the velocity of its own 3/4-chord point
against still air, u forward and w upward relative to the section, U = hypot(u, w), w_n = w |u| / U; spanwise flow is
ignored. At its 1/4-chord point act, per span, the lift along +z, the suction toward the leading edge, and the profile
drag rho/2 c cd0 U (-u, w). The tail is a flat plate, rho/2 S a |u| w with a = 2 pi / (1 + 2 / aspect ratio), in the
wing's centre-line downwash times a factor; the body a drag area at its centre of mass.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aerobat_pin.aerodynamics.lifting_line import LiftingLine
from aerobat_pin.arrays import Array
from aerobat_pin.wing import LINKS, Wing


@dataclass(frozen=True)
class StripLoads:
    """What each strip does, all (N,).

    Incidence [rad], effective velocity w_eff [m/s], circulation [m2/s], and the force [N] along the link's x (suction
    less drag) and z (lift plus drag).
    """

    incidence: Array
    effective_velocity: Array
    circulation: Array
    force_x: Array
    force_z: Array


class RobotAir:
    """Unsteady aerodynamics of the robot, a pure function of link twists and aerodynamic state.

    Args:
        wing: the planform along the links.
        strips: number of strips over the full span.
        air_density: [kg/m3].
    """

    def __init__(self, wing: Wing, *, strips: int = 16, air_density: float = 1.225) -> None:
        """Place the strips on the links."""
        shape = wing.morphology
        self.line = LiftingLine(wing.span, wing.chord, strips=strips, air_density=air_density)
        self.link, origin = wing.attach(self.line.y)
        x = wing.leading_edge(self.line.y)
        quarter, three_quarter = (origin.copy() for _ in range(2))
        quarter[:, 0] += x - 0.25 * self.line.chord
        three_quarter[:, 0] += x - 0.75 * self.line.chord
        self.quarter_chord, self.three_quarter_chord = quarter, three_quarter  # (N, 3) [m] in the links' frames
        self._sum_by_link = (self.link == np.arange(len(LINKS))[:, None]).astype(float)
        self.profile_drag = shape.aerodynamics.profile_drag
        self.body_drag_area = shape.aerodynamics.body_drag_area
        self.tail = shape.tail
        self.tail_downwash_factor = shape.aerodynamics.tail_downwash_factor

    @property
    def state_size(self) -> int:
        """Number of aerodynamic states."""
        return 3 * self.line.strips

    def evaluate(self, twists: Array, state: Array) -> tuple[Array, Array, StripLoads]:
        """Compute loads and state rates.

        Args:
            twists: (5, 6) twist of each link of `LINKS` at and in its own frame, linear first [m/s, rad/s].
            state: (3N,) aerodynamic state.

        Returns:
            Wrenches (5, 6) on the links at and in their own frames, force first [N, N m]; state rates (3N,); strips.
        """
        line, points = self.line, self.three_quarter_chord
        linear, angular = twists[self.link, :3], twists[self.link, 3:]
        u = linear[:, 0] + angular[:, 1] * points[:, 2] - angular[:, 2] * points[:, 1]
        w = -(linear[:, 2] + angular[:, 0] * points[:, 1] - angular[:, 1] * points[:, 0])
        speed = np.hypot(u, w)
        still = speed == 0.0
        normal_velocity = w * np.abs(u) / np.where(still, 1.0, speed)
        w_eff, w_total = line.effective_velocity(state, speed, normal_velocity)
        rates = line.rates(state, speed, w_eff, w_total)

        drag = 0.5 * line.air_density * line.chord * self.profile_drag * speed
        force_x = line.width * (np.sign(u) * line.suction(w_eff) - drag * u)
        force_z = line.width * (line.lift(speed, w_eff) + drag * w)
        arm = self.quarter_chord
        strip_wrenches = np.column_stack(
            [
                force_x,
                np.zeros_like(force_x),
                force_z,
                arm[:, 1] * force_z,
                arm[:, 2] * force_x - arm[:, 0] * force_z,
                -arm[:, 1] * force_x,
            ]
        )
        wrenches = self._sum_by_link @ strip_wrenches
        wrenches[0] += self._body_and_tail(twists[0], float(line.centre_downwash @ line.split(state)[2]))
        return wrenches, rates, StripLoads(np.arctan2(w, u), w_eff, line.split(state)[2].copy(), force_x, force_z)

    def _body_and_tail(self, twist: Array, centre_downwash: float) -> Array:
        """Return the wrench (6,) on the base, at its origin and in its axes."""
        density = self.line.air_density
        wrench = np.zeros(6)
        velocity = twist[:3]
        wrench[:3] = -0.5 * density * self.body_drag_area * np.sqrt(velocity @ velocity) * velocity
        if self.tail is None:
            return wrench
        tail, (x, y, z) = self.tail, self.tail.position
        u = velocity[0] + twist[4] * z - twist[5] * y
        w = -(velocity[2] + twist[3] * y - twist[4] * x) - self.tail_downwash_factor * centre_downwash
        nose = np.array([np.cos(tail.incidence), np.sin(tail.incidence)])
        along, across = u * nose[0] - w * nose[1], u * nose[1] + w * nose[0]
        slope = 2.0 * np.pi / (1.0 + 2.0 * tail.chord / tail.span)
        force = 0.5 * density * tail.span * tail.chord * slope * abs(along) * across
        fx, fz = -force * nose[1], force * nose[0]
        wrench += np.array([fx, 0.0, fz, y * fz, z * fx - x * fz, -y * fx])
        return wrench
