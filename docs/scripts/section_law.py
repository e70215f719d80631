"""Write the tables and figures of docs/section_law.md: the section laws against measured plates and wings."""

from collections.abc import Iterator
from functools import cache

import numpy as np
import support.high_incidence as section
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from support.measurements import plates, plunging
from support.pages import ROOT, Values, run, save, table

from aerobat_pin.aerobat import flight_motion, flown_robot
from aerobat_pin.aerobat.air.believed_air import reconstructed_air
from aerobat_pin.flight import simulate
from aerobat_pin.observers import rotations
from aerobat_pin.scenario import load_scenario
from aerobat_pin.visualization import style

LINES = dict(zip(section.LAWS, (style.VERMILLION, style.PURPLE, style.BLUE, style.GREEN, style.MUTED), strict=True))
STYLES = dict(zip(section.LAWS, ("-", "-.", "--", ":", (0, (1, 3))), strict=True))
FLIGHTS, BEYOND = ("paper", "paper_open_loop"), (20.0, 34.0, 40.0)  # [deg]; the plunging section reaches 34
CHANGES = (
    ("none", {}),
    ("2", {"lift_limit": 2.0}),
    ("1.5", {"lift_limit": 1.5}),
    ("1", {"lift_limit": 1.0}),
    ("Dickinson", {"model": "quasi_steady"}),
)


def steady_figure() -> Figure:
    """Draw normal force, lift and drag over incidence, aspect ratio 2 above, wall to wall below."""
    figure, angles, named = Figure(figsize=(7.4, 5.4), layout="constrained"), np.arange(2.0, 91.0, 4.0), {}
    panels = figure.subplots(2, 3, sharex=True)
    for row, (aspect_ratio, sets) in zip(panels, ((2.0, (0, 2)), (None, (1,))), strict=True):
        for law in section.LAWS:
            lift, drag = section.steady(law, aspect_ratio, angles)
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


@cache
def moving() -> tuple[Figure, dict[str, str]]:
    """Draw the plunging section and the flapping wing; return the figure and the tables on the two."""
    figure = Figure(figsize=(7.4, 2.9), layout="constrained")
    *left, right = figure.subplots(1, 3)
    rows: list[list[str]] = []
    for one in plunging():
        found = {law: np.array([section.plunge(law, one, k) for k in one.reduced_frequency]) for law in section.MOVING}
        ends = [f"{found[law][-1, 0]:.2f}, {abs(found[law][-1, 1]):.2f}" for law in section.MOVING]
        measured = f"{one.first_harmonic[-1]:.2f}, {one.least_mean[-1]:.2f} to {one.largest_mean[-1]:.2f}"
        rows.append([f"{one.incidence:.0f}, up to {one.largest_incidence[-1]:.0f}", measured, *ends])
        for axis, at in zip(left, (0.0, 9.0), strict=True):
            if one.incidence == at:
                for law in section.MOVING:
                    look = {"color": LINES[law], "linestyle": STYLES[law], "label": law.name}
                    axis.plot(one.reduced_frequency, found[law][:, 0], **look)
                axis.plot(one.reduced_frequency, one.first_harmonic, "ko", markerfacecolor="none", label="measured")
                axis.set_title(f"plunging about {at:.0f} deg")
                axis.set_xlabel("reduced frequency k")
                axis.set_ylim(0.0, 2.5)
    left[0].set_ylabel("lift coefficient, first harmonic")
    left[0].legend(fontsize=6.5)
    force = 2.0 * section.WING.pressure @ section.WING.area
    right.plot(section.WING.cycles, 1e3 * force, "ko", markerfacecolor="none", markersize=3)
    readings = []
    for law in (*section.MOVING, section.POTENTIAL):
        ours, even = section.tapped(law), section.tapped(law, flat=True)
        if law in (section.ROBOT, section.LIMIT_1, section.DICKINSON):
            look = {"color": LINES[law], "linestyle": STYLES[law]}
            right.plot(section.WING.cycles, 1e3 * (even if law is section.DICKINSON else ours), **look)
        readings.append([law.name, *(_reading(one, force) for one in (ours, even))])
    right.set_title("flapping")
    right.set_xlabel("time [flaps]")
    right.set_ylabel("force at the taps [mN]")
    names = " | ".join(law.name for law in section.MOVING)
    return figure, {
        "plunging": table(f"incidence [deg] | measured | {names}", rows),
        "taps": table("law | as the taps read attached flow | even load", readings),
    }


def _reading(ours: np.ndarray, force: np.ndarray) -> str:
    ratio = section.harmonic(ours) / section.harmonic(force)
    off = 100 * (ours - force).std() / force.std()
    return f"{100 * (abs(ratio) - 1):+.0f} %, {round(np.degrees(np.angle(ratio))):+d} deg, {off:.0f} %"


def steady_rows() -> Iterator[list[str]]:
    """Yield the errors on the plates."""
    for one in plates():
        errors_of = np.array([section.errors(law, one) for law in section.LAWS])
        for (low, high), each in zip(section.RANGES, errors_of.T, strict=True):
            if np.isfinite(each[0]):
                shown = [f"{x:.2f}" for x in each]
                cells = [f"**{x}**" if x == min(shown) else x for x in shown]
                yield [one.name, f"{max(low, one.incidence[0]):.0f} to {min(high, one.incidence[-1]):.0f}", *cells]


def flights() -> tuple[list[list[str]], list[list[str]]]:
    """Return rows of what the laws do to shipped flights: shares of the time beyond incidences, mean forces."""
    shares, means = [], []
    for name in FLIGHTS:
        scenario = load_scenario(name)
        robot, log = flown_robot(scenario), simulate(scenario)
        reached = np.degrees(np.abs(log.truth["incidence"].values))
        shares.append([f"`{name}`", *(f"{100 * np.mean(reached > b):.0f} %" for b in BEYOND), f"{reached.max():.0f}"])
        turn = rotations(log.measured["q"].values[:-1])
        flap = round(1.0 / scenario.crank.frequency / scenario.simulation.dt)
        last = len(turn) // flap * flap - flap
        for change, values in CHANGES:
            air = scenario.air.model_copy(update=values)
            wrench = sum(reconstructed_air(robot, air, flight_motion(log, robot, air)).values())
            force = np.einsum("nij,nj->ni", turn, wrench[:, :3])[-last:].mean(axis=0)
            x, _, z = force / (robot.mass * scenario.flight.gravity)
            means.append([f"`{name}`", change, f"{z:.3f}", f"{x:+.3f}"])
    return shares, means


def quick() -> Values:
    """Return the table that takes no time."""
    names = " | ".join(law.name for law in section.LAWS)
    return {"docs/section_law.md": {"plates": table(f"plate | incidence [deg] | {names}", steady_rows())}}


def find() -> Values:
    """Draw the figures, and return the tables on motions and flights."""
    picture, motions = moving()
    save({"steady": steady_figure(), "moving": picture}, ROOT / "docs" / "figures" / "section_law")
    shares, means = flights()
    beyond = " | ".join(f"beyond {b:.0f} deg" for b in BEYOND)
    tables = motions | {
        "shares": table(f"flight | {beyond} | largest [deg]", shares),
        "forces": table("flight | limit | lift | thrust", means),
    }
    return {"docs/section_law.md": tables}


if __name__ == "__main__":
    run(find, quick)
