"""Identify parameters of a belief from free runs, by least squares on what the belief leaves unexplained.

The generalised residual of every interval is computed anew for each guess: known forces and momentum from the changed
robot. Both low-passes of the redundancy take the derivative of the sensors' noise out; then every 5 ms a sample counts,
moments over 50 mm. Each parameter is expected to be near its believed value, which decides where the runs do not: what
they cannot tell apart is shared out instead of growing without bound.

    minimise   n_eff / n sum |L^T low-passed phi(theta)|^2 / allowed^2   +   sum (theta / expected)^2

n_eff is the number of independent samples that n samples of a periodic run are worth.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from aerobat_pin.estimation.calibration.free_run import HELD_OUT, FreeRun
from aerobat_pin.numerics import Array
from aerobat_pin.observers import force_size, slow_part
from aerobat_pin.records import Parameter

SPACING = 0.005  # [s] between samples that count
INDEPENDENT = 50.0  # samples of one row that a run is worth: twice the harmonics that errors of the air have
IDENTIFICATION_STEP = 0.02  # of the expected deviation: difference for the derivatives
MOST_LINEARISATIONS = 12
FACTORS, SHIFT_LIMITS = (-0.7, 2.0), 0.04  # within which changes are sought: of factors [-], of lengths both ways [m]
SETTLED_COST = 1.0e-4  # relative change of the cost at which the search ends
UNSURE = 0.5  # of the deviation expected beforehand: a parameter that is known less well is not identifiable
SAME_EFFECT = 0.8  # correlation from which two parameters are said to do the same
BEYOND = 3.0  # expected deviations: a larger change is taken for the error of something else


@dataclass(frozen=True)
class Identified:
    """Parameters that were identified; errors in N per row with moments over 50 mm."""

    parameters: Mapping[str, Parameter]  # name -> unit and expected deviation of each of the n parameters
    values: Array  # (n,) their changes
    covariance: Array  # (n, n) of the changes
    kept: bool  # whether the calibration uses them
    before: tuple[float, float]  # rms of what the belief leaves unexplained in the runs' first part, and held out
    after: tuple[float, float]  # the same with the changed parameters
    allowed: float  # largest error that counts as explained

    @property
    def used(self) -> dict[str, float]:
        """Parameter -> change, as the calibration uses it."""
        return dict(zip(self.parameters, self.values.tolist(), strict=True)) if self.kept else {}

    @property
    def deviations(self) -> Array:
        """Standard deviations (n,) of the changes."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def explains(self) -> bool:
        """Whether the changes explain the part of the runs that was held out."""
        return self.after[1] <= self.allowed

    @property
    def unidentifiable(self) -> dict[str, list[str]]:
        """Parameter that the runs do not show -> those that do the same."""
        deviations, names = self.deviations, list(self.parameters)
        alike = np.abs(self.covariance) / np.outer(deviations, deviations) > SAME_EFFECT
        return {
            name: [other for j, other in enumerate(names) if j != i and alike[i, j]]
            for i, name in enumerate(names)
            if deviations[i] > UNSURE * self.parameters[name].expected
        }

    @property
    def fudge(self) -> list[str]:
        """Parameters that took up the error of something else: all of them unless they explain, else the far ones."""
        far = np.abs(self.values) > BEYOND * np.array([parameter.expected for parameter in self.parameters.values()])
        return [name for name, wide in zip(self.parameters, far, strict=True) if wide or not self.explains]

    def describe(self) -> list[str]:
        """Return the result in lines of text."""
        lines = [
            f"belief off by {_both(self.before)}; with other parameters {_both(self.after)} "
            f"({force_size(self.allowed)} count as explained)"
        ]
        hidden = self.unidentifiable
        changes = zip(self.parameters.items(), self.values, self.deviations, strict=True)
        for (name, parameter), value, deviation in changes:
            unit, factor = ("mm", 1e3) if parameter.unit == "m" else ("%", 1e2)
            line = f"  {name:<15} {factor * value:+8.2f} {unit:<2}  deviation {factor * deviation:.2g} {unit}"
            if name in hidden:
                line += "   not identifiable" + (f": {', '.join(hidden[name])} does the same" if hidden[name] else "")
            lines.append(line)
        if not self.explains:
            lines.append(
                "  these numbers do not explain the runs: they are fudge for an error of another kind, and are "
                + ("used because they were asked for by name" if self.kept else "not used")
            )
        elif self.fudge:
            lines.append(f"  far from what was expected, so perhaps fudge for another error: {', '.join(self.fudge)}")
        return lines


