"""Write the tables and draw the figures of docs/lifting_line.md: the lifting line alone, rung by rung.

How many strips it takes, and how large a step they allow, is counted here.
"""

from collections.abc import Callable

import ladder
import moments
import numpy as np
from support.pages import ROOT, Values, run, save, table
from support.shed_wake import STEPS, flap_robot

from aerobat_pin import load_aerobat, load_scenario, simulate
from aerobat_pin.aerodynamics import LiftingLine
from aerobat_pin.observers import euler_angles

STRIPS = (8, 12, 16, 20, 40)
ON_THE_ROBOT = (8, 12, 16, 20, 24, 32, 40)
FREE = (16, 20, 24, 28, 32, 64)
AIRSPEED = 4.0  # [m/s]


def wings() -> dict[str, Callable[[int], LiftingLine]]:
    """Return the planforms, with a number of strips still to be said."""
    robot = load_aerobat().wing
    return {
        "rectangle": lambda strips: LiftingLine(0.40, 0.10, strips=strips),
        "ellipse": lambda strips: LiftingLine(0.40, lambda y: 0.1 * np.sqrt(1.0 - (y / 0.2) ** 2), strips=strips),
        "Aerobat": lambda strips: LiftingLine(robot.span, robot.chord, strips=strips),
    }


def robot_errors() -> str:
    """Return the errors of the flapping robot's lift against 160 strips, by number of strips."""
    exact = flap_robot(160, STEPS)[0][::10, 2]
    means, sizes = ["mean lift [%]"], ["rms of the error over rms of the lift [%]"]
    for count in ON_THE_ROBOT:
        lift = flap_robot(count, STEPS // 10)[0][:, 2]
        means.append(f"{100.0 * (lift.mean() / exact.mean() - 1.0):+.2f}")
        sizes.append(f"{100.0 * np.sqrt(np.mean((lift - exact) ** 2) / np.mean(exact**2)):.1f}")
    return table(f"strips | {' | '.join(map(str, ON_THE_ROBOT))}", [means, sizes])


def free_flights() -> str:
    """Return what becomes of the free flight `paper_open_loop` without unknown forces, by number of strips."""
    columns = [("distance in 2 s [m]", "height at the end [m]", "pitch [deg]")]
    for count in FREE:
        scenario = load_scenario("paper_open_loop", [f"air.strips={count}"]).model_copy(update={"unknown_force": []})
        q = simulate(scenario).measured["q"].values
        pitch = np.degrees(euler_angles(q)[:, 1])  # nose up
        columns.append((f"{q[-1, 0]:.2f}", f"{q[-1, 2]:+.2f}", f"{pitch.min():.1f} .. {pitch.max():.1f}"))
    return table(f"strips | {' | '.join(map(str, FREE))}", zip(*columns, strict=True))


def stable_steps() -> str:
    """Return Runge-Kutta's largest stable step [ms] by number of strips."""
    rows = []
    for name, wing in wings().items():
        limits = (runge_kutta_limit(wing(n).state_space(AIRSPEED).A) for n in STRIPS)
        rows.append([name, *(f"{1e3 * limit:.2f}" for limit in limits)])
    return table(f"strips | {' | '.join(map(str, STRIPS))}", rows)


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


def quick() -> Values:
    """Return the tables that take no time."""
    return {"docs/lifting_line.md": {"fit": moments.fit_table(), "steps": stable_steps()}}


def find() -> Values:
    """Draw every rung, and return the tables on flights and cases."""
    figures, (picture, cases) = {draw.__name__: draw() for draw in (*ladder.FIGURES, moments.pitch)}, moments.cases()
    save(figures | {"cases": picture}, ROOT / "docs" / "figures" / "lifting_line")
    return {"docs/lifting_line.md": {"cases": cases, "robot": robot_errors(), "flights": free_flights()}}


if __name__ == "__main__":
    run(find, quick)
