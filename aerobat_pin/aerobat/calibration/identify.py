"""Identify parameters of a belief from free flights, by least squares on what the belief leaves unexplained.

The generalised residual of every interval is computed anew for each guess: known forces from `known_inputs`, momentum
from the changed model. Both low-passes of the redundancy take the derivative of the sensors' noise out; then every 5 ms
a sample counts, moments over 50 mm. Each parameter is expected to be near its believed value, which decides where the
flights do not: what they cannot tell apart is shared out instead of growing without bound.

    minimise   n_eff / n sum |L^T low-passed phi(theta)|^2 / allowed^2   +   sum (theta / expected)^2

n_eff is the number of independent samples that n samples of a periodic flight are worth.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from aerobat_pin.aerobat.calibration.free_flight import FreeFlight, interval_residual, unexplained, weighted
from aerobat_pin.aerobat.calibration.identified import Identified
from aerobat_pin.aerobat.calibration.parameters import PARAMETERS
from aerobat_pin.numerics import Array
from aerobat_pin.observers import slow_part

HELD_OUT = 0.25  # share of each flight, at its end, that checks the result
SPACING = 0.005  # [s] between samples that count
INDEPENDENT = 50.0  # samples of one row that a flight is worth: twice the harmonics that errors of the air have
IDENTIFICATION_STEP = 0.02  # of the expected deviation: difference for the derivatives
MOST_LINEARISATIONS = 8
FACTORS, SHIFT_LIMITS = (-0.7, 2.0), 0.04  # within which changes are sought: of factors [-], of lengths both ways [m]
SETTLED_COST = 1.0e-4  # relative change of the cost at which the search ends


def identify(
    flights: Sequence[FreeFlight], names: Sequence[str], *, always: bool, progress: Callable[[float], None] | None
) -> Identified:
    """Identify parameters from free flights.

    Args:
        flights: the flights.
        names: the parameters.
        always: whether the calibration uses the result even if it does not explain the flights.
        progress: called with the share that is done.
    """
    from scipy.optimize import least_squares

    expected = np.array([PARAMETERS[name].expected for name in names])
    allowed = max(unexplained(one, interval_residual(one.robot.model, one.inputs)).allowed for one in flights)
    known: dict[bytes, list[Array]] = {}
    done = [0]

    def rows(x: Array) -> list[Array]:
        """Return the rows of every flight, low-passed and thinned, with parameters x in expected deviations."""
        key = x.tobytes()
        if key not in known:
            values = dict(zip(names, (expected * x).tolist(), strict=True))
            known[key] = []
            for one in flights:
                inputs, robot = one.seen_with(values)
                series = slow_part(inputs.time, weighted(one, interval_residual(robot.model, inputs)))
                every = max(1, round(SPACING * len(series) / (inputs.time[-1] - inputs.time[0])))
                known[key].append(series[::every])
            done[0] += 1
            if progress is not None:
                progress(min(0.95, done[0] / (4.0 * (len(names) + 1))))
        return known[key]

    def cost(x: Array) -> Array:
        parts = [x]
        for series in rows(x):
            learnt = series[: _split(series)]
            parts.append(np.ravel(learnt) * np.sqrt(INDEPENDENT / len(learnt)) / allowed)
        return np.concatenate(parts)

    def slopes(x: Array) -> Array:
        here = cost(x)
        return np.column_stack(
            [(cost(x + IDENTIFICATION_STEP * unit) - here) / IDENTIFICATION_STEP for unit in np.eye(len(x))]
        )

    factor = np.array([PARAMETERS[name].unit == "1" for name in names])
    bounds = [
        np.where(factor, end, side * SHIFT_LIMITS) / expected for end, side in zip(FACTORS, (-1.0, 1.0), strict=True)
    ]
    found = least_squares(
        cost, np.zeros(len(names)), slopes, bounds, max_nfev=MOST_LINEARISATIONS, ftol=SETTLED_COST, xtol=SETTLED_COST
    )
    normal = np.linalg.inv(found.jac.T @ found.jac)
    before, after = (_rms_of_both(rows(x)) for x in (np.zeros(len(names)), found.x))
    scale = max(1.0, (after[0] / allowed) ** 2)
    result = Identified(
        names=tuple(names),
        values=expected * found.x,
        covariance=scale * normal * np.outer(expected, expected),
        kept=True,
        before=before,
        after=after,
        allowed=allowed,
    )
    return replace(result, kept=always or result.explains)


def _split(series: Array) -> int:
    """Return the number of samples that are not held out."""
    return max(1, int((1.0 - HELD_OUT) * len(series)))


def _rms_of_both(flights: Sequence[Array]) -> tuple[float, float]:
    """Return the rms of all rows in the flights' first parts, and in the parts held out."""
    learnt = np.concatenate([np.ravel(series[: _split(series)]) for series in flights])
    kept = np.concatenate([np.ravel(series[_split(series) :]) for series in flights])
    return float(np.sqrt(np.mean(learnt**2))), float(np.sqrt(np.mean(kept**2)))
