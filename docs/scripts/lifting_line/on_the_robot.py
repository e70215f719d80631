"""The section law that flies on the robot beside the line's own; for docs/lifting_line.md."""

from __future__ import annotations

import numpy as np
from ladder import OURS, THEORY
from matplotlib.figure import Figure
from support import references
from support.lattice_cases import stroke_of, wing
from support.section_law import STEPS, fly_on_links, plate, plate_drag

from aerobat_pin.aerodynamics import fly
from aerobat_pin.visualization import style


def law() -> Figure:
    """Return the robot's section law beside the line's own: a steady plate's drag, the flapping rectangle's thrust."""
    figure = Figure(figsize=(6.4, 3.2), layout="constrained")
    steady, pull = figure.subplots(1, 2)
    angles, marked = np.linspace(0.0, 90.0, 181), np.arange(5.0, 90.0, 5.0)
    steady.plot(angles, plate_drag(np.radians(angles)), **THEORY, label="closed form")
    steady.plot(marked, [plate(a)[1] for a in np.radians(marked)], **OURS, label="on the robot")
    steady.axhline(0.0, color=style.TRUTH, linestyle=":", label="potential flow")
    steady.set_xlabel("incidence [deg]")
    steady.set_ylabel("drag / (rho V Gamma) [-]")
    steady.set_ylim(-0.03, 0.6)
    steady.legend(loc="upper left")
    lattice, stroke, phase = references.LATTICE_FLAP, stroke_of("flap 30 deg"), np.arange(STEPS) / STEPS
    force, _ = fly_on_links(wing(), stroke)
    alone = fly(wing(), stroke, [0.0, *(4.0 + phase) / stroke.frequency]).force[1:]
    pull.plot(phase, force[:, 0], color=style.ESTIMATES[0], label="on the robot")
    pull.plot(phase, alone[:, 0], "--", color=style.ESTIMATES[1], label="line alone")
    pull.axhline(lattice.thrust_mean, color=style.TRUTH, linestyle=":", label="lattice, mean")
    pull.set_xlabel("time [cycles]")
    pull.set_ylabel("thrust [N]")
    pull.set_ylim(0.0, 0.2)
    pull.legend()
    return figure
