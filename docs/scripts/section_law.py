"""Write docs/section_law.md and its figures: the section laws against measured plates and wings; `--check` compares it."""

from __future__ import annotations

from collections.abc import Iterator

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from support.high_incidence import (
    DICKINSON,
    LAWS,
    LIMIT_1,
    MOVING,
    POTENTIAL,
    RANGES,
    ROBOT,
    WING,
    errors,
    harmonic,
    plunge,
    steady,
    tapped,
)
from support.measurements import plates, plunging
from support.pages import HOLE, ROOT, Part, run

from aerobat_pin.aerobat import flight_motion
from aerobat_pin.aerobat.believed_air import reconstructed_air
from aerobat_pin.flight import simulate
from aerobat_pin.robot import flown_robot, rotations
from aerobat_pin.scenario import load_scenario
from aerobat_pin.visualization import style

PAGE, FIGURES = "docs/section_law.md", ROOT / "docs" / "figures" / "section_law"
LINES = dict(zip(LAWS, (style.VERMILLION, style.PURPLE, style.BLUE, style.GREEN, style.MUTED), strict=True))
STYLES = dict(zip(LAWS, ("-", "-.", "--", ":", (0, (1, 3))), strict=True))
FLIGHTS, BEYOND = ("paper", "paper_open_loop"), (20.0, 34.0, 40.0)  # [deg]; the plunging section reaches 34
CHANGES = (
    ("none", {}),
    ("2", {"lift_limit": 2.0}),
    ("1.5", {"lift_limit": 1.5}),
    ("1", {"lift_limit": 1.0}),
    ("Dickinson", {"model": "quasi_steady"}),
)

INTRODUCTION = """# The section law at high incidence

`make docs` writes this page. The measurements and their sources are in `tests/support/measurements.py`, the laws' forces on
them in `tests/support/high_incidence.py`, the tests in `tests/aerodynamics/test_high_incidence.py`.

In ordinary flapping the outer strips of the robot pass 40 to 60 degrees of incidence. Which law should they follow there?
Five are compared with what others measured at Reynolds numbers from 100 to 140 000. Aerobat's mean chord of 135 mm flies at
27 000 in `paper` and 45 000 in `paper_open_loop`, with reduced frequencies k = pi f c / V of 0.5 to 0.7; its outermost
strips have chords of 25 to 64 mm.

| law | how to choose it |
|---|---|
| robot | the default: [`strip_forces.py`](../aerobat_pin/aerodynamics/strip_forces.py), attached flow, suction that fades |
| limit 2, limit 1 | the same with `air.lift_limit` = 2 or 1 |
| Dickinson | `air.model = "quasi_steady"`: [`quasi_steady.py`](../aerobat_pin/aerodynamics/quasi_steady.py), a fit of a revolving fly's wing, Reynolds number 136 |
| potential flow | `fly`: all of the suction |

**Result.** A wing that stands still in the stream and a wing that flaps want different laws.

| case | nearest | the default |
|---|---|---|
| small incidence, Reynolds number 75 000 and more | all but Dickinson | normal force within 15 % up to 6 degrees, at aspect ratio 2 within 7 % up to 15 |
| steady, 16 to 40 degrees | limit 1 | has 1.2 to 2.4 times the measured normal force |
| steady, 40 to 90 degrees | limit 1 or 2 | too large up to 60 degrees, then too small: across the stream a plate has a drag of 1.2 to 1.5, this law only its profile drag |
| plunging and flapping, k from 0.26 to 0.94, up to 34 degrees | robot | lift amplitude within 10 % (root mean square), means not too large |
| flapping beyond 34 degrees | no measurement found | lies between steady plates and revolving wings |

So the default stays: attached flow without a limit. For a steady glide or a trim beyond 10 degrees of incidence without
flapping, set `air.lift_limit = 1`.
"""

