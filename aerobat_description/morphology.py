"""A morphology: every number that makes one Aerobat, read from TOML and checked.

Units are SI throughout; axes are x forward, y left, z up. Only the left wing is written down, the right one is its
mirror image, so a morphology cannot be lopsided.
"""

from __future__ import annotations

import difflib
import itertools
import math
import tomllib
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from typing import Any, get_args, get_type_hints

from aerobat_description import MORPHOLOGIES, PACKAGE_PATH

Vector = tuple[float, ...]
Pair = tuple[float, float]
Triple = tuple[float, float, float]


class MorphologyError(ValueError):
    """A morphology that cannot be read, or that no robot can have. The message names key, value and rule."""


@dataclass(frozen=True)
class Body:
    """Mass [kg], inertia (xx, yy, zz, xy, xz, yz) [kg m2] about the centre of mass `com` [m] in the link frame."""

    mass: float
    inertia: tuple[float, float, float, float, float, float]
    com: Triple = (0.0, 0.0, 0.0)

    def check(self, where: str) -> None:
        """Raise unless the mass is positive and the principal moments obey the strict triangle inequality."""
        _require(self.mass > 0.0, f"{where}.mass", self.mass, "it must be positive")
        # The second-moment matrix tr(I)/2 - I is positive definite exactly when every principal moment is smaller
        # than the sum of the other two; Sylvester's criterion tests it without eigenvalues.
        xx, yy, zz, xy, xz, yz = self.inertia
        a, b, c = (yy + zz - xx) / 2, (xx + zz - yy) / 2, (xx + yy - zz) / 2
        minors = (a, a * b - xy * xy, a * (b * c - yz * yz) - xy * (xy * c + yz * xz) - xz * (xy * yz + b * xz))
        rule = "each principal moment must be smaller than the sum of the other two"
        _require(min(minors) > 0.0, f"{where}.inertia", self.inertia, rule)


@dataclass(frozen=True)
class Hull:
    """Visible shape of the body, an ellipsoid about its centre of mass [m]."""

    length: float
    width: float
    height: float

    def check(self, where: str) -> None:
        """Raise unless every size is positive."""
        _positive(self, where, "length", "width", "height")


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
            _require(limits[0] < limits[1], f"{where}.{key}", limits, "the lower limit comes first")
        _positive(self, where, "effort", "velocity")


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
    force_point: Triple | None = None

    def check(self, where: str) -> None:
        """Raise unless stations increase and the leading edge stays ahead of the trailing edge."""
        for panel in ("proximal", "distal"):
            stations, leading, trailing = (
                getattr(self, f"{panel}_{name}") for name in ("stations", "leading_edge", "trailing_edge")
            )
            same = len(stations) == len(leading) == len(trailing) >= 2
            _require(
                same, f"{where}.{panel}_stations", stations, "stations and edges have the same length, two or more"
            )
            rising = stations[0] == 0.0 and all(a < b for a, b in itertools.pairwise(stations))
            _require(rising, f"{where}.{panel}_stations", stations, "stations start at 0 and increase")
            ahead = all(le >= te for le, te in zip(leading, trailing, strict=True))
            _require(ahead, f"{where}.{panel}_leading_edge", leading, "it lies ahead of the trailing edge")
        _positive(self, where, "minimum_chord")


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
        _positive(self, where, "L1", "L2a", "L3a", "L3b", "L4", "L5a", "L6", "L7a", "L7b")


@dataclass(frozen=True)
class Surface:
    """A flat quasi-steady surface: span, chord, centre from the body COM [m], incidence nose-up [rad]."""

    span: float
    chord: float
    position: Triple
    incidence: float = 0.0

    def check(self, where: str) -> None:
        """Raise unless span and chord are positive."""
        _positive(self, where, "span", "chord")


@dataclass(frozen=True)
class Fin:
    """A vertical quasi-steady surface in the body's plane of symmetry: area [m2], lift slope [1/rad], centre [m]."""

    area: float
    lift_slope: float
    position: Triple

    def check(self, where: str) -> None:
        """Raise unless area and lift slope are positive."""
        _positive(self, where, "area", "lift_slope")


@dataclass(frozen=True)
class Aerodynamics:
    """Profile drag coefficient, drag area of the body [m2], tail downwash over centre-line downwash."""

    profile_drag: float
    body_drag_area: float
    tail_downwash_factor: float

    def check(self, where: str) -> None:
        """Raise unless no coefficient is negative."""
        for key in ("profile_drag", "body_drag_area", "tail_downwash_factor"):
            _require(getattr(self, key) >= 0.0, f"{where}.{key}", getattr(self, key), "it is not negative")


@dataclass(frozen=True)
class Guard:
    """Propeller guard, a picture only: half axes of the ring (x, y) and radius of its tube [m]."""

    radius: Pair
    tube: float

    def check(self, where: str) -> None:
        """Raise unless the ring has a size."""
        _require(min(self.radius) > 0.0, f"{where}.radius", self.radius, "both half axes are positive")
        _positive(self, where, "tube")


