"""Aerodynamics of Aerobat: strips fixed to the links, a quasi-steady tail and fin, the body's drag, and added mass.

All forces depend on the links' twists relative to the air: the twist of each link minus the wind, in the link's axes.
`strip_forces` and `quasi_steady` are the two models of the wing; the first file also models body, tail and fin. A strip
that lies across a joint is divided into pieces, each on one link.

Added mass: each piece of a strip accelerates a mass m of air (`LiftingLine.added_mass`, times a factor) along its
normal and at mid-chord, and resists turning about mid-chord with the moment of inertia m b^2 / 8. All pieces on a link
have the link's z axis as normal. So one constant matrix (3, 3) describes the added mass of a link, multiplying the
link's (v_z, omega_x, omega_y):

    G = sum m ([1, y, -x]^T [1, y, -x] + diag(0, 0, b^2 / 8))

and (v_z, omega_x, omega_y) G (v_z, omega_x, omega_y)^T / 2 is its kinetic energy.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from aerobat_description.morphology import Morphology
from aerobat_pin.aerobat.wing import LINKS, Wing
from aerobat_pin.aerodynamics import (
    AirConstants,
    LiftingLine,
    Pieces,
    Strips,
    Surfaces,
    add_surfaces,
    quasi_steady_loads,
    strip_loads,
    strip_rows,
)
from aerobat_pin.numerics import Array, fields_of, fill, guarded, inner, new_state

SMALLEST_SHARE = 1e-6  # a smaller share of a strip is a joint that lies on the strip's edge, up to rounding
Model = Literal["lifting_line", "quasi_steady"]
NO_SURFACES = Surfaces(0.0, 0.0, np.zeros(3), 1.0, 0.0, 0.0, np.zeros(3), 0.0)


def divide(wing: Wing, line: LiftingLine, added_mass: Array) -> Pieces:
    """Divide the strips of a lifting line along the links.

    A strip reaches to midway between its station and the next one, in the angle of the cosine, and to the tip. A piece
    lies at its strip's station, or, if the strip is divided, in the middle of its own part.

    Args:
        wing: planform along the links.
        line: lifting line on that planform.
        added_mass: added mass of each strip (N,) [kg].
    """
    shoulder, elbow, _ = wing.breaks
    joints = np.array([elbow, shoulder, -shoulder, -elbow])
    midway = 0.5 * line.span * np.cos((np.arange(1, line.strips) + 0.5) * np.pi / (line.strips + 1))
    edges = np.concatenate([[0.5 * line.span], midway, [-0.5 * line.span]])
    cuts = np.sort(np.concatenate([edges, joints[np.abs(joints) < 0.5 * line.span]]))[::-1]
    middle = 0.5 * (cuts[:-1] + cuts[1:])
    strip = np.clip(np.searchsorted(-edges, -middle) - 1, 0, line.strips - 1)
    share = -np.diff(cuts) / -np.diff(edges)[strip]
    strip, middle, share = (part[share > SMALLEST_SHARE] for part in (strip, middle, share))
    share /= np.bincount(strip, share)[strip]
    y = np.where(np.bincount(strip)[strip] == 1, line.y[strip], middle)
    link, point = wing.attach(y)
    point[:, 0] += wing.leading_edge(y) - 0.5 * wing.chord(y)
    x, y, z = point.T
    return Pieces(strip, link, x, y, z, share, 0.5 * share * (added_mass * line.semichord)[strip])


@inner
def air_loads(air: AirConstants, twists: Array, state: Array, wrenches: Array, rates: Array, loads: Array) -> None:
    """Compute the wrenches on the links and the rates of the aerodynamic state, with the arguments of `strip_loads`.

    `state` and `rates` are empty in the quasi-steady model; `loads` (9, N) is written, see `StripLoads`.
    """
    rows = strip_rows(loads)
    if air.quasi_steady[()] > 0.0:
        downwash = quasi_steady_loads(air, twists, wrenches, rows)
    else:
        downwash = strip_loads(air, twists, state, wrenches, rates, rows)
    add_surfaces(air.surfaces, air.density[()], twists[0], downwash, wrenches[0])


class RobotAir:
    """Aerodynamics of the robot: a pure function of the links' twists relative to the air and the aerodynamic state.

    Args:
        wing: the planform along the links.
        strips: number of strips over the full span.
        air_density: density of the air [kg/m3].
        model: `lifting_line` (unsteady, 3N states) or `quasi_steady` (no states).
        lift_limit: largest lift coefficient of a strip in the lifting line; None for attached flow without limit.
        added_mass: factor on the line's added mass; 1 is theory, 0 leaves it out.

    Attributes:
        line: the lifting line of the planform.
        pieces: the strips' pieces on the links.
        added_mass: G of each link (5, 3, 3) [kg, kg m, kg m2].

    Raises:
        ArgumentError: the model is unknown.
        ShapeError: the number of strips, the density or the lift limit is not positive, or the factor is negative.
    """

    @guarded(air_density="positive", lift_limit="positive", added_mass="not negative")
    def __init__(
        self,
        wing: Wing,
        *,
        strips: int = 16,
        air_density: float = 1.225,
        model: Model = "lifting_line",
        lift_limit: float | None = None,
        added_mass: float = 1.0,
    ) -> None:
        shape = wing.morphology
        self.model: Model = model
        self.lift_limit = lift_limit
        self.line = line = LiftingLine(wing.span, wing.chord, strips=strips, air_density=air_density)
        mass = added_mass * line.added_mass * line.width
        self.pieces = pieces = divide(wing, line, mass)
        rows = np.column_stack([np.ones(len(pieces.share)), pieces.y, -pieces.x])
        G = rows[:, :, None] * rows[:, None]
        G[:, 2, 2] += line.semichord[pieces.strip] ** 2 / 8.0
        self.added_mass = np.zeros((len(LINKS), 3, 3))
        np.add.at(self.added_mass, pieces.link, (pieces.share * mass[pieces.strip])[:, None, None] * G)
        self.memory = air_memory(
            line,
            pieces,
            quasi_steady=float(model == "quasi_steady"),
            profile_drag=shape.aerodynamics.profile_drag,
            slope_over_limit=0.0 if lift_limit is None else line.lift_slope / lift_limit,
            surfaces=_surfaces(shape, line.lift_slope),
            tail_span=0.0 if shape.tail is None else shape.tail.span,
        )

    def __repr__(self) -> str:
        return f"RobotAir({self.model}, {self.line!r}, {self.state_size} states, lift limit {self.lift_limit})"

    @property
    def state_size(self) -> int:
        """Number of aerodynamic states: 3N, or none in the quasi-steady model."""
        return 3 * self.line.strips if self.model == "lifting_line" else 0

    @guarded(twists=("n", len(LINKS), 6))
    def airspeed(self, twists: Array) -> Array:
        """Return each strip's airspeed in its plane (n, N) [m/s], given link twists relative to the air (n, 5, 6)."""
        pieces = self.pieces
        linear, angular = np.split(twists[:, pieces.link], 2, axis=2)
        velocity = linear + np.cross(angular, np.column_stack([pieces.x, pieces.y, pieces.z]))
        to_strips = np.zeros((self.line.strips, len(pieces.strip)))
        to_strips[pieces.strip, np.arange(len(pieces.strip))] = pieces.share
        return np.asarray(np.hypot(velocity[..., 0] @ to_strips.T, velocity[..., 2] @ to_strips.T))


