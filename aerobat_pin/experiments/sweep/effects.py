"""What each quantity that a sweep varies does to the errors, from the grid of its results."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from aerobat_pin.errors import SweepError
from aerobat_pin.experiments.sweep.sweep_file import DRAW, SEED
from aerobat_pin.numerics import Array, guarded

COURSE = ("rms_x", "rms_y", "rms_z")
THIRDS = ("lowest third", "middle third", "highest third")  # of the values that were drawn of a key


@dataclass(frozen=True)
class Effect:
    """Errors along one varied quantity, over all runs with the same value of it.

    Attributes:
        name: dimension of the sweep, or key of its draws.
        labels: what each of the n values is called.
        values: (n,) the values; None if they are no numbers.
        errors: what errs, in which unit -> median, least and largest error (n, 3); NaN where all runs failed.
    """

    name: str
    labels: tuple[str, ...]
    values: Array | None
    errors: dict[str, Array]


@guarded()
def sweep_effects(grid: xr.Dataset) -> list[Effect]:
    """Return the effect of each varied quantity.

    What errs is the force of each observer: rms of the error over axes and points [mN]; and of a closed loop the place
    about its course [mm]. Seeds are no effect unless nothing else is varied.

    Args:
        grid: the results of a sweep, as `run_sweep` returns them.

    Raises:
        SweepError: these are no results of a sweep.
    """
    if not {"rmse", "failed"} <= set(grid.data_vars):
        raise SweepError("sweep_effects(grid): results of a sweep, with rmse and failed, were expected")
    dims = [str(name) for name in grid["failed"].dims if grid.sizes[name] > 1]
    dims = [name for name in dims if name != SEED] or dims
    return [effect for name in dims for effect in _effects_along(grid, name)]


def _effects_along(grid: xr.Dataset, name: str) -> Iterator[Effect]:
    errors: dict[str, Any] = {
        f"{observer} [mN]": 1e3
        * np.sqrt((grid["rmse"].sel(observer=observer) ** 2).sum("axis", skipna=False).mean("point"))
        for observer in grid["observer"].values
    }
    if set(COURSE) <= set(grid.data_vars):
        errors["off course [mm]"] = 1e3 * np.sqrt(sum(grid[axis] ** 2 for axis in COURSE))
    rows = {what: found.transpose(name, ...).values.reshape(grid.sizes[name], -1) for what, found in errors.items()}
    if name != DRAW:
        labels = grid[name].values
        numbers = np.asarray(labels, float) if labels.dtype.kind in "if" else None
        texts = tuple(str(one) if numbers is None else f"{one:.4g}" for one in labels)
        yield Effect(name, texts, numbers, {what: _spread(list(values)) for what, values in rows.items()})
        return
    for key in (str(key) for key, one in grid.coords.items() if one.dims == (DRAW,) and key != DRAW):
        values = np.asarray(grid[key].values, float)
        thirds = [third for third in np.array_split(np.argsort(values), len(THIRDS)) if len(third)]
        middles = np.array([np.median(values[third]) for third in thirds])
        texts = tuple(f"{middle:.4g} ({third})" for middle, third in zip(middles, THIRDS, strict=False))
        found = {what: _spread([values[third] for third in thirds]) for what, values in rows.items()}
        yield Effect(key, texts, middles, found)


def _spread(groups: list[Array]) -> Array:
    """Return median, least and largest (n, 3) of each group of errors, without those of runs that failed."""
    finite = [group[np.isfinite(group)] for group in map(np.ravel, groups)]
    nothing = np.full(3, np.nan)
    return np.array([[np.median(one), one.min(), one.max()] if len(one) else nothing for one in finite])


@guarded()
def effects_text(effects: list[Effect]) -> str:
    """Return a table as text: a row for each value of each quantity, with the median error and its range."""
    names = list(dict.fromkeys(what for effect in effects for what in effect.errors))
    cells = [("median error, least .. largest", *names)]
    for effect in effects:
        for k, label in enumerate(effect.labels):
            found = (effect.errors[what][k] for what in names)
            numbers = ("-" if np.isnan(one[0]) else f"{one[0]:.3g}, {one[1]:.3g} .. {one[2]:.3g}" for one in found)
            cells.append((f"{effect.name} = {label}", *numbers))
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return "\n".join("  ".join(map(str.ljust, row, widths)).rstrip() for row in cells)
