"""Find contacts: thresholds learnt from free runs of any robot, above which a force is a contact.

The detector is a Kalman filter whose forces walk slowly, a third of the robot's weight per root second: with noisy
sensors it sees a step of 0.1 N on a robot of 0.9 N within 3 ms, where the usual walk, seven times as fast, needs a
threshold above the step. Excursions are counted in the deviations that the filter states, which change within a wing
beat; so counted, noise is nearly normal. A component's threshold is 5.3 times the root mean square of its excursions in
the free runs, which noise does not pass in hours, but no more than 1.6 times the largest of them, as what repeats
itself with the wings has no such tails; and at least 1.2 % of the weight.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from aerobat_pin.forces import Contact, KnownInputs
from aerobat_pin.numerics import Array
from aerobat_pin.observers import KalmanObserver, LevelDetector, scale_of_forces

DETECTOR_WALK = 0.33  # of the robot's weight per root second
ABOVE_USUAL, ABOVE_LARGEST = 5.3, 1.6  # threshold, in usual and largest excursions of the free runs; the lower one
LEAST_THRESHOLD = 0.012  # of the robot's weight
SETTLING = 0.1  # [s] at the start of a run in which the filter still learns its sensors
FLOOR = 0.5  # of the threshold: where a contact is said to begin
ECHO = 0.25  # of a contact, in thresholds, below which an overlapping one elsewhere is its echo
JOINED = 0.02  # [s]: contacts with shorter pauses are one


@dataclass(frozen=True)
class Detection:
    """What is normal where nothing pushes."""

    frames: tuple[str, ...]  # points at which forces are sought
    bias: Array  # (3 n,) mean of the detector's forces in the free runs, world axes [N]
    threshold: Array  # (3 n,) distance from it at which a contact is found [N], where the filter is as sure as usual
    # (3 n,) root mean square of the standard deviation that the filter states in the free runs [N]; thresholds are in
    # proportion to what it states
    deviation: Array

    def excess(self, model: pin.Model, inputs: KnownInputs, widened: Array | float) -> Array:
        """Return the excess (m, n) of each point over its threshold; 0 where none is sought, 1 where one is found.

        All that was learnt is among the known forces of the inputs; `widened` is a factor of the thresholds, or (m,).
        """
        sought = settled_intervals(inputs)
        force, deviation = _detected(model, self.frames, inputs)
        least = LEAST_THRESHOLD * scale_of_forces(model)
        over = np.abs(force - self.bias) / np.maximum(self.threshold * deviation / self.deviation, least)
        over /= np.reshape(widened, (-1, 1))
        return np.where(sought[:, None], np.max(over.reshape(len(over), -1, 3), axis=2), 0.0)

    def contacts(self, time: Array, excess: Array) -> tuple[Contact, ...]:
        """Return the contacts between times (m + 1,) [s] in the order of their onsets, from their `excess` (m, n)."""
        sized: list[tuple[Contact, float]] = []
        for frame, statistic in zip(self.frames, excess.T, strict=True):
            joined: list[tuple[Contact, float]] = []
            for event in LevelDetector(np.zeros(()), FLOOR, 1.0, 0.0).detect(time, statistic.copy()):
                contact, size = Contact(frame, event.onset, event.alarm, event.end), event.peak
                if joined and joined[-1][0].end is not None and event.onset - joined[-1][0].end < JOINED:
                    before, larger = joined.pop()
                    contact, size = Contact(frame, before.onset, before.alarm, event.end), max(size, larger)
                joined.append((contact, size))
            sized += joined
        kept = [contact for contact, size in sized if not any(_hides(*other, contact, size) for other in sized)]
        return tuple(sorted(kept, key=lambda contact: contact.onset))


def _hides(other: Contact, large: float, contact: Contact, size: float) -> bool:
    """Whether a contact is the echo of a far larger one that overlaps it at another point."""
    apart = any(a.end is not None and a.end < b.onset for a, b in ((other, contact), (contact, other)))
    return other.point != contact.point and not apart and size < ECHO * large


def settled_intervals(inputs: KnownInputs) -> NDArray[np.bool_]:
    """Return in which intervals (m,) the detector has settled."""
    return np.asarray(inputs.time[:-1] - inputs.time[0] >= SETTLING)


def learn_detection(frames: Sequence[str], runs: Iterable[tuple[pin.Model, KnownInputs, Array | float]]) -> Detection:
    """Return the thresholds that free runs show, given model, calibrated inputs and factor of thresholds of each."""
    parts, widths, weights = [], [], []
    for model, inputs, widened in runs:
        settled = settled_intervals(inputs)
        parts.append(_detected(model, frames, inputs)[:, settled])
        widths.append(np.broadcast_to(widened, settled.shape)[settled])
        weights.append(scale_of_forces(model))
    forces, deviations = np.concatenate(parts, axis=1)
    seen, bias = np.isfinite(deviations), np.mean(forces, axis=0)
    excursions = np.abs(forces - bias) / deviations / np.concatenate(widths)[:, None]
    size, largest = np.sqrt(np.mean(excursions**2, axis=0)), np.max(excursions, axis=0)
    allowed = np.minimum(ABOVE_USUAL * size, ABOVE_LARGEST * largest)
    mean = np.mean(np.square(deviations, where=seen, out=np.zeros_like(deviations)), axis=0)
    usual = np.sqrt(np.where(mean > 0.0, mean / np.maximum(np.mean(seen, axis=0), 1e-9), 1.0))
    least = LEAST_THRESHOLD * weights[0]
    return Detection(tuple(frames), bias, np.maximum(allowed * usual, least), usual)


def _detected(model: pin.Model, frames: Sequence[str], inputs: KnownInputs) -> Array:
    """Return the detector's forces and their standard deviations (2, m, 3 n) [N]; infinite where there is no trace."""
    detector = KalmanObserver(model, frames, rows=inputs.rows, force_walk=DETECTOR_WALK * scale_of_forces(model))
    estimate = detector.run(inputs.time, inputs.q, inputs.v, inputs.tau, inputs.known)
    return np.array([estimate.components, estimate.standard_deviation])
