"""The sections of a morphology. Units are SI; axes are x forward, y left, z up; only the left wing is written down."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

from aerobat_description.names import check_name
from aerobat_description.reading import positive, require

Vector = tuple[float, ...]
Pair = tuple[float, float]
Vector3 = tuple[float, float, float]
MEETING = 1e-6  # [m] between ends that meet


@dataclass(frozen=True)
class Body:
    """Mass [kg], inertia (xx, yy, zz, xy, xz, yz) [kg m2] about the centre of mass `com` [m] in the link frame."""

    mass: float
    inertia: tuple[float, float, float, float, float, float]
    com: Vector3 = (0.0, 0.0, 0.0)

    def check(self, where: str) -> None:
        """Raise unless the mass is positive and the principal moments obey the strict triangle inequality."""
        require(self.mass > 0.0, f"{where}.mass", self.mass, "it must be positive")
        # The second-moment matrix tr(I)/2 - I is positive definite exactly when every principal moment is smaller
        # than the sum of the other two; Sylvester's criterion tests it without eigenvalues.
        xx, yy, zz, xy, xz, yz = self.inertia
        a, b, c = (yy + zz - xx) / 2, (xx + zz - yy) / 2, (xx + yy - zz) / 2
        minors = (a, a * b - xy * xy, a * (b * c - yz * yz) - xy * (xy * c + yz * xz) - xz * (xy * yz + b * xz))
        rule = "each principal moment must be smaller than the sum of the other two"
        require(min(minors) > 0.0, f"{where}.inertia", self.inertia, rule)


@dataclass(frozen=True)
class Hull:
    """Visible fuselage [m]: length, centred on the centre of mass, largest width and height.

    `drop` is the height of its middle line; `boom` the radius of the booms to tail and fin.
    """

    length: float
    width: float
    height: float
    drop: float
    boom: float

    def check(self, where: str) -> None:
        """Raise unless every size is positive."""
        positive(self, where, "length", "width", "height", "boom")


@dataclass(frozen=True)
class Joints:
    """Limits (lower, upper) [rad], effort [N m] and velocity [rad/s] of shoulder and elbow."""

    shoulder_limits: Pair
    elbow_limits: Pair
    effort: float
    velocity: float

    def check(self, where: str) -> None:
        """Raise unless limits rise and effort and velocity are positive."""
        for key in ("shoulder_limits", "elbow_limits"):
            limits = getattr(self, key)
            require(limits[0] < limits[1], f"{where}.{key}", limits, "the lower limit comes first")
        positive(self, where, "effort", "velocity")


@dataclass(frozen=True)
class FreeFlyer:
    """Finite bounds of the free base, for tools that sample or plan: position +- [m], speeds [m/s, rad/s]."""

    position: float
    velocity: float
    angular_velocity: float

    def check(self, where: str) -> None:
        """Raise unless every bound is positive."""
        positive(self, where, "position", "velocity", "angular_velocity")


@dataclass(frozen=True)
class WingShape:
    """Planform of the left wing in its wing frames: stations along y, edges along x [m].

    `force_point`, in the distal frame, is where unknown forces are taken to act: the distal COM when left out.
    """

    offset_x: float
    proximal_stations: Vector
    proximal_leading_edge: Vector
    proximal_trailing_edge: Vector
    distal_stations: Vector
    distal_leading_edge: Vector
    distal_trailing_edge: Vector
    minimum_chord: float
    force_point: Vector3 | None = None

    def check(self, where: str) -> None:
        """Raise unless stations increase and the leading edge stays ahead of the trailing edge, and the parts meet."""
        for panel in ("proximal", "distal"):
            stations, leading, trailing = (
                getattr(self, f"{panel}_{name}") for name in ("stations", "leading_edge", "trailing_edge")
            )
            same = len(stations) == len(leading) == len(trailing) >= 2
            require(same, f"{where}.{panel}_stations", stations, "stations and edges have the same length, two or more")
            rising = stations[0] == 0.0 and all(a < b for a, b in itertools.pairwise(stations))
            require(rising, f"{where}.{panel}_stations", stations, "stations start at 0 and increase")
            ahead = all(le >= te for le, te in zip(leading, trailing, strict=True))
            rule = "it lies ahead of the trailing edge, or the planform crosses itself"
            require(ahead, f"{where}.{panel}_leading_edge", leading, rule)
        positive(self, where, "minimum_chord")
        self._check_fit(where)

    def _check_fit(self, where: str) -> None:
        """Raise unless the panels meet at the elbow, and minimum chord and force point fit them."""
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
    """Kinetic Sculpture: bar lengths [m], bend alpha3 [rad], ground pivots (outboard, up) [m] from the body's axis."""

    L1: float
    L2a: float
    L2b: float
    L2c: float
    L3a: float
    L3b: float
    L3c: float
    alpha3: float
    L4: float
    L5a: float
    L5b: float
    L5c: float
    L5d: float
    L6: float
    L7a: float
    L7b: float
    L7c: float
    P1: Pair
    P5: Pair
    P8: Pair

    def check(self, where: str) -> None:
        """Raise unless every bar has a positive length; offsets within a bar's own frame may have either sign."""
        positive(self, where, "L1", "L2a", "L3a", "L3b", "L4", "L5a", "L6", "L7a", "L7b")


