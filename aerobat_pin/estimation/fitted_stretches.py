"""Where fits take their samples: a stretch of a record, and the rest that tests them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from aerobat_pin.estimation.inverse_dynamics import contact_torque
from aerobat_pin.estimation.known_forces import KnownForces
from aerobat_pin.numerics import Array
from aerobat_pin.records import Block, Map, Record

MOST_FITTED = 200_000  # samples of a fit; a longer record is thinned


def fitted_blocks(
    record: Record, fit: tuple[float, float], most: int = MOST_FITTED
) -> Iterator[tuple[Block, NDArray[np.bool_], NDArray[np.bool_]]]:
    """Yield blocks of a record, which of their intervals (m,) are for a fit, and which are for its test.

    A record of more than `most` intervals is thinned.

    Args:
        record: the record. A fit is tested outside of it where nothing touches the robot, or a sensor says what does.
        fit: times after the start [s] between which there is a fit.
        most: intervals of all blocks together.
    """
    tested = (-np.inf, np.inf) if fits_to_sensor(record.map) else record.map.use.free
    whole = [(first, last, True, True) for first, last in record.parts]
    if sum(last - first for first, last in record.parts) > most:
        whole = [(first, last, True, False) for first, last in record.spread(most, *fit)]
        whole += [(first, last, False, True) for first, last in record.spread(most, *(tested or ()))]
    for first, last, fits_here, tests_here in whole:
        block = record.block(first, last)
        when = block.time[:-1] - record.start
        inside = within(when, fit)
        yield block, inside & fits_here, ~inside & within(when, tested) & tests_here


def within(when: Array, stretch: tuple[float, float] | None) -> NDArray[np.bool_]:
    """Return which times (m,) [s] are in a stretch; none if there is no stretch."""
    return np.zeros(len(when), bool) if stretch is None else (when >= stretch[0]) & (when < stretch[1])


def fits_to_sensor(chosen: Map) -> bool:
    """Return whether friction is fitted while something pushes, which a force sensor shows."""
    return chosen.joints.friction is not None and chosen.joints.friction.to is not None


def explained(record: Record, forces: KnownForces, block: Block) -> Array:
    """Return the generalised force (m, nv) of all known forces, and of a sensor that a fit knows."""
    given = sum(forces.known(block).values(), np.zeros_like(block.tau))
    return given + contact_torque(record, block) if fits_to_sensor(record.map) else given


def rms_or_nan(values: Array) -> float:
    """Return the root mean square of values (m,); NaN if there are none."""
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")