STEADY = """Thin plates stall near 10 degrees, and from then on the force is normal to the plate: drag over lift is the tangent of
the incidence. That is said of plates of aspect ratio 0.4 to 9 at Reynolds numbers of 60 000 to 200 000 (Ortiz, Rival & Wood,
Energies 8 (2015) 2438) and of revolving hawkmoth wings (Usherwood & Ellington, J. Exp. Biol. 205 (2002) 1547): separation
at a sharp leading edge leaves no suction. The robot's law keeps some suction up to 60 degrees. Dickinson's wing revolves, and
the vortex at its leading edge stays: its normal force is about twice that of a plate in a straight stream. A table row is the
root mean square error of the force coefficient, lift and drag together; the smallest is bold.
"""

MOVED = """This section stalls at 9 degrees when it stands still. When it plunges, its lift goes on growing as attached flow says, and
its mean is larger than that. Perrotta (thesis, University of Maryland, 2017) found the same on a flat plate of aspect ratio 4
that plunges or meets gusts: its forces are nearer to attached than to separated flow, which speaks for a leading-edge vortex
that adds to the lift.
"""

UNKNOWN = """## What is not known

* **Flapping beyond 34 degrees.** The plunging section and the flapping wing end there. At 45 degrees and aspect ratio 2
  the default's normal force coefficient is 1.5, that of the towed plate 1.2, and Dickinson's 2.5.
* **Slow flapping.** Nothing here is slower than k = 0.16, and a stroke that is slow enough is a steady plate. The strips at
  the tips have k = 0.1 to 0.3 with their own chords.
* **Thrust.** None of these sources gives the force along the chord while the wing moves. On steady plates there is no
  suction beyond stall; the default keeps c (3 - c^2) / 2 of it.
* **Broadside.** Neither the default nor a limit has the drag of a plate across the stream. The incidences of the shipped
  flights end at 62 degrees.
* **The section.** The plunging one is a NACA 0012, not a membrane. Who measured it is our conclusion, see the source.
"""


def steady_figure() -> Figure:
    """Draw normal force, lift and drag over incidence, aspect ratio 2 above, wall to wall below."""
    figure, angles, named = Figure(figsize=(7.4, 5.4), layout="constrained"), np.arange(2.0, 91.0, 4.0), {}
    for row, (aspect_ratio, sets) in zip(
        figure.subplots(2, 3, sharex=True), ((2.0, (0, 2)), (None, (1,))), strict=True
    ):
        for law in LAWS:
            lift, drag = steady(law, aspect_ratio, angles)
            _three(row, angles, lift, drag, color=LINES[law], linestyle=STYLES[law], label=law.name)
        for at in sets:
            one = plates()[at]
            look = {"color": style.TRUTH, "linestyle": "none", "marker": "o^s"[at], "markersize": 3.5}
            _three(row, one.incidence, one.lift, one.drag, **look, markerfacecolor="none", label=one.name)
        for axis, name in zip(row, ("normal force", "lift", "drag"), strict=True):
            axis.set_ylabel(f"{name} / (rho/2 V² S)")
        for axis, top in zip(row, (3.6, 3.4 if aspect_ratio is None else 2.0, 3.6), strict=True):
            axis.set_ylim(-0.1, top)
        row[1].set_title("wall to wall" if aspect_ratio is None else f"aspect ratio {aspect_ratio:.0f}")
        row[1].set_xlabel("incidence [deg]" if aspect_ratio is None else "")
        named |= {line.get_label(): line for line in row[0].get_lines()}
    figure.legend(named.values(), named, loc="outside upper center", ncols=4)
    return figure


def _three(row: Axes, angles: np.ndarray, lift: np.ndarray, drag: np.ndarray, **look: object) -> None:
    normal = lift * np.cos(np.radians(angles)) + drag * np.sin(np.radians(angles))
    for axis, values in zip(row, (normal, lift, drag), strict=True):
        axis.plot(angles, values, **look)


