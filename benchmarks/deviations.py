"""Are the deviations that `kalman` and `smoother` state those of their errors? The table of docs/observers.md.

Forces, errors of the model and sensor noise are drawn from what the observers assume, on rails along the true motion of
a flight (`tests/support/rails.py`), and estimated with settings as they come. About a minute. The deviations of the
joint smoother are measured by `benchmarks/raw_sensors.py`.
"""

from collections.abc import Iterator

import numpy as np
from support.pages import Values, run, table
from support.rails import SENSORS, Rails

from aerobat_pin import load_scenario, simulate
from aerobat_pin.aerobat import FORCE_POINTS, believed_robot
from aerobat_pin.observers import KalmanObserver, SmootherObserver

FLIGHTS = ("paper", "observer_benchmark", "tumble")
LEARNING = 20  # first intervals, in which the observers do not know their sensors yet
HEAD = "flight | observer | error squared | inside 1.96 deviations | rms error [mN]"
DRAWS = 8


def rows() -> Iterator[list[str]]:
    """Yield a row for each flight, model and observer."""
    for name in FLIGHTS:
        scenario = load_scenario(name, ["simulation.duration=1.0"])
        log, model = simulate(scenario), believed_robot(scenario).model
        q, v = (np.asarray(log.measured[key].values, float) for key in ("q", "v"))
        for misfit in (True, False):
            rails = Rails(model, log.time, q, v, FORCE_POINTS, misfit)
            for kind in (KalmanObserver, SmootherObserver):
                observer, ratios, errors = kind(model, FORCE_POINTS, sensor_noise=SENSORS), [], []
                for seed in range(DRAWS):
                    measured, tau, force = rails.draw(seed)
                    found = observer.run(log.time, q, measured, tau)
                    error = (found.components - force)[LEARNING:]
                    ratios.append(error / found.standard_deviation[LEARNING:])
                    errors.append(error)
                label = name if misfit else f"{name}, exact model"
                inside = 100.0 * np.mean(np.abs(ratios) < 1.96)
                rms = 1e3 * np.sqrt(np.mean(np.square(errors)))
                squared = np.mean(np.square(ratios))
                yield [label, f"`{observer.name}`", f"{squared:.2f}", f"{inside:.1f} %", f"{rms:.1f}"]


def find() -> Values:
    """Return the table."""
    return {"docs/observers.md": {"deviations": table(HEAD, rows())}}


if __name__ == "__main__":
    run(find)
