"""The file of a calibration: NetCDF, every array under its place in `Calibration`, and all else as one text of JSON.

A file may come from a stranger: each part is checked against the types of `Calibration`, its numbers and its shapes.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from operator import attrgetter
from pathlib import Path
from types import UnionType
from typing import Any, get_args, get_origin, get_type_hints

import numpy as np
import xarray as xr

from aerobat_pin.errors import CalibrationError, LogError
from aerobat_pin.estimation.calibration.calibration import Calibration
from aerobat_pin.forces import weight_count
from aerobat_pin.numerics import Array, guarded
from aerobat_pin.observers import FRICTION_COEFFICIENTS
from aerobat_pin.records import netcdf_bytes, read_netcdf

FAMILY = "aerobat calibration"
KIND = f"{FAMILY} 9"  # with the number of the form
ALL_ELSE = "words"  # the variable with all that is no array
STANDS_FOR = "array "  # begins what stands there in place of an array: its place, or the shape of one without numbers
LARGEST_LEARNT = 1.0e9  # of any number in a file
UNKNOWN_SIZES = ("fitted.friction.deviation",)  # arrays that may have infinite entries


@guarded()
def calibration_bytes(calibration: Calibration) -> bytes:
    """Return the content of a calibration's file."""
    arrays: dict[str, Array] = {}
    words = json.dumps(_taken_apart(replace(calibration, correct=False), "", arrays))
    parts = {name: (tuple(f"{name}.{axis}" for axis in range(a.ndim)), a) for name, a in arrays.items()}
    return netcdf_bytes(xr.Dataset(parts | {ALL_ELSE: ((), words)}, attrs={"kind": KIND}))


def _taken_apart(value: Any, place: str, arrays: dict[str, Array]) -> Any:
    """Return what JSON can hold of a value, and collect its arrays by their place."""
    if isinstance(value, np.ndarray):
        place = place.replace("%", "%25").replace("/", "%2F")  # a slash in a force's name would begin a group
        arrays |= {place: value} if value.size else {}
        return f"{STANDS_FOR}{place if value.size else list(value.shape)}"
    if is_dataclass(value):
        value = {field.name: getattr(value, field.name) for field in fields(value)}
    if isinstance(value, Mapping):
        return {key: _taken_apart(entry, f"{place}.{key}".strip("."), arrays) for key, entry in value.items()}
    if isinstance(value, tuple):
        return [_taken_apart(entry, f"{place}.{k}", arrays) for k, entry in enumerate(value)]
    return value.item() if isinstance(value, np.generic) else value


@guarded()
def read_calibration(path: Path) -> Calibration:
    """Read a calibration's file. Raises CalibrationError if it is missing, damaged, older, newer or another."""
    name = f"calibration {path}"
    try:
        data = read_netcdf(path, "calibration")[""]
    except LogError as error:
        raise CalibrationError(str(error)) from error
    kind = str(data.attrs.get("kind", ""))
    if kind != KIND and kind.startswith(FAMILY):
        form, read = kind.removeprefix(FAMILY).strip(), KIND.removeprefix(FAMILY).strip()
        newer = form.isdecimal() and int(form) > int(read)
        age, remedy = ("a newer", ", or install a newer aerobat-pinocchio") if newer else ("an older", "")
        raise CalibrationError(f"{name}: {age} file: calibrate again{remedy}")
    if kind != KIND:
        raise CalibrationError(f"{name}: a file that `aerobat calibrate` wrote was expected")
    try:
        calibration: Calibration = _of_type(Calibration, json.loads(str(data[ALL_ELSE].values)), data)
        for place, wanted in _shapes(calibration).items():
            if (shape := attrgetter(place)(calibration).shape) != wanted:
                raise ValueError(f"{place} has shape {shape}: {wanted} was expected")
        _refuse_values(calibration)
    except (KeyError, ValueError, TypeError, AttributeError, OverflowError, RecursionError) as error:
        reason = " ".join(str(error).split())[:200]
        raise CalibrationError(f"{name}: a part is missing or damaged: {reason}") from error
    return calibration


def _of_type(kind: Any, value: Any, data: xr.Dataset) -> Any:
    """Return what JSON held as a value of a type. Raises KeyError, TypeError or ValueError if it is none."""
    origin, inner = get_origin(kind), get_args(kind)
    if origin is np.ndarray:
        return _stored_array(value, data)
    if origin is UnionType:  # of something and None
        return None if value is None else _of_type(inner[0], value, data)
    if origin in (dict, Mapping):
        return {key: _of_type(inner[1], entry, data) for key, entry in _of_kind(value, dict).items()}
    hints = {} if origin is tuple else get_type_hints(kind)
    if is_dataclass(kind):
        names, entries = [field.name for field in fields(kind)], _of_kind(value, dict)
        make: Any = kind
        return make(**{name: _of_type(hints[name], entries[name], data) for name in names})
    if origin is tuple or hints:
        entries = _of_kind(value, list)
        kinds = hints.values() or (len(entries) * inner[:1] if inner[-1] is ... else inner)
        elements = [_of_type(each, entry, data) for each, entry in zip(kinds, entries, strict=True)]
        return kind(*elements) if hints else tuple(elements)
    return _of_kind(value, *((float, int) if kind is float else (kind,)))


