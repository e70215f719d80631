"""Results of an observer: a `Sample` for each update of a stream, an `Estimate` for a whole record."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from aerobat_pin.errors import ObserverError
from aerobat_pin.numerics import Array, guarded
from aerobat_pin.observers.expected import SHOWN
from aerobat_pin.observers.identifiability import Identifiability
from aerobat_pin.observers.redundancy import Redundancy, redundancy_of

if TYPE_CHECKING:
    from xarray import Dataset


class Sample:
    """The estimate for one interval: the unknown components and the generalised residual."""

    __slots__ = ("_count", "_nv", "_values")

    def __init__(self, values: Array, nv: int, count: int) -> None:
        """Store the values: the residual (nv), the components (count), and what only one kind of observer has."""
        self._values, self._nv, self._count = values, nv, count

    @property
    def force(self) -> Array:
        """Forces (n, 3) [N] in world axes; valid only if all components are such forces (see `Estimate.force`)."""
        return self.components.reshape(-1, 3)

    @property
    def components(self) -> Array:
        """All components (c,) in the order of the applications."""
        return self._values[self._nv : self._nv + self._count]

    @property
    def residual(self) -> Array:
        """Generalised residual (nv,)."""
        return self._values[: self._nv]

    @property
    def standard_deviation(self) -> Array | None:
        """Standard deviations (c,) of the components, if the observer computes them; infinite without a trace."""
        start = self._nv + self._count
        return self._values[start : start + self._count] if len(self._values) > start else None

    def __repr__(self) -> str:
        return f"{type(self).__name__}(components={np.array2string(self.components, precision=4)})"


@dataclass(frozen=True)
class Innovation:
    """How well a filter predicts the next sample: its innovations L^-1 e, L L^T the covariance that it predicts for e.

    Attributes:
        nis: (m,) normalised innovation squared, e^T S^-1 e over the number of rows in use. Its mean is 1 if the filter
            errs as much as it says, smaller if it errs less.
        whiteness: correlation of neighbouring innovations, between -1 and 1: 0 if the filter uses all that a sample
            says about the next one, positive if it is too slow for the forces or a wrong model pushes steadily.
    """

    nis: Array
    whiteness: float

    @property
    def mean(self) -> float:
        """Mean of `nis`."""
        return float(np.mean(self.nis))


@dataclass(frozen=True, repr=False)
class Estimate:
    """Estimates over a record; row k belongs to the interval from time_k to time_k+1.

    Attributes:
        observer: name of the observer.
        gain: gain of the observer [1/s].
        rows: which rows of the residual the observer used, or the name of a tie.
        frames: names of the n frames at which unknown forces act.
        time: (m + 1,) sample times [s].
        components: (m, c) estimated components; their labels are `identifiability.components`.
        units: (c,) unit of each component, `N` or `N m`.
        residual: (m, nv) estimated generalised force.
        identifiability: which components can be determined from the rows used.
        unexplained: (m, nv) weighted rows [N] that no force explains, padded with zeros; see `redundancy`.
        rows_in_use: number of rows that the observer uses.
        weight: weight of everything that moves [N].
        standard_deviation: (m, c) standard deviations of the components, if the observer computes them, else None;
            infinite for a component of a pattern that leaves no trace.
        innovation: how well a Kalman filter predicts the samples, else None.
        expected_force: (c,) size of the components that was expected before, if any was, else None.
        seen: (m, c) share of its square that the rows settle; None where none was expected.
        doubt: (m,) k: how many times as large as stated the squared errors of the rows are, where they can be seen;
            None without expected errors, NaN where there is no row to spare.
        notes: lines of text about what the observer chose or found beside the forces.
        warnings: lines of text about what spoils the estimate.
    """

    observer: str
    gain: Array
    rows: str
    frames: tuple[str, ...]
    time: Array
    components: Array
    units: tuple[str, ...]
    residual: Array
    identifiability: Identifiability
    unexplained: Array
    rows_in_use: int
    weight: float
    standard_deviation: Array | None = None
    innovation: Innovation | None = None
    expected_force: Array | None = None
    seen: Array | None = None
    doubt: Array | None = None
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    @cached_property
    def redundancy(self) -> Redundancy:
        """What no force explains, and what this says about the belief."""
        return redundancy_of(
            self.time, self.unexplained, self.rows_in_use, self.identifiability.rank, self.weight, self.frames
        )

    @property
    def redundancy_series(self) -> Array:
        """Size (m,) [N] of what no force explains in each interval, per redundant row."""
        share = max(self.redundancy.redundant, 1)
        return np.asarray(np.sqrt(np.sum(self.unexplained**2, axis=1) / share))

    @property
    def shown(self) -> NDArray[np.bool_]:
        """Whether each component (m, c) is seen well enough to be shown; everywhere if no force was expected."""
        return np.ones(self.components.shape, bool) if self.seen is None else self.seen > SHOWN

    @property
    def are_world_forces(self) -> bool:
        """Whether the components are n forces in world axes, with three components each."""
        labels = self.identifiability.components
        return len(labels) == 3 * len(self.frames) and all(label[-3:] in (".Fx", ".Fy", ".Fz") for label in labels)

    @property
    def force(self) -> Array:
        """Forces (m, n, 3) [N] in world axes.

        Raises:
            ObserverError: not all components are forces in world axes; read them by `component`.
        """
        if not self.are_world_forces:
            raise ObserverError("not all components are forces in world axes: read them by `component`")
        return self.components.reshape(len(self.components), -1, 3)

    @guarded()
    def component(self, label: str) -> Array:
        """Return the component (m,) [N or N m] with a label such as `tool.Mz`. Raises ObserverError if none has it."""
        labels = self.identifiability.components
        if label not in labels:
            raise ObserverError(f"no component '{label}'; there are {', '.join(labels)}")
        return self.components[:, labels.index(label)]

    def to_xarray(self) -> Dataset:
        """Return the dataset that `estimate.nc` contains for this estimate.

        To join the datasets of several observers, call `xarray.concat` along `observer`. If all components are forces
        in world axes, they are in `force_W` (observer, interval, point, axis). Otherwise all components are in
        `components` (observer, interval, component), each with its `unit`.
        """
        import xarray as xr  # takes a third of a second to import; only this method needs it

        def variable(dims: str, values: Array, unit: str, meaning: str) -> tuple[Any, ...]:
            return dims.split(), values, {"units": unit, "long_name": meaning}

        coords: dict[str, Any] = {
            "observer": [self.observer],
            "interval": variable("interval", self.time[:-1], "s", "start of the interval"),
            "interval_end": variable("interval", self.time[1:], "s", "end of the interval"),
        }
        over = "observer interval"
        if self.are_world_forces:
            name, meaning, more = "force_W", "force in world axes", ["point", "axis"]
            coords |= {"point": list(self.frames), "axis": ["x", "y", "z"]}
        else:
            name, meaning, more = "components", "component", ["component"]
            coords |= {"component": list(self.identifiability.components), "unit": ("component", list(self.units))}
        dims, shape = " ".join([over, *more]), (1, len(self.components), *(len(coords[dim]) for dim in more))
        sure = np.full_like(self.components, np.nan) if self.standard_deviation is None else self.standard_deviation
        nothing = np.full(len(self.components), np.nan)
        nis = nothing if self.innovation is None else self.innovation.nis
        seen = np.full_like(self.components, np.nan) if self.seen is None else self.seen
        unit, words = ", ".join(dict.fromkeys(self.units)), f"of the estimated {meaning}, where the observer knows it"
        variables = {
            name: (dims, self.components.reshape(shape), unit, f"estimated {meaning}, mean over the interval"),
            "standard_deviation": (dims, sure.reshape(shape), unit, words),
            "seen": (dims, seen.reshape(shape), "1", f"share of the expected square of the {meaning} that is settled"),
            "k": (over, (nothing if self.doubt is None else self.doubt)[None], "1", "squared errors over the stated"),
            "residual": (f"{over} v_axis", self.residual[None], "N, N m", "estimated generalised force"),
            "redundancy": (over, self.redundancy_series[None], "N", "what no force explains, per redundant row"),
            "nis": (over, nis[None], "1", "normalised innovation squared, per row, of a filter"),
        }
        if name == "force_W":
            variables["force_deviation_W"] = variables["standard_deviation"]
        return xr.Dataset({key: variable(*values) for key, values in variables.items()}, coords=coords)

    def __repr__(self) -> str:
        lines = (
            f"  {label:<24} mean {mean:>9}, {least:>9} to {most:>9} {unit}"
            for label, mean, least, most, unit in self._rows()
        )
        return "\n".join([self._title(), *lines, f"  {self.redundancy.describe()}"])

    def _repr_html_(self) -> str:
        """Show the content of `__repr__` as a table."""
        cells = [("component", "mean", "least", "largest", "unit"), *self._rows()]
        rows = ("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in cells)
        return f"<p>{escape(self._title())}</p><table>{''.join(rows)}</table>"

    def _title(self) -> str:
        first, last = self.time[[0, -1]]
        known = f"rank {self.identifiability.rank} of {len(self.units)}"
        return (
            f"Estimate of '{self.observer}': {len(self.components)} intervals from {first:g} s to {last:g} s, "
            f"rows '{self.rows}', {known}"
        )

    def _rows(self) -> Iterator[tuple[str, ...]]:
        """Yield label, mean, smallest value, largest value and unit of each component."""
        for label, unit, values in zip(self.identifiability.components, self.units, self.components.T, strict=True):
            yield label, *(f"{number:.4g}" for number in (values.mean(), values.min(), values.max())), unit
