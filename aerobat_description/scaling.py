"""Change a robot's proportions consistently: geometry, masses and inertias together."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from aerobat_description.reading import positive

if TYPE_CHECKING:
    from aerobat_description.morphology import Morphology
    from aerobat_description.sections import Body

EDGES = ("proximal_leading_edge", "proximal_trailing_edge", "distal_leading_edge", "distal_trailing_edge")


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

    def applied(self, morphology: Morphology) -> Morphology:
        """Return the scaled morphology, unchecked."""
        wing, tip = morphology.wing, morphology.wing.distal_stations[-1]
        inner = 0.5 * morphology.span - tip
        stretch = (0.5 * self.span * morphology.span - inner) / tip
        edges: dict[str, Any] = {name: tuple(self.chord * x for x in getattr(wing, name)) for name in EDGES}
        stations = tuple(stretch * y for y in wing.distal_stations)
        point = wing.force_point
        if point is not None:
            point = (self.chord * point[0], stretch * point[1], point[2])
        return replace(
            morphology,
            body=stretched(morphology.body, self.body_mass, 1.0, 1.0),
            proximal=stretched(morphology.proximal, self.wing_mass, self.chord, 1.0),
            distal=stretched(morphology.distal, self.wing_mass, self.chord, stretch),
            wing=replace(wing, distal_stations=stations, force_point=point, **edges),
        )


def stretched(body: Body, mass: float, x: float, y: float) -> Body:
    """Return a body whose every particle was moved to (x X, y Y, Z) and made `mass` times as heavy.

    The second moments of mass S = tr(J)/2 1 - J stretch as diag(x, y, 1) S diag(x, y, 1), and J = tr(S) 1 - S.
    """
    if mass == x == y == 1.0:
        return body
    jxx, jyy, jzz, jxy, jxz, jyz = body.inertia
    sxx, syy, szz = (x * x * (jyy + jzz - jxx) / 2, y * y * (jxx + jzz - jyy) / 2, (jxx + jyy - jzz) / 2)
    jxx, jyy, jzz, jxy, jxz, jyz = syy + szz, sxx + szz, sxx + syy, x * y * jxy, x * jxz, y * jyz
    inertia = (mass * jxx, mass * jyy, mass * jzz, mass * jxy, mass * jxz, mass * jyz)
    return replace(body, mass=mass * body.mass, com=(x * body.com[0], y * body.com[1], body.com[2]), inertia=inertia)
