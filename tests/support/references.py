"""What a lifting line answers to: closed forms for small angles, and numbers of a vortex lattice; s in semichords."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import quad
from scipy.special import hankel2, i0, i1, k0, k1

from aerobat_pin.aerodynamics.lifting_line import JONES_EPS, JONES_PSI
from aerobat_pin.numerics import Array

# CL at s of a rectangular wing of aspect ratio 4 after an impulsive start at 5 deg, by an unsteady vortex lattice.
LATTICE_START = {0.25: 0.2476, 1.0: 0.2701, 2.0: 0.2894, 5.0: 0.3153, 10.0: 0.3270}


class FlapLoads(NamedTuple):
    """Lift and thrust of a flapping wing over a cycle [N]."""

    lift_rms: float
    lift_max: float
    thrust_mean: float


# A rectangular wing, span 0.40 m, chord 0.10 m, that flaps 30 deg to both sides about its root at 5 Hz and flies level
# at 4 m/s in air of 1.225 kg/m3, by PteraSoftware 5.1.0 (192 panels).
LATTICE_FLAP = FlapLoads(lift_rms=0.3526, lift_max=0.529, thrust_mean=0.0636)


class LatticeCase(NamedTuple):
    """A motion of the same wing by the same solver, third cycle; amplitude sin(2 pi 5 t), angles in degrees."""

    # `lift` [N]: mean and three complex harmonics; `moment` [N m]: of the root's leading edge, nose up; `thrust` [N].

    motion: dict[str, float]
    lift: tuple[complex, ...]
    thrust: float
    moment: tuple[complex, ...]


# 8 x 12 uniform panels a side, NACA 0002, prescribed wake, 64 steps a cycle, third cycle. Motion A sin(wt); lift and
# thrust in wind axes, moment nose up about the leading edge of the root at rest; the halves hinge at the root, 10
# micrometres off the middle. The solver's loads lag by 1.18 of its time steps, which `lattice` takes away.
LATTICE_LAG = 1.18 / 64  # [cycles]
LATTICE_CASES = {
    "flap 30 deg": LatticeCase(
        {"flap": 30.0}, (0.0, -0.49239 - 0.07234j, 0.0, -0.02763 - 0.01516j), 0.063621, (0.0, 0.010437 + 0.007090j)
    ),
    "flap 30 deg, incidence 5 deg": LatticeCase(
        {"flap": 30.0, "incidence": 5.0},
        (0.12764, -0.49619 - 0.07237j, 0.02761 + 0.00836j, -0.02773 - 0.01490j),
        0.060213,
        (-0.002608, 0.010516 + 0.007418j),
    ),
    "flap 5 deg": LatticeCase(
        {"flap": 5.0}, (0.0, -0.08046 - 0.01107j, 0.0, -0.00013 - 0.00007j), 0.001721, (0.0, 0.001714 + 0.000794j)
    ),
    "plunge 10 mm": LatticeCase(
        {"plunge": 0.010}, (0.0, -0.10220 - 0.01160j, 0.0, -0.00004 - 0.00002j), 0.002395, (0.0, 0.002229 + 0.000911j)
    ),
    "pitch 5 deg": LatticeCase(  # about the quarter chord
        {"pitch": 5.0}, (0.0, 0.06439 - 0.11579j, 0.0, 0.00004 - 0.00012j), -0.001803, (0.0, -0.003214 + 0.002386j)
    ),
}


# Twice as many steps a cycle: the solver's first harmonics of lift and moment, lag included, are not converged in time.
LATTICE_FINE = {
    "plunge 10 mm": (-0.103970 - 0.020530j, 0.002405 + 0.001537j),
    "pitch 5 deg": (0.072789 - 0.113860j, -0.003947 + 0.002277j),
}


def lattice(name: str) -> LatticeCase:
    """Return a case without the solver's own lag."""
    case = LATTICE_CASES[name]
    lift, moment = (
        tuple(value * np.exp(2j * np.pi * n * LATTICE_LAG) for n, value in enumerate(values))
        for values in (case.lift, case.moment)
    )
    return case._replace(lift=lift, moment=moment)


def wagner(s: float) -> float:
    """Return Wagner's function (1925), lift after a step: Theodorsen's, by Laplace along its branch cut; to 1e-6."""

    def decay(x: float) -> float:
        return float(np.exp(-s * x) / x**2 / ((k0(x) - k1(x)) ** 2 + (np.pi * (i0(x) + i1(x))) ** 2))

    pieces = ((0.0, 0.01), (0.01, 1.0), (1.0, 20.0))
    return 1.0 - sum(float(quad(decay, *piece, epsabs=1e-10)[0]) for piece in pieces)


def jones(s: ArrayLike) -> Array:
    """Return R. T. Jones's fit (1938) of Wagner's function."""
    x = np.asarray(s, float)
    return np.asarray(1.0 - sum(psi * np.exp(-eps * x) for psi, eps in zip(JONES_PSI, JONES_EPS, strict=True)))


def indicial_rise(aspect_ratio: float, s: ArrayLike) -> Array:
    """Return R. T. Jones's lift after a step (NACA TR 681, 1940), of an elliptic wing of aspect ratio 3 or 6."""
    size, rate = {3.0: (0.283, 0.540), 6.0: (0.361, 0.381)}[aspect_ratio]
    return np.asarray(1.0 - size * np.exp(-rate * np.asarray(s, float)))