def identify(
    runs: Sequence[FreeRun],
    parameters: Mapping[str, Parameter],
    *,
    always: bool,
    progress: Callable[[float], None] | None,
) -> Identified:
    """Identify parameters from free runs, which are as believed at first.

    `always` says whether the calibration uses the result even if it does not explain the runs.
    """
    from scipy.optimize import least_squares

    expected = np.array([parameter.expected for parameter in parameters.values()])
    allowed = max(run.judged().allowed for run in runs)
    known: dict[bytes, list[list[Array]]] = {}

    def rows(x: Array) -> list[list[Array]]:
        """Return `_thinned` of every run, with parameters x in expected deviations."""
        key = x.tobytes()
        if key not in known:
            values = dict(zip(parameters, (expected * x).tolist(), strict=True))
            known[key] = [_thinned(run.with_values(values)) for run in runs]
            if progress is not None:
                progress(min(0.95, len(known) / (4.0 * (len(parameters) + 1))))
        return known[key]

    def cost(x: Array) -> Array:
        parts = [np.ravel(learnt) * np.sqrt(INDEPENDENT / len(learnt)) / allowed for learnt, _ in rows(x)]
        return np.concatenate([x, *parts])

    last: list[Array] = []  # x, cost and slopes of the step before

    def slopes(x: Array) -> Array:
        """Return slopes: differences at the first x, then what the last step showed in its own direction."""
        here = cost(x)
        if last:
            step = x - last[0]
            J = last[2] + np.outer(here - last[1] - last[2] @ step, step) / (step @ step)
        else:
            units = IDENTIFICATION_STEP * np.eye(len(x))
            J = np.column_stack([(cost(x + unit) - here) / IDENTIFICATION_STEP for unit in units])
        last[:] = x.copy(), here, J
        return J

    factor = np.array([parameter.unit == "1" for parameter in parameters.values()])
    bounds = [
        np.where(factor, end, side * SHIFT_LIMITS) / expected for end, side in zip(FACTORS, (-1.0, 1.0), strict=True)
    ]
    solution = least_squares(
        cost,
        np.zeros(len(parameters)),
        slopes,
        bounds,
        max_nfev=MOST_LINEARISATIONS,
        ftol=SETTLED_COST,
        xtol=SETTLED_COST,
    )
    normal = np.linalg.inv(solution.jac.T @ solution.jac)
    before, after = (_rms_of_both(rows(x)) for x in (np.zeros(len(parameters)), solution.x))
    scale = max(1.0, (after[0] / allowed) ** 2)
    covariance = scale * normal * np.outer(expected, expected)
    result = Identified(dict(parameters), expected * solution.x, covariance, True, before, after, allowed)
    return replace(result, kept=always or result.explains)


def _thinned(run: FreeRun) -> list[Array]:
    """Return the rows of a run, low-passed, every `SPACING`: those of its first part, and those that are held out."""
    series, time = slow_part(run.inputs.time, run.rows()), run.inputs.time
    thinned = series[:: max(1, round(SPACING * len(series) / (time[-1] - time[0])))]
    return np.split(thinned, [max(1, int((1.0 - HELD_OUT) * len(thinned)))])


def _rms_of_both(runs: Sequence[Sequence[Array]]) -> tuple[float, float]:
    """Return the rms of all rows in the runs' first parts, and in the parts held out."""
    learnt, kept = (np.concatenate([np.ravel(part) for part in parts]) for parts in zip(*runs, strict=True))
    return float(np.sqrt(np.mean(learnt**2))), float(np.sqrt(np.mean(kept**2)))


def _both(errors: tuple[float, float]) -> str:
    return f"{force_size(errors[0])} a row, {force_size(errors[1])} where held out"
