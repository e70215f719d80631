"""Three laws of the closed loop, tuned alike, against the same disturbances: a table of docs/control_results.md.

    python benchmarks/closed_loop_fair.py --seeds 10 --page docs/control_results.md

PD, PD with integral, and PD with integral and observer have the gains of `closed_loop_gains.json`, which
`closed_loop_search.py` found within the same limits, by a linear model alone: no law has seen any of these flights.
The figures of finished flights are kept in `--kept`, so that a stopped run goes on.
"""

from __future__ import annotations

import argparse
import datetime
import json
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from closed_loop import flight
from closed_loop_page import Board
from closed_loop_search import GAINS, SCENARIO, settings_of

from aerobat_pin.control import Controller, loop_margins, noise_slew, wrong_plant_ms
from aerobat_pin.scenario import load_scenario

FIRST_SEED = 601
GUST = "gust_closed_loop"
CALM = "unknown_force=[]"
FORCE = 'unknown_force=[{{frame="base_link", axes="world", direction=[0.0, 1.0, 0.0], {}}}]'
LATE = tuple(
    f"sensors.{name}.{key}" for name in ("position", "attitude", "velocity") for key in ("rate=100.0", "delay=0.01")
)
BELIEF = "believed.thrusters={lag=0.045, delay=0.001}"
SLOW, BEHIND = ("thrusters.lag=0.09", BELIEF), ("thrusters.delay=0.02", BELIEF)
OLD = ("sensors.velocity.delay=0.03", "believed.sensors.velocity.delay=0.0")
CASES: dict[str, tuple[str, tuple[str, ...], str]] = {
    "push on the left wing": (SCENARIO, (), "y"),
    "2 mN sideways": (SCENARIO, (FORCE.format('signal="step", height=0.002, start=0.0'),), "y"),
    "lateral gust, 1.5 m/s": (GUST, (), "y"),
    "gust upwards, 1.5 m/s": (GUST, ("air.gust.amplitude=[0.0, 0.0, 1.5]",), "z"),
    "lateral gust, 2 m/s over 0.8 s": (GUST, ("air.gust={amplitude=[0.0, 2.0, 0.0], start=0.7, duration=0.8}",), "y"),
    "turbulence, Dryden, 1 m/s": (
        SCENARIO,
        (
            CALM,
            "air.turbulence={{deviation=[1.0, 1.0, 1.0], seed={seed}}}",
            "believed.air.turbulence.deviation=[0, 0, 0]",
        ),
        "y",
    ),
    "side wind, 1 m/s": (SCENARIO, (CALM, "air.wind=[0.0, 1.0, 0.0]", "believed.air.wind=[0.0, 0.0, 0.0]"), "y"),
    "thruster 1 at 60 %": (SCENARIO, (CALM, "thrusters.fault={thruster=1, factor=0.6}"), "z"),
    "attitude off by 2 deg about each axis": (SCENARIO, (CALM, "sensors.attitude.bias=0.0349"), "y"),
    "calm": (SCENARIO, (CALM,), "y"),
    **{
        f"0.1 N sideways, sine of {rate} Hz": (SCENARIO, (FORCE.format(f'signal="sine", frequency={rate}'),), "y")
        for rate in (0.3, 0.7, 1.0, 2.0)
    },
    "poses and velocity at 100 Hz, 10 ms late; calm": (SCENARIO, (CALM, *LATE), "y"),
    "the same, pushed": (SCENARIO, LATE, "y"),
    "thrust lag 90 ms, 45 believed; pushed": (SCENARIO, SLOW, "y"),
    "thrusters 20 ms late, 1 believed; pushed": (SCENARIO, BEHIND, "y"),
    "velocity 30 ms late, not known; pushed": (SCENARIO, OLD, "y"),
    "all three of them; pushed": (SCENARIO, (*SLOW[:1], *BEHIND[:1], *OLD, BELIEF), "y"),
}
WORDS = """Each law has gains of its own, within the same limits: Ms at most 2.4 on each of four wrong plants, a delay
margin of at least 23 ms, 27 N/s of slew by the sensors' noise (steering and pushes add to it). All seeds are new. PD
with integral was tuned to the edge of the limits by `benchmarks/closed_loop_search.py`, on a linear model, whose
disturbances were settled after looking at these flights with another seed. The observer's law has gains of an earlier
search, by the push and the gusts with other seeds, and stays inside the limits: where it is behind, part of that is
tuning. How fast the bias of the velocity is found was chosen for both by four of these flights, with another seed.

What the observer gives: 3 to 22 % less error of a push on a wing, of a short lateral gust, of a side wind and of sines
up to 1 Hz, and a law that twice the believed thrust lag does not upset. What it costs: PD with integral is ahead in
turbulence, in a long gust, in a gust upwards, in calm, where the attitude is off, and where thrusters are later than
believed. A 2 Hz push is faster than both: plain PD is best. With the truth in the place of its estimate, filtered
alike, a push and a gust change by 2 %: lag of the thrusters and authority bind, not estimation.

Three wrong beliefs at once leave only PD on its course. Lag and delay of the thrusters alone suffice: in the linear
model the roll loop of the observer's law is unstable with 90 ms of lag for 45 and 20 ms of delay for 1, with a velocity
on time or 30 ms late; that is more than the delay margin of 25 ms."""
LAWS = {"PD": "pd", "PD + I": "pd_i", "PD + I + observer": "observer"}
TRUTH = "truth for the estimate"
WITH_TRUTH = ("push on the left wing", "lateral gust, 1.5 m/s", "calm")


