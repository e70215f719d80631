"""Tune the three laws of the closed loop by one search, to the same limits.

    python benchmarks/closed_loop_search.py pd_i --minutes 30

Gains are natural frequencies, shares of damping, integrals and observer gains. A step changes all of a law's gains by
random factors (a (1 + 1) evolution strategy by the one-fifth rule); a candidate beyond a limit is not flown. What is
minimised is the geometric mean of y (z, in the gust upwards) over `FLOWN`, with seeds that `closed_loop_page.py` does
not show. The best so far and the state of the random numbers stand in `closed_loop_gains.json`, so that a stopped
search goes on.

What was run for the gains that are kept, on a machine that was busy: 3 minutes for the observer's law (12 candidates, 5
flown; the first point is that of a longer search that is not kept), 9 minutes for PD with integral, 1 for PD, in which
none was better than its first guess. The search of PD with integral had not come to its end: its gains of roll,
sideways and lead are those of a scan of 530 candidates by the linear model of `margins` (least response to a step
sideways, within the same limits); its first point on the other axes is an observer of first order beside PD, written
as PID: kp + K kd, kd + K J, K kp.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from closed_loop import flight

from aerobat_pin.control import Controller, loop_margins, noise_slew, wrong_plant_ms
from aerobat_pin.scenario import load_scenario

GAINS = Path(__file__).with_name("closed_loop_gains.json")
MOST_MS, LEAST_DELAY, MOST_SLEW = 2.4, 0.023, 27.0  # on wrong plants; of any axis [s]; by sensors' noise [N/s]
SCENARIO = "paper_left_closed_loop"
FLOWN = (  # scenario, settings, axis, seed
    (SCENARIO, (), "y", 411),
    ("gust_closed_loop", (), "y", 412),
    ("gust_closed_loop", ("air.gust.amplitude=[0.0, 0.0, 1.5]",), "z", 413),
)
SHARED = ("forward", "lateral", "height", "roll", "pitch", "yaw")
PARTS = {
    "pd": ("control.feedforward=false", "control.integral=false"),
    "pd_i": ("control.feedforward=false",),
    "observer": (),
}


def settings_of(law: str, gains: dict[str, Any]) -> tuple[str, ...]:
    """Return the settings of a law with these gains."""
    return (*PARTS[law], *(f"control.{key}={value}" for key, value in gains.items()))


def within_limits(law: str, gains: dict[str, Any]) -> dict[str, float] | None:
    """Return worst Ms, least delay margin and slew of a law, None if a limit is passed."""
    scenario = load_scenario(SCENARIO, settings_of(law, gains))
    margins = loop_margins(scenario).values()
    found = {"ms": max(wrong_plant_ms(scenario).values()), "delay": min(one.delay for one in margins)}
    if not all(one.stable for one in margins) or found["ms"] > MOST_MS or found["delay"] < LEAST_DELAY:
        return None
    found["slew"] = noise_slew(Controller(scenario))
    return found if found["slew"] <= MOST_SLEW else None


def cost(law: str, gains: dict[str, Any]) -> float:
    """Return the geometric mean of the errors [mm] over the flights of the search."""
    errors = [flight(name, (*settings_of(law, gains), *more), seed)[axis] for name, more, axis, seed in FLOWN]
    return float(1e3 * np.exp(np.mean(np.log(errors))))


def changed(gains: dict[str, Any], width: float, rng: np.random.Generator) -> dict[str, Any]:
    """Return gains with random factors."""
    new: dict[str, Any] = {}
    for key, value in gains.items():
        values = np.atleast_1d(value) * np.exp(width * rng.standard_normal(np.size(value)))
        new[key] = [round(float(one), 3) for one in values] if isinstance(value, list) else round(float(values[0]), 3)
    if "lead" in new:
        new["lead"] = min(max(new["lead"], 1.0), 10.0)
    return new


def main() -> int:
    """Search for some minutes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("law", choices=list(PARTS))
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    law, until = options.law, time.time() + 60.0 * options.minutes
    known = json.loads(GAINS.read_text())
    state = known[law]
    rng = np.random.default_rng([options.seed, state.get("tried", 0)])
    state.setdefault("width", 0.1)
    if "cost" not in state:
        state["limits"] = within_limits(law, state["gains"])
        state["cost"] = cost(law, state["gains"]) if state["limits"] else 1e9
        print(law, "start", state["cost"], state["limits"], flush=True)
    while time.time() < until:
        gains = changed(state["gains"], state["width"], rng)
        limits = within_limits(law, gains)
        state["tried"] = state.get("tried", 0) + 1
        better = False
        if limits is not None:
            state["flown"] = state.get("flown", 0) + 1
            found = cost(law, gains)
            better = found < state["cost"]
            if better:
                state.update(gains=gains, cost=found, limits=limits)
                print(f"{law} {state['tried']:4d} {found:7.3f} mm {limits} {gains}", flush=True)
        state["width"] = float(np.clip(state["width"] * (1.5 if better else 0.96), 0.01, 0.3))
        known = json.loads(GAINS.read_text())
        known[law] = state
        GAINS.write_text(json.dumps(known, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
