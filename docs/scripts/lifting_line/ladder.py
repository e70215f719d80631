"""The rungs that the lifting line alone is held to, one figure each, theory against ours; for docs/lifting_line.md."""

from __future__ import annotations

from typing import NamedTuple

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


class Rung(NamedTuple):
    """A figure, what it is called, and what it shows, with the errors of this run."""

    name: str
    title: str
    figure: Figure
    caption: str


def step() -> Rung:
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
    caption = (
        f"Lift after a step of incidence in two dimensions. The line gives R. T. Jones's fit of Wagner's function to "
        f"{power_of_ten(np.max(np.abs(ours - fit)))}; the fit itself is within {100 * np.max(np.abs(ours / exact - 1)):.1f} % of "
        f"Wagner's exact function up to s = {s[-1]:.0f}, worst at s = {s[np.argmax(np.abs(ours / exact - 1))]:.1f}."
    )
    return Rung("step", "Two dimensions: a step of incidence", figure, caption)


def harmonic() -> Rung:
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
    caption = (
        f"Harmonic lift in two dimensions. The line gives the C(k) of Jones's fit to {power_of_ten(np.max(np.abs(ours - fit)))}; "
        f"the fit itself is within {off.max():.2f} % of Theodorsen's C(k), worst at k = {k[np.argmax(off)]:.2f}."
    )
    return Rung("harmonic", "Two dimensions: harmonic lift", figure, caption)


def plunge() -> Rung:
    """A plunging section: lift with and without added mass after Theodorsen, suction after Garrick."""
    airspeed, chord, frequency, height, density = 4.0, 0.1, 5.0, 0.010, 1.225
    line, omega = LiftingLine(ENDLESS, chord, strips=1, air_density=density), 2.0 * np.pi * frequency
    theory = references.plunge(height, frequency, airspeed, chord, density)
    k, speed = omega * chord / 2.0 / airspeed, height * omega
    time = np.arange(3001) * 1e-3
    last = slice(-201, None)
    phase = time[last] * frequency - time[-201] * frequency
    turn = np.exp(2j * np.pi * phase)
    lag = complex(references.theodorsen(k))
    w = -speed * turn  # a wing that rises meets air from above
    quasi = np.pi * density * airspeed * chord
    figure, (lift, pull) = _pair(ratio=(1.0, 1.0))
    caption, errors = [], []
    for factor, c, style_theory, style_ours, label in (
        (1.0, lag + 0.5j * k, THEORY, OURS, "with added mass"),
        (0.0, lag, {**THEORY, "linestyle": "--"}, ALSO, "circulatory"),
    ):
        flight = fly(line, Stroke(airspeed, frequency=frequency, plunge=height), time, added_mass=factor)
        ours = flight.force[last, 2] / line.width[0]
        lift.plot(phase, quasi * (c * w).real, **style_theory, label=f"Theodorsen, {label}")
        lift.plot(phase[::10], ours[::10], **style_ours, label=f"line, {label}")
        size, expected = 2.0 * abs(np.fft.fft(ours[:-1])[1]) / 200, quasi * abs(c) * speed
        errors.append(f"{size:.4f} N/m {label} (theory {expected:.4f}, {100 * (size / expected - 1):+.1f} %)")
    thrust = flight.force[last, 0] / line.width[0]
    mean = thrust[:-1].mean()
    pull.plot(phase, np.pi * density * chord * (lag * w).real ** 2, **THEORY, label="Garrick")
    pull.plot(phase[::10], thrust[::10], **OURS, label="line, leading-edge suction")
    lift.set_ylabel("lift [N/m]")
    pull.set_ylabel("thrust [N/m]")
    for axis in (lift, pull):
        low, high = axis.get_ylim()
        axis.set_ylim(low, high + 0.35 * (high - low))
    _finish(figure, (lift, pull), "time [cycles]", columns=2)
    caption = (
        f"A section that plunges {1e3 * height:.0f} mm at {frequency:g} Hz and {airspeed:g} m/s, chord {chord:g} m, "
        f"k = {k:.2f}. Lift amplitude {' and '.join(errors)}; mean thrust {mean:.5f} N/m (Garrick "
        f"{theory.thrust:.5f}, {100 * (mean / theory.thrust - 1):+.1f} %)."
    )
    return Rung("plunge", "Two dimensions: a plunging section", figure, caption)


