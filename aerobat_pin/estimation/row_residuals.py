"""Where no point is named at which something may push: the residual of each row, with its deviation and contacts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from aerobat_pin.estimation.calibration_use import SURE_OF_CONTACT, Contact
from aerobat_pin.estimation.stored_estimate import StoredEstimate
from aerobat_pin.numerics import Array
from aerobat_pin.observers import AllBut, Estimate, Expected, Identifiability, LevelDetector, Observer, row_names

CONTACT_ENDS = 0.5  # of the threshold, where it begins and ends


def rows_as_components(estimate: Estimate, observer: Observer, v: Array, expected: Expected | None) -> Estimate:
    """Return an estimate, of an observer without points, whose components are its believed rows, such as `elbow.M`.

    Their deviations, at velocities v (m + 1, nv), are what is expected where nothing touches, if that is known.
    """
    names, rows = row_names(observer.model), observer.believed.rows
    kept = rows.kept(observer.model) if isinstance(rows, AllBut) else list(range(len(names)))
    labels = [name if "." in name else f"{name}.{'F' if unit == 'N' else 'M'}" for name, unit in names.items()]
    units, count = tuple(np.array(list(names.values()))[kept].tolist()), len(kept)
    deviation = None if expected is None else expected.row_deviation(0.5 * (v[1:] + v[:-1]))[:, kept]
    known = Identifiability(tuple(labels[k] for k in kept), count, np.ones(count), np.zeros((0, count)), np.ones(count))
    return replace(
        estimate,
        components=estimate.residual[:, kept],
        units=units,
        identifiability=known,
        standard_deviation=deviation,
    )


def row_contacts(estimate: StoredEstimate) -> list[Contact] | None:
    """Return when a row is beyond its threshold, in the order of time; None for an estimate of forces at points."""
    head = estimate.head
    if head.frames or head.standard_deviation is None:
        return None
    time = np.concatenate([estimate.start[:], [estimate.end]])
    values = np.concatenate([block.components for block in estimate.blocks()])
    bars = np.concatenate([SURE_OF_CONTACT * np.asarray(block.standard_deviation) for block in estimate.blocks()])
    contacts, detector = [], LevelDetector(np.zeros(()), CONTACT_ENDS, 1.0, 0.0)
    for k, label in enumerate(head.identifiability.components):
        for event in detector.detect(time, np.abs(values[:, k]) / bars[:, k]):
            during = (time[1:] > event.onset) & (time[:-1] < (np.inf if event.end is None else event.end))
            size = float(np.max(np.abs(values[during, k])))
            contacts.append(Contact(label, event.onset, event.alarm, event.end, size))
    return sorted(contacts, key=lambda event: event.onset)
