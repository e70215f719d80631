"""Measure whether the deviations that `kalman` and `smoother` state are those of their errors, and write the table.

PYTHONPATH=tests python benchmarks/deviations.py [--draws 8] [--write docs/observers.md]

Forces, errors of the model and sensor noise are drawn from what the observers assume, on rails along the true motion of
a flight (`tests/support/rails.py`), and estimated with settings as they come. About a minute. The deviations of the
joint smoother are measured by `benchmarks/raw_sensors.py`.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from support.rails import SENSORS, Rails

from aerobat_pin import load_scenario, simulate
from aerobat_pin.observers import KalmanObserver, SmootherObserver
from aerobat_pin.robot import FORCE_POINTS, believed_robot

FLIGHTS = ("paper", "observer_benchmark", "tumble")
LEARNING = 20  # first intervals, in which the observers do not know their sensors yet
BEGIN, END = "<!-- deviations -->\n", "<!-- /deviations -->"
HEAD = """| flight | observer | error squared | inside 1.96 deviations | rms error [mN] |
|---|---|---|---|---|
"""


def rows(draws: int) -> Iterator[str]:
    """Yield a row for each flight, model and observer."""
    for name in FLIGHTS:
        scenario = load_scenario(name, ["simulation.duration=1.0"])
        log, model = simulate(scenario), believed_robot(scenario).model
        assert log.truth is not None
        q, v = (np.asarray(log.measured[key].values, float) for key in ("q", "v"))
        for misfit in (True, False):
            rails = Rails(model, log.time, q, v, FORCE_POINTS, misfit)
            for kind in (KalmanObserver, SmootherObserver):
                observer, ratios, errors = kind(model, FORCE_POINTS, sensor_noise=SENSORS), [], []
                for seed in range(draws):
                    measured, tau, force = rails.draw(seed)
                    found = observer.run(log.time, q, measured, tau)
                    assert found.standard_deviation is not None
                    error = (found.components - force)[LEARNING:]
                    ratios.append(error / found.standard_deviation[LEARNING:])
                    errors.append(error)
                label = name if misfit else f"{name}, exact model"
                inside = 100.0 * np.mean(np.abs(ratios) < 1.96)
                rms = 1e3 * np.sqrt(np.mean(np.square(errors)))
                yield f"| {label} | `{observer.name}` | {np.mean(np.square(ratios)):.2f} | {inside:.1f} % | {rms:.1f} |"


def main() -> None:
    """Measure and print the table, or write it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--draws", type=int, default=8)
    parser.add_argument("--write", type=Path)
    chosen = parser.parse_args()
    lines = []
    for row in rows(chosen.draws):
        print(row, flush=True)
        lines.append(row)
    if chosen.write is not None:
        text = chosen.write.read_text(encoding="utf-8")
        before, after = text.split(BEGIN)[0], text.split(END)[1]
        chosen.write.write_text(before + BEGIN + HEAD + "\n".join(lines) + "\n" + END + after, encoding="utf-8")


if __name__ == "__main__":
    main()
