"""How far an estimate can be trusted: size and deviation of its components, what no force explains, warnings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import comb, sqrt

import numpy as np

from aerobat_pin.forces.scores import quantity
from aerobat_pin.numerics import Array
from aerobat_pin.observers import Estimate, MomentumObserver

DIFFERENCE = 6  # order of the differences in which a force that changes slowly leaves nothing, and noise everything
GAUSSIAN = 1.4826  # standard deviation over median of the magnitude
NOISE_STRETCH = 32  # samples in which noise is told from that of other stretches
BURST = 0.95  # share of the time in which a component's noise is smaller than what it is judged by
MISFIT = "forces elsewhere, a moment, or a wrong model"  # what such errors may come from
LARGEST_NOISE = 0.5  # share of a component's rms above which its noise is named
DOUBT_STRETCH = 1.0  # [s] over which k is averaged to find when the rows fit worst


@dataclass(frozen=True)
class ComponentSize:
    """Size of an estimated force component over the flight.

    Attributes:
        name: label of the component.
        rms: root mean square of the estimate, where it is seen; None where it never is.
        unit: N or N m.
        deviation: median of the standard deviation that the observer states, where the component is seen;
            None if it states none, or if it is infinite.
        unseen: whether the component belongs to a pattern that leaves no trace at some instant of the flight; if a
            force was expected, whether it is never seen.
        seen: share of the time in which the rows settle nine tenths of what was expected; None if nothing was.
    """

    name: str
    rms: float | None
    unit: str
    deviation: float | None = None
    unseen: bool = False
    seen: float | None = None

    def certainty(self, say: Callable[[float, str], str]) -> str:
        """Return the deviation as text: `infinite` if the component is unseen, `-` if the observer states none.

        Args:
            say: function from a size [N, N m] and its unit to text.
        """
        if self.unseen:
            return "infinite" if self.seen is None else "not seen"
        return "-" if self.deviation is None else say(self.deviation, self.unit)


@dataclass(frozen=True)
class InnovationScore:
    """Mean normalised innovation squared `nis` of a filter (1 if it errs as it says), and their `whiteness` (0)."""

    nis: float
    whiteness: float


def sample_noise(components: Array) -> Array:
    """Return the standard deviation (c,) of what changes from sample to sample in series (m, c); 0 for short ones.

    It is the median size of the sixth differences, over that of white noise of deviation 1. Steps and pushes are rare
    and do not count. The noise of `momentum` and `force_level` is stronger at high frequencies, up to a fifth at
    K dt = 0.4, and overestimated by as much.
    """
    if len(components) <= 2 * DIFFERENCE:
        return np.zeros(components.shape[1])
    size = np.median(np.abs(np.diff(components, n=DIFFERENCE, axis=0)), axis=0)
    return np.asarray(GAUSSIAN * size / sqrt(comb(2 * DIFFERENCE, DIFFERENCE)))


def local_noise(components: Array) -> Array:
    """Return the standard deviation (m, c) of what changes from sample to sample, over each `NOISE_STRETCH` samples.

    Noise of velocity sensors reaches a force by the geometry of the moment, and may be ten times as large in an eighth
    of a wing beat as elsewhere.
    """
    if len(components) <= 2 * NOISE_STRETCH:
        return np.broadcast_to(sample_noise(components), components.shape)
    count = (len(components) - DIFFERENCE) // NOISE_STRETCH
    change = np.abs(np.diff(components, n=DIFFERENCE, axis=0))[: count * NOISE_STRETCH]
    size = GAUSSIAN * np.median(change.reshape(count, NOISE_STRETCH, -1), axis=1)
    size /= sqrt(comb(2 * DIFFERENCE, DIFFERENCE))
    return np.asarray(size[np.minimum(np.arange(len(components)) // NOISE_STRETCH, count - 1)])


def burst_noise(components: Array) -> Array:
    """Return the standard deviation (c,) of what changes from sample to sample, in the noisiest stretches."""
    return np.maximum(sample_noise(components), np.quantile(local_noise(components), BURST, axis=0))


def _noisy_components(estimate: Estimate) -> list[str]:
    """Return a warning about the components that are mostly noise, if an observer states no deviations itself."""
    if estimate.innovation is not None or not estimate.frames:  # a filter has taken it out
        return []
    noise, rms = burst_noise(estimate.components), np.sqrt(np.mean(estimate.components**2, axis=0))
    loud = [
        f"{name} {quantity(sigma, unit)} of {quantity(size, unit)}"
        for name, unit, sigma, size in zip(estimate.identifiability.components, estimate.units, noise, rms, strict=True)
        if sigma > LARGEST_NOISE * size
    ]
    line = (
        f"mostly noise from sample to sample, at times at least: {', '.join(loud)} rms; a lower gain, kalman or "
        "smoother take it out, unless the force itself is that rough"
    )
    return [line] if loud else []


def worst_stretch(time: Array, doubt: Array) -> tuple[float, float]:
    """Return the largest mean over `DOUBT_STRETCH` of k (m,), in which NaN counts as 0, and when that begins [s].

    It is 0 if the edges of the intervals (m + 1,) [s], which have no hole, do not reach so far.
    """
    ends = np.searchsorted(time, time[:-1] + DOUBT_STRETCH - 1e-9)
    begins = np.flatnonzero(ends < len(time))
    if not len(begins):
        return 0.0, float(time[0])
    total = np.concatenate([[0.0], np.cumsum(np.nan_to_num(doubt))])
    means = (total[ends[begins]] - total[begins]) / (ends[begins] - begins)
    worst = int(np.argmax(means))
    return float(means[worst]), float(time[begins[worst]])


def belief_words(k: float) -> str:
    """Return in words how much larger than stated the squared errors of the rows are."""
    return f"belief: squared errors of the rows are {k:.2g} times as large as stated"


def warnings_about(estimate: Estimate) -> list[str]:
    """Return what spoils this estimate although the rows determine it."""
    lines = [*estimate.warnings, *_noisy_components(estimate)]
    if estimate.observer == MomentumObserver.name and estimate.rows == "base+power":
        lines.append(
            "filters the rows before it combines them with the motor's power, which holds at each instant only: the "
            "force between the points is wrong; force_level, kalman and smoother project first"
        )
    return lines
