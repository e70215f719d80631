"""Read and check morphologies: all the numbers that define one variant of Aerobat.

Units are SI; axes are x forward, y left, z up. A morphology contains only the left wing; the right wing is its mirror
image.
"""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from aerobat_description import MORPHOLOGIES, PACKAGE_PATH
from aerobat_description.morphology_tables import (
    Aerodynamics,
    Bars,
    Body,
    Fin,
    FreeFlyer,
    Guard,
    Hull,
    Joints,
    LinkageLengths,
    Scale,
    Surface,
    Thruster,
    Vector,
    WingShape,
)
from aerobat_description.position_closure import ClosureError, advice, elbow, reach, remedies
from aerobat_description.reading import (
    MorphologyError,
    build,
    check_name,
    check_thrusters,
    did_you_mean,
    dotted,
    merge,
    require,
)
from aerobat_description.toml_text import TomlError, toml_file

LIMIT_MARGIN = 0.1  # [rad] between the linkage's range and a joint limit that is adapted to it
STRETCH = 0.05  # allowed relative difference of the last proximal station and the elbow's distance; 2.5 % as shipped
PLANFORM_EDGES = ("proximal_leading_edge", "proximal_trailing_edge", "distal_leading_edge", "distal_trailing_edge")


@dataclass(frozen=True)
class Morphology:
    """The numbers of one robot. Create it with `load` or `from_mapping`, which check all values."""

    name: str
    description: str
    body: Body
    hull: Hull
    proximal: Body
    distal: Body
    joints: Joints
    free_flyer: FreeFlyer
    wing: WingShape
    linkage: LinkageLengths
    bars: Bars
    aerodynamics: Aerodynamics
    tail: Surface | None = None
    fin: Fin | None = None
    guard: Guard | None = None
    thrusters: tuple[Thruster, ...] = ()

    @classmethod
    def load(cls, morphology: str | Path, changes: Mapping[str, Any] | None = None) -> Morphology:
        """Read a shipped morphology by name, or a TOML file, and apply changes.

        Args:
            morphology: `"aerobat"`, `"aerobat_guard"`, `"aerobat_light"`, or the path of a TOML file.
            changes: nested values laid over the file, such as `{"wing": {"offset_x": -0.06}}`. If they change the
                linkage, some other values are adapted to it: see `laid_over`.

        Raises:
            MorphologyError: there is no such morphology, or it fails a check.
        """
        return cls.from_mapping(laid_over(_file_values(str(morphology)), changes or {}))

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any]) -> Morphology:
        """Build a morphology from nested plain values, and apply the factors in its table `scale`.

        Raises MorphologyError, which names key, value and rule, if a value fails a check.
        """
        values = dict(values)
        scale = build(Scale, values.pop("scale", {}), "scale")
        morphology: Morphology = build(cls, values, "")
        if scale != Scale():
            morphology = build(cls, asdict(morphology._scaled(scale)), "")
        return morphology

    def with_changes(self, changes: Mapping[str, Any]) -> Morphology:
        """Return a new morphology with changes, adapted and checked as by `load`; nothing is read from disk.

        Args:
            changes: nested values, such as `{"linkage": {"L3b": 6.8e-3}, "scale": {"span": 1.1}, "tail": None}`.

        Raises:
            MorphologyError: the changed morphology fails a check.
        """
        return self.from_mapping(laid_over(asdict(self), changes))

    def _scaled(self, scale: Scale) -> Morphology:
        """Return the morphology with scale factors applied, without checks."""
        wing, tip = self.wing, self.wing.distal_stations[-1]
        inner = 0.5 * self.span - tip
        stretch = (0.5 * scale.span * self.span - inner) / tip
        edges: dict[str, Any] = {key: tuple(scale.chord * x for x in getattr(wing, key)) for key in PLANFORM_EDGES}
        stations = tuple(stretch * y for y in wing.distal_stations)
        point = wing.force_point
        if point is not None:
            point = (scale.chord * point[0], stretch * point[1], point[2])
        return replace(
            self,
            body=stretched(self.body, scale.body_mass, 1.0, 1.0),
            proximal=stretched(self.proximal, scale.wing_mass, scale.chord, 1.0),
            distal=stretched(self.distal, scale.wing_mass, scale.chord, stretch),
            wing=replace(wing, distal_stations=stations, force_point=point, **edges),
        )

    def check(self, where: str) -> None:
        """Raise MorphologyError unless names are valid, the body is symmetric, and all parts fit together.

        The parts are linkage, joint limits, planform and masses.
        """
        check_name(self.name, dotted(where, "name"))
        require(not any(self.body.com), "body.com", self.body.com, "base_link has its origin at the centre of mass")
        mirrored = self.body.inertia[3] == self.body.inertia[5] == 0.0
        rule = "left and right mirror each other: xy and yz must be 0"
        require(mirrored, "body.inertia", self.body.inertia, rule)
        check_thrusters([thruster.name for thruster in self.thrusters])
        self._check_turning()
        rule = f"the bars of both sides are taken from the body in the MJCF: less than its mass, {self.body.mass:g} kg"
        require(2.0 * self.bars.mass < self.body.mass, "bars", asdict(self.bars), rule)
        bone, stations = math.hypot(*self.elbow), self.wing.proximal_stations
        rule = f"the last one is at the elbow, {bone:.4g} m from the shoulder, to {100 * STRETCH:g} %"
        require(abs(stations[-1] / bone - 1.0) <= STRETCH, "wing.proximal_stations", stations, rule)
        rule = f"it is not larger than the span, {self.span:.3f} m"
        require(abs(self.wing.offset_x) <= self.span, "wing.offset_x", self.wing.offset_x, rule)
        for panel, length in (("proximal", self.elbow[1]), ("distal", self.wing.distal_stations[-1])):
            self._check_panel(panel, length)
        half_span = 0.5 * self.span
        for part in ("body", "proximal", "distal"):
            link = getattr(self, part)
            gyration = math.sqrt(max(link.inertia[:3]) / link.mass)
            rule = f"a radius of gyration of {gyration:.3f} m is larger than half the span, {half_span:.3f} m"
            require(gyration < half_span, f"{part}.inertia", link.inertia, rule)

    def _check_panel(self, panel: str, length: float) -> None:
        """Raise MorphologyError unless a panel has an area and its centre of mass lies within its outline."""
        stations, leading, trailing = self.wing.outline(panel)
        area = _area(stations, leading, trailing)
        require(area > 0.0, f"wing.{panel}_leading_edge", leading, "the panel has no area")
        com = getattr(self, panel).com
        inside = 0.0 <= com[1] <= length and min(trailing) <= com[0] <= max(leading)
        require(inside, f"{panel}.com", com, "the centre of mass lies within the panel's outline")

    def _check_turning(self) -> None:
        """Raise MorphologyError unless the crank can turn and the joint limits include the linkage's range.

        If the crank cannot turn, the message names bar lengths with which it can.
        """
        try:
            reached = reach(self.linkage)
        except ClosureError as error:
            would = advice(self.linkage, remedies(self.linkage, error.dyad))
            raise MorphologyError(f"morphology: linkage: the crank cannot turn: {error}{would}") from error
        for joint, (low, high) in reached.items():
            limits = getattr(self.joints, f"{joint}_limits")
            rule = f"the linkage reaches {math.floor(1e3 * low) / 1e3:.3f} to {math.ceil(1e3 * high) / 1e3:.3f} rad"
            require(limits[0] <= low and high <= limits[1], f"joints.{joint}_limits", limits, rule)

    @property
    def mass(self) -> float:
        """Total mass [kg]."""
        return self.body.mass + 2.0 * (self.proximal.mass + self.distal.mass)

    @property
    def shoulder(self) -> Vector:
        """Position of the left shoulder axis relative to the body COM, in body axes [m]."""
        return (self.wing.offset_x, *self.linkage.P5)

    @property
    def force_point(self) -> Vector:
        """Point of the left wing at which unknown forces act, in the distal frame [m]."""
        return self.distal.com if self.wing.force_point is None else self.wing.force_point

    @property
    def elbow(self) -> Vector:
        """Position of the left elbow axis (pin J6) relative to the shoulder axis, in the proximal frame [m]."""
        at = elbow(self.linkage)
        return (0.0, at.real, at.imag)

    @property
    def span(self) -> float:
        """Span [m]: length of the path from tip to tip along the links."""
        return 2.0 * (self.shoulder[1] + math.hypot(*self.elbow) + self.wing.distal_stations[-1])

    @property
    def wing_area(self) -> float:
        """Area of the membranes of one wing, spread flat [m2]."""
        return sum(_area(*self.wing.outline(panel)) for panel in ("proximal", "distal"))