def steady() -> Rung:
    """Steady elliptic and rectangular wings against Prandtl and Glauert."""
    ratios, marked = np.linspace(2.5, 12.0, 40), np.array([3.0, 4.0, 6.0, 8.0, 10.0, 12.0])
    figure = Figure(figsize=(6.4, 3.2), layout="constrained")
    axes = figure.subplots(1, 2)
    worst = {}
    for name, theory, chord, line_style, mark in (
        ("elliptic", references.elliptic, lambda y, a: 4.0 / (np.pi * a) * np.sqrt(1.0 - 4.0 * y**2), "-", OURS),
        ("rectangular", references.rectangular, lambda y, a: np.full(y.shape, 1.0 / a), "--", ALSO),
    ):
        curves = np.array([theory(ratio, INCIDENCE) for ratio in ratios])
        ours = np.array(
            [LiftingLine(1.0, lambda y, a=a: chord(y, a)).steady_coefficients(INCIDENCE) for a in marked]  # noqa: B023
        )
        exact = np.array([theory(ratio, INCIDENCE) for ratio in marked])
        worst[name] = np.max(np.abs(ours / exact - 1.0), axis=0)
        source = "Prandtl" if name == "elliptic" else "Glauert"
        for i, axis in enumerate(axes):
            axis.plot(ratios, curves[:, i], **{**THEORY, "linestyle": line_style}, label=f"{source}, {name}")
            axis.plot(marked, ours[:, i], **mark, label=f"line, {name}")
    for axis, label in zip(axes, ("lift coefficient CL [-]", "induced drag coefficient CDi [-]"), strict=True):
        axis.set_ylabel(label)
        axis.set_xlabel("aspect ratio [-]")
    axes[0].legend()
    lift, drag = worst["rectangular"]
    caption = (
        f"Steady wings at 5 deg, 16 strips. On elliptic wings CL and CDi are Prandtl's to {power_of_ten(worst['elliptic'].max())}. "
        f"On rectangular ones they are those of Glauert's series, CL to {power_of_ten(lift)} and CDi to {power_of_ten(drag)}. At aspect "
        f"ratio 4 a vortex lattice gives CL 0.314: what is missing there is missing in every lifting line."
    )
    return Rung("steady", "Three dimensions: steady wings", figure, caption)


def start() -> Rung:
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
    lags = {}
    for ratio, colour in ((3.0, style.ESTIMATES[1]), (6.0, style.ESTIMATES[2])):
        wing = LiftingLine(1.0, lambda y, a=ratio: 4.0 / (np.pi * a) * np.sqrt(1.0 - 4.0 * y**2))
        lift = wing.step_response([*(s / 2.0 / ratio), 1e4], 1.0, 1.0) @ wing.width
        rise.plot(s, lift[:-1] / lift[-1], color=colour, label=f"line, aspect ratio {ratio:g}")
        rise.plot(s, references.indicial_rise(ratio, s), ":", color=colour, label=f"R. T. Jones, {ratio:g}")
        wanted = np.array([0.0, 1.0, 2.0, 5.0, 10.0])
        found = wing.step_response(wanted / 2.0 / ratio, 1.0, 1.0) @ wing.width / lift[-1]
        values = 100.0 * (found / references.indicial_rise(ratio, wanted) - 1.0)
        lags[ratio] = ", ".join(f"{value:+.1f}" for value in values)
    rise.set_ylabel("lift / final lift")
    for panel in (axis, rise):
        panel.set_xlabel("distance flown s [semichords]")
        panel.legend(loc="lower right")
    off = 100.0 * (coefficient(lattice[:, 0]) / lattice[:, 1] - 1.0)
    ratios = ", ".join(f"{value:+.1f} % at {where:g}" for value, where in zip(off, lattice[:, 0], strict=True))
    caption = (
        f"Impulsive start of a rectangular wing of aspect ratio 4 at 5 deg. Line against lattice: {ratios} semichords. "
        f"The line begins without downwash, with half the lift of endless sections, CL {coefficient(np.zeros(1))[0]:.3f}; "
        "the lattice begins lower.\n\n"
        f"Right, elliptic wings against R. T. Jones (NACA TR 681, 1940), s in mean semichords. At s = 0, 1, 2, 5 and 10 the line is off by {lags[3.0]} % at aspect "
        f"ratio 3 and by {lags[6.0]} % at 6. Jones's wing rises almost as fast as its own wake leaves; the line has Wagner's lag in every section, whatever the span, and "
        "then Prandtl's downwash."
    )
    return Rung("start", "Three dimensions: an impulsive start", figure, caption)


