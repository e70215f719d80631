"""Clock offsets between sensors: extra states that the samples of a smoothed record may ask for.

The clock of motion capture is the reference. An offset is reported if the samples are so much likelier with it; it is
applied only on request.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from aerobat_pin.aerobat.raw.layout import Prior
from aerobat_pin.aerobat.raw.linear import LinearRecord
from aerobat_pin.aerobat.raw.tuning import Tuning

LEAST_GAIN = 250.0  # of the log-likelihood: smaller gains are made up by errors of the model
LEAST_OFFSET = 2.0e-4  # [s]: less does no harm
TIMED = ("gyro", "accelerometer", "crank", "torque")


@dataclass(frozen=True)
class ClockOffset:
    """A sensor's clock offset.

    Attributes:
        sensor: name of the sensor.
        seconds: how much later than motion capture it stamps its samples [s].
        deviation: standard deviation [s].
        gain: log-likelihood that the samples gain by it, after those of the sensors before it.
    """

    sensor: str
    seconds: float
    deviation: float
    gain: float

    @property
    def sure(self) -> bool:
        """Whether the gain is large enough to report the offset."""
        return self.gain > LEAST_GAIN and abs(self.seconds) > LEAST_OFFSET

    def __str__(self) -> str:
        late = "late" if self.seconds > 0.0 else "early"
        return (
            f"{self.sensor} is {1e3 * abs(self.seconds):.2f} ms {late} against motion capture (deviation "
            f"{1e3 * self.deviation:.2f} ms, log-likelihood gain {self.gain:.0f})"
        )


def clock_offsets(linear: LinearRecord, prior: Prior, tuning: Tuning, error: float) -> tuple[ClockOffset, ...]:
    """Return the clock offsets that the samples ask for, one sensor after the other, the one that gains most first.

    One offset explains what several others could explain together: if the crank is late, all but the crank are early.
    `error` is the standard deviation of an offset before the samples are seen [s].
    """
    sensors = linear.layout.offsets

    def filtered(free: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """Return log-likelihood, last state and its deviations, with these offsets free."""
        score, state = linear.filter(tuning, prior.padded(np.where(free, error, 0.0)), keep=False)
        return score, state.x, np.sqrt(np.diag(state.P))

    chosen, gains = np.zeros(len(sensors), bool), dict[int, float]()
    best, last, spread = filtered(chosen)
    if filtered(~chosen)[0] - best < LEAST_GAIN:
        return ()
    while not np.all(chosen):
        tried = {i: filtered(chosen | (np.arange(len(sensors)) == i)) for i in np.flatnonzero(~chosen).tolist()}
        i = max(tried, key=lambda sensor: tried[sensor][0])
        if tried[i][0] - best < LEAST_GAIN:
            break
        chosen[i], gains[i] = True, tried[i][0] - best
        best, last, spread = tried[i]
    places = linear.layout.offset_at
    return tuple(
        ClockOffset(sensors[i], float(last[places[sensors[i]]]), float(spread[places[sensors[i]]]), gain)
        for i, gain in gains.items()
    )


def corrected(
    offsets: tuple[ClockOffset, ...], linear: LinearRecord, prior: Prior, tuning: Tuning, error: float
) -> tuple[ClockOffset, ...]:
    """Return offsets with what is still missing after they were applied and the record was smoothed anew."""
    names, places = [offset.sensor for offset in offsets], linear.layout.offset_at
    spreads = np.array([error if name in names else 0.0 for name in linear.layout.offsets])
    _, filtered = linear.filter(tuning, prior.padded(spreads), keep=False)
    return tuple(
        replace(offset, seconds=offset.seconds + float(filtered.x[places[offset.sensor]])) for offset in offsets
    )