def stretched(body: Body, mass: float, x: float, y: float) -> Body:
    """Return a body with every particle (X, Y, Z) moved to (x X, y Y, Z) and made `mass` times as heavy.

    The second moments of mass S = tr(J)/2 1 - J stretch as diag(x, y, 1) S diag(x, y, 1), and J = tr(S) 1 - S.
    """
    if mass == x == y == 1.0:
        return body
    jxx, jyy, jzz, jxy, jxz, jyz = body.inertia
    sxx, syy, szz = (x * x * (jyy + jzz - jxx) / 2, y * y * (jxx + jzz - jyy) / 2, (jxx + jyy - jzz) / 2)
    jxx, jyy, jzz, jxy, jxz, jyz = syy + szz, sxx + szz, sxx + syy, x * y * jxy, x * jxz, y * jyz
    inertia = (mass * jxx, mass * jyy, mass * jzz, mass * jxy, mass * jxz, mass * jyz)
    return replace(body, mass=mass * body.mass, com=(x * body.com[0], y * body.com[1], body.com[2]), inertia=inertia)


def _area(stations: Vector, leading: Vector, trailing: Vector) -> float:
    chord = [a - b for a, b in zip(leading, trailing, strict=True)]
    steps = zip(itertools.pairwise(stations), itertools.pairwise(chord), strict=True)
    return sum((y1 - y0) * (c0 + c1) / 2 for (y0, y1), (c0, c1) in steps)