@dataclass(frozen=True)
class Morphology:
    """One robot. Build it with `load` or `from_mapping`; both check it."""

    name: str
    description: str
    body: Body
    hull: Hull
    proximal: Body
    distal: Body
    joints: Joints
    wing: WingShape
    linkage: LinkageLengths
    aerodynamics: Aerodynamics
    tail: Surface | None = None
    fin: Fin | None = None
    guard: Guard | None = None

    @classmethod
    def load(cls, morphology: str | Path, changes: Mapping[str, Any] | None = None) -> Morphology:
        """Read a shipped morphology by name, or a TOML file, and apply changes.

        Args:
            morphology: `"aerobat"`, `"aerobat_guard"`, `"aerobat_light"`, or the path of a TOML file.
            changes: nested values laid over the file, such as `{"wing": {"offset_x": -0.06}}`.

        Raises:
            MorphologyError: no such morphology, or one that fails a check.
        """
        return cls.from_mapping(_merge(_read(str(morphology)), changes or {}))

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any]) -> Morphology:
        """Build from nested plain values. Raises MorphologyError with key, value and rule."""
        made = _build(cls, values, "")
        assert isinstance(made, cls)
        return made

    def check(self, where: str) -> None:
        """Raise unless the name can name files and a robot."""
        plain = bool(self.name) and all(letter.isalnum() or letter in "_-" for letter in self.name)
        _require(plain, _dotted(where, "name"), repr(self.name), "letters, digits, _ and - only")

    @property
    def mass(self) -> float:
        """Total mass [kg]."""
        return self.body.mass + 2.0 * (self.proximal.mass + self.distal.mass)

    @property
    def shoulder(self) -> Vector:
        """Left shoulder axis from the body COM [m], in body axes."""
        return (self.wing.offset_x, *self.linkage.P5)

    @property
    def force_point(self) -> Vector:
        """Left point of application of unknown forces [m], in the distal frame."""
        return self.distal.com if self.wing.force_point is None else self.wing.force_point

    @property
    def elbow(self) -> Vector:
        """Left elbow axis from the shoulder axis [m], in the proximal frame: pin J6 at theta_s = 0."""
        bars = self.linkage
        along = bars.L3a + bars.L3c * math.sin(bars.alpha3)
        return (0.0, along, bars.L3c * math.cos(bars.alpha3))


def _require(holds: bool, key: str, value: object, rule: str) -> None:
    if not holds:
        raise MorphologyError(f"morphology: {key} = {value}: {rule}")


def _positive(section: object, where: str, *keys: str) -> None:
    for key in keys:
        value = getattr(section, key)
        _require(value > 0.0, f"{where}.{key}", value, "it must be positive")


def _read(morphology: str) -> dict[str, Any]:
    path = Path(morphology)
    if morphology in MORPHOLOGIES:
        path = Path(PACKAGE_PATH, "morphologies", f"{morphology}.toml")
    elif not path.is_file():
        shipped = ", ".join(MORPHOLOGIES)
        raise MorphologyError(f"no morphology named '{morphology}': shipped are {shipped}; or give a TOML file")
    try:
        values = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise MorphologyError(f"morphology file {path}: not valid TOML: {error}") from error
    parent = values.pop("extends", None)
    if parent is None:
        return values
    if parent not in MORPHOLOGIES or parent == values.get("name"):
        raise MorphologyError(f"morphology file {path}: extends = {parent!r}: name another shipped morphology")
    return _merge(_read(parent), values)


def _merge(base: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    merged = dict(base)
    for key, value in changes.items():
        below = merged.get(key)
        merged[key] = _merge(below, value) if isinstance(value, Mapping) and isinstance(below, Mapping) else value
    return merged


def _build(kind: Any, values: object, where: str) -> Any:
    """Turn plain TOML values into `kind`: a dataclass, a number, a string or a vector of numbers."""
    if not hasattr(kind, "__dataclass_fields__"):
        return _leaf(kind, values, where)
    if not isinstance(values, Mapping):
        raise MorphologyError(f"morphology: {where} = {values!r}: a table was expected")
    known = {field.name: field for field in fields(kind)}
    hints = get_type_hints(kind)
    for key in values:
        if key not in known:
            close = difflib.get_close_matches(str(key), known, n=1)
            hint = f"; did you mean '{close[0]}'?" if close else f"; known are {', '.join(known)}"
            raise MorphologyError(f"morphology: unknown key '{_dotted(where, key)}'{hint}")
    made = {}
    for key, field in known.items():
        if key in values:
            optional = [choice for choice in get_args(hints[key]) if choice is not type(None)]
            inner = optional[0] if type(None) in get_args(hints[key]) else hints[key]
            made[key] = _build(inner, values[key], _dotted(where, key))
        elif field.default is MISSING:
            raise MorphologyError(f"morphology: missing key '{_dotted(where, key)}'")
    section = kind(**made)
    if hasattr(section, "check"):
        section.check(where)
    return section


def _leaf(kind: Any, value: Any, where: str) -> Any:
    if kind is str:
        _require(isinstance(value, str), where, repr(value), "a string was expected")
        return value
    numbers = value if isinstance(value, list | tuple) else [value]
    good = all(isinstance(x, int | float) and not isinstance(x, bool) and abs(x) < 1e300 for x in numbers)
    _require(good, where, value, "finite numbers were expected")
    if kind is float:
        _require(not isinstance(value, list | tuple), where, value, "one number was expected")
        return float(numbers[0])
    size = None if Ellipsis in get_args(kind) else len(get_args(kind))
    rule = "a list of numbers was expected" if size is None else f"a list of {size} numbers was expected"
    _require(isinstance(value, list | tuple) and size in (None, len(value)), where, value, rule)
    return tuple(float(x) for x in numbers)


def _dotted(where: str, key: object) -> str:
    return f"{where}.{key}" if where else str(key)
