"""The unknown forces of a scenario file, one class for each value of `signal`.

Each class integrates its signal over time exactly, so that the mean force over an interval is exact. The signal of the
paper (section III-A) is f_t = 0.2 sin(q_e) + noise, plus 0.15 while 1 s < t <= 1.6 s, with noise ~ N(0, 0.01^2). Its
sine follows the elbow angle q_e continuously. The noise and the paper's step change only at the ticks of a clock that
is independent of the integrator, so they do not depend on the integrator's step. Every other signal acts with its mean
over each step of the integrator, so that no impulse is lost between two steps.
"""

from __future__ import annotations

import math
import warnings
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Discriminator, Field, Tag, model_validator

from aerobat_pin.errors import LARGEST_TABLE, LogError, ScenarioError, foreign_file
from aerobat_pin.numerics import Array, Integers, guarded
from aerobat_pin.scenario.tables import NonNegative, Number, Positive, Section, Triple

Axes = Literal["link", "body", "world"]


class UnknownForce(Section):
    """One unknown force: it acts at a frame, along a direction, and varies in time as its signal says."""

    frame: str = Field(description="frame at whose origin it acts; `base_link` is the body")
    signal: str = Field("paper", description="one of those below, each with keys of its own")
    direction: Triple = Field((0.0, 0.0, 1.0), description="normalised on reading [-]")
    axes: Axes = Field("link", description="axes in which the direction is fixed: of the frame's link, body or world")
    noise: NonNegative = Field(0.0, description="standard deviation of white noise [N], drawn per force")
    tick: Annotated[Number, Field(ge=1.0e-5)] = Field(1.0e-3, description="one value of the noise is held so long [s]")

    @property
    def elbow_amplitude(self) -> float:
        """Factor of sin(elbow angle) [N]; the simulation adds this part, as it follows the elbow at every instant."""
        return 0.0

    @property
    def event(self) -> tuple[str, float, float] | None:
        """Name, start and end [s] of the signal's event, for figures and replay; end is infinite if it stays on."""
        return None

    def impulse_until(self, time: Array) -> Array:
        """Return the integral of the force (n,) [N s] up to increasing times (n,) [s], without noise and elbow part.

        The integral can start at any time, as long as it is the same for all entries: only differences are used.
        """
        raise NotImplementedError

    @guarded(edges=("2+",))
    def interval_means(self, edges: Array, rng: np.random.Generator) -> tuple[Array, Array]:
        """Draw the noise of a run, and average both noise and signal over intervals.

        Args:
            edges: (n + 1,) interval edges [s]; noise is drawn from the tick in which the first one lies.
            rng: random generator for the noise.

        Returns:
            Mean noise (n,) and mean noise-free force (n,) [N] over each interval, both without the part that follows
            the elbow.

        Raises:
            ScenarioError: the file of a recorded force cannot be read.
        """
        ticks = _ticks(edges, self.tick)
        noise = self.noise * rng.standard_normal(len(ticks))
        since = edges - ticks[0] * self.tick
        return tick_means(noise, self.tick, since), _mean_rates(self.impulse_until(edges), edges)


class PaperForce(UnknownForce):
    """The force of the paper: a sine of the elbow angle, noise and a step."""

    signal: Literal["paper"] = Field("paper", description="the paper's: sine of the elbow angle, noise and step")
    noise: NonNegative = Field(0.01, description="standard deviation of white noise [N], drawn per force")
    tick: Annotated[Number, Field(ge=1.0e-5)] = Field(
        1.0e-3, description="one value of noise and step is held this long [s]"
    )
    amplitude: Number = Field(0.2, description="factor of sin(elbow angle) [N]")
    step: Number = Field(0.15, description="height of the step [N]")
    step_start: Number = Field(1.0, description="on for step_start < t <= step_end [s]")
    step_end: Number = Field(1.6, description="see step_start [s]")

    @model_validator(mode="after")
    def _ends_after_start(self) -> PaperForce:
        if self.step_end < self.step_start:
            times = f"step_start = {self.step_start} s to step_end = {self.step_end} s"
            raise ValueError(f"unknown_force: step from {times}: step_end comes later")
        return self

    @property
    def elbow_amplitude(self) -> float:
        """Factor of sin(elbow angle) [N]."""
        return self.amplitude

    @property
    def event(self) -> tuple[str, float, float] | None:
        """Name, start and end [s] of the step; None if its height is 0."""
        return ("step", self.step_start, self.step_end) if self.step != 0.0 else None

    def impulse_until(self, time: Array) -> Array:
        """Return the integral of the step (n,) [N s] up to times (n,) [s]; the step changes at ticks only."""
        ticks = _ticks(time, self.tick)
        start = ticks * self.tick
        # The margin of 5e-4 ticks excludes t = 1.0 s from "1 s < t" even if the tick's time is rounded up.
        on = (start > self.step_start + 5e-4 * self.tick) & (start <= self.step_end + 5e-4 * self.tick)
        return _tick_integral(self.step * on, self.tick, time - ticks[0] * self.tick)


