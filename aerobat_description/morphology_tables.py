"""The tables of a morphology file as checked dataclasses.

Units are SI; axes are x forward, y left, z up. Only the left wing is described; the right wing is its mirror image.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

from aerobat_description.reading import AboveZero, NotNegative, check_name, require

Vector = tuple[float, ...]
Pair = tuple[float, float]
Vector3 = tuple[float, float, float]
MEETING = 1e-6  # [m]: largest distance between two ends that count as meeting


@dataclass(frozen=True)
class Body:
    """Mass properties of a link: mass [kg], centre of mass `com` in the link frame [m], and inertia [kg m2].

    The inertia (xx, yy, zz, xy, xz, yz) is taken about the centre of mass, along the axes of the link frame.
    """

    mass: AboveZero
    inertia: tuple[float, float, float, float, float, float]
    com: Vector3 = (0.0, 0.0, 0.0)

    def check(self, where: str) -> None:
        """Raise MorphologyError unless a body with this inertia can exist."""
        # The second-moment matrix tr(I)/2 - I is positive definite exactly when every principal moment is smaller
        # than the sum of the other two; Sylvester's criterion tests it without eigenvalues.
        xx, yy, zz, xy, xz, yz = self.inertia
        a, b, c = (yy + zz - xx) / 2, (xx + zz - yy) / 2, (xx + yy - zz) / 2
        minors = (a, a * b - xy * xy, a * (b * c - yz * yz) - xy * (xy * c + yz * xz) - xz * (xy * yz + b * xz))
        rule = "each principal moment must be smaller than the sum of the other two"
        require(min(minors) > 0.0, f"{where}.inertia", self.inertia, rule)


@dataclass(frozen=True)
class Hull:
    """The visible fuselage, which is centred on the centre of mass along x.

    Attributes:
        length: length along x [m].
        width: largest width [m].
        height: largest height [m].
        drop: z coordinate of the middle line [m].
        boom: radius of the booms to tail and fin [m].
    """

    length: AboveZero
    width: AboveZero
    height: AboveZero
    drop: float
    boom: AboveZero


@dataclass(frozen=True)
class Joints:
    """Limits of shoulder and elbow: angles (lower, upper) [rad], largest torque [N m] and largest rate [rad/s]."""

    shoulder_limits: Pair
    elbow_limits: Pair
    effort: AboveZero
    velocity: AboveZero

    def check(self, where: str) -> None:
        """Raise MorphologyError unless lower limits are below upper limits."""
        for key in ("shoulder_limits", "elbow_limits"):
            limits = getattr(self, key)
            require(limits[0] < limits[1], f"{where}.{key}", limits, "the lower limit comes first")


@dataclass(frozen=True)
class FreeFlyer:
    """Finite bounds of the free base, for tools that sample or plan.

    They apply in both directions of each axis: position [m], velocity [m/s], angular velocity [rad/s].
    """

    position: AboveZero
    velocity: AboveZero
    angular_velocity: AboveZero


@dataclass(frozen=True)
class WingShape:
    """Planform of the left wing.

    Stations are y coordinates, edges are x coordinates at the stations, each in the frame of its panel [m].

    Attributes:
        offset_x: x coordinate of the wing's axes in the body frame [m].
        proximal_stations, proximal_leading_edge, proximal_trailing_edge: outline of the proximal panel.
        distal_stations, distal_leading_edge, distal_trailing_edge: outline of the distal panel.
        minimum_chord: smallest chord that the lifting line uses, for the pointed tip [m].
        force_point: point at which unknown forces act, in the distal frame [m]; the distal COM if None.
    """

    offset_x: float
    proximal_stations: Vector
    proximal_leading_edge: Vector
    proximal_trailing_edge: Vector
    distal_stations: Vector
    distal_leading_edge: Vector
    distal_trailing_edge: Vector
    minimum_chord: AboveZero
    force_point: Vector3 | None = None

    def outline(self, panel: str) -> tuple[Vector, Vector, Vector]:
        """Return stations, leading edge and trailing edge of a panel, `proximal` or `distal` [m]."""
        stations, leading, trailing = (
            getattr(self, f"{panel}_{name}") for name in ("stations", "leading_edge", "trailing_edge")
        )
        return stations, leading, trailing

    def check(self, where: str) -> None:
        """Raise MorphologyError unless the planform is valid.

        Stations increase, the leading edge is ahead of the trailing edge, and the panels meet at the elbow.
        """
        for panel in ("proximal", "distal"):
            stations, leading, trailing = self.outline(panel)
            same = len(stations) == len(leading) == len(trailing) >= 2
            require(same, f"{where}.{panel}_stations", stations, "stations and edges have the same length, two or more")
            rising = stations[0] == 0.0 and all(a < b for a, b in itertools.pairwise(stations))
            require(rising, f"{where}.{panel}_stations", stations, "stations start at 0 and increase")
            ahead = all(le >= te for le, te in zip(leading, trailing, strict=True))
            rule = "it lies ahead of the trailing edge, or the planform crosses itself"
            require(ahead, f"{where}.{panel}_leading_edge", leading, rule)
        self._check_fit(where)

    def _check_fit(self, where: str) -> None:
        """Raise MorphologyError unless the panels meet at the elbow and fit the minimum chord and the force point."""
        edges = []
        for edge in ("leading_edge", "trailing_edge"):
            inner, outer = getattr(self, f"proximal_{edge}"), getattr(self, f"distal_{edge}")
            rule = f"it starts where the proximal one ends, at {inner[-1]:g} m"
            require(abs(outer[0] - inner[-1]) <= MEETING, f"{where}.distal_{edge}", outer, rule)
            edges.append((*inner, *outer))
        largest = max(le - te for le, te in zip(*edges, strict=True))
        rule = f"the wing's largest chord is {largest:g} m"
        require(self.minimum_chord <= largest, f"{where}.minimum_chord", self.minimum_chord, rule)
        if self.force_point is not None:
            x, y, z = self.force_point
            tip, back, front = self.distal_stations[-1], min(self.distal_trailing_edge), max(self.distal_leading_edge)
            rule = f"on the distal panel x is {back:g} to {front:g} m and y 0 to {tip:g} m; z is within half of that"
            on = back <= x <= front and 0.0 <= y <= tip and abs(z) <= 0.5 * tip
            require(on, f"{where}.force_point", self.force_point, rule)


@dataclass(frozen=True)
class LinkageLengths:
    """Dimensions of the linkage, which the paper calls Kinetic Sculpture.

    Lengths L1 to L7c belong to the bars L1 to L7 [m]; alpha3 is the bend of the humerus L3 [rad]. P1, P5 and P8 are the
    positions (outboard, up) of the pivots J1, J5 and J8 relative to the x axis of the body [m].
    """

    L1: AboveZero
    L2a: AboveZero
    L2b: float
    L2c: float
    L3a: AboveZero
    L3b: AboveZero
    L3c: float
    alpha3: float
    L4: AboveZero
    L5a: AboveZero
    L5b: float
    L5c: float
    L5d: float
    L6: AboveZero
    L7a: AboveZero
    L7b: AboveZero
    L7c: float
    P1: Pair
    P5: Pair
    P8: Pair


@dataclass(frozen=True)
class Bars:
    """Masses of the linkage's bars that are not wing links, of one side [kg].

    The tree of the URDF takes these bars as massless, as the paper does; the closed linkage of the MJCF has them.
    """

    L1: AboveZero
    L2: AboveZero
    L4: AboveZero
    L5: AboveZero
    L6: AboveZero

    @property
    def mass(self) -> float:
        """Mass of the bars of one side [kg]."""
        return self.L1 + self.L2 + self.L4 + self.L5 + self.L6


@dataclass(frozen=True)
class Surface:
    """A horizontal surface such as the tail: a flat plate with quasi-steady aerodynamics.

    Span, chord, and position of the centre relative to the body COM are in m; the incidence is positive nose up [rad].
    """

    span: AboveZero
    chord: AboveZero
    position: Vector3
    incidence: float = 0.0

    def check(self, where: str) -> None:
        """Raise MorphologyError unless the surface is centred."""
        _centred(self.position, f"{where}.position")


@dataclass(frozen=True)
class Fin:
    """A vertical surface in the body's plane of symmetry, with quasi-steady aerodynamics.

    Area [m2], lift slope [1/rad], and position of the centre relative to the body COM [m].
    """

    area: AboveZero
    lift_slope: AboveZero
    position: Vector3

    def check(self, where: str) -> None:
        """Raise MorphologyError unless the surface is centred."""
        _centred(self.position, f"{where}.position")


@dataclass(frozen=True)
class Aerodynamics:
    """Aerodynamic coefficients.

    Attributes:
        profile_drag: profile drag coefficient of the wings' strips.
        body_drag_area: drag area (coefficient times area) of the body [m2].
        tail_downwash_factor: downwash at the tail divided by the wing's mean downwash over the tail's span.
    """

    profile_drag: NotNegative
    body_drag_area: NotNegative
    tail_downwash_factor: NotNegative


@dataclass(frozen=True)
class Guard:
    """The visible ring of the propeller guard; its mass is part of the body.

    Attributes:
        radius: half axes (x, y) of the ring [m].
        centre: x coordinate of the ring's centre [m].
        tube: radius of the ring's tube [m].
    """

    radius: Pair
    centre: float
    tube: AboveZero

    def check(self, where: str) -> None:
        """Raise MorphologyError unless the half axes are positive and the tube is thinner than the ring."""
        require(min(self.radius) > 0.0, f"{where}.radius", self.radius, "both half axes are positive")
        rule = f"it is smaller than the ring's half axes, {min(self.radius):g} m at least"
        require(self.tube < min(self.radius), f"{where}.tube", self.tube, rule)


@dataclass(frozen=True)
class Thruster:
    """A propeller on the guard.

    Attributes:
        name: name of the thruster and of its frame.
        position: position relative to the body COM, body axes [m].
        direction: unit vector along the thrust, body axes.
        thrust: full thrust [N].
        torque: reaction torque about the direction at full thrust [N m].
    """

    name: str
    position: Vector3
    direction: Vector3
    thrust: AboveZero
    torque: float = 0.0

    def check(self, where: str) -> None:
        """Raise MorphologyError unless the name is valid and the direction is a unit vector."""
        check_name(self.name, f"{where}.name")
        unit = abs(sum(x * x for x in self.direction) - 1.0) < 1e-9
        require(unit, f"{where}.direction", self.direction, "a unit vector was expected")


@dataclass(frozen=True)
class Scale:
    """Scale factors of a morphology, from the table `[scale]` of a file or of changes; all are 1 by default.

    Attributes:
        span: factor of the span. The linkage determines the length of the proximal panel, so only the distal panel is
            stretched, together with its mass distribution.
        chord: factor by which both panels and their mass distributions are stretched along x, away from the y axis of
            the wing frame.
        wing_mass: factor of mass and inertia of the four wing links.
        body_mass: factor of mass and inertia of the body.
    """

    span: AboveZero = 1.0
    chord: AboveZero = 1.0
    wing_mass: AboveZero = 1.0
    body_mass: AboveZero = 1.0


def _centred(position: Vector3, where: str) -> None:
    require(position[1] == 0.0, where, position, "left and right mirror each other: y must be 0")
