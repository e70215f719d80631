"""How large errors are where nothing pushes, and nothing was fitted: of the rows, and of the forces that are found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from aerobat_pin.estimation.calibration.free_run import FreeRun, free_runs
from aerobat_pin.forces import (
    SLIDES_AT,
    KnownForces,
    PairedEstimate,
    contact_torque,
    expected_of,
    fits_to_sensor,
    held_out_stretch,
    inputs_between,
    instants_of,
    observers_of,
    rms_in,
    run_observers,
    sensor_references,
    settled,
    used_by_fits,
)
from aerobat_pin.observers import low_passed, row_names, typical_step
from aerobat_pin.records import FREE_NV

RAISED_BY = 2.0  # deviations by which the second moment of errors of rows is raised
FEWEST_LEFT = 10  # intervals that no fit used, from which the noise of the rows follows


def row_noise(runs: Sequence[FreeRun], *, learnt: bool) -> dict[str, float]:
    """Return row -> root second moment of what is left where it moves [N, N m], in data that no fit used.

    It is taken behind the low-pass of the observers, as errors that this takes out do not reach their forces. A joint
    at rest says nothing of its errors when it slides: an instant counts by how far it does. A few errors may all be
    small: the second moment is raised by twice its deviation, and is at least that of the data that a fit used. A row
    that hardly moves has none. `learnt` says whether more than the map's fits was learnt from all but the part of the
    runs that is held out.
    """
    names = row_names(runs[0].record.robot.model) if runs else {}
    count, square, different = np.zeros((3, 2, len(names)))  # where nothing was fitted, and where it was
    slid = np.zeros(len(names), int)  # in how many intervals that no fit used
    for run in runs:
        robot, time, v = run.record.robot, run.inputs.time, run.inputs.v
        fitted = used_by_fits(run.record, run.forces.values, time[:-1])
        if learnt:
            fitted[run.fitted] = True
        share = -np.expm1(-float(run.record.map.observer.gain) * typical_step(time))
        sliding = np.tanh(0.5 * (v[1:] + v[:-1]) / run.forces.values.stiction(robot)[1])
        sliding[:, : FREE_NV if robot.free else 0] = 1.0
        residual = sliding * low_passed(run.residual, share)
        for which, kept in enumerate(settled(run.record, time[:-1]) & part for part in (~fitted, fitted)):
            if not kept.any():
                continue
            power = np.abs(np.fft.fft(residual[kept], axis=0)) ** 2  # as many errors differ as frequencies have a part
            different[which] += np.sum(power, axis=0) ** 2 / np.maximum(np.sum(power**2, axis=0), 1e-300)
            count[which] += np.sum(sliding[kept] ** 2, axis=0)
            square[which] += np.sum(residual[kept] ** 2, axis=0)
        slid += np.count_nonzero(np.abs(sliding[settled(run.record, time[:-1]) & ~fitted]) > SLIDES_AT, axis=0)
    raised = square / np.maximum(count, 1e-300) * (1.0 + RAISED_BY * np.sqrt(2.0 / np.maximum(different, 1.0)))
    raised = np.maximum(raised[0], square[1] / np.maximum(count[1], 1e-300))
    return {name: float(np.sqrt(raised[k])) for k, name in enumerate(names) if slid[k] >= FEWEST_LEFT}


def noise_where_known(forces: KnownForces) -> dict[str, float]:
    """Return what `row_noise` does for where nothing touches by the map, or a sensor says what; else nothing."""
    record = forces.record
    if fits_to_sensor(record.map):
        pushed = free_runs(record, forces)
        runs = [run.explained("sensor", contact_torque(record, record.block(*run.stretch))) for run in pushed]
        return row_noise(runs, learnt=False)
    free = record.map.use.free
    return {} if free is None else row_noise(free_runs(record, forces, free), learnt=False)


def error_bar(pairs: Sequence[tuple[KnownForces | None, KnownForces]]) -> dict[str, tuple[float, float]]:
    """Return component -> rms error without and with what was learnt; empty where no record is settled.

    It is that over the records that show it. `pairs` are the known forces of each record without it, None if there is
    no estimate then, and with it.
    """
    squares: list[dict[str, float]] = []
    for k in (0, 1):
        sizes = [entry for pair in pairs for entry in _sizes_where_free(pair[k]).items()]
        seen = {label: [rms**2 for name, rms in sizes if name == label and np.isfinite(rms)] for label, _ in sizes}
        squares.append({label: float(np.mean(each)) if each else np.nan for label, each in seen.items()})
    return {label: (squares[0].get(label, np.nan) ** 0.5, size**0.5) for label, size in squares[1].items()}


def _sizes_where_free(known: KnownForces | None) -> dict[str, float]:
    """Return component -> rms error, against the sensor if a fit knows its force."""
    if known is None:
        return {}
    record = known.record
    inputs = inputs_between(record, known)
    instants = instants_of(record, inputs, known.values) if record.robot.limits_forces else None
    expected = None if instants is None else expected_of(record, instants, known.values)
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
        size = f"{after:.3g} {unit}" if np.isfinite(after) else "not seen"
        parts.append(f"{label} {size}" + (f" (without {before:.3g})" if np.isfinite(before) else ""))
    return f"error bar, rms where nothing was fitted: {', '.join(parts)}"
