"""The error bar of a calibration: the force that is found where nothing pushes, and where nothing was fitted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from aerobat_pin.estimation.against_reference import PairedEstimate, sensor_references
from aerobat_pin.estimation.calibration.map_fits import held_out_stretch
from aerobat_pin.estimation.expected_of_record import expected_of
from aerobat_pin.estimation.gain_regression import fits_to_sensor
from aerobat_pin.estimation.known_forces import KnownForces
from aerobat_pin.estimation.run_observers import inputs_between, observers_of, points_of, rms_in, run_observers


def error_bar(pairs: Sequence[tuple[KnownForces | None, KnownForces]]) -> dict[str, tuple[float, float]]:
    """Return component -> rms error without and with what was learnt, over some records; empty where none is settled.

    Args:
        pairs: known forces of each record without and with what was learnt; None if there is no estimate without it.
    """
    squares: list[dict[str, float]] = []
    for k in (0, 1):
        sizes = [_sizes_where_free(pair[k]) for pair in pairs]
        labels = sizes[0].keys()
        squares.append({label: float(np.mean([rms.get(label, np.nan) ** 2 for rms in sizes])) for label in labels})
    return {label: (squares[0].get(label, np.nan) ** 0.5, size**0.5) for label, size in squares[1].items()}


def _sizes_where_free(known: KnownForces | None) -> dict[str, float]:
    """Return component -> rms error, against the sensor if a fit knows its force."""
    if known is None:
        return {}
    record = known.record
    inputs = inputs_between(record, known)
    expected = expected_of(record, inputs, known.values, points_of(record.map))
    named = observers_of(record, (), expected)[0]
    # force_level is right for any choice of rows
    chosen = next((observer for observer in named if observer.name == "force_level"), named[0])
    estimate = run_observers(record, inputs, [chosen], expected=expected)[chosen.name]
    if fits_to_sensor(record.map):
        [sensor] = sensor_references(record)  # the fit had it
        side = PairedEstimate.of(estimate, sensor, record.dt)
        return {
            f"{sensor.frame}.{label}": score.rmse if score.rmse_outside_fit is None else score.rmse_outside_fit
            for label, score in (side.scores() if side is not None else {}).items()
        }
    rms = rms_in(record, estimate, held_out_stretch(record))
    return {} if rms is None else dict(zip(estimate.head.identifiability.components, rms.tolist(), strict=True))


def bar_words(bar: Mapping[str, tuple[float, float]]) -> str:
    """Return an error bar in words."""
    if not bar:
        return "no error bar: the recording is too short for one"
    parts = []
    for label, (before, after) in bar.items():
        unit = "N m" if ".M" in label else "N"
        parts.append(f"{label} {after:.3g} {unit}" + (f" (without {before:.3g})" if np.isfinite(before) else ""))
    return f"error bar, rms where nothing was fitted: {', '.join(parts)}"
