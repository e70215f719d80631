"""What an observer answers: a `Sample` on a stream, an `Estimate` of a record."""

from __future__ import annotations

from dataclasses import dataclass

from aerobat_pin.errors import ObserverError
from aerobat_pin.numerics import Array
from aerobat_pin.observers.identifiability import Identifiability


class Sample:
    """One estimate: the unknown components and the generalised residual of an interval."""

    __slots__ = ("_nv", "_values")

    def __init__(self, values: Array, nv: int) -> None:
        """Keep residual and components, one after the other (nv + c,)."""
        self._values, self._nv = values, nv

    @property
    def force(self) -> Array:
        """Forces (n, 3) [N] in world axes, where that is what acts (see `Estimate.force`)."""
        return self._values[self._nv :].reshape(-1, 3)

    @property
    def components(self) -> Array:
        """All components (c,) in the order of the applications."""
        return self._values[self._nv :]

    @property
    def residual(self) -> Array:
        """Generalised residual (nv,)."""
        return self._values[: self._nv]


@dataclass(frozen=True)
class Estimate:
    """A run of estimates; number k belongs to the interval [time_k, time_k+1].

    Attributes:
        observer: name of the observer.
        gain: its gain [1/s].
        rows: which rows of the residual it believed, or the name of a tie.
        frames: names of the n frames at which something acts.
        time: (m + 1,) sample times [s].
        components: (m, c); their labels are `identifiability.components`.
        units: (c,) `N` or `N m` of each component.
        residual: (m, nv) estimated generalised force.
        identifiability: what could be known at all.
        standard_deviation: (m, c) of the components, where the observer knows its own.
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
    standard_deviation: Array | None = None

    @property
    def are_world_forces(self) -> bool:
        """Whether the components are n forces in world axes, three each."""
        return all(label[-3:] in (".Fx", ".Fy", ".Fz") for label in self.identifiability.components)

    @property
    def force(self) -> Array:
        """Forces (m, n, 3) [N] in world axes.

        Raises:
            ObserverError: something else than forces in world axes acts; look at `component`.
        """
        if not self.are_world_forces:
            raise ObserverError("not all components are forces in world axes: read them by `component`")
        return self.components.reshape(len(self.components), -1, 3)

    def component(self, label: str) -> Array:
        """Return one component (m,) [N or N m] by its label, such as `tool.Mz`. Raises ObserverError listing them."""
        labels = self.identifiability.components
        if label not in labels:
            raise ObserverError(f"no component '{label}'; there are {', '.join(labels)}")
        return self.components[:, labels.index(label)]
