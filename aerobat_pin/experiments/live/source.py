"""What a live page shows: a robot that moves, the force that acts on it where that is known, and its estimate."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from time import monotonic
from typing import Any, ClassVar, NamedTuple

import numpy as np
import pinocchio as pin

from aerobat_pin.errors import ObserverError
from aerobat_pin.estimation import Result
from aerobat_pin.experiments.experiment import Experiment, Progress
from aerobat_pin.numerics import Array
from aerobat_pin.observers import OBSERVERS, SmootherObserver

LIVE_OBSERVERS = tuple(name for name, kind in OBSERVERS.items() if not issubclass(kind, SmootherObserver))
PUSH_SHARE = 0.1  # of the weight: the largest force that a slider sets
KEPT = 20.0  # [s] that can be saved
LARGEST_LIVE_GAIN, LARGEST_WIND, LOUDEST = 2000.0, 5.0, 10.0  # [1/s, m/s, -]


class LiveRow(NamedTuple):
    """One instant: time [s], true force (p, 3), NaN where unknown, and estimate (p, 3), world axes [N]."""

    time: float
    true: Array
    estimate: Array


class LiveSource:
    """A robot that lives; subclasses say how.

    Attributes:
        title: a line about it.
        model: its model.
        points: frames at which forces are sought.
        limit: of a force that may be set [N]; 0 where none can be.
        unseen: whether it goes on before the first page is open.
        knobs: which of `noise` (a factor) and `wind` (3,) [m/s] may be set.
        time: of now [s].
        q: configuration (nq,) of now.
        observer: name of what estimates.
        gain: its K [1/s].
        said: a line about what has just happened; empty for nothing.
        ended: whether nothing more comes.
        urdf: file that may have the robot's shapes; None for none.
    """

    knobs: ClassVar[tuple[str, ...]] = ()
    unseen: ClassVar[bool] = True
    limit = 0.0
    said = ""
    ended = False
    urdf: Path | None = None

    def __init__(self, title: str, model: pin.Model, points: tuple[str, ...], observer: str, gain: float) -> None:
        self.title, self.model, self.points, self.observer, self.gain = title, model, points, observer, gain
        self.force: Array = np.zeros((len(points), 3))
        self.wind: Array = np.zeros(3)
        self.noise = 1.0
        self.time, self.q = 0.0, np.array(pin.neutral(model))
        self.unknown = np.full((len(points), 3), np.nan)

    def advance(self, seconds: float, budget: float) -> list[LiveRow]:
        """Go on by some time [s], but work no longer than the budget [s]; return what was estimated."""
        until, deadline, rows = self.time + seconds - 1e-9, monotonic() + budget, list[LiveRow]()
        while self.time < until and monotonic() < deadline and not self.ended:
            rows += self.step()
        return rows

    def step(self) -> list[LiveRow]:
        """Go on by one interval; return its estimate, if there is one."""
        raise NotImplementedError

    def change(self, values: Mapping[str, Any]) -> None:
        """Set `force` (p, 3), `wind` (3,), `noise`, or `observer` and `gain`; others, or wrong ones, are refused.

        Raises:
            ObserverError, MapError: no observer has that name or gain.
            TypeError, ValueError: these are no such numbers.
        """
        for name, given in values.items():
            if name == "force" and self.limit:
                self.force = _within(given, -self.limit, self.limit).reshape(self.force.shape)
            elif name == "wind" and name in self.knobs:
                self.wind = _within(given, -LARGEST_WIND, LARGEST_WIND).reshape(3)
            elif name == "noise" and name in self.knobs:
                self.noise = float(_within(given, 0.0, LOUDEST))
        observer, gain = str(values.get("observer", self.observer)), float(values.get("gain", self.gain))
        if observer not in LIVE_OBSERVERS or not 0.0 < gain <= max(LARGEST_LIVE_GAIN, self.gain):
            raise ObserverError(
                f"{observer} with K {gain:g} 1/s: one of {', '.join(LIVE_OBSERVERS)} and a gain up to "
                f"{LARGEST_LIVE_GAIN:g} were expected"
            )
        tuned = (observer, gain) != (self.observer, self.gain)
        self.observer, self.gain = observer, gain
        self.changed(tuned=tuned)

    def changed(self, *, tuned: bool) -> None:
        """Take over what was set; `tuned` says whether that is another observer or gain."""

    def close(self) -> None:
        """Leave what was entered: a network."""

    def result(self, show: Progress) -> Experiment | Result:
        """Return the last `KEPT` seconds, estimated as a whole."""
        raise NotImplementedError


def _within(given: Any, least: float, most: float) -> Array:
    """Return numbers within bounds. Raises TypeError or ValueError for what is none, or not finite."""
    values: Array = np.array(given, float)
    if not np.all(np.isfinite(values)):
        raise ValueError(f"{given}: finite numbers were expected")
    return np.asarray(np.clip(values, least, most))
