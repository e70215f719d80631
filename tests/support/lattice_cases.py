"""The vortex lattice's cases, flown with the lifting line and with the section law of the robot's strips."""

from functools import cache
from typing import NamedTuple

import numpy as np

from aerobat_pin.aerodynamics import LiftingLine, Stroke, fly
from aerobat_pin.numerics import Array
from support.references import LATTICE_CASES, LatticeCase
from support.section_law import CYCLES, STEPS, fly_on_links

CHORD = 0.10  # [m]


def wing(strips: int = 16) -> LiftingLine:
    """Return the rectangle, with the leading edge at x = 0."""
    return LiftingLine(0.40, CHORD, quarter_chord=-0.25 * CHORD, strips=strips)


def stroke_of(name: str) -> Stroke:
    """Return a case's motion; it pitches about the quarter chord."""
    angles = {key: value if key == "plunge" else np.radians(value) for key, value in LATTICE_CASES[name].motion.items()}
    return Stroke(4.0, frequency=5.0, pitch_axis=-0.25 * CHORD, **angles)


@cache
def flown(name: str, strips: int = 16, *, robot: bool = False) -> LatticeCase:
    """Fly a case and return it as the lattice does: through `fly`, or through the robot's kernel."""
    stroke, line = stroke_of(name), wing(strips)
    if robot:
        force, moment = fly_on_links(line, stroke)
    else:
        time = (CYCLES - 1.0 + np.arange(STEPS) / STEPS) / stroke.frequency
        flight = fly(line, stroke, [0.0, *time])
        force, moment = flight.force[1:], flight.moment[1:]
    lift, turn = harmonics(force[:, 2]), harmonics(-moment[:, 1])
    return LatticeCase(LATTICE_CASES[name].motion, tuple(lift), float(force[:, 0].mean()), tuple(turn[:2]))


def harmonics(signal: Array) -> Array:
    """Return the mean and the complex amplitudes of the first three harmonics of one cycle (4,)."""
    found = np.fft.rfft(signal)[:4] / len(signal)
    return np.asarray(np.concatenate([found[:1], 2.0 * found[1:]]))


class Errors(NamedTuple):
    """A line against the lattice: rms of the lift's error over its rms, ratios of thrust and moments, degrees."""

    # `moment`, `phase`: first harmonic about the leading edge; `quarter`: about the quarter chord; `centre`: over lift.

    lift: float
    lift_ratio: float
    lift_phase: float
    thrust: float
    moment: float
    phase: float
    quarter: float
    centre: float
    lattice_centre: float


def errors(ours: LatticeCase, theirs: LatticeCase) -> Errors:
    """Compare a flown case with the lattice's, both without lag."""
    weight = np.array([1.0, 0.5, 0.5, 0.5])  # squares of harmonics in a mean square
    mine, lift = np.array(ours.lift), np.array(theirs.lift)
    error = np.sqrt((weight @ np.abs(mine - lift) ** 2) / (weight @ np.abs(lift) ** 2))
    (lift_1, turn_1), (lift_2, turn_2) = ((each.lift[1], each.moment[1]) for each in (ours, theirs))
    about = [abs(turn + 0.25 * CHORD * push) for push, turn in ((lift_1, turn_1), (lift_2, turn_2))]
    (lift_ratio, lift_phase), (moment, phase) = (
        (abs(ratio), float(np.degrees(np.angle(ratio)))) for ratio in (lift_1 / lift_2, turn_1 / turn_2)
    )
    centre, lattice_centre = (abs(turn / lift) / CHORD for turn, lift in ((turn_1, lift_1), (turn_2, lift_2)))
    thrust, quarter = ours.thrust / theirs.thrust, about[0] / about[1]
    return Errors(float(error), lift_ratio, lift_phase, thrust, moment, phase, quarter, centre, lattice_centre)