def limits_of(law: str, gains: dict[str, Any]) -> tuple[str, ...]:
    """Return the cells that say what a law bears."""
    scenario = load_scenario(SCENARIO, settings_of(law, gains))
    margins, wrong = loop_margins(scenario), wrong_plant_ms(scenario)
    name = max(wrong, key=lambda one: wrong[one])
    return (
        f"{margins['roll'].ms:.2f}",
        f"{1e3 * min(one.delay for one in margins.values()):.0f} ms",
        f"{wrong[name]:.2f} ({name})",
        f"{noise_slew(Controller(scenario)):.0f} N/s",
    )


def table(found: dict[str, list[float]], known: dict[str, Any]) -> list[str]:
    """Return the lines of the page."""
    columns = [*LAWS, TRUTH]
    flown = sorted({int(key.rsplit("|", 1)[1]) for key in found})
    counts = [sum(key.startswith(f"{case}|PD|") for key in found) for case in CASES]
    number = f"{min(counts)} to {max(counts)}" if min(counts) < max(counts) else f"{counts[0]}"
    told = f"medians of {number} of the seeds {', '.join(map(str, flown))}; rms in mm"
    lines = [f"Measured on {datetime.date.today()}; {told}.", "", WORDS, ""]
    lines += [f"| | {' | '.join(columns)} |", "|---" * (len(columns) + 1) + "|"]
    for case in CASES:
        cells = []
        for column in columns:
            values = [row[0] for key, row in found.items() if key.startswith(f"{case}|{column}|")]
            cells.append(f"{1e3 * np.median(values):.2f}" if values else "")
        best = min((float(cell) for cell in cells[:3] if cell), default=0.0)
        cells[:3] = [f"**{cell}**" if cell and float(cell) == best else cell for cell in cells[:3]]
        lines.append(f"| {case}, {CASES[case][2]} | {' | '.join(cells)} |")
    pushed = {
        column: [row[1] for key, row in found.items() if key.startswith(f"push on the left wing|{column}|")]
        for column in LAWS
    }
    cells = [f"{np.median(values):.1f}" if values else "" for values in pushed.values()]
    lines.append(f"| slew of the commands, pushed, N/s | {' | '.join(cells)} | |")
    limits = [limits_of(law, known[law]["gains"]) for law in LAWS.values()]
    names = ("Ms of roll", "least delay margin of all axes", "largest Ms on a wrong plant", "slew by noise alone")
    lines += [f"| {name} | {' | '.join(row)} | |" for name, row in zip(names, zip(*limits, strict=True), strict=True)]
    return lines


def main() -> int:
    """Fly, seed by seed, and write the page after each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--kept", type=Path, default=Path("build/closed_loop_fair.json"))
    parser.add_argument("--page", type=Path)
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    known = json.loads(GAINS.read_text())
    found: dict[str, list[float]] = json.loads(options.kept.read_text()) if options.kept.exists() else {}
    options.kept.parent.mkdir(exist_ok=True)
    for seed in range(FIRST_SEED, FIRST_SEED + options.seeds):
        for case, (name, more, axis) in CASES.items():
            for column in [*LAWS, *([TRUTH] if case in WITH_TRUTH else [])]:
                law = LAWS.get(column, "observer")
                key = f"{case}|{column}|{seed}"
                if key in found:
                    continue
                truth = ("control.source=filtered_truth",) if column == TRUTH else ()
                more = tuple(one.format(seed=seed) if "{seed}" in one else one for one in more)
                one = flight(name, (*settings_of(law, known[law]["gains"]), *truth, *more), seed)
                found[key] = [float(one[axis]), float(one["slew"])]
                options.kept.write_text(json.dumps(found))
        lines = table(found, known)
        print("\n".join(lines), flush=True)
        if options.page is not None:
            board = Board(options.page)
            board.section("fair", options.seeds)
            board.lines = [board.lines[0], "", *lines]
            board.write(options.page, "fair")
    return 0


if __name__ == "__main__":
    sys.exit(main())
