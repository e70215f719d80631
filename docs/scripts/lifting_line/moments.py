"""Moments and thrust beside lift: a pitching section, and the vortex lattice's cases; for docs/lifting_line.md."""

from functools import cache

import numpy as np
from ladder import OURS, THEORY
from matplotlib.figure import Figure
from support import references
from support.lattice_cases import errors, flown
from support.pages import table
from support.section_law import ENDLESS, STEPS, fly_on_links

from aerobat_pin.aerodynamics import LiftingLine, Stroke
from aerobat_pin.visualization import style

SPEED, SEMICHORD, ANGLE = 4.0, 0.05, 1e-3
AXES = {"1/4": -0.5, "1/2": 0.0, "3/4": 0.5}  # of the chord; semichords behind mid-chord
MARKED, LISTED = (0.05, 0.1, 0.2, 0.39, 0.7, 1.0, 2.0), (0.05, 0.1, 0.25, 0.39, 0.56, 0.8, 1.0, 2.0)
DRAWN = ("flap 30 deg", "plunge 10 mm", "pitch 5 deg")


def theory(k: float, axis: float, *, fit: bool = False) -> references.Pitch:
    """Return Theodorsen's and Garrick's section, with the exact C(k) or that of Jones's fit."""
    lag = (references.jones_harmonic if fit else references.theodorsen)(k)
    return references.pitch(k, axis, ANGLE, SPEED, SEMICHORD, complex(lag))


def on_links(k: float, axis: float) -> tuple[complex, complex]:
    """Return lift and moment of the robot's section law, pitching, per span."""
    line = LiftingLine(ENDLESS, 2.0 * SEMICHORD, strips=1, quarter_chord=(axis + 0.5) * SEMICHORD)
    stroke = Stroke(SPEED, frequency=k * SPEED / SEMICHORD / (2.0 * np.pi), pitch=ANGLE)
    force, moment = fly_on_links(line, stroke, max(4, int(np.ceil(80.0 * k / (2.0 * np.pi)))))
    turn = 2j * np.exp(-2j * np.pi * np.arange(STEPS) / STEPS) / STEPS / line.width.sum()
    return complex(force[:, 2] @ turn), complex(-moment[:, 1] @ turn)


def pitch() -> Figure:
    """A pitching section about three axes: lift and moment against Theodorsen, and what the fit of Jones costs."""
    figure = Figure(figsize=(6.4, 3.2), layout="constrained")
    axes, k = figure.subplots(1, 2), np.geomspace(0.05, 2.0, 60)
    scale = np.pi * 1.225 * SPEED**2 * SEMICHORD * ANGLE
    for (name, axis), line in zip(AXES.items(), ("-", "--", ":"), strict=True):
        exact = np.array([theory(x, axis)[:2] for x in k])
        ours = np.array([on_links(x, axis) for x in MARKED])
        for i, (panel, size) in enumerate(zip(axes, (2.0 * scale, 2.0 * scale * SEMICHORD), strict=True)):
            panel.plot(k, np.abs(exact[:, i]) / size, **{**THEORY, "linestyle": line}, label=f"axis at {name} chord")
            panel.plot(MARKED, np.abs(ours[:, i]) / size, **OURS, label="on the robot" if line == ":" else None)
    for panel, label in zip(axes, ("lift / steady lift [-]", "moment / (steady lift b) [-]"), strict=True):
        panel.set_xlabel("reduced frequency k [-]")
        panel.set_xscale("log")
        panel.set_ylim(bottom=0.0)
        panel.set_ylabel(label)
    axes[0].legend()
    return figure


def fit_table() -> str:
    """Return the error of Jones's fit against Theodorsen and Garrick by reduced frequency."""
    rows = []
    for k in LISTED:
        exact, fit = (complex(lag(k)) for lag in (references.theodorsen, references.jones_harmonic))
        plunge = abs((fit - exact) / (exact + 0.5j * k))
        row = [f"{k:g}", f"{100.0 * plunge:.1f}", f"{100.0 * (abs(fit / exact) ** 2 - 1.0):+.1f}"]
        for axis in AXES.values():
            pairs = zip(theory(k, axis, fit=True)[:2], theory(k, axis)[:2], strict=True)
            row.append(", ".join(f"{100.0 * abs(mine / theirs - 1.0):.1f}" for mine, theirs in pairs))
        rows.append(row)
    pitching = " | ".join(f"pitch about {name}: lift, moment" for name in AXES)
    return table(f"k | plunge: lift | thrust | {pitching}", rows)


@cache
def cases() -> tuple[Figure, str]:
    """The vortex lattice's five cases: lift, thrust, moments, centre of pressure; the figure and the table."""
    figure, rows = Figure(figsize=(6.8, 4.2), layout="constrained"), []
    panels = figure.subplots(2, len(DRAWN), sharex=True)
    phase = np.arange(STEPS + 1) / STEPS
    waves = np.exp(2j * np.pi * np.outer(phase, np.arange(4)))
    for name in references.LATTICE_CASES:
        exact = references.lattice(name)
        for robot in (False, True):
            found = flown(name, robot=robot)
            off = errors(found, exact)
            lift, moment = f"{off.lift_ratio:.3f}, {off.lift_phase:+.1f} deg", f"{off.moment:.2f}, {off.phase:+.1f} deg"
            shares = [f"{100.0 * off.lift:.1f} %", f"{off.thrust:.3f}", moment, f"{off.quarter:.2f}"]
            centre = f"{off.centre:.3f} ({off.lattice_centre:.3f})"
            rows.append([name, "robot" if robot else "`fly`", lift, *shares, centre])
            if name in DRAWN:
                look = {"color": style.ESTIMATES[int(robot)], "linestyle": "--" if robot else "-"}
                upper, lower = panels[:, DRAWN.index(name)]
                upper.plot(phase, (waves @ found.lift).real, **look, label="robot" if robot else "fly")
                lower.plot(phase, 1e3 * (waves[:, :2] @ found.moment).real, **look)
        if name in DRAWN:
            upper.plot(phase, (waves @ exact.lift).real, **{**THEORY, "linestyle": ":"}, label="lattice")
            lower.plot(phase, 1e3 * (waves[:, :2] @ exact.moment).real, **{**THEORY, "linestyle": ":"})
            upper.set_title(name)
            lower.set_xlabel("time [cycles]")
    panels[0, 0].set_ylabel("lift [N]")
    panels[1, 0].set_ylabel("moment [N mm],\nfirst harmonic")
    figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    head = "case | through | lift, phase | rms error | thrust | moment, phase | about 1/4 | centre of pressure"
    return figure, table(head, rows)