def theodorsen(k: ArrayLike) -> NDArray[np.complex128]:
    """Return Theodorsen's function C(k) (1935): harmonic lift over its quasi-steady value, for e^(i w t), k > 0."""
    return np.asarray(hankel2(1, k) / (hankel2(1, k) + 1j * hankel2(0, k)))


def jones_harmonic(k: ArrayLike) -> NDArray[np.complex128]:
    """Return C(k) as it follows from R. T. Jones's fit."""
    s = 1j * np.asarray(k, float)
    return np.asarray(1.0 - sum(psi * s / (s + eps) for psi, eps in zip(JONES_PSI, JONES_EPS, strict=True)))


class Plunge(NamedTuple):
    """A plunging section: lift amplitude without and with added mass, mean thrust [N/m], propulsive efficiency."""

    circulatory: float
    lift: float
    thrust: float
    efficiency: float


def plunge(amplitude: float, frequency: float, airspeed: float, chord: float, air_density: float) -> Plunge:
    """Return lift after Theodorsen (1935), thrust and efficiency after Garrick (1936), of a plunging flat plate; SI."""
    # L = 2 pi rho U b h w |C|, with added mass |C + i k/2|; T = pi rho b (h w |C|)^2; efficiency |C|^2 / Re C.
    omega, semichord = 2.0 * np.pi * frequency, chord / 2.0
    k, speed = omega * semichord / airspeed, amplitude * omega
    lag = complex(theodorsen(k))
    quasi_steady = 2.0 * np.pi * air_density * airspeed * semichord * speed
    thrust = np.pi * air_density * semichord * (abs(lag) * speed) ** 2
    return Plunge(quasi_steady * abs(lag), quasi_steady * abs(lag + 0.5j * k), float(thrust), abs(lag) ** 2 / lag.real)


class Pitch(NamedTuple):
    """A pitching section, per span: amplitudes of lift [N/m] and nose-up moment about its axis [N], mean thrust."""

    lift: complex
    moment: complex
    thrust: float


def pitch(k: float, axis: float, amplitude: float, airspeed: float, semichord: float, lag: complex) -> Pitch:
    """Return lift and moment after Theodorsen (NACA TR 496, 1935), thrust after Garrick (TR 567, 1936), 1.225 kg/m3."""
    # With a the axis, in semichords behind mid-chord, Q = U th + b (1/2 - a) th', and th = amplitude e^(i w t):
    # L = pi rho b^2 (U th' - b a th'') + 2 pi rho U b C Q
    # M = -pi rho b^2 (b (1/2 - a) U th' + b^2 (1/8 + a^2) th'') + 2 pi rho U b^2 (a + 1/2) C Q
    # T = pi rho b / 2 (2 C Q - b th')^2 - th L
    rho, U, b, a = 1.225, airspeed, semichord, axis
    s = 1j * k * U / b
    rate, second = s * amplitude, s**2 * amplitude
    Q = U * amplitude + b * (0.5 - a) * rate
    lift = np.pi * rho * b**2 * (U * rate - b * a * second) + 2.0 * np.pi * rho * U * b * lag * Q
    moment = -np.pi * rho * b**2 * (b * (0.5 - a) * U * rate + b**2 * (0.125 + a**2) * second)
    moment += 2.0 * np.pi * rho * U * b**2 * (a + 0.5) * lag * Q
    suction = np.pi * rho * b / 4.0 * abs(2.0 * lag * Q - b * rate) ** 2
    return Pitch(complex(lift), complex(moment), float(suction - 0.5 * (amplitude * lift).real))


def elliptic(aspect_ratio: float, incidence: float) -> tuple[float, float]:
    """Return CL and CDi of an elliptic wing after Prandtl: CL = 2 pi a / (1 + 2/AR), CDi = CL^2 / (pi AR); [rad]."""
    lift = 2.0 * np.pi * incidence / (1.0 + 2.0 / aspect_ratio)
    return lift, lift**2 / (np.pi * aspect_ratio)


def rectangular(aspect_ratio: float, incidence: float) -> tuple[float, float]:
    """Return CL and CDi of a rectangular wing at an incidence [rad]: Glauert's series (1926), 60 odd terms."""
    # Gamma = 2 S U sum_n A_n sin(n t), mu = 2 pi c/(4 S): sum_n A_n sin(n t) (n mu/sin(t) + 1) = mu a, midway between
    # the angles of a `LiftingLine`; CL = pi AR A_1, CDi = pi AR sum_n n A_n^2.
    terms = np.arange(1, 120, 2)
    theta = (np.arange(len(terms)) + 0.5) * np.pi / (2 * len(terms))
    mu = 2.0 * np.pi / (4.0 * aspect_ratio)
    matrix = np.sin(np.outer(theta, terms)) * (terms * mu / np.sin(theta)[:, None] + 1.0)
    series = np.linalg.solve(matrix, np.full(len(terms), mu * incidence))
    return float(np.pi * aspect_ratio * series[0]), float(np.pi * aspect_ratio * (terms @ series**2))