class StepForce(UnknownForce):
    """A constant force that is switched on at one time and, if `end` is given, off at another."""

    signal: Literal["step"] = Field(description="on at a time, and perhaps off again")
    height: Number = Field(0.1, description="of the step [N]")
    start: Number = Field(0.5, description="on from here [s]")
    end: Number | None = Field(None, description="off from here [s]; never, when left out")

    @property
    def event(self) -> tuple[str, float, float] | None:
        """Name, start and end [s] of the step; the end is infinite if it stays on."""
        return "step", self.start, self._off

    @model_validator(mode="after")
    def _ends_after_start(self) -> StepForce:
        if self.end is not None and self.end <= self.start:
            raise ValueError(f"unknown_force: step from start = {self.start} s to end = {self.end} s: end comes later")
        return self

    def impulse_until(self, time: Array) -> Array:
        """Return the integral of the step (n,) [N s] up to times (n,) [s], up to a constant."""
        return np.asarray(self.height * np.clip(time, self.start, self._off))

    @property
    def _off(self) -> float:
        return math.inf if self.end is None else self.end


class ImpulseForce(UnknownForce):
    """A short push of a given impulse."""

    signal: Literal["impulse"] = Field(description="a short push of a given impulse")
    impulse: Number = Field(2.0e-3, description="whole of the push [N s]")
    start: Number = Field(0.5, description="of the push [s]")
    duration: Positive = Field(0.01, description="of the push [s]")
    shape: Literal["half_sine", "boxcar"] = Field("half_sine", description="how the force rises and falls, or is held")

    @property
    def event(self) -> tuple[str, float, float] | None:
        """Name, start and end [s] of the push."""
        return "impulse", self.start, self.start + self.duration

    def impulse_until(self, time: Array) -> Array:
        """Return the part of the impulse (n,) [N s] that the push has given by times (n,) [s]."""
        share = np.clip((time - self.start) / self.duration, 0.0, 1.0)
        return np.asarray(self.impulse * (share if self.shape == "boxcar" else 0.5 * (1.0 - np.cos(np.pi * share))))


class SineForce(UnknownForce):
    """A steady oscillation: amplitude sin(2 pi frequency t + phase)."""

    signal: Literal["sine"] = Field(description="amplitude sin(2 pi frequency t + phase)")
    amplitude: Number = Field(0.1, description="of the sine [N]")
    frequency: Positive = Field(10.0, description="of the sine [Hz]")
    phase_deg: Number = Field(0.0, description="at t = 0 [deg]")

    def impulse_until(self, time: Array) -> Array:
        """Return the integral of the sine (n,) [N s] up to times (n,) [s], up to a constant."""
        rate = 2.0 * np.pi * self.frequency
        return np.asarray(-self.amplitude / rate * np.cos(rate * time + np.radians(self.phase_deg)))


class OneCosineForce(UnknownForce):
    """A smooth push as from a gust: the force rises and falls as (1 - cos) / 2."""

    signal: Literal["one_cosine"] = Field(description="a gust's push: half a cosine up and half down")
    amplitude: Number = Field(0.1, description="largest force [N]")
    start: Number = Field(0.5, description="of the push [s]")
    duration: Positive = Field(0.5, description="of the push [s]")

    @property
    def event(self) -> tuple[str, float, float] | None:
        """Name, start and end [s] of the push."""
        return "push", self.start, self.start + self.duration

    def impulse_until(self, time: Array) -> Array:
        """Return the integral (n,) [N s] of amplitude (1 - cos(2 pi (t - start) / duration)) / 2 up to times (n,)."""
        share = np.clip((time - self.start) / self.duration, 0.0, 1.0)
        turn = 2.0 * np.pi
        return np.asarray(0.5 * self.amplitude * self.duration * (share - np.sin(turn * share) / turn))


