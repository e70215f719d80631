"""Compare two measurements of the same quantity: factor, lag and correlation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aerobat_pin.numerics import Array

LATEST_SHIFT = 0.3  # [s] that the search can find
UNIT_FACTORS = {  # measured per reference -> the slip that makes it
    57.2958: "degrees are read as radians",
    1.0 / 57.2958: "degrees of the position or pose are read as radians",
    1000.0: "thousandths are read as units",
    1e-3: "thousandths of the position (mm) are read as units",
    100.0: "hundredths are read as units",
    0.01: "hundredths of the position (cm) are read as units",
    9.5493: "revolutions a minute are read as rad/s",
}


@dataclass(frozen=True)
class SeriesComparison:
    """How a measured series follows its reference.

    Attributes:
        factor: measured per reference, least squares at the best lag.
        lag: how late the measured series is [s].
        correlation: at the best lag, about zero, all columns together.
        share: rms of what the best factor and lag leave, over the rms of the measured series.
    """

    factor: float
    lag: float
    correlation: float
    share: float

    @property
    def unit_slip(self) -> str:
        """The slip of units that explains the factor within 6 %, or nothing."""
        for factor, name in UNIT_FACTORS.items():
            if abs(self.factor / factor - 1.0) < 0.06:
                return name
        return ""


def compare(reference: Array, measured: Array, dt: float) -> SeriesComparison | None:
    """Compare evenly spaced series (m, k); None if the reference or the measured one does not move."""
    a, b = reference - reference.mean(axis=0), measured - measured.mean(axis=0)
    power_a, power_b = float(np.sum(a * a)), float(np.sum(b * b))
    if power_a <= 1e-18 * a.size or power_b <= 1e-18 * b.size:
        return None
    most = min(max(2, round(LATEST_SHIFT / dt)), len(a) // 4)
    inner = b[most : len(b) - most]
    size = 1 << int(np.ceil(np.log2(len(a) + len(inner))))
    spectrum = np.sum(np.fft.rfft(a, size, axis=0) * np.conj(np.fft.rfft(inner, size, axis=0)), axis=1)
    products = np.fft.irfft(spectrum, size)[: 2 * most + 1]  # of inner with the reference from its row 0, 1, ... on
    sums = np.concatenate([[0.0], np.cumsum(np.sum(a * a, axis=1))])
    power = sums[len(inner) : len(inner) + 2 * most + 1] - sums[: 2 * most + 1]
    products = (products / np.sqrt(np.maximum(power, 1e-9 * power_a)))[::-1]  # lags -most ... most
    best = int(np.argmax(np.abs(products)))
    shift = 0.0
    if 0 < best < len(products) - 1:
        before, here, after = products[best - 1 : best + 2]
        bend = before - 2.0 * here + after
        shift = 0.5 * (before - after) / bend if bend != 0.0 else 0.0
    whole = best - most
    first, second = (a[: len(a) - whole], b[whole:]) if whole >= 0 else (a[-whole:], b[: len(b) + whole])
    cross = float(np.sum(first * second))
    factor = cross / float(np.sum(first * first))
    correlation = cross / float(np.sqrt(np.sum(first * first) * np.sum(second * second)))
    left = float(np.sqrt(np.sum((second - factor * first) ** 2) / np.sum(second * second)))
    return SeriesComparison(factor, (whole + shift) * dt, correlation, left)
