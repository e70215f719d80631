"""The section law that flies on the robot beside the line's own; for docs/lifting_line.md."""

from __future__ import annotations

import numpy as np
from ladder import OURS, THEORY, Rung
from matplotlib.figure import Figure
from support import references
from support.lattice_cases import stroke_of, wing
from support.section_law import STEPS, fly_on_links, plate, plate_drag

from aerobat_pin.aerodynamics import fly
from aerobat_pin.visualization import style

MARKED = (20.0, 30.0, 39.0)  # [deg]


def law() -> Rung:
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
    lift = force[:, 2]
    ours = references.FlapLoads(np.sqrt(np.mean(lift**2)), np.abs(lift).max(), force[:, 0].mean())
    pull.plot(phase, force[:, 0], color=style.ESTIMATES[0], label="on the robot")
    pull.plot(phase, alone[:, 0], "--", color=style.ESTIMATES[1], label="line alone")
    pull.axhline(lattice.thrust_mean, color=style.TRUTH, linestyle=":", label="lattice, mean")
    pull.set_xlabel("time [cycles]")
    pull.set_ylabel("thrust [N]")
    pull.set_ylim(0.0, 0.2)
    pull.legend()
    drags = ", ".join(f"{plate(np.radians(a))[1]:.2f} at {a:.0f} deg" for a in MARKED)
    rms, top, thrust = (100.0 * (mine / theirs - 1.0) for mine, theirs in zip(ours, lattice, strict=True))
    share = 100.0 * (alone[:, 0].mean() / lattice.thrust_mean - 1.0)
    caption = (
        "Left, the drag of a steady plate without ends, through the robot's kernel: s c (1 - c^3 (3 - c^2) / 2) times rho V Gamma, where "
        f"s and c are the sine and cosine of the incidence and Gamma is the circulation of the attached plate; {drags}. Right, the "
        f"flapping rectangle through the same kernel. Against the lattice: lift rms {ours.lift_rms:.4f} N ({rms:+.1f} %), maximum {ours.lift_max:.4f} N "
        f"({top:+.1f} %), mean thrust {ours.thrust_mean:.4f} N ({thrust:+.1f} %; the line alone {share:+.1f} %)."
    )
    return Rung("on_the_robot", "On the robot", figure, caption)
