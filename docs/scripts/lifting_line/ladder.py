"""The rungs that the lifting line alone is held to, a figure each, theory against ours; for docs/lifting_line.md."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from support import references
from support.section_law import ENDLESS

from aerobat_pin.aerodynamics import LiftingLine, Stroke, fly
from aerobat_pin.visualization import style

INCIDENCE = np.radians(5.0)
THEORY = {"color": style.TRUTH, "linewidth": 1.6}
OURS = {"color": style.ESTIMATES[0], "marker": "o", "markerfacecolor": "none", "markersize": 4.5, "linestyle": "none"}
ALSO = {**OURS, "color": style.ESTIMATES[1], "marker": "s"}


def step() -> Figure:
    """Two-dimensional step of incidence against Wagner and R. T. Jones."""
    s = np.linspace(0.0, np.sqrt(60.0), 121) ** 2  # closer where the lift grows
    line = LiftingLine(ENDLESS, 2.0, strips=1, air_density=1.0)
    ours = line.step_response(s, 1.0, 1.0)[:, 0] / (2.0 * np.pi)
    exact, fit = np.array([references.wagner(x) for x in s]), references.jones(s)
    figure, (main, error) = _pair()
    main.plot(s, exact, **THEORY, label="Wagner, exact")
    main.plot(s[::4], ours[::4], **OURS, label="lifting line without ends")
    main.set_ylim(0.45, 1.0)
    main.set_ylabel("lift / final lift")
    error.plot(s, 100.0 * (ours / exact - 1.0), "-", color=style.ESTIMATES[0], label="line against Wagner")
    error.plot(s, 100.0 * (ours / fit - 1.0), "--", color=style.INK, label="line against Jones's fit")
    error.set_ylabel("difference [%]")
    _finish(figure, (main, error), "distance flown s [semichords]")
    return figure


def harmonic() -> Figure:
    """Two-dimensional frequency response against Theodorsen and R. T. Jones."""
    k = np.geomspace(0.01, 10.0, 121)
    line = LiftingLine(ENDLESS, 2.0, strips=1, air_density=1.0)
    ours = line.frequency_response(k, 1.0)[:, 0] / (2.0 * np.pi)
    exact, fit = references.theodorsen(k), references.jones_harmonic(k)
    figure, (main, error) = _pair()
    main.plot(k, exact.real, **THEORY, label="Theodorsen, Re C")
    main.plot(k, -exact.imag, **{**THEORY, "linestyle": "--"}, label="Theodorsen, -Im C")
    main.plot(k[::3], ours.real[::3], **OURS, label="line, Re C")
    main.plot(k[::3], -ours.imag[::3], **ALSO, label="line, -Im C")
    main.set_ylabel("lift / quasi-steady lift")
    off = 100.0 * np.abs(ours / exact - 1.0)
    error.plot(k, off, "-", color=style.ESTIMATES[0], label="line against Theodorsen")
    error.plot(k, 100.0 * np.abs(ours / fit - 1.0), "--", color=style.INK, label="line against Jones's fit")
    error.set_ylabel("difference, |.| [%]")
    main.set_xscale("log")
    _finish(figure, (main, error), "reduced frequency k [-]")
    return figure


def plunge() -> Figure:
    """A plunging section: lift with and without added mass after Theodorsen, suction after Garrick."""
    airspeed, chord, frequency, height, density = 4.0, 0.1, 5.0, 0.010, 1.225
    line, omega = LiftingLine(ENDLESS, chord, strips=1, air_density=density), 2.0 * np.pi * frequency
    k, speed = omega * chord / 2.0 / airspeed, height * omega
    time = np.arange(3001) * 1e-3
    last = slice(-201, None)
    phase = time[last] * frequency - time[-201] * frequency
    turn = np.exp(2j * np.pi * phase)
    lag = complex(references.theodorsen(k))
    w = -speed * turn  # a wing that rises meets air from above
    quasi = np.pi * density * airspeed * chord
    figure, (lift, pull) = _pair(ratio=(1.0, 1.0))
    for factor, c, style_theory, style_ours, label in (
        (1.0, lag + 0.5j * k, THEORY, OURS, "with added mass"),
        (0.0, lag, {**THEORY, "linestyle": "--"}, ALSO, "circulatory"),
    ):
        flight = fly(line, Stroke(airspeed, frequency=frequency, plunge=height), time, added_mass=factor)
        ours = flight.force[last, 2] / line.width[0]
        lift.plot(phase, quasi * (c * w).real, **style_theory, label=f"Theodorsen, {label}")
        lift.plot(phase[::10], ours[::10], **style_ours, label=f"line, {label}")
    thrust = flight.force[last, 0] / line.width[0]
    pull.plot(phase, np.pi * density * chord * (lag * w).real ** 2, **THEORY, label="Garrick")
    pull.plot(phase[::10], thrust[::10], **OURS, label="line, leading-edge suction")
    lift.set_ylabel("lift [N/m]")
    pull.set_ylabel("thrust [N/m]")
    for axis in (lift, pull):
        low, high = axis.get_ylim()
        axis.set_ylim(low, high + 0.35 * (high - low))
    _finish(figure, (lift, pull), "time [cycles]", columns=2)
    return figure


def steady() -> Figure:
    """Steady elliptic and rectangular wings against Prandtl and Glauert."""
    ratios, marked = np.linspace(2.5, 12.0, 40), np.array([3.0, 4.0, 6.0, 8.0, 10.0, 12.0])
    figure = Figure(figsize=(6.4, 3.2), layout="constrained")
    axes = figure.subplots(1, 2)
    for name, theory, chord, line_style, mark in (
        ("elliptic", references.elliptic, lambda y, a: 4.0 / (np.pi * a) * np.sqrt(1.0 - 4.0 * y**2), "-", OURS),
        ("rectangular", references.rectangular, lambda y, a: np.full(y.shape, 1.0 / a), "--", ALSO),
    ):
        curves = np.array([theory(ratio, INCIDENCE) for ratio in ratios])
        ours = np.array(
            [LiftingLine(1.0, lambda y, a=a: chord(y, a)).steady_coefficients(INCIDENCE) for a in marked]  # noqa: B023
        )
        source = "Prandtl" if name == "elliptic" else "Glauert"
        for i, axis in enumerate(axes):
            axis.plot(ratios, curves[:, i], **{**THEORY, "linestyle": line_style}, label=f"{source}, {name}")
            axis.plot(marked, ours[:, i], **mark, label=f"line, {name}")
    for axis, label in zip(axes, ("lift coefficient CL [-]", "induced drag coefficient CDi [-]"), strict=True):
        axis.set_ylabel(label)
        axis.set_xlabel("aspect ratio [-]")
    axes[0].legend()
    return figure


def start() -> Figure:
    """Impulsive start of a rectangular wing against an unsteady vortex lattice."""
    line = LiftingLine(4.0, 1.0, air_density=1.0)
    s = np.concatenate([[0.0], np.geomspace(0.1, 12.0, 60)])
    lattice = np.array(list(references.LATTICE_START.items()))

    def coefficient(distance: np.ndarray) -> np.ndarray:
        return 2.0 * line.step_response(distance / 2.0, 1.0, INCIDENCE) @ line.width / line.area

    figure = Figure(figsize=(6.8, 3.2), layout="constrained")
    axis, rise = figure.subplots(1, 2)
    axis.plot(s, coefficient(s), color=style.ESTIMATES[0], label="lifting line, 16 strips")
    axis.plot(*lattice.T, "o", color=style.TRUTH, label="unsteady vortex lattice")
    axis.axhline(line.steady_coefficients(INCIDENCE)[0], color=style.MUTED, linestyle=":", label="line, steady")
    axis.set_ylabel("lift coefficient CL [-]")
    for ratio, colour in ((3.0, style.ESTIMATES[1]), (6.0, style.ESTIMATES[2])):
        wing = LiftingLine(1.0, lambda y, a=ratio: 4.0 / (np.pi * a) * np.sqrt(1.0 - 4.0 * y**2))
        lift = wing.step_response([*(s / 2.0 / ratio), 1e4], 1.0, 1.0) @ wing.width
        rise.plot(s, lift[:-1] / lift[-1], color=colour, label=f"line, aspect ratio {ratio:g}")
        rise.plot(s, references.indicial_rise(ratio, s), ":", color=colour, label=f"R. T. Jones, {ratio:g}")
    rise.set_ylabel("lift / final lift")
    for panel in (axis, rise):
        panel.set_xlabel("distance flown s [semichords]")
        panel.legend(loc="lower right")
    return figure


def _pair(ratio: tuple[float, float] = (2.0, 1.0)) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(6.2, 4.0), layout="constrained")
    return figure, list(figure.subplots(2, 1, sharex=True, height_ratios=ratio))


def _finish(figure: Figure, axes: list[Axes] | tuple[Axes, ...], label: str, columns: int = 1) -> None:
    axes[-1].set_xlabel(label)
    figure.align_ylabels(axes)
    for axis in axes:
        axis.legend(ncols=columns)


FIGURES = (step, harmonic, plunge, steady, start)