class RecordedForce(UnknownForce):
    """A force recorded in a CSV file: linear between samples, zero before the first and after the last."""

    signal: Literal["recorded"] = Field(description="a series from a file, linear between its samples")
    file: str = Field(min_length=1, description="CSV with a header: time in s, rising, and columns in N")
    column: str = Field("force", description="name of the column")

    @cached_property
    def series(self) -> tuple[Array, Array]:
        """Times (m,) [s] and forces (m,) [N] of the samples. Raises ScenarioError if the file does not contain them."""
        return _read_series(Path(self.file), self.column)

    def impulse_until(self, time: Array) -> Array:
        """Return the integral of the recorded force (n,) [N s] from the first sample up to times (n,) [s]."""
        stamps, force = self.series
        lengths = np.diff(stamps)
        whole = np.concatenate([[0.0], np.cumsum(0.5 * (force[1:] + force[:-1]) * lengths)])
        at = np.clip(time, stamps[0], stamps[-1])
        k = np.clip(np.searchsorted(stamps, at, side="right") - 1, 0, len(lengths) - 1)
        into = at - stamps[k]
        slope = (force[k + 1] - force[k]) / lengths[k]
        return np.asarray(whole[k] + into * (force[k] + 0.5 * slope * into))


def _signal(values: Any) -> str:
    """Return the value of a table's key `signal`, by default `paper`."""
    return str(values.get("signal", "paper")) if isinstance(values, dict) else str(getattr(values, "signal", "paper"))


UnknownForceSection = Annotated[
    Annotated[PaperForce, Tag("paper")]
    | Annotated[StepForce, Tag("step")]
    | Annotated[ImpulseForce, Tag("impulse")]
    | Annotated[SineForce, Tag("sine")]
    | Annotated[OneCosineForce, Tag("one_cosine")]
    | Annotated[RecordedForce, Tag("recorded")],
    Discriminator(_signal),
]


def tick_means(values: Array, tick: float, edges: Array) -> Array:
    """Return means (n,) over intervals with edges (n + 1,) [s] of values[i] from i tick to (i + 1) tick [s]."""
    return _mean_rates(_tick_integral(values, tick, edges), edges)


def _tick_integral(values: Array, tick: float, time: Array) -> Array:
    clock = np.arange(len(values) + 1) * tick
    return np.asarray(np.interp(time, clock, np.concatenate([[0.0], np.cumsum(values) * tick])))


def _mean_rates(integral: Array, edges: Array) -> Array:
    return np.asarray(np.diff(integral) / np.diff(edges))


def _ticks(time: Array, tick: float) -> Integers:
    """Return the numbers of the clock's ticks from the one in which the first of the times lies to the last one's."""
    first = int(np.floor(time[0] / tick + 1e-6))
    return np.arange(first, max(int(np.ceil(time[-1] / tick - 1e-6)), first + 1))


def _read_series(path: Path, column: str) -> tuple[Array, Array]:
    """Read `time` and one other column of a CSV file. Raises ScenarioError, which says what is wrong with the file."""
    import pandas as pd  # slow to import

    where = f"unknown_force: recorded file {path}"
    try:
        foreign_file(path, where, LARGEST_TABLE)
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)  # rows with more cells than the header
            table = pd.read_csv(
                path, encoding="utf-8-sig", skipinitialspace=True, skip_blank_lines=False, index_col=False
            ).dropna(how="all")
    except LogError as error:
        raise ScenarioError(str(error)) from error
    except (ValueError, OSError, pd.errors.ParserWarning) as error:
        raise ScenarioError(f"{where}: cannot be read as CSV: {' '.join(str(error).split())[:200]}") from error
    heads = [str(name).partition("[") for name in table.columns]
    names, chosen = [head[0].strip() for head in heads], []
    for name, unit in (("time", "s"), (column, "N")):
        if name not in names:
            raise ScenarioError(f"{where}: no column named '{name}'; its header has {', '.join(names)}")
        if (said := heads[names.index(name)][2].strip("] ")) not in ("", unit):
            raise ScenarioError(f"{where}: {name} [{said}]: {unit} was expected")
        cells = table.iloc[:, names.index(name)]
        numbers = np.asarray(pd.to_numeric(cells, errors="coerce"), float)
        if not np.all(np.isfinite(numbers)):
            k = int(np.argmin(np.isfinite(numbers)))
            wrong = f"line {table.index[k] + 2}: {name} = {str(cells.iloc[k])[:40]}"
            raise ScenarioError(f"{where}, {wrong}: a finite number was expected")
        chosen.append(numbers)
    time, force = chosen
    if len(time) < 2 or np.any(np.diff(time) <= 0.0):
        raise ScenarioError(f"{where}: two rows or more with rising times were expected")
    return time, force
