"""Faults of a stream of samples, planted at random."""

from collections.abc import Iterator
from enum import Enum, auto

import numpy as np


class Fault(Enum):
    """What is wrong with a sample."""

    NONE = auto()
    NOT_A_NUMBER = auto()
    INFINITE = auto()
    HUGE = auto()
    ZERO_QUATERNION = auto()
    TEXT = auto()
    DUPLICATE = auto()
    LATE = auto()
    LOST = auto()
    LOST_CHANNEL = auto()
    STAMP_OFF = auto()
    STAMP_NOT_A_NUMBER = auto()
    CLOCK_STEP = auto()
    STALL = auto()


def faulty(
    stamped: list[tuple[float, dict[str, float]]], rng: np.random.Generator, share: float
) -> Iterator[tuple[float, dict[str, object], Fault]]:
    """Yield time [s], columns and fault of samples, of which a share has a fault."""
    kinds, shift, stalled, until = list(Fault)[1:], 0.0, "", 0
    for k, (time, row) in enumerate(stamped):
        kind = kinds[rng.integers(len(kinds))] if rng.random() < share else Fault.NONE
        sent: dict[str, object] = dict(row)
        column = list(row)[rng.integers(len(row))]
        at = time
        if kind is Fault.CLOCK_STEP and rng.random() < 0.2:
            shift += float(rng.choice([-3600.0, -2.0, 0.3, 5.0, 3600.0]))
        if kind is Fault.STALL:
            stalled, until = column[:2], k + int(rng.integers(10, 200))
        if k < until:
            sent = {key: value for key, value in sent.items() if not key.startswith(stalled)}
        if kind is Fault.LOST:
            continue
        if kind in BAD:
            sent[column] = BAD[kind]
        elif kind is Fault.ZERO_QUATERNION:
            sent |= {key: 0.0 for key in row if key.startswith("q")}
        elif kind is Fault.LOST_CHANNEL:
            sent.pop(column, None)
        elif kind is Fault.STAMP_OFF:
            at += float(rng.choice([-3600.0, 3600.0, 1e9, -1e9]))
        elif kind is Fault.STAMP_NOT_A_NUMBER:
            at = float(rng.choice([np.nan, np.inf, -np.inf, 1e300]))
        elif kind is Fault.LATE:
            at -= 0.05 * float(rng.random())
        yield at + shift, sent, kind
        if kind is Fault.DUPLICATE:
            yield at + shift, sent, kind


BAD: dict[Fault, object] = {Fault.NOT_A_NUMBER: np.nan, Fault.INFINITE: np.inf, Fault.HUGE: 1e300, Fault.TEXT: "text"}