def _of_kind(value: Any, *kinds: type) -> Any:
    """Return a value of one of some types. Raises TypeError for another one."""
    if not isinstance(value, kinds) or (isinstance(value, bool) and bool not in kinds):
        raise TypeError(f"{str(value)[:40]}: {kinds[0].__name__} was expected")
    return value


def _stored_array(value: Any, data: xr.Dataset) -> Array:
    """Return the array for which a text of JSON stands. Raises KeyError, TypeError or ValueError."""
    if not isinstance(value, str) or not value.startswith(STANDS_FOR):
        raise TypeError(f"{str(value)[:40]}: an array was expected")
    place = value.removeprefix(STANDS_FOR)
    if place.startswith("["):
        shape = tuple(json.loads(place))
        if 0 not in shape:
            raise ValueError(f"an array of shape {shape} has no numbers")
        return np.zeros(shape)
    values = np.asarray(data[place].values, float)
    if place not in UNKNOWN_SIZES and not np.all(np.abs(values) <= LARGEST_LEARNT):
        raise ValueError(f"{place} holds a number that is not finite, or beyond {LARGEST_LEARNT:g}")
    return values


def _shapes(learnt: Calibration) -> dict[str, tuple[int, ...]]:
    """Return place of an array -> the shape that it must have."""
    fitted, friction, identified, series = learnt.fitted, learnt.fitted.friction, learnt.identified, learnt.series
    n, gains = len(fitted.joints), len(fitted.joints) + fitted.links.size
    shapes: dict[str, tuple[int, ...]] = {
        "fitted.links": (len(fitted.links), 10),
        "fitted.gain_covariance": (gains, gains) if len(fitted.links) else (0, 0),
        "fitted.scale": (n if friction is not None else 0,),
    }
    if friction is not None:
        shapes |= {f"fitted.friction.{name}": (n,) for name in FRICTION_COEFFICIENTS}
        if friction.deviation is not None:
            shapes["fitted.friction.deviation"] = n, len(FRICTION_COEFFICIENTS)
    if identified is not None:
        count = len(identified.parameters)
        shapes |= {"identified.values": (count,), "identified.covariance": (count, count)}
    if series is not None:
        rows, states = len(series.size), len(series.states)
        weights = weight_count(series.order, states)
        shapes |= {"series.centre": (states,), "series.scale": (states,), "series.mean": (weights, rows)}
        shapes |= {"series.covariance": (rows, weights, weights), "series.remainder": (rows,)}
    if learnt.detection is not None:
        size = (3 * len(learnt.detection.frames),)
        shapes |= {"detection.bias": size, "detection.threshold": size, "detection.deviation": size}
    return shapes


def _refuse_values(learnt: Calibration) -> None:
    """Raise ValueError for numbers that no calibration has."""
    fitted, identified, series = learnt.fitted, learnt.identified, learnt.series
    numbers = {"row_noise": [*learnt.row_noise.values(), *fitted.row_noise.values()], "fitted.doubt": [fitted.doubt]}
    numbers["ranges"] = [end for ends in learnt.ranges.values() for end in ends]
    numbers |= {} if fitted.friction is None else {"fitted.friction.rate": [fitted.friction.rate]}
    numbers |= {} if series is None else {"series.share": [series.share]}
    if identified is not None:
        expected = [parameter.expected for parameter in identified.parameters.values()]
        numbers["identified"] = [*identified.before, *identified.after, identified.allowed, *expected]
    for part, values in numbers.items():
        if not np.all(np.abs(values) <= LARGEST_LEARNT):
            raise ValueError(f"{part} holds a number that is not finite, or beyond {LARGEST_LEARNT:g}")
    if not 0.0 < fitted.mass <= LARGEST_LEARNT:
        raise ValueError(f"mass {fitted.mass:g}: a factor above 0 was expected")
    if identified is not None and np.any(identified.values <= -1.0):
        raise ValueError("change of -1 or less: of a factor, more than -1 was expected")
    if series is not None and not np.all(series.scale > 0.0):
        raise ValueError("series.scale: units above 0 were expected")
    if learnt.detection is not None and not np.all(learnt.detection.deviation > 0.0):
        raise ValueError("detection.deviation: deviations above 0 were expected")
