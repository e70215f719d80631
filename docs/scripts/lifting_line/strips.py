"""How many strips a lifting line takes, and how large a step they allow; for docs/lifting_line.md."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import numpy as np
from ladder import INCIDENCE, Rung, power_of_ten
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter, ScalarFormatter
from support.flapping_robot import AIRSPEED as ROBOT_AIRSPEED
from support.flapping_robot import FREQUENCY, PITCH, STEPS, flap_robot
from support.pages import HOLE

from aerobat_pin.aerodynamics import LiftingLine, Stroke, fly
from aerobat_pin.flight import simulate
from aerobat_pin.robot import euler_angles, load_aerobat
from aerobat_pin.scenario import load_scenario
from aerobat_pin.visualization import style

STRIPS = (8, 12, 16, 20, 40)
ODD = (9, 13, 17, 21, 41)
ON_THE_ROBOT = (8, 12, 16, 20, 24, 32, 40)
FREE = (16, 20, 24, 28, 32, 64)
AIRSPEED, STEP = 4.0, 1e-3  # [m/s], [s] of the flights in this project


def wings() -> dict[str, Callable[[int], LiftingLine]]:
    """Return the planforms, with a number of strips still to be said."""
    robot = load_aerobat().wing
    return {
        "rectangle": lambda strips: LiftingLine(0.40, 0.10, strips=strips),
        "ellipse": lambda strips: LiftingLine(0.40, lambda y: 0.1 * np.sqrt(1.0 - (y / 0.2) ** 2), strips=strips),
        "Aerobat": lambda strips: LiftingLine(robot.span, robot.chord, strips=strips),
    }


def grid() -> Rung:
    """Return the error of steady and of flapping lift against many strips; of the robot in flapping flight, too."""
    figure = Figure(figsize=(6.4, 3.4), layout="constrained")
    axis = figure.add_subplot()
    found: dict[str, dict[int, float]] = {}

    def study(name: str, value: Callable[[int], float], counts: tuple[int, ...], reference: int) -> None:
        exact = value(reference)
        found[name] = {count: 100.0 * abs(value(count) / exact - 1.0) for count in counts}

    for name, wing in wings().items():
        study(f"{name}, steady", lambda n, wing=wing: wing(n).steady_coefficients(INCIDENCE)[0], STRIPS, 200)
    study("rectangle, flapping", flapping_lift, STRIPS, 80)
    study("rectangle, flapping, odd", flapping_lift, ODD, 80)
    robot = robot_errors(ON_THE_ROBOT)
    found["Aerobat, flapping on its links"] = {count: abs(mean) for count, (mean, _) in robot.items()}
    exact = found.pop("ellipse, steady")
    looks = (
        ("o", "-", style.LEFT),
        ("s", "--", style.ESTIMATES[0]),
        ("^", "-", style.INK),
        ("v", ":", style.MUTED),
        ("D", "-", style.ESTIMATES[2]),
    )
    for (name, errors), (mark, line, colour) in zip(found.items(), looks, strict=True):
        axis.loglog(list(errors), list(errors.values()), marker=mark, linestyle=line, color=colour, label=name)
    axis.axvline(16, color=style.MUTED, linewidth=0.8, linestyle="-.")
    axis.set_ylabel("error of lift [%]")
    _count_axis(figure, "lower right", columns=2)
    axis.set_ylim(bottom=1e-6)
    flap, aerobat = found["rectangle, flapping"], found["Aerobat, steady"]
    caption = (
        f"Error of the steady lift against 200 strips, and of the rms of the flapping rectangle's lift against 80. With 16 strips: "
        f"rectangle steady {found['rectangle, steady'][16]:.4f} %, flapping {flap[16]:.2f} %, Aerobat's planform "
        f"{aerobat[16]:.2f} %; the worst of these with 12 to 40 strips is {max(e[n] for e in (flap, aerobat) for n in STRIPS[1:]):.2f} %. "
        f"The elliptic wing, exact to {power_of_ten(max(exact.values()) / 100.0)} with any number, is not drawn. Odd numbers of strips have a "
        f"station in the kink that flapping makes at the root: with 17 the error is {found['rectangle, flapping, odd'][17]:.2f} %.\n\n"
        f"The robot flaps about its joints. The table has the lift of its strips over a flap, without added mass, against 160 strips, on a "
        f"prescribed motion: {ROBOT_AIRSPEED:g} m/s, {np.degrees(PITCH):.0f} deg nose up, {FREQUENCY:g} Hz.\n\n"
        f"{robot_table(robot)}\n\n{free_flights(FREE)}"
    )
    return Rung("strips", "How many strips", figure, caption)


def robot_errors(counts: tuple[int, ...]) -> dict[int, tuple[float, float]]:
    """Return the errors of the flapping robot's lift against 160 strips, by count: of its mean, and rms over rms [%]."""
    exact, found = flap_robot(160, STEPS)[0][::10, 2], {}
    for count in counts:
        lift = flap_robot(count, STEPS // 10)[0][:, 2]
        rms = np.sqrt(np.mean((lift - exact) ** 2) / np.mean(exact**2))
        found[count] = 100.0 * float(lift.mean() / exact.mean() - 1.0), 100.0 * float(rms)
    return found


def robot_table(errors: Mapping[int, tuple[float, float] | None]) -> str:
    """Return these errors as a table, with holes where there are none."""
    mean, rms = (
        " | ".join(HOLE if pair is None else form.format(pair[i]) for pair in errors.values())
        for i, form in enumerate(("{:+.2f}", "{:.1f}"))
    )
    return (
        f"| strips | {' | '.join(map(str, errors))} |\n|{'---|' * (len(errors) + 1)}\n"
        f"| mean lift [%] | {mean} |\n"
        f"| rms of the error over rms of the lift [%] | {rms} |"
    )


def free_flights(counts: tuple[int, ...]) -> str:
    """Return what becomes of the free flight `paper_open_loop` without unknown forces, by number of strips."""
    columns, distance = [], []
    for count in counts:
        scenario = load_scenario("paper_open_loop", [f"air.strips={count}"]).model_copy(update={"unknown_force": []})
        q = simulate(scenario).measured["q"].values
        pitch = np.degrees(euler_angles(q)[:, 1])  # nose up
        distance.append(q[-1, 0])
        columns.append((f"{q[-1, 0]:.2f}", f"{q[-1, 2]:+.2f}", f"{pitch.min():.1f} .. {pitch.max():.1f}"))
    spread = 100.0 * (max(distance) / min(distance) - 1.0)
    rows = zip(("distance in 2 s [m]", "height at the end [m]", "pitch [deg]"), zip(*columns, strict=True), strict=True)
    return (
        "The free flight `paper_open_loop`, here without unknown forces, adds up such errors for two seconds: its distance "
        f"spreads by {spread:.1f} %. It is trimmed with 16 strips. Where many strips need a shorter step than 1 ms, the flight "
        f"takes several in each interval.\n\n| strips | {' | '.join(map(str, counts))} |\n|{'---|' * (len(counts) + 1)}\n"
        + "\n".join(f"| {name} | {' | '.join(values)} |" for name, values in rows)
    )


def quick_parts() -> Iterator[tuple[str, str]]:
    """Yield name and text of what is quick to find of `grid`: the error of the steady robot, and of the flapping one two columns."""
    steady = [wings()["Aerobat"](count).steady_coefficients(INCIDENCE)[0] for count in (16, 200)]
    error = 100.0 * abs(steady[0] / steady[1] - 1.0)
    yield "16 strips on Aerobat's planform, steady", f"## How many strips{HOLE}Aerobat's planform {error:.2f} %"
    yield "strips of the flapping robot", robot_table(dict.fromkeys(ON_THE_ROBOT) | robot_errors((8, 16)))


def stable_step() -> Rung:
    """Return Runge-Kutta's largest stable step against the number of strips."""
    figure = Figure(figsize=(6.4, 3.2), layout="constrained")
    axis = figure.add_subplot()
    limits: dict[str, dict[int, float]] = {}
    for (name, wing), mark in zip(wings().items(), ("o", "s", "^"), strict=True):
        limits[name] = {count: runge_kutta_limit(wing(count).state_space(AIRSPEED).A) for count in STRIPS}
        colour = {"o": style.LEFT, "s": style.ESTIMATES[2], "^": style.ESTIMATES[0]}[mark]
        line = {"o": "-", "s": ":", "^": "--"}[mark]
        axis.loglog(STRIPS, 1e3 * np.array(list(limits[name].values())), line, marker=mark, color=colour, label=name)
    axis.axhline(
        1e3 * STEP, color=style.INK, linewidth=1.0, linestyle="-.", label=f"the flights' step, {1e3 * STEP:g} ms"
    )
    axis.set_ylabel("largest stable step [ms]")
    _count_axis(figure, "best")
    axis.set_yticks([1, 2, 5, 10, 20], ["1", "2", "5", "10", "20"])
    axis.yaxis.set_minor_formatter(NullFormatter())
    robot = limits["Aerobat"]
    rows = "\n".join(
        f"| {name} | {' | '.join(f'{1e3 * limit:.2f}' for limit in found.values())} |" for name, found in limits.items()
    )
    caption = (
        f"Largest step [ms] with which the classical fourth-order Runge-Kutta method is stable at {AIRSPEED:g} m/s, from the "
        "eigenvalues of A. It falls with the square of the number of strips and with the airspeed. With the flights' step of "
        f"{1e3 * STEP:g} ms, 40 strips on Aerobat's planform are stable only where the air passes a section at less than "
        f"{AIRSPEED * robot[40] / STEP:.1f} m/s. A flapping tip is faster, and such a flight diverges. 16 strips are stable up to "
        f"{AIRSPEED * robot[16] / STEP:.0f} m/s.\n\n"
        f"| strips | {' | '.join(map(str, STRIPS))} |\n|{'---|' * (len(STRIPS) + 1)}\n{rows}"
    )
    return Rung("stable_step", "How large a step", figure, caption)


def flapping_lift(strips: int) -> float:
    """Return the rms of the flapping rectangle's lift [N]."""
    stroke = Stroke(AIRSPEED, frequency=5.0, flap=np.radians(30.0))
    lift = fly(LiftingLine(0.40, 0.10, strips=strips), stroke, np.linspace(0.0, 1.0, 501)).force[-100:, 2]
    return float(np.sqrt(np.mean(lift**2)))


def runge_kutta_limit(matrix: np.ndarray) -> float:
    """Return the largest h [s] with |1 + z + z^2/2 + z^3/6 + z^4/24| <= 1 for z = h times each eigenvalue, bisected."""
    values = np.linalg.eigvals(matrix)
    low, high = 0.0, 4.0 / np.abs(values).max()
    for _ in range(40):
        middle = 0.5 * (low + high)
        z = middle * values
        grows = np.abs(1.0 + z * (1.0 + z / 2.0 * (1.0 + z / 3.0 * (1.0 + z / 4.0)))) > 1.0
        low, high = (low, middle) if grows.any() else (middle, high)
    return low


def _count_axis(figure: Figure, legend: str, columns: int = 1) -> None:
    (axis,) = figure.axes
    axis.set_xlabel("number of strips [-]")
    axis.set_xticks(STRIPS)
    axis.xaxis.set_major_formatter(ScalarFormatter())
    axis.xaxis.set_minor_formatter(NullFormatter())
    axis.legend(loc=legend, ncols=columns)
