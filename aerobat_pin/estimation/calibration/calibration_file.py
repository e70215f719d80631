"""The file of a calibration: NetCDF, whose parts are checked as they are read."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from aerobat_pin.errors import CalibrationError, LogError
from aerobat_pin.estimation.calibration.calibration import Belief, Calibration
from aerobat_pin.estimation.calibration.detection import Detection
from aerobat_pin.estimation.calibration.identify import Identified
from aerobat_pin.estimation.calibration.learnt_error import LearntError, weight_count
from aerobat_pin.estimation.known_forces import Fit, FittedValues
from aerobat_pin.numerics import Array, guarded
from aerobat_pin.observers import FRICTION_COEFFICIENTS, JointFriction
from aerobat_pin.records import Parameter, netcdf_bytes, read_netcdf

FAMILY = "aerobat calibration"
KIND = f"{FAMILY} 7"  # with the number of the form
LARGEST_LEARNT = 1.0e9  # of any number in a file
EXTRA_PART = "extra_"  # prefix of what only the robot itself reads
MOST_POWERS = 3  # of a thrust's polynomial


@guarded()
def calibration_bytes(calibration: Calibration) -> bytes:
    """Return the content of a calibration's file."""
    fitted, belief, identified = calibration.fitted, calibration.belief, calibration.identified
    parts: dict[str, Any] = {
        "record": ("file", _lines(calibration.records)),
        "note": ("line", _lines(calibration.notes)),
        "warning": ("doubt", _lines(calibration.warnings)),
        "mass": ((), fitted.mass, {"long_name": "factor of all masses and inertias", "units": "1"}),
    }
    coords: dict[str, Any] = {}
    if calibration.row_noise:
        parts["row_noise"] = ("row", list(calibration.row_noise.values()), {"long_name": "rms left where not fitted"})
        coords |= {"row": list(calibration.row_noise)}
    if identified is not None:
        parts["change"] = ("parameter", identified.values)
        parts["covariance"] = (("parameter", "other"), identified.covariance)
        parts["parameter_unit"] = ("parameter", [parameter.unit for parameter in identified.parameters.values()])
        parts["expected"] = ("parameter", [parameter.expected for parameter in identified.parameters.values()])
        parts["error"] = (("stage", "share"), np.array([identified.before, identified.after]))
        coords |= {"parameter": list(identified.parameters), "other": list(identified.parameters)}
        coords |= {"stage": ["before", "after"], "share": ["learnt", "held_out"]}
    if fitted.friction is not None:
        table = np.column_stack([getattr(fitted.friction, name) for name in FRICTION_COEFFICIENTS])
        parts["friction"] = (("joint", "coefficient"), table)
        parts["friction_deviation"] = (("joint", "coefficient"), fitted.friction.deviation)
        parts["effort_factor"] = ("joint", fitted.scale)
        coords |= {"joint": list(fitted.joints), "coefficient": list(FRICTION_COEFFICIENTS)}
    if len(fitted.links):
        parts["link_change"] = (("link", "parameter_of"), fitted.links)
        parts["gain_covariance"] = (("gain", "gain_too"), fitted.gain_covariance)
    if fitted.coefficients:
        table = np.full((len(fitted.coefficients), MOST_POWERS), np.nan)
        for row, values in zip(table, fitted.coefficients.values(), strict=True):
            row[: len(values)] = values
        parts["thrust"] = (("known", "coefficient_of"), table, {"units": "N"})
        coords |= {"known": list(fitted.coefficients)}
    if calibration.series is not None:
        series = calibration.series
        parts["doubted_share"] = ((), series.share, {"long_name": "error over the doubted known force", "units": "1"})
        parts["weight"] = (("term", "v_axis"), series.mean)
        parts["weight_covariance"] = (("v_axis", "term", "term_too"), series.covariance)
        parts["error_size"] = (("v_axis", "size"), np.column_stack([series.size, series.remainder]))
        parts["state_scale"] = (("state", "scale"), np.column_stack([series.centre, series.scale]))
        parts["state_unit"] = ("state", list(series.states.values()))
        coords |= {"state": list(series.states), "size": ["error", "remainder"], "scale": ["centre", "unit"]}
    if calibration.detection is not None:
        normal = calibration.detection
        limits = {"bias": normal.bias, "threshold": normal.threshold, "deviation": normal.deviation}
        parts["normal"] = (("component", "limit"), np.column_stack(list(limits.values())))
        parts["frame"] = ("point", _lines(normal.frames))
        coords["limit"] = list(limits)
    if calibration.error_bar:
        parts["error_bar"] = (("force", "without_with"), np.array(list(calibration.error_bar.values())))
        coords |= {"force": list(calibration.error_bar), "without_with": ["without", "with"]}
    for name, values in calibration.extras.items():
        parts[f"{EXTRA_PART}{name}"] = (tuple(f"{name}_{axis}" for axis in range(values.ndim)), values)
    attributes = {
        "kind": KIND,
        "robot": belief.robot,
        "fingerprint": belief.fingerprint,
        "settings": json.dumps(dict(belief.settings)),
        "fits": json.dumps([asdict(fit) for fit in fitted.fits]),
        "kept": int(identified is not None and identified.kept),
        "allowed": 0.0 if identified is None else identified.allowed,
        "friction_rate": 0.0 if fitted.friction is None else fitted.friction.rate,
        "harmonics": -1 if calibration.series is None else calibration.series.order,
    }
    return netcdf_bytes(xr.Dataset(parts, coords, attributes))


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
        return _Parts(data).calibration()
    except (KeyError, ValueError, TypeError, AttributeError, IndexError, RecursionError) as error:
        reason = " ".join(str(error).split())[:200]
        raise CalibrationError(f"{name}: a part is missing or damaged: {reason}") from error