def moving() -> tuple[Figure, str]:
    """Draw the plunging section and the flapping wing; return the figure and the text on the two."""
    figure = Figure(figsize=(7.4, 2.9), layout="constrained")
    *left, right = figure.subplots(1, 3)
    records, rows, off = plunging(), [], {law: [] for law in MOVING}
    for one in records:
        found = {law: np.array([plunge(law, one, k) for k in one.reduced_frequency]) for law in MOVING}
        for law in MOVING:
            off[law] += list(found[law][1:, 0] / one.first_harmonic[1:] - 1.0)
        ends = [f"{found[law][-1, 0]:.2f}, {abs(found[law][-1, 1]):.2f}" for law in MOVING]
        measured = f"{one.first_harmonic[-1]:.2f}, {one.least_mean[-1]:.2f} to {one.largest_mean[-1]:.2f}"
        rows.append(_row(f"{one.incidence:.0f}, up to {one.largest_incidence[-1]:.0f}", measured, *ends))
        for axis, at in zip(left, (0.0, 9.0), strict=True):
            if one.incidence == at:
                for law in MOVING:
                    look = {"color": LINES[law], "linestyle": STYLES[law], "label": law.name}
                    axis.plot(one.reduced_frequency, found[law][:, 0], **look)
                axis.plot(one.reduced_frequency, one.first_harmonic, "ko", markerfacecolor="none", label="measured")
                axis.set_title(f"plunging about {at:.0f} deg")
                axis.set_xlabel("reduced frequency k")
                axis.set_ylim(0.0, 2.5)
    left[0].set_ylabel("lift coefficient, first harmonic")
    left[0].legend(fontsize=6.5)
    force = 2.0 * WING.pressure @ WING.area
    right.plot(WING.cycles, 1e3 * force, "ko", markerfacecolor="none", markersize=3)
    readings = []
    for law in (*MOVING, POTENTIAL):
        ours, even = tapped(law), tapped(law, flat=True)
        if law in (ROBOT, LIMIT_1, DICKINSON):
            look = {"color": LINES[law], "linestyle": STYLES[law]}
            right.plot(WING.cycles, 1e3 * (even if law is DICKINSON else ours), **look)
        readings.append(_row(law.name, *(_reading(one, force) for one in (ours, even))))
    right.set_title("flapping")
    right.set_xlabel("time [flaps]")
    right.set_ylabel("force at the taps [mN]")
    spread = ", ".join(f"{law.name} {100 * np.sqrt(np.mean(np.square(off[law]))):.0f} %" for law in MOVING)
    ratio = np.ptp(WING.pressure[:, 0::3], axis=0) / np.ptp(WING.pressure[:, 2::3], axis=0)
    text = "\n".join(
        [
            "A NACA 0012 from wall to wall, Reynolds number 20 000, plunges half a chord from top to bottom. Left and middle: "
            f"first harmonic of its lift. Root mean square of the relative error for k of 0.31 and above: {spread}. The "
            "table has the first harmonic and the mean at k = 0.94; the measured means are the least and largest of four strokes.",
            "",
            _row("incidence [deg]", "measured", *(law.name for law in MOVING)),
            "|---" * (2 + len(MOVING)) + "|",
            *rows,
            "",
            MOVED,
            "Right: a rigid wing of 0.43 m span flaps 21 degrees to both sides about its root at 2.9 m/s and 3.3 Hz, tips up to "
            f"32 degrees, k = 0.26, Reynolds number 14 000. Nine pressures, their means taken off; the measured ones have a mean "
            "that a wing at no incidence should not have. The taps see an attached section's load 22 % too small, because "
            "most of it lies before the first one, so the laws are read as the taps would read them. That the load is so "
            f"distributed they say themselves: front taps swing {ratio.min():.1f} to {ratio.max():.1f} times as much as rear "
            "ones, and attached flow says 5. Error of the first harmonic's amplitude, its phase, and the rms of the difference over that of the "
            "force; the second column is for a load that is even along the chord, as in separated flow. Without the taps' own word on the "
            "distribution this bench would not tell the robot's law from limit 1.",
            "",
            _row("law", "as the taps read attached flow", "even load"),
            "|---|---|---|",
            *readings,
        ]
    )
    return figure, text


def _row(*cells: str) -> str:
    return f"| {' | '.join(cells)} |"


def _reading(ours: np.ndarray, force: np.ndarray) -> str:
    ratio = harmonic(ours) / harmonic(force)
    off = 100 * (ours - force).std() / force.std()
    return f"{100 * (abs(ratio) - 1):+.0f} %, {round(np.degrees(np.angle(ratio))):+d} deg, {off:.0f} %"


