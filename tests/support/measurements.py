"""Forces that others measured far beyond stall, over rho/2 V^2 S, read off figures by those who are named."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from aerobat_pin.aerodynamics import Halves
from aerobat_pin.numerics import Array

MEASURED = Path(__file__).resolve().parent / "measured"


class Plates(NamedTuple):
    """A plate in a steady stream: what it is, its aspect ratio (None: from wall to wall), and its coefficients (n,)."""

    name: str
    aspect_ratio: float | None
    incidence: Array
    lift: Array
    drag: Array


def plates() -> list[Plates]:
    """Return the measured plates, from the most viscous one on, and a fit of stalled ones."""
    # Towed, aspect ratio 2, Re 100: Taira, Dickson, Colonius, Dickinson & Rowley, AIAA 2007-710; by PetIBM, to 0.01.
    # Channel, wall to wall, Re 75 000, 13 % thick: EPFL, mean of five runs, which differ by 0.04; L. Schneeberger's
    # dstoolbox. Tunnel, aspect ratio 2, Re 140 000: Pelletier & Mueller, J. Aircraft 37 (2000) 825; T. Fox, to 0.03.
    # Stalled, aspect ratio 4: Viterna & Corrigan, NASA CP-2230 (1981), normal force 1.11 + 0.018 AR at 90 degrees.
    table = np.genfromtxt(MEASURED / "plates.csv", delimiter=",", names=True, dtype=None, encoding="utf-8")
    stalled = np.arange(60.0, 91.0, 5.0)
    cosine, sine = np.cos(np.radians(stalled)), np.sin(np.radians(stalled))
    normal = (1.11 + 0.018 * 4.0) * sine
    fit = Plates("stalled plates, fit, aspect ratio 4", 4.0, stalled, normal * cosine, normal * sine)
    found = []
    for key, name, aspect_ratio in (
        ("towed", "aspect ratio 2, Re 100", 2.0),
        ("channel", "wall to wall, Re 75 000", None),
        ("tunnel", "aspect ratio 2, Re 140 000", 2.0),
    ):
        rows = table[table["set"] == key]
        found.append(Plates(name, aspect_ratio, *(rows[c].astype(float) for c in ("incidence_deg", "lift", "drag"))))
    return [*found, fit]


class Plunging(NamedTuple):
    """A section that plunges half a chord: k = pi f c / V, first harmonic of lift, least and largest mean."""

    incidence: float
    reduced_frequency: Array
    first_harmonic: Array
    least_mean: Array
    largest_mean: Array

    @property
    def largest_incidence(self) -> Array:
        """Largest incidence of the flow at the section, without the wake's (n,) [deg]."""
        return np.asarray(self.incidence + np.degrees(np.arctan(0.5 * self.reduced_frequency)))


def plunging() -> list[Plunging]:
    """Return a plunging NACA 0012, wall to wall, Reynolds number 20 000; at rest it stalls at 9 degrees."""
    # Chiereghin, Cleaver & Gursul, AIAA J. 57 (2019) 208, as we conclude; read by R. Jan (UA 1), to 0.03.
    table = np.genfromtxt(MEASURED / "plunging.csv", delimiter=",", skip_header=1)
    return [Plunging(a, *table[table[:, 0] == a].T[1:]) for a in np.unique(table[:, 0])]


class Flapping:
    """A rigid flapping wing: nine mean-free pressures (50, 9) [Pa], places (9, 2) [m], areas [m2], planform [m]."""

    # Yeo, Atkins & Shyy (2011), case C: half span 0.213 m, chord 0.072 m, 2.9 m/s, 3.3 Hz, 21 degrees to both sides;
    # read by C. Urban (PteraSoftware, validation).

    airspeed, frequency, half_span = 2.9, 3.3, 0.213
    stations = 1e-3 * np.array([0.0, 50.0, 100.0, 135.0, 165.0, 190.0, 205.0, 212.0, 213.0])
    leading = 1e-3 * np.array([0.0, 0.5, 1.8, 3.6, 6.0, 9.2, 12.7, 16.9, 18.7])
    trailing = 1e-3 * np.array([72.0, 71.5, 67.0, 61.2, 53.5, 43.4, 33.0, 21.4, 18.7])

    def __init__(self) -> None:
        table = np.genfromtxt(MEASURED / "flapping.csv", delimiter=",", skip_header=1)
        self.cycles, angle = table[:, 0], np.radians(table[:, 1])
        self.pressure = table[:, 2:] - table[:, 2:].mean(axis=0)
        self._harmonics = [np.mean(angle * np.exp(-2j * np.pi * n * self.cycles)) * (2 if n else 1) for n in range(4)]
        aft = np.array([12.0, 36.0, 60.0, 13.08, 34.2, 55.32, 15.69, 30.69, 45.69])
        out = np.array([36.0, 36.0, 36.0, 107.0, 107.0, 107.0, 177.5, 176.0, 162.825])
        self.place = 1e-3 * np.column_stack([aft, out])
        heights = np.repeat([0.024, 0.02112, 0.015], 3)
        self.area = heights * [0.072, 0.072, 0.072, 0.07, 0.07, 0.07, 0.071, 0.06565, 0.04165]

    def chord(self, y: Array) -> Array:
        """Return the chord at stations of the whole wing [m]."""
        return np.asarray(np.interp(np.abs(y), self.stations, self.trailing - self.leading))

    def quarter_chord(self, y: Array) -> Array:
        """Return x of the quarter chord, forward from the root's leading edge, at stations of the whole wing [m]."""
        return np.asarray(-np.interp(np.abs(y), self.stations, self.leading) - 0.25 * self.chord(y))

    def __call__(self, time: float) -> Halves:
        """Return the motion of both halves at a time [s]: the first three harmonics of the measured angle."""
        spin = 2j * np.pi * self.frequency * np.arange(4)
        parts = self._harmonics * np.exp(spin * time)
        angle, rate = float(np.sum(parts.real)), float(np.sum((spin * parts).real))
        rotation, twist = np.empty((2, 3, 3)), np.zeros((2, 6))
        for i, side in enumerate((1.0, -1.0)):
            cosine, sine = np.cos(angle), side * np.sin(angle)
            rotation[i] = [[1.0, 0.0, 0.0], [0.0, cosine, -sine], [0.0, sine, cosine]]
            twist[i, 0], twist[i, 3] = self.airspeed, side * rate
        return Halves(rotation, twist)