def flap() -> Rung:
    """The flapping rectangle against PteraSoftware."""
    lattice, frequency = references.LATTICE_FLAP, 5.0
    line, stroke = LiftingLine(0.40, 0.10), Stroke(4.0, frequency=frequency, flap=np.radians(30.0))
    time = np.linspace(0.0, 1.0, 1001)
    figure, (lift, pull) = _pair(ratio=(1.0, 1.0))
    phase = frequency * (time[-201:] - time[-201])
    found = {}
    for factor, line_style in ((1.0, "-"), (0.0, "--")):
        flight = fly(line, stroke, time, added_mass=factor)
        found[factor] = flight.force[-200:]
        label = "with added mass" if factor else "circulatory alone"
        colour = style.ESTIMATES[0] if factor else style.ESTIMATES[1]
        lift.plot(phase, flight.force[-201:, 2], line_style, color=colour, label=f"line, {label}")
    pull.plot(phase, flight.force[-201:, 0], color=style.ESTIMATES[0], label="line")
    rms, top, thrust = np.sqrt(np.mean(found[1.0][:, 2] ** 2)), np.abs(found[1.0][:, 2]).max(), found[1.0][:, 0].mean()
    for sign in (1.0, -1.0):
        _level(lift, sign * lattice.lift_max, "lattice, maximum" if sign > 0 else "", "-.")
        _level(lift, sign * lattice.lift_rms, "lattice, rms" if sign > 0 else "", ":")
    _level(pull, lattice.thrust_mean, "lattice, mean", "-.")
    pull.axhline(thrust, color=style.ESTIMATES[0], linestyle="--", linewidth=1.0, label="line, mean")
    lift.set_ylim(-0.65, 1.0)
    lift.set_ylabel("lift [N]")
    pull.set_ylabel("thrust [N]")
    pull.set_ylim(0.0, 0.2)
    _finish(figure, (lift, pull), "time [cycles]", columns=2)
    shares = [100.0 * (ours / theirs - 1.0) for ours, theirs in zip((rms, top, thrust), lattice, strict=True)]
    incidence = np.degrees(np.abs(flight.incidence).max())
    caption = (
        "A rectangular wing, 0.40 m x 0.10 m, that flaps 30 deg to both sides about its root at 5 Hz and 4 m/s. Against "
        f"PteraSoftware 5.1.0 (192 panels): lift rms {rms:.4f} N (lattice {lattice.lift_rms:g}, {shares[0]:+.1f} %), "
        f"maximum {top:.4f} N ({lattice.lift_max:g}, {shares[1]:+.1f} %), mean thrust {thrust:.4f} N "
        f"({lattice.thrust_mean:g}, {shares[2]:+.1f} %). Incidence at the outermost strip reaches {incidence:.0f} deg."
    )
    return Rung("flap", "Three dimensions: a flapping rectangle", figure, caption)


def _pair(ratio: tuple[float, float] = (2.0, 1.0)) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(6.2, 4.0), layout="constrained")
    return figure, list(figure.subplots(2, 1, sharex=True, height_ratios=ratio))


def _finish(figure: Figure, axes: list[Axes] | tuple[Axes, ...], label: str, columns: int = 1) -> None:
    axes[-1].set_xlabel(label)
    figure.align_ylabels(axes)
    for axis in axes:
        axis.legend(ncols=columns)


def _level(axis: Axes, value: float, label: str, line_style: str) -> None:
    axis.axhline(value, color=style.TRUTH, linestyle=line_style, linewidth=1.0, label=label or None)


def power_of_ten(value: float) -> str:
    """Round up to a power of ten, which does not depend on the machine."""
    return f"1e{int(np.ceil(np.log10(max(value, 1e-12))))}"


RUNGS = (step, harmonic, plunge, steady, start, flap)