def _lines(texts: Sequence[str]) -> list[str]:
    """Return texts as a part of a file, which cannot be empty."""
    return list(texts) or [""]


class _Parts:
    """The parts of a file; one that is not as it should be is a KeyError or ValueError."""

    def __init__(self, data: xr.Dataset) -> None:
        self._data, self._noted = data, data.attrs

    def calibration(self) -> Calibration:
        """Return the calibration."""
        noted, extras = self._noted, {}
        for key in map(str, self._data.data_vars):
            if key.startswith(EXTRA_PART):
                extras[key.removeprefix(EXTRA_PART)] = self._numbers(key, *self._data[key].shape)
        settings = self._object("settings", dict)
        if not all(isinstance(value, str) for value in settings.values()):
            raise ValueError("settings: names and their values in words were expected")
        rows, bar = self._texts("row") if "row_noise" in self._data else (), self._texts("force")
        noise = self._numbers("row_noise", len(rows)).tolist() if rows else []
        bars = self._numbers("error_bar", len(bar), 2, finite=False).tolist() if bar else []
        return Calibration(
            belief=Belief(str(noted["robot"]), str(noted["fingerprint"]), settings),
            records=self._texts("record"),
            identified=self._identified() if "change" in self._data else None,
            fitted=self._fitted(),
            series=self._series() if "weight" in self._data else None,
            detection=self._detection() if "normal" in self._data else None,
            extras=extras,
            error_bar={label: (before, after) for label, (before, after) in zip(bar, bars, strict=True)},
            row_noise=dict(zip(rows, noise, strict=True)),
            warnings=self._texts("warning"),
            notes=self._texts("note"),
        )

    def _identified(self) -> Identified:
        names, units = self._texts("parameter"), self._texts("parameter_unit")
        values, expected = self._numbers("change", len(names)), self._numbers("expected", len(names))
        if np.any(values <= -1.0):
            raise ValueError("change of -1 or less: of a factor, more than -1 was expected")
        before, after = self._numbers("error", 2, 2).tolist()
        return Identified(
            parameters={name: Parameter(*entry) for name, *entry in zip(names, units, expected.tolist(), strict=True)},
            values=values,
            covariance=self._numbers("covariance", len(names), len(names)),
            kept=bool(self._noted["kept"]),
            before=(before[0], before[1]),
            after=(after[0], after[1]),
            allowed=float(self._noted["allowed"]),
        )

    def _fitted(self) -> FittedValues:
        joints, known = self._texts("joint"), self._texts("known")
        friction: JointFriction | None = None
        scale: Array = np.ones(0)
        if "friction" in self._data:
            shape = len(joints), len(FRICTION_COEFFICIENTS)
            coulomb, viscous, inertia, offset = self._numbers("friction", *shape).T
            deviation, rate = self._numbers("friction_deviation", *shape, finite=False), self._noted["friction_rate"]
            friction = JointFriction(coulomb, viscous, inertia, offset, float(rate), deviation)
            scale = self._numbers("effort_factor", len(joints))
        table = self._numbers("thrust", len(known), MOST_POWERS, finite=False) if known else np.zeros((0, MOST_POWERS))
        coefficients = {name: row[np.isfinite(row)] for name, row in zip(known, table, strict=True)}
        mass = float(self._numbers("mass"))
        if not 0.0 < mass:
            raise ValueError(f"mass {mass:g}: a factor above 0 was expected")
        fits = tuple(_fit_of(entry) for entry in self._object("fits", list))
        fitted = FittedValues(coefficients, joints, friction, scale, mass, fits=fits)
        if "link_change" not in self._data:
            return fitted
        links, size = int(self._data.sizes["link"]), int(self._data.sizes["gain"])
        if size != len(joints) + 10 * links:
            raise ValueError(f"gain_covariance of {size}: one row for each joint and ten for each link were expected")
        errors = self._numbers("link_change", links, 10)
        return replace(fitted, links=errors, gain_covariance=self._numbers("gain_covariance", size, size))

    def _series(self) -> LearntError:
        states, count = self._texts("state"), int(self._data.sizes["v_axis"])
        order = int(self._noted["harmonics"])
        weights = weight_count(order, len(states))
        size, remainder = self._numbers("error_size", count, 2).T
        centre, scale = self._numbers("state_scale", len(states), 2).T
        if not np.all(scale > 0.0):
            raise ValueError("state_scale: units above 0 were expected")
        units = dict(zip(states, self._texts("state_unit"), strict=True))
        mean = self._numbers("weight", weights, count)
        spread = self._numbers("weight_covariance", count, weights, weights)
        share = float(self._numbers("doubted_share"))
        return LearntError(order, units, share, centre, scale, size, mean, spread, remainder)

    def _detection(self) -> Detection:
        frames = self._texts("frame")
        bias, threshold, deviation = self._numbers("normal", 3 * len(frames), 3).T
        if not np.all(deviation > 0.0):
            raise ValueError("normal: deviations above 0 were expected")
        return Detection(frames, bias, threshold, deviation)

    def _texts(self, key: str) -> tuple[str, ...]:
        """Return texts; none if there is no such part."""
        texts = np.atleast_1d(self._data[key].values) if key in self._data else ()
        return tuple(str(text) for text in texts if str(text))

    def _numbers(self, key: str, *shape: int, finite: bool = True) -> Array:
        """Return numbers of a shape, all finite and within bounds unless they need not be."""
        values = np.asarray(self._data[key].values, float)
        if values.shape != shape:
            raise ValueError(f"{key} has shape {values.shape}: {shape} was expected")
        if finite and not np.all(np.abs(values) <= LARGEST_LEARNT):
            raise ValueError(f"{key} holds a number that is not finite, or beyond {LARGEST_LEARNT:g}")
        return values

    def _object(self, key: str, kind: type) -> Any:
        """Return what an attribute says in JSON."""
        value = json.loads(str(self._noted[key]))
        if not isinstance(value, kind):
            raise ValueError(f"{key}: a {kind.__name__} in JSON was expected")
        return value


def _fit_of(entry: dict[str, Any]) -> Fit:
    """Return a fit of its entry in a file."""
    values = {str(key): float(value) for key, value in entry["values"].items()}
    before, inside, outside = (float(entry[key]) for key in ("before", "inside", "outside"))
    words = str(entry["log"]), str(entry.get("untold", ""))
    return Fit(str(entry["name"]), values, str(entry["unit"]), before, inside, outside, *words)
