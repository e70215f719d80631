"""A record linearised about a nominal motion: filtered for its likelihood, or smoothed, and for clock offsets.

These are extra states that the samples of a smoothed record may ask for. The clock of motion capture is the reference.
An offset is reported if the samples are so much likelier with it; it is applied only on request.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from aerobat_pin.aerobat.raw.dynamics import LinearDynamics
from aerobat_pin.aerobat.raw.layout import CRANK_ERROR, Layout, Prior
from aerobat_pin.aerobat.raw.nominal_motion import NominalMotion
from aerobat_pin.aerobat.raw.recursion import Filtered, SampleRows, Smoothed, filter_record, smooth_record
from aerobat_pin.aerobat.raw.tuning import Tuning, white_variance
from aerobat_pin.numerics import Array, Integers

GYRO_WALK, ACCELEROMETER_WALK = 1.0e-4, 1.0e-3  # of the biases [rad/s/sqrt(s), m/s2/sqrt(s)]
LEAST_GAIN = 250.0  # of the log-likelihood: smaller gains are made up by errors of the model
LEAST_OFFSET = 2.0e-4  # [s]: less does no harm
TIMED = ("gyro", "accelerometer", "crank", "torque")


def added_variances(layout: Layout, tuning: Tuning, dt: Array) -> Array:
    """Return the variances (m, n) that intervals dt (m,) [s] add to the states; of the white forces: the next one's."""
    added, each = np.zeros((len(dt), layout.size)), dt[:, None]
    added[:, CRANK_ERROR.stop - 1] = tuning.jerk**2 * dt
    added[:, layout.gyro_bias] = GYRO_WALK**2 * each
    added[:, layout.accelerometer_bias] = ACCELEROMETER_WALK**2 * each
    added[:, layout.walk] = tuning.by_mode(tuning.walk, layout.points) ** 2 * each
    added[:, layout.slope] = tuning.by_mode(tuning.bend, layout.points) ** 2 * each
    added[:, layout.white] = np.tile(white_variance(tuning, np.append(dt[1:], dt[-1])), layout.points)
    return added


@dataclass(frozen=True)
class LinearRecord:
    """A record linearised about a nominal motion: dynamics and samples.

    Attributes:
        layout: places of the states.
        nominal: the motion.
        dynamics: of each interval.
        sensors: names of the sensors.
        rows: the samples.
        jumps: (m,) variance that a jump at the end of an interval adds to each slow force [N2]; 0 where there is none.
    """

    layout: Layout
    nominal: NominalMotion
    dynamics: LinearDynamics
    sensors: tuple[str, ...]
    rows: SampleRows
    jumps: Array

    def noise(self, tuning: Tuning) -> Array:
        """Return the variances (m, n) that each interval adds to the states."""
        added = added_variances(self.layout, tuning, np.diff(self.nominal.time))
        added[:, self.layout.walk] += self.jumps[:, None]
        return added

    def filter(self, tuning: Tuning, prior: Prior, *, keep: bool) -> tuple[float, Filtered]:
        """Filter the record from a prior; return the log-likelihood, and what `smooth_record` needs if it is kept."""
        n, m, k = self.layout.size, len(self.nominal.time) - 1, len(self.rows.e)
        x, P = prior.about(self.nominal), prior.covariance.copy()
        white = self.layout.white
        first = white_variance(tuning, np.diff(self.nominal.time[:2]))
        x[white], P[white, :], P[:, white] = 0.0, 0.0, 0.0
        P[white, white] = np.diag(np.tile(first[0], self.layout.points))
        knots = m + 1 if keep else 0
        filtered = Filtered(x, P, *map(np.empty, ((k, n), (k, 2), (knots, n), (knots, n, n))))
        d, fresh = self.dynamics, _ends(white)
        return filter_record(d.transition, d.shift, self.noise(tuning), fresh, self.rows, filtered), filtered

    def score(self, tuning: Tuning, prior: Prior) -> float:
        """Return the log-likelihood of the samples."""
        return self.filter(tuning, prior, keep=False)[0]

    def smooth(self, tuning: Tuning, prior: Prior, *, scores: bool = False, blocks: bool = False) -> Smoothed:
        """Smooth the record; scores and blocks take most of the time, and are empty if not asked for."""
        _, filtered = self.filter(tuning, prior, keep=True)
        layout, (m, n) = self.layout, filtered.states.shape
        spread, wanted, b = m if blocks else 0, m if scores or blocks else 0, 3 * layout.points
        sizes = (m, n), (spread, b, b), (wanted, n), (wanted, n), (wanted, b, b)
        smoothed = Smoothed(filtered, *map(np.empty, sizes))
        smooth_record(self.dynamics.transition, _ends(layout.white), _ends(layout.walk), self.rows, smoothed)
        return smoothed


def _ends(states: slice) -> Integers:
    return np.array([states.start, states.stop], dtype=np.intp)


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
