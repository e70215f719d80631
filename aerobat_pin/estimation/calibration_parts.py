"""The file of a calibration of any kind: a NetCDF file, whose parts are checked as they are read."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import xarray as xr

from aerobat_pin.errors import CalibrationError, LogError
from aerobat_pin.numerics import Array
from aerobat_pin.observers import FRICTION_COEFFICIENTS, JointFriction
from aerobat_pin.records import netcdf_bytes, read_netcdf

KIND, MAP_KIND = "aerobat calibration 1", "aerobat calibration by a map 1"  # with the number of the form
CALIBRATION_KINDS = {  # attribute `kind` of a file -> the command that writes it, and what it is about
    KIND: ("aerobat calibrate", "about Aerobat over its crank's phase, which no map knows"),
    MAP_KIND: ("aerobat calibrate LOG --map MAP", "by a map: it needs --map"),
}
LARGEST_LEARNT = 1.0e9  # of any number in a file

Learnt = TypeVar("Learnt")


class CalibrationParts:
    """What a calibration's file holds; a part that is not as it should be is a KeyError or ValueError."""

    def __init__(self, data: xr.Dataset) -> None:
        self._data, self.attributes = data, data.attrs

    def __contains__(self, key: str) -> bool:
        """Return whether there is a part of this name."""
        return key in self._data

    def size(self, dimension: str) -> int:
        """Return the size of a dimension."""
        return int(self._data.sizes[dimension])

    def texts(self, key: str) -> tuple[str, ...]:
        """Return texts; none if there is no such part."""
        return tuple(str(text) for text in np.atleast_1d(self._data[key].values) if str(text)) if key in self else ()

    def some_of(self, key: str, known: Collection[str], what: str) -> tuple[str, ...]:
        """Return texts that must all be known ones."""
        found = self.texts(key)
        if not set(found) <= set(known):
            raise ValueError(f"{key}s {', '.join(found)}: {what} {', '.join(known)} were expected")
        return found

    def numbers(self, key: str, *shape: int, finite: bool = True) -> Array:
        """Return numbers of a shape, all finite and within bounds unless they need not be."""
        values = np.asarray(self._data[key].values, float)
        if values.shape != shape:
            raise ValueError(f"{key} has shape {values.shape}: {shape} was expected")
        if finite and not np.all(np.abs(values) <= LARGEST_LEARNT):
            raise ValueError(f"{key} holds a number that is not finite, or beyond {LARGEST_LEARNT:g}")
        return values

    def friction(self, joints: int) -> JointFriction | None:
        """Return the friction of so many joints, if there is any."""
        if "friction" not in self:
            return None
        shape = joints, len(FRICTION_COEFFICIENTS)
        coulomb, viscous, inertia, offset = self.numbers("friction", *shape).T
        deviation = self.numbers("friction_deviation", *shape, finite=False)
        return JointFriction(coulomb, viscous, inertia, offset, float(self.attributes["friction_rate"]), deviation)


def parts_bytes(
    kind: str,
    variables: Mapping[str, Any],
    coords: Mapping[str, Any],
    attributes: Mapping[str, Any],
    friction: JointFriction | None,
    joints: Sequence[str],
) -> bytes:
    """Return the content of a calibration's file: what is given as xarray takes it, and the friction of joints."""
    attributes = {"kind": kind, **attributes, "friction_rate": 0.0 if friction is None else friction.rate}
    if friction is not None:
        table = np.column_stack([getattr(friction, name) for name in FRICTION_COEFFICIENTS])
        own = {"friction": table, "friction_deviation": friction.deviation}
        variables = {**variables, **{key: (("joint", "coefficient"), values) for key, values in own.items()}}
        coords = {**coords, "joint": list(joints), "coefficient": list(FRICTION_COEFFICIENTS)}
    return netcdf_bytes(xr.Dataset(variables, coords, attributes))


def lines_of(texts: Sequence[str]) -> list[str]:
    """Return texts as a part of a file, which cannot be empty."""
    return list(texts) or [""]


def read_parts(path: Path, kind: str, learnt: Callable[[CalibrationParts], Learnt]) -> Learnt:
    """Return what `learnt` makes of a file's parts.

    Raises:
        CalibrationError: the file is missing or damaged, or of another kind.
    """
    name = f"calibration {path}"
    try:
        data = read_netcdf(path, "calibration")[""]
    except LogError as error:
        raise CalibrationError(str(error)) from error
    if (about := str(data.attrs.get("kind", ""))) != kind:
        why = f"; this one was learnt {CALIBRATION_KINDS[about][1]}" if about in CALIBRATION_KINDS else ""
        raise CalibrationError(f"{name}: a file that `{CALIBRATION_KINDS[kind][0]}` wrote was expected{why}")
    try:
        return learnt(CalibrationParts(data))
    except (KeyError, ValueError, TypeError, AttributeError, IndexError, RecursionError) as error:
        reason = " ".join(str(error).split())[:200]
        raise CalibrationError(f"{name}: a part is missing or damaged: {reason}") from error