def steady_table() -> str:
    """Return the table of errors on the plates."""
    rows = [_row("plate", "incidence [deg]", *(law.name for law in LAWS)), "|---" * (2 + len(LAWS)) + "|"]
    for one in plates():
        found = np.array([errors(law, one) for law in LAWS])
        for (low, high), each in zip(RANGES, found.T, strict=True):
            if np.isfinite(each[0]):
                shown = [f"{x:.2f}" for x in each]
                best = min(shown)
                low, high = max(low, one.incidence[0]), min(high, one.incidence[-1])
                cells = [f"**{x}**" if x == best else x for x in shown]
                rows.append(_row(one.name, f"{low:.0f} to {high:.0f}", *cells))
    return "\n".join(rows) + "\n"


def flights(*, fly: bool) -> str:
    """Return what the laws do to shipped flights, with holes for the numbers if they are not flown."""
    shares, means = [], []
    for name in FLIGHTS:
        if not fly:
            shares.append(_row(f"`{name}`", *[HOLE] * (len(BEYOND) + 1)))
            means += [_row(f"`{name}`", change, HOLE, HOLE) for change, _ in CHANGES]
            continue
        scenario = load_scenario(name)
        robot, log = flown_robot(scenario), simulate(scenario)
        reached = np.degrees(np.abs(log.truth["incidence"].values))
        shares.append(
            _row(f"`{name}`", *(f"{100 * np.mean(reached > b):.0f} %" for b in BEYOND), f"{reached.max():.0f}")
        )
        turn = rotations(log.measured["q"].values[:-1])
        flap = round(1.0 / scenario.crank.frequency / scenario.simulation.dt)
        last = len(turn) // flap * flap - flap
        for change, values in CHANGES:
            air = scenario.air.model_copy(update=values)
            made = sum(reconstructed_air(robot, air, flight_motion(log, robot, air)).values())
            force = np.einsum("nij,nj->ni", turn, made[:, :3])[-last:].mean(axis=0) / (
                robot.mass * scenario.flight.gravity
            )
            means.append(_row(f"`{name}`", change, f"{force[2]:.3f}", f"{force[0]:+.3f}"))
    return "\n".join(
        [
            "Share of the time, mean over the strips, that a strip spends beyond an incidence, and the largest incidence:",
            "",
            _row("flight", *(f"beyond {b:.0f} deg" for b in BEYOND), "largest [deg]"),
            "|---" * (2 + len(BEYOND)) + "|",
            *shares,
            "",
            "Mean force of the air, with added mass, on the same motion under other laws, over the weight:",
            "",
            _row("flight", "limit", "lift", "thrust"),
            "|---|---|---|---|",
            *means,
            "",
        ]
    )


def section(title: str, name: str, text: str) -> str:
    """Return a section with its figure."""
    return f"## {title}\n\n![{title}](figures/section_law/{name}.png)\n\n{text}"


def write() -> None:
    """Draw the figures and write the page."""
    FIGURES.mkdir(parents=True, exist_ok=True)
    with mpl.rc_context(style.RC):
        steady_figure().savefig(FIGURES / "steady.png", metadata={"Software": None})
        figure, text = moving()
        figure.savefig(FIGURES / "moving.png", metadata={"Software": None})
    parts = [
        INTRODUCTION,
        section("Plates in a steady stream", "steady", STEADY),
        steady_table(),
        section("Wings that move", "moving", text + "\n"),
        "## The shipped flights\n",
        flights(fly=True),
        UNKNOWN,
    ]
    (ROOT / PAGE).write_text("\n".join(parts), encoding="utf-8")


def parts() -> Iterator[Part]:
    """Yield all parts; the numbers of the flights are left out."""
    for name, text in (("introduction", INTRODUCTION), ("steady", STEADY), ("what is not known", UNKNOWN)):
        yield Part(PAGE, name, text)
    yield Part(PAGE, "plates", steady_table())
    yield Part(PAGE, "wings that move", moving()[1])
    yield Part(PAGE, "flights", flights(fly=False))


if __name__ == "__main__":
    run(write, parts)
