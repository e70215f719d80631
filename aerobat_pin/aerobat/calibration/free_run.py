"""Was a flight free of unknown forces? What a log's truth, or else the residual itself, says about that."""

from __future__ import annotations

import numpy as np

from aerobat_pin.aerobat.calibration.free_flight import AT_ONCE, FreeFlight, unexplained, weighted
from aerobat_pin.errors import CalibrationError
from aerobat_pin.numerics import Array
from aerobat_pin.observers import ForceLevelObserver, redundancy_of, slow_part

LARGEST_TRUTH = 1.0e-3  # [N]: rms of a true force that counts as none
CONTACT = 8.0  # typical sizes of what the calibration leaves: a longer or larger one is a contact
LEAST_CONTACT = 0.02  # of the robot's weight
STEADY = 3.0  # times the error of the belief: forces that are larger are hardly made up by it


def refuse_forced(flight: FreeFlight) -> None:
    """Raise CalibrationError if the truth of a simulated log knows an unknown force."""
    truth = flight.log.truth
    if truth is None:
        return
    force = truth["force_W"].values
    sizes = np.sqrt(np.mean(np.sum(force**2, axis=2), axis=0)) if force.size else np.zeros(0)
    if np.any(sizes > LARGEST_TRUTH):
        at = int(np.argmax(sizes))
        raise CalibrationError(
            f"{flight.name}: an unknown force of {1e3 * sizes[at]:.0f} mN rms acts at {truth['point'].values[at]}: a "
            "flight without unknown forces was expected"
        )


def contacts(flight: FreeFlight, left: Array) -> list[str]:
    """Return a warning where something seems to push for a while, given what a calibration leaves (m, nv).

    A free flight repeats itself with the crank, so little is left of it, and as much in one flap as in another.
    """
    series = slow_part(flight.inputs.time, weighted(flight, left))
    size = np.sqrt(np.mean(series**2, axis=1))
    at, usual = int(np.argmax(size)), float(np.median(size))
    if size[at] <= max(CONTACT * usual, LEAST_CONTACT * flight.weight) and unexplained(flight, left).verdict != (
        "inconsistent"
    ):
        return []
    return [
        f"warning: {flight.name}: {1e3 * size[at]:.0f} mN a row are left at t = {flight.inputs.time[at]:.3f} s, and "
        f"{1e3 * usual:.1f} mN usually: did something push, or the flight change? A free, steady run was expected"
    ]


def steady_forces(flight: FreeFlight) -> list[str]:
    """Return a warning where forces are found that are too large for the error of the belief.

    A force that repeats with every flap cannot be told from an error of the air by its repetition. But what the belief
    gets wrong is seldom explained by two point forces alone: their redundancy shows it too. If it shows little, and
    the forces found are large, they are real, or an error that looks like forces at these very points.
    """
    inputs, model = flight.inputs, flight.robot.model
    observer = ForceLevelObserver(model, flight.frames, AT_ONCE, inputs.rows)
    found = observer.run(inputs.time, inputs.q, inputs.v, inputs.tau, inputs.known)
    check = found.redundancy
    if check.verdict != "consistent":
        return []
    count = found.components.shape[1]
    force = redundancy_of(inputs.time, found.components, count + 1, 1, flight.weight, ())
    limit = STEADY * max(check.belief, check.allowed)
    if force.belief <= limit:
        return []
    return [
        f"warning: {flight.name}: forces of {1e3 * force.belief:.0f} mN are found while the belief is right within "
        f"{1e3 * check.allowed:.1f} mN a row: either something pushed, or the masses at {' and '.join(flight.frames)} "
        "are wrong"
    ]