@dataclass(frozen=True)
class Surface:
    """A flat quasi-steady surface: span, chord, centre from the body COM [m], incidence nose-up [rad]."""

    span: float
    chord: float
    position: Vector3
    incidence: float = 0.0

    def check(self, where: str) -> None:
        """Raise unless span and chord are positive and the surface is centred."""
        positive(self, where, "span", "chord")
        _centred(self.position, f"{where}.position")


@dataclass(frozen=True)
class Fin:
    """A vertical quasi-steady surface in the body's plane of symmetry: area [m2], lift slope [1/rad], centre [m]."""

    area: float
    lift_slope: float
    position: Vector3

    def check(self, where: str) -> None:
        """Raise unless area and lift slope are positive and the surface is centred."""
        positive(self, where, "area", "lift_slope")
        _centred(self.position, f"{where}.position")


@dataclass(frozen=True)
class Aerodynamics:
    """Profile drag coefficient, drag area of the body [m2], tail downwash over centre-line downwash."""

    profile_drag: float
    body_drag_area: float
    tail_downwash_factor: float

    def check(self, where: str) -> None:
        """Raise unless no coefficient is negative."""
        for key in ("profile_drag", "body_drag_area", "tail_downwash_factor"):
            require(getattr(self, key) >= 0.0, f"{where}.{key}", getattr(self, key), "it is not negative")


@dataclass(frozen=True)
class Guard:
    """Propeller guard, a picture only: half axes (x, y) of the ring, x of its centre, and radius of its tube [m]."""

    radius: Pair
    centre: float
    tube: float

    def check(self, where: str) -> None:
        """Raise unless the ring has a size and a hole."""
        require(min(self.radius) > 0.0, f"{where}.radius", self.radius, "both half axes are positive")
        positive(self, where, "tube")
        rule = f"it is smaller than the ring's half axes, {min(self.radius):g} m at least"
        require(self.tube < min(self.radius), f"{where}.tube", self.tube, rule)


@dataclass(frozen=True)
class Thruster:
    """A propeller on the guard.

    `position` from the body COM and unit `direction` of the thrust, in body axes; full `thrust` [N] and `torque`, the
    reaction about the direction at full thrust [N m].
    """

    name: str
    position: Vector3
    direction: Vector3
    thrust: float
    torque: float = 0.0

    def check(self, where: str) -> None:
        """Raise unless the name can name a frame, the direction is a unit vector and the thrust positive."""
        check_name(self.name, f"{where}.name")
        unit = abs(sum(x * x for x in self.direction) - 1.0) < 1e-9
        require(unit, f"{where}.direction", self.direction, "a unit vector was expected")
        positive(self, where, "thrust")


@dataclass(frozen=True)
class Scale:
    """Factors on a morphology, 1 by default; `[scale]` of a file or of changes.

    `span` stretches the arc from tip to tip. The linkage sets the length of the proximal panel, so the distal panel
    takes all of it, with the mass in it. `chord` stretches both panels and their masses along x, about the wing
    frame's y axis. `wing_mass` and `body_mass` multiply mass and inertia of the four wing links, and of the body.
    """

    span: float = 1.0
    chord: float = 1.0
    wing_mass: float = 1.0
    body_mass: float = 1.0

    def check(self, where: str) -> None:
        """Raise unless every factor is positive."""
        positive(self, where, "span", "chord", "wing_mass", "body_mass")


def _centred(position: Vector3, where: str) -> None:
    require(position[1] == 0.0, where, position, "left and right mirror each other: y must be 0")
