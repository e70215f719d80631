"""The section laws beyond stall: their forces on the plates and wings that others have measured."""

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np

from aerobat_description.morphology import Morphology
from aerobat_pin.aerobat import LINKS
from aerobat_pin.aerodynamics import Halves, LiftingLine, StripLoads, Stroke, fly, strips_of
from aerobat_pin.aerodynamics.lifting_line import JONES_EPS
from aerobat_pin.numerics import Array
from support.measurements import Flapping, Plates, Plunging
from support.section_law import ENDLESS, HALVES, fly_strips, loads_of, memory_of

PROFILE_DRAG = Morphology.load("aerobat").aerodynamics.profile_drag
RANGES = ((0.0, 15.0), (15.0, 40.0), (40.0, 90.0))  # [deg]; each holds its upper end
WING = Flapping()
STEPS, FLAPS = 50, 4  # steps of a flap, and flaps: the last one is reported


class Law(NamedTuple):
    """A section law: its name; `limit` of the lift coefficient, 0 for none; quasi-steady after Dickinson; potential."""

    name: str
    limit: float = 0.0
    quasi_steady: bool = False
    potential: bool = False

    def memory(self, line: LiftingLine) -> Array:
        """Return the memory of the strips of a line under this law."""
        return memory_of(
            line,
            quasi_steady=float(self.quasi_steady),
            profile_drag=PROFILE_DRAG,
            slope_over_limit=line.lift_slope / self.limit if self.limit else 0.0,
        )


ROBOT, LIMIT_2, LIMIT_1 = Law("robot"), Law("limit 2", limit=2.0), Law("limit 1", limit=1.0)
DICKINSON, POTENTIAL = Law("Dickinson", quasi_steady=True), Law("potential flow", potential=True)
MOVING = (ROBOT, LIMIT_2, LIMIT_1, DICKINSON)  # those of the kernels
LAWS = (*MOVING, POTENTIAL)


@cache
def rectangle(aspect_ratio: float | None) -> LiftingLine:
    """Return a rectangular wing with a chord of 0.1 m in air of 1 kg/m3; None is from wall to wall."""
    span, strips = (ENDLESS, 1) if aspect_ratio is None else (0.1 * aspect_ratio, 8)
    return LiftingLine(span, 0.1, strips=strips, air_density=1.0)


def steady(law: Law, aspect_ratio: float | None, incidence: Array) -> tuple[Array, Array]:
    """Return lift and drag coefficient (n,) of a rectangle at rising incidences [deg]; aspect ratio None: by walls."""
    line, angle = rectangle(aspect_ratio), np.radians(incidence)
    pressure = 0.5 * line.chord @ line.width
    cosine, sine = np.cos(angle), np.sin(angle)
    if law.potential:
        bound = line.steady_circulation(1.0)
        normal = (bound @ line.width) * cosine * sine / pressure
        edge = line.suction(bound / (line.lift_slope * line.semichord), 0.0 * bound)
        axial = edge @ line.width * sine**2 / pressure
    else:
        normal, axial = _settled(law.memory(line), line.strips, angle) / pressure
    return normal * cosine + axial * sine, normal * sine - axial * cosine


def _settled(air: Array, strips: int, incidence: Array) -> Array:
    """Return normal and axial force (2, n) of strips in 1 m/s at incidences [rad], by Newton's method."""
    twists, bound, force = np.zeros((len(LINKS), 6)), np.zeros(strips), np.empty((2, len(incidence)))
    semichord, unit = 0.05, np.eye(strips)

    def settled(circulation: Array) -> tuple[Array, StripLoads]:
        """Return the growth of the circulation and the loads when the lags have settled."""
        state = np.concatenate([np.zeros(2 * strips), circulation])
        slope = loads_of(air, twists, state)[1]
        state[: 2 * strips] = semichord * slope[: 2 * strips] / np.repeat(JONES_EPS, strips)
        _, slope, loads = loads_of(air, twists, state)
        return slope[2 * strips :], loads

    for k, angle in enumerate(incidence):
        twists[HALVES, 0], twists[HALVES, 2] = np.cos(angle), -np.sin(angle)
        for _ in range(30):
            found, loads = settled(bound)
            if np.max(np.abs(found)) < 1e-9:
                break
            jacobian = np.column_stack([(settled(bound + 1e-6 * one)[0] - found) / 1e-6 for one in unit])
            bound = bound - np.linalg.solve(jacobian, found)
        else:
            raise AssertionError(f"the strips do not settle at {np.degrees(angle):g} degrees")
        force[:, k] = loads.force_z.sum(), loads.force_x.sum()
    return force