def air_memory(
    line: LiftingLine,
    pieces: Pieces,
    *,
    quasi_steady: float = 0.0,
    profile_drag: float = 0.0,
    slope_over_limit: float = 0.0,
    surfaces: Surfaces = NO_SURFACES,
    tail_span: float = 0.0,
) -> Array:
    """Return a new memory with the aerodynamic constants of a lifting line whose strips are fixed to links.

    Args:
        line: the lifting line.
        pieces: the strips' pieces on the links.
        quasi_steady: 1 for the quasi-steady model, 0 for the lifting line.
        profile_drag: coefficient of profile drag.
        slope_over_limit: lift slope divided by the largest lift coefficient [1/rad]; 0 for no limit.
        surfaces: aerodynamic constants of body, tail and fin; when omitted, these have no forces.
        tail_span: span over which the downwash at the tail is averaged [m]; 0 for no downwash there.
    """
    memory = new_state(AirConstants, n=line.strips, p=len(pieces.strip))
    force_factor = 0.5 * line.air_density * line.chord * line.width
    values = AirConstants(
        quasi_steady,
        line.air_density,
        line.lift_slope,
        profile_drag,
        slope_over_limit,
        Strips(0.25 * line.chord, 1.0 / line.semichord, force_factor),
        pieces,
        line.downwash,
        np.zeros(line.strips) if tail_span == 0.0 else line.mean_downwash(tail_span),
        surfaces,
    )
    fill(fields_of(memory, AirConstants), values)
    return memory


def _surfaces(shape: Morphology, lift_slope: float) -> Surfaces:
    """Return the aerodynamic constants of a morphology's body, tail and fin; a missing tail or fin has no force."""
    tail, drag, fin = shape.tail, shape.aerodynamics, shape.fin
    surfaces = NO_SURFACES._replace(drag_area=drag.body_drag_area, downwash_factor=drag.tail_downwash_factor)
    if tail is not None:
        surfaces = surfaces._replace(
            tail=np.array(tail.position),
            tail_cosine=np.cos(tail.incidence),
            tail_sine=np.sin(tail.incidence),
            tail_lift=0.5 * tail.span * tail.chord * lift_slope / (1 + 2 * tail.chord / tail.span),
        )
    if fin is not None:
        surfaces = surfaces._replace(fin=np.array(fin.position), fin_lift=0.5 * fin.area * fin.lift_slope)
    return surfaces