def _file_values(morphology: str) -> dict[str, Any]:
    path = Path(morphology)
    if morphology in MORPHOLOGIES:
        path = Path(PACKAGE_PATH, "morphologies", f"{morphology}.toml")
    elif not os.path.isfile(path):
        hint = did_you_mean(morphology, MORPHOLOGIES, "shipped are")
        raise MorphologyError(f"no morphology named '{morphology}': {hint}; or give a TOML file")
    try:
        values = toml_file(path)
    except TomlError as error:
        raise MorphologyError(f"morphology file {path}: {error}") from error
    parent = values.pop("extends", None)
    if parent is None:
        return values
    where = f"morphology file {path}"
    if parent not in MORPHOLOGIES or parent == values.get("name"):
        raise MorphologyError(f"{where}: extends = {parent!r}: name another shipped morphology")
    if "name" not in values:
        raise MorphologyError(f"{where}: missing key 'name': a robot that extends '{parent}' has a name of its own")
    return laid_over(_file_values(parent), values)


def laid_over(values: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return the nested values of a morphology with changes laid over them, and adapted to a changed linkage.

    Joint limits that are narrower than the linkage's range plus `LIMIT_MARGIN` are widened to it. The proximal stations
    are stretched with the distance from shoulder to elbow. Keys that `changes` contains are not adapted. Values that no
    robot can have are kept; building the robot then raises an error that explains them.
    """
    merged = merge(values, changes)
    if "linkage" not in changes:
        return merged
    try:
        before, after = (build(LinkageLengths, tables["linkage"], "linkage") for tables in (values, merged))
        joints, wing = build(Joints, merged["joints"], "joints"), build(WingShape, merged["wing"], "wing")
        reached = reach(after)
    except (KeyError, MorphologyError, ClosureError):
        return merged
    given = changes.get("joints", {}), changes.get("wing", {})
    limits = {f"{joint}_limits": (low - LIMIT_MARGIN, high + LIMIT_MARGIN) for joint, (low, high) in reached.items()}
    pairs = {key: (*getattr(joints, key), *pair) for key, pair in limits.items() if key not in given[0]}
    wide = {key: (min(ends), max(ends)) for key, ends in pairs.items()}
    stretch = abs(elbow(after)) / abs(elbow(before))
    stations = {"proximal_stations": [stretch * y for y in wing.proximal_stations]}
    return merge(merged, {"joints": wide, "wing": {} if "proximal_stations" in given[1] else stations})