def errors(law: Law, plate: Plates) -> Array:
    """Return the rms of the force coefficient's error, lift and drag together, in each of `RANGES`; NaN where empty."""
    lift, drag = steady(law, plate.aspect_ratio, plate.incidence)
    off = np.hypot(lift - plate.lift, drag - plate.drag)
    inside = [(low < plate.incidence) & (plate.incidence <= high) for low, high in RANGES]
    return np.array([np.sqrt(np.mean(off[one] ** 2)) if one.any() else np.nan for one in inside])


class StripForces(NamedTuple):
    """Forces over a flap (steps, N) [N]: circulatory, of added mass, suction minus drag; rotations (steps, N, 3, 3)."""

    normal: Array
    added: Array
    axial: Array
    rotation: Array


def flap(law: Law, line: LiftingLine, motion: Callable[[float], Halves], frequency: float) -> StripForces:
    """Fly a line under a law; loads of the last flap: potential flow by `fly`, the others by the robot's kernel."""
    half, step = np.where(line.y > -1e-9 * line.span, 0, 1), 1.0 / frequency / STEPS
    last = range((FLAPS - 1) * STEPS, FLAPS * STEPS)
    near = 1e-4 / frequency
    rate = [(motion(k * step + near).twist - motion(k * step - near).twist)[half].T / (2.0 * near) for k in last]
    added = np.array([-line.width * line.added_mass * (r[2] + r[3] * line.y - r[4] * line.mid_chord) for r in rate])
    rotation = np.array([motion(k * step).rotation[half] for k in last])
    if law.potential:
        flown = fly(line, motion, np.arange(FLAPS * STEPS + 1) * step).strip_force[-STEPS - 1 : -1]
        local = np.einsum("tnji,tnj->tni", rotation, flown)
        return StripForces(local[..., 2] - added, added, local[..., 0], rotation)
    twists = np.zeros((2 * FLAPS * STEPS + 1, len(LINKS), 6))
    twists[:, HALVES] = [motion(0.5 * k * step).twist for k in range(len(twists))]
    found = strips_of(fly_strips(law.memory(line), twists, step, STEPS)[0])
    return StripForces(found.force_z, added, found.force_x, rotation)


def plunge(law: Law, measured: Plunging, k: float) -> tuple[float, float]:
    """Return first harmonic and mean of the lift coefficient of the plunging section at a reduced frequency."""
    line, frequency = rectangle(None), k / (0.1 * np.pi)
    stroke = Stroke(1.0, np.radians(measured.incidence), frequency=frequency, plunge=0.025)
    loads = flap(law, line, stroke, frequency)
    force = np.stack([loads.axial, 0.0 * loads.axial, loads.normal + loads.added], axis=-1)
    lift = np.einsum("tnij,tnj->ti", loads.rotation, force)[:, 2] / (0.05 * line.width.sum())
    return abs(harmonic(lift)), float(lift.mean())


def harmonic(history: Array) -> complex:
    """Return the first harmonic of a history (steps, ...) over a flap."""
    turn = np.exp(-2j * np.pi * np.arange(len(history)) / len(history))
    return complex(2.0 * np.mean(turn * history))


@cache
def _tapped_line() -> LiftingLine:
    return LiftingLine(2.0 * WING.half_span, WING.chord, quarter_chord=WING.quarter_chord, air_density=1.2)


def tapped(law: Law, *, flat: bool = False) -> Array:
    """Return the force (50,) [N] of both halves that the taps of the flapping wing would give, without its mean."""
    # A section: 2 l / (pi c) sqrt(c / x - 1) attached, 8 m / (pi c^2) sqrt(x (c - x)) added mass; `flat`: even.
    line, wing = _tapped_line(), WING
    loads, left = flap(law, line, wing, wing.frequency), line.y > 0.0
    chord = wing.chord(wing.place[:, 1])
    x = (wing.place[:, 0] + wing.quarter_chord(wing.place[:, 1]) + 0.25 * chord) / chord

    def at(per_strip: Array) -> Array:
        rows = (per_strip / line.width)[:, left][:, ::-1]
        return np.array([np.interp(wing.place[:, 1], line.y[left][::-1], row) for row in rows]) / chord

    circulatory, added = at(loads.normal), at(loads.added)
    pressure = (
        circulatory + added
        if flat
        else 2.0 / np.pi * circulatory * np.sqrt(1.0 / x - 1.0) + 8.0 / np.pi * added * np.sqrt(x * (1.0 - x))
    )
    force = 2.0 * pressure @ wing.area
    return np.asarray(force - force.mean())
