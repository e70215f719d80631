"""How well an estimate agrees with a reference: R2, error and lag of each axis, from sums that need no whole series."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, field

import numpy as np

from aerobat_pin.numerics import Array, guarded

FORCE_AXES = ("Fx", "Fy", "Fz")
POINT_SUFFIX = "_force_point"
NO_SIGNAL = 1.0e-3  # [N]: if the true force has a smaller standard deviation, R2 is meaningless
TRUTH_SCORES = ("r2", "r2_noise_free", "rmse", "lag_s")  # of a truth
LONGEST_LAG = 0.05  # [s]: the longest lag that the search can find


def _quantity(unit: str, meaning: str) -> dict[str, str]:
    return {"unit": unit, "meaning": meaning}


@dataclass(frozen=True)
class Score:
    """Scores of one axis of one force; the metadata of each field names its unit.

    R2 and lag are None if the reference hardly varies (see `NO_SIGNAL`); the lag also if none is found. What is about
    noise belongs to a truth, what is about a fit, a factor or an offset to a sensor; elsewhere it is None.
    """

    r2: float | None = field(metadata=_quantity("1", "R2 against the true force with its noise"))
    r2_noise_free: float | None = field(metadata=_quantity("1", "R2 against the noise-free part of the true force"))
    rmse: float = field(metadata=_quantity("N", "root mean square error against the true force with its noise"))
    lag_s: float | None = field(metadata=_quantity("s", "delay of the noise-free truth that fits the estimate best"))
    r2_outside_fit: float | None = field(
        default=None, metadata=_quantity("1", "R2 on what no fit to the reference used; None without such a fit")
    )
    rmse_outside_fit: float | None = field(default=None, metadata=_quantity("N", "root mean square error there"))
    factor: float | None = field(
        default=None, metadata=_quantity("1", "sensor per estimate, least squares about the means")
    )
    offset: float | None = field(default=None, metadata=_quantity("N", "mean of the estimate minus that of the sensor"))
    r2_seen: float | None = field(default=None, metadata=_quantity("1", "R2 where the pose shows the component"))
    rmse_seen: float | None = field(default=None, metadata=_quantity("N", "root mean square error there"))

    @property
    def tells(self) -> bool:
        """Whether there is more to say than the error: the true force varies, or it is a sensor's."""
        return not (self.r2 is self.r2_noise_free is self.offset is None)

    def to_json(self) -> dict[str, float | None]:
        """Return all fields, of a score against a truth those alone that a truth has."""
        values: dict[str, float | None] = asdict(self)
        return values if self.offset is not None else {name: values[name] for name in TRUTH_SCORES}


class Moments:
    """Means and squares about the means of pairs of series (n, k), merged piece by piece.

    Source: Chan, Golub and LeVeque, Algorithms for computing the sample variance (1983), eq. 2.1. Of a single piece
    they are numpy's own.

    Args:
        width: number of components k.
    """

    def __init__(self, width: int) -> None:
        self.count = 0
        self._mean = np.zeros((2, width))
        self._estimate, self._truth, self._along, self._error = np.zeros((4, width))

    def add(self, estimate: Array, truth: Array) -> None:
        """Add rows (n, k) of both series."""
        if not len(estimate):
            return
        rows = np.array([estimate.T, truth.T])
        mean = rows.mean(axis=2)
        estimated, true = rows - mean[..., None]
        step, whole = mean - self._mean, self.count + len(estimate)
        share = self.count * len(estimate) / whole
        self._estimate += np.sum(estimated**2, axis=1) + share * step[0] ** 2
        self._truth += np.sum(true**2, axis=1) + share * step[1] ** 2
        self._along += np.sum(estimated * true, axis=1) + share * step[0] * step[1]
        self._error += np.sum((rows[0] - rows[1]) ** 2, axis=1)
        self._mean += len(estimate) / whole * step
        self.count = whole

    @property
    def r2(self) -> list[float | None]:
        """R2 of each component; None where the truth hardly varies."""
        dull = np.sqrt(self._truth / max(self.count, 1)) < NO_SIGNAL
        pairs = zip(dull, self._error, self._truth, strict=True)
        return [None if still else float(1.0 - error / power) for still, error, power in pairs]

    @property
    def rmse(self) -> list[float]:
        """Root mean square of the difference."""
        return [float(size) for size in np.sqrt(self._error / max(self.count, 1))]

    @property
    def offset(self) -> list[float]:
        """Mean of the estimate minus that of the truth."""
        return [float(size) for size in self._mean[0] - self._mean[1]]

    @property
    def factor(self) -> list[float | None]:
        """Truth per estimate, least squares about the means."""
        return [float(a / p) if p > 0.0 else None for a, p in zip(self._along, self._estimate, strict=True)]


@guarded()
def point_label(frame: str) -> str:
    """Return the short name of a force point: `left` for `left_force_point`."""
    return frame.removesuffix(POINT_SUFFIX)


def quantity(value: float, unit: str) -> str:
    """Return a size with three digits, in thousandths of the unit below 1, as `238 mN`."""
    factor, prefix = (1e3, "m") if value < 0.9995 else (1.0, "") if value < 999.5 else (1e-3, "k")
    return f"{factor * value:.3g} {prefix}{unit}"


def one_unit(sizes: Iterable[float | None]) -> Callable[[float, str], str]:
    """Return what says the sizes [N, N m] of a table in one unit: `238.00 mN`, or `1.506 N` if one is 1 or more.

    None and infinite ones do not count.
    """
    if max((abs(size) for size in sizes if size is not None and np.isfinite(size)), default=0.0) < 1.0:
        return lambda value, unit: f"{1e3 * value:.2f} m{unit}"
    return lambda value, unit: f"{value:.3f} {unit}"


def short_label(component: str) -> str:
    """Return the label of a component with the short name of its point: `left.Fx`."""
    frame, _, axis = component.rpartition(".")
    return f"{point_label(frame)}.{axis}"


@guarded(estimate=("m",), truth=("m",))
def r_squared(estimate: Array, truth: Array) -> float | None:
    """Return R2 = 1 - SSE/SST of two series (m,) [N], or None if the standard deviation of `truth` is below 1 mN."""
    if np.std(truth) < NO_SIGNAL:
        return None
    return float(1.0 - np.sum((estimate - truth) ** 2) / np.sum((truth - np.mean(truth)) ** 2))


def lag(estimate: Array, truth: Array, dt: float) -> float | None:
    """Return the lag of an estimate: the delay [s] of `truth` (m,) with the smallest squared error to `estimate` (m,).

    A parabola interpolates between samples. The result is None if `truth` hardly varies, or if the best delay lies at
    an end of the searched range, 0 to 50 ms (less for a short flight).
    """
    if np.std(truth) < NO_SIGNAL:
        return None
    longest = min(max(2, round(LONGEST_LAG / dt)), len(truth) // 4)
    # Row i of `windows` is the truth at delay longest - i samples, cut to the samples in which every delay has data.
    windows = np.lib.stride_tricks.sliding_window_view(truth, len(truth) - 1 - longest)
    errors = np.mean((estimate[longest:-1] - windows[longest + 1 :: -1]) ** 2, axis=1)
    best = int(np.argmin(errors))
    if best in (0, len(errors) - 1):
        return None
    before, here, after = errors[best - 1 : best + 2]
    bend = before - 2.0 * here + after
    offset = 0.5 * (before - after) / bend if bend > 0.0 else 0.0
    return float((best - 1 + offset) * dt)
