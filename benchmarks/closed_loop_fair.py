"""Three laws of the closed loop, tuned alike, against the same disturbances: a table of docs/control_results.md.

    PYTHONPATH=tests python benchmarks/closed_loop_fair.py --seeds 10 --write

PD, PD with integral, and PD with integral and observer have the gains of `closed_loop_gains.json`, within the same
limits; beside them fly those that a study says. `closed_loop_search.py` says how each of ours was found. No flight of
these seeds served a choice. The figures of finished flights are kept in `--kept`, so that a stopped run goes on.
`--only` names the rows that are flown; the page keeps its others.
"""

import argparse
import datetime
import json
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from closed_loop import PAGE, flight
from closed_loop_search import GAINS, SCENARIO, settings_of
from support.pages import ROOT, cells, fill, table

from aerobat_pin.control import Controller, loop_margins, noise_slew, wrong_plant_ms
from aerobat_pin.scenario import load_scenario

FIRST_SEED = 721
GUST = "gust_closed_loop"
CALM = "unknown_force=[]"
FORCE = 'unknown_force=[{{frame="base_link", axes="world", direction=[0.0, 1.0, 0.0], {}}}]'
LATE = tuple(
    f"sensors.{name}.{key}" for name in ("position", "attitude", "velocity") for key in ("rate=100.0", "delay=0.01")
)
BELIEF = "believed.thrusters={lag=0.045, delay=0.001}"
SLOW, BEHIND = ("thrusters.lag=0.09", BELIEF), ("thrusters.delay=0.02", BELIEF)
OLD = ("sensors.velocity.delay=0.03", "believed.sensors.velocity.delay=0.0")
GUST_OF = "air.gust={{amplitude={}, start=0.7, duration={}}}"
TURBULENCE = "air.turbulence={{{{deviation={}, length={}, seed={{seed}}}}}}"
ALL_AXES = TURBULENCE.format("[1, 1, 1]", 1.0)
STILL = "believed.air={gust={amplitude=[0, 0, 0]}, turbulence={deviation=[0, 0, 0]}}"
CASES: dict[str, tuple[str, tuple[str, ...], str]] = {
    "push on the left wing": (SCENARIO, (), "y"),
    "2 mN sideways": (SCENARIO, (FORCE.format('signal="step", height=0.002, start=0.0'),), "y"),
    "lateral gust, 1.5 m/s": (GUST, (), "y"),
    "gust upwards, 1.5 m/s": (SCENARIO, (CALM, GUST_OF.format("[0, 0, 1.5]", 0.4), STILL), "z"),
    "lateral gust, 2 m/s over 0.4 s": (SCENARIO, (CALM, GUST_OF.format("[0, 2, 0]", 0.4), STILL), "y"),
    "lateral gust, 2 m/s over 0.8 s": (SCENARIO, (CALM, GUST_OF.format("[0, 2, 0]", 0.8), STILL), "y"),
    "turbulence sideways, 1 m/s, eddies of 1.6 m": (SCENARIO, (CALM, TURBULENCE.format("[0, 1, 0]", 1.6), STILL), "y"),
    "turbulence along all axes, 1 m/s, eddies of 1 m": (SCENARIO, (CALM, ALL_AXES, STILL), "y"),
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
LAWS = {"PD": "pd", "PD + I": "pd_i", "PD + I + observer": "observer"}
TRUTH = "truth for the estimate"
WITH_TRUTH = ("push on the left wing", "lateral gust, 1.5 m/s", "calm")
STUDIED: dict[str, tuple[float, float, float]] = {  # what the study says of its PD, PD with integral, observer's law
    "push on the left wing": (66.2, 12.4, 10.0),
    "2 mN sideways": (2.57, 0.32, 0.68),
    "lateral gust, 1.5 m/s": (23.3, 9.8, 9.0),
    "gust upwards, 1.5 m/s": (9.4, 4.8, 4.5),
    "lateral gust, 2 m/s over 0.4 s": (27.9, 12.0, 10.6),
    "turbulence sideways, 1 m/s, eddies of 1.6 m": (50.1, 16.2, 14.8),
    "side wind, 1 m/s": (96.2, 12.0, 8.2),
    "thruster 1 at 60 %": (21.2, 4.0, 3.8),
    "attitude off by 2 deg about each axis": (24.0, 7.0, 15.0),
    "calm": (0.31, 0.23, 0.96),
    "0.1 N sideways, sine of 0.3 Hz": (78.6, 16.7, 14.4),
    "0.1 N sideways, sine of 0.7 Hz": (48.3, 20.4, 16.9),
    "0.1 N sideways, sine of 1.0 Hz": (31.7, 23.1, 19.8),
    "0.1 N sideways, sine of 2.0 Hz": (9.6, 10.0, 10.6),
}
STUDY = ("its PD", "its observer's law")  # columns of the laws with the gains that it says


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


def median_of(found: dict[str, list[float]], case: str, column: str, what: int = 0) -> float | None:
    """Return the median over seeds of an error [m] (0) or of the commands' slew [N/s] (1); None if none was flown."""
    values = [row[what] for key, row in found.items() if key.startswith(f"{case}|{column}|")]
    return float(np.median(values)) if values else None


def values(found: dict[str, list[float]], known: dict[str, Any]) -> dict[str, str]:
    """Return what the page says; of a case that was not flown, its rows from before."""
    columns, before = [*LAWS, TRUTH], cells((ROOT / PAGE).read_text("utf-8"))
    flown = sorted({int(key.rsplit("|", 1)[1]) for key in found})
    anew = [case for case in CASES if f"{case}|PD|{flown[0]}" in found]
    counts = [sum(key.startswith(f"{case}|PD|") for key in found) for case in anew]
    number = f"{min(counts)} to {max(counts)}" if min(counts) < max(counts) else f"{counts[0]}"
    told = f"medians of {number} of the seeds {flown[0]} to {flown[-1]}; rms in mm"
    if len(anew) < len(CASES):
        named = ", ".join(f'"{case}"' for case in anew)
        told += f". So it is in {len(anew)} of the {len(CASES)} rows, {named}; the others are from before"
    rows: list[list[str]] = []
    for case, (_, _, axis) in CASES.items():
        if case not in anew:
            rows += [row for row in before if row[0] == f"{case}, {axis}"]
            continue
        errors = [median_of(found, case, column) for column in columns]
        shown = ["" if value is None else f"{1e3 * value:.2f}" for value in errors]
        best = min((float(cell) for cell in shown[:3] if cell), default=0.0)
        shown[:3] = [f"**{cell}**" if cell and float(cell) == best else cell for cell in shown[:3]]
        said = [f"{value:g}" for value in STUDIED[case][1:]] if case in STUDIED else ["", ""]
        rows.append([f"{case}, {axis}", *shown, *said])
    slew = [f"{median_of(found, 'push on the left wing', column, 1) or 0.0:.1f}" for column in LAWS]
    limits = [limits_of(law, known[law]["gains"]) for law in LAWS.values()]
    names = ("Ms of roll", "least delay margin of all axes", "largest Ms on a wrong plant", "slew by noise alone")
    limited = [("slew of the commands, pushed, N/s", slew), *zip(names, zip(*limits, strict=True), strict=True)]
    rows += [[name, *row, "", "", ""] for name, row in limited]
    study: list[list[str]] = []
    for case, (of_pd, _, of_observer) in STUDIED.items():
        here = [median_of(found, case, column) for column in STUDY]
        if None in here:
            study += [row for row in before if row[0] == case]
            continue
        of_this = [f"{1e3 * (one or 0.0):.2f}" for one in here]
        study.append([case, of_this[0], f"{of_pd:g}", of_this[1], f"{of_observer:g}"])
    return {
        "flown": f"{datetime.date.today()}; {told}",
        "fair": table(f"| {' | '.join(columns)} | study: PD + I | study: observer", rows),
        "study": table("| its PD, here | said | its observer's law, here | said", study),
    }


def flights(known: dict[str, Any]) -> dict[tuple[str, str], tuple[str, tuple[str, ...], str]]:
    """Return scenario, settings and axis of each case and column."""
    laws = {column: settings_of(law, known[law]["gains"]) for column, law in LAWS.items()}
    laws[TRUTH] = (*laws["PD + I + observer"], "control.source=filtered_truth")
    laws |= {column: settings_of(known[column]["law"], known[column]["gains"]) for column in STUDY}
    kept = {TRUTH: WITH_TRUTH, **dict.fromkeys(STUDY, tuple(STUDIED))}
    return {
        (case, column): (name, (*settings, *more), axis)
        for case, (name, more, axis) in CASES.items()
        for column, settings in laws.items()
        if case in kept.get(column, CASES)
    }


def main() -> None:
    """Fly, seed by seed, and write the page after each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--kept", type=Path, default=Path("build/closed_loop_fair.json"))
    parser.add_argument("--write", action="store_true", help=f"write what was flown into {PAGE}")
    parser.add_argument("--only", nargs="*", default=list(CASES), choices=list(CASES), metavar="ROW")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    known = json.loads(GAINS.read_text())
    found: dict[str, list[float]] = json.loads(options.kept.read_text()) if options.kept.exists() else {}
    options.kept.parent.mkdir(exist_ok=True)
    for seed in range(FIRST_SEED, FIRST_SEED + options.seeds):
        for (case, column), (name, settings, axis) in flights(known).items():
            key = f"{case}|{column}|{seed}"
            if key not in found and case in options.only:
                settings = tuple(one.format(seed=seed) if "{seed}" in one else one for one in settings)
                one = flight(name, settings, seed)
                found[key] = [float(one[axis]), float(one["slew"])]
                options.kept.write_text(json.dumps(found))
        told = values(found, known)
        print("\n\n".join(told.values()), flush=True)
        if options.write:
            fill(PAGE, told)


if __name__ == "__main__":
    main()
