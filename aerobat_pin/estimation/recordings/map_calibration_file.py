"""Write what a recording showed by a map to a NetCDF file, and read it again."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from aerobat_pin.errors import CalibrationError, LogError
from aerobat_pin.estimation.recordings.fit_joint_friction import friction_values
from aerobat_pin.estimation.recordings.known_forces import Fit, FittedValues
from aerobat_pin.estimation.recordings.map_calibration import MASS_NAME, MapCalibration
from aerobat_pin.flight import netcdf_bytes, read_netcdf
from aerobat_pin.numerics import Array, guarded
from aerobat_pin.observers import FRICTION_COEFFICIENTS, JointFriction

MAP_KIND = "aerobat calibration by a map 1"  # attribute `kind` of the file, with the number of its form
POWERS = (1, 2, 3)  # of a thrust's polynomial
LARGEST_LEARNT = 1.0e9  # of any number in the file
LEFT_OVER = ("before", "inside", "outside")  # columns of what a fit leaves


@guarded()
def map_calibration_bytes(calibration: MapCalibration) -> bytes:
    """Return the content of a calibration's file."""
    values = calibration.values
    variables: dict[str, Any] = {
        "note": (("line",), list(calibration.notes) or [""]),
        "mass": ((), values.mass, {"long_name": "factor of all masses and inertias", "units": "1"}),
        "left": (("fit", "part"), np.array([[fit.before, fit.inside, fit.outside] for fit in values.fits])),
        "left_unit": (("fit",), [fit.unit for fit in values.fits]),
    }
    coords: dict[str, Any] = {"fit": [fit.name for fit in values.fits], "part": list(LEFT_OVER)}
    if calibration.error_bar:
        variables["error_bar"] = (("component", "stage"), np.array(list(calibration.error_bar.values())))
        coords |= {"component": list(calibration.error_bar), "stage": ["without", "with"]}
    deviation = next((fit.values["deviation"] for fit in values.fits if fit.name == MASS_NAME), np.nan)
    variables["mass_deviation"] = ((), deviation, {"units": "1"})
    if values.friction is not None:
        losses = [getattr(values.friction, name) for name in FRICTION_COEFFICIENTS]
        variables["friction"] = (("joint", "coefficient"), np.column_stack(losses))
        variables["friction_deviation"] = (("joint", "coefficient"), values.friction.deviation)
        variables["effort_factor"] = (("joint",), values.scale)
        variables["effort_fitted"] = (("joint",), np.array(_scaled(values), np.int8))
        variables["torque_per_unit"] = (("joint",), [calibration.torque_per_unit[name] for name in values.joints])
        coords |= {"joint": list(values.joints), "coefficient": list(FRICTION_COEFFICIENTS)}
    if values.coefficients:
        table = np.zeros((len(values.coefficients), len(POWERS)))
        for row, name in zip(table, values.coefficients, strict=True):
            row[_power_columns(calibration.laws[name])] = values.coefficients[name]
        variables["thrust"] = (("known", "power"), table, {"units": "N"})
        coords |= {"known": list(values.coefficients), "power": list(POWERS)}
    attributes = {
        "kind": MAP_KIND,
        "robot": calibration.robot,
        "fingerprint": calibration.fingerprint,
        "log": calibration.log,
        "laws": json.dumps(dict(calibration.laws)),
        "friction_rate": 0.0 if values.friction is None else values.friction.rate,
    }
    return netcdf_bytes(xr.Dataset(variables, coords, attributes))


@guarded()
def read_map_calibration(path: Path) -> MapCalibration:
    """Read a calibration's file. Raises CalibrationError if it is missing, damaged or something else."""
    name = f"calibration {path}"
    try:
        data = read_netcdf(path, "calibration")[""]
    except LogError as error:
        raise CalibrationError(str(error)) from error
    if data.attrs.get("kind") != MAP_KIND:
        about = str(data.attrs.get("kind", ""))
        why = ""
        if about.startswith("aerobat calibration"):
            why = "; this one was learnt about Aerobat over its crank's phase, which no map knows"
        raise CalibrationError(f"{name}: a file that `aerobat calibrate LOG --map MAP` wrote was expected{why}")
    try:
        return _calibration_in(data)
    except (KeyError, ValueError, TypeError, AttributeError, IndexError, RecursionError) as error:
        reason = " ".join(str(error).split())[:200]
        raise CalibrationError(f"{name}: a part is missing or damaged: {reason}") from error


def _calibration_in(data: xr.Dataset) -> MapCalibration:
    noted, joints = data.attrs, _texts_of(data, "joint")
    laws = json.loads(str(noted["laws"]))
    if not isinstance(laws, dict) or not all(isinstance(law, str) for law in laws.values()):
        raise ValueError("laws: name and law of each thrust were expected")
    friction, torques, scaled = None, {}, False
    scale: Array = np.ones(0)
    if "friction" in data:
        coulomb, viscous, inertia, offset = _finite_numbers(
            data, "friction", (len(joints), len(FRICTION_COEFFICIENTS))
        ).T
        deviation = np.asarray(data["friction_deviation"].values, float).reshape(len(joints), -1)
        friction = JointFriction(coulomb, viscous, inertia, offset, float(noted["friction_rate"]), deviation)
        scale = _finite_numbers(data, "effort_factor", (len(joints),))
        scaled = bool(np.any(_finite_numbers(data, "effort_fitted", (len(joints),))))
        torques = dict(zip(joints, _finite_numbers(data, "torque_per_unit", (len(joints),)).tolist(), strict=True))
    known = _texts_of(data, "known")
    coefficients: dict[str, Array] = {}
    if known:
        rows = _finite_numbers(data, "thrust", (len(known), len(POWERS)))
        coefficients = {name: row[_power_columns(laws[name])] for name, row in zip(known, rows, strict=True)}
    mass = float(_finite_numbers(data, "mass", ()))
    if not 0.0 < mass:
        raise ValueError(f"mass {mass:g}: a factor above 0 was expected")
    bar = {}
    if "error_bar" in data:
        labels = _texts_of(data, "component")
        sizes = np.asarray(data["error_bar"].values, float).reshape(len(labels), 2)
        bar = {label: (float(before), float(after)) for label, (before, after) in zip(labels, sizes, strict=True)}
    return MapCalibration(
        robot=str(noted["robot"]),
        fingerprint=str(noted["fingerprint"]),
        torque_per_unit=torques,
        laws=laws,
        values=FittedValues(
            coefficients,
            joints,
            friction,
            scale,
            mass,
            _read_fits(data, friction, scale if scaled else None, coefficients),
        ),
        error_bar=bar,
        log=str(noted["log"]),
        notes=_texts_of(data, "note"),
    )


def _read_fits(
    data: xr.Dataset, friction: JointFriction | None, scale: Array | None, coefficients: dict[str, Array]
) -> tuple[Fit, ...]:
    """Return what a file says about how well each fit holds."""
    names, found = _texts_of(data, "fit"), []
    left = np.asarray(data["left"].values, float).reshape(len(names), len(LEFT_OVER))
    joint = 0
    laws = json.loads(str(data.attrs["laws"]))
    for name, sizes, unit in zip(names, left, np.atleast_1d(data["left_unit"].values), strict=True):
        thrust = name.removeprefix("known.")
        if name == MASS_NAME:
            values = {"times": float(data["mass"]), "deviation": float(data["mass_deviation"])}
        elif thrust in coefficients:
            powers = [POWERS[k] for k in _power_columns(laws[thrust])]
            values = {f"of power {p}": float(c) for p, c in zip(powers, coefficients[thrust], strict=True)}
        elif friction is not None:
            values = friction_values(friction, None if scale is None else float(scale[joint]), joint)
            joint += 1
        else:
            raise ValueError(f"fit {name}: of what the file does not have")
        found.append(Fit(name, values, str(unit), *sizes.tolist()))
    return tuple(found)


def _scaled(values: FittedValues) -> list[bool]:
    """Return whether the factor of each joint's effort was fitted."""
    fits = {fit.name: fit for fit in values.fits}
    return ["effort times" in fits[f"friction of {joint}"].values for joint in values.joints]


def _power_columns(law: str) -> list[int]:
    """Return the columns of the powers of a law such as `polynomial 1 2 of commands ...`."""
    words = law.partition(" of commands")[0].split()[1:]
    return [POWERS.index(int(word)) for word in words]


def _finite_numbers(data: xr.Dataset, key: str, shape: tuple[int, ...]) -> Array:
    """Return a variable of finite numbers. Raises ValueError for another shape, or for numbers beyond all bounds."""
    values = np.asarray(data[key].values, float)
    if values.shape != shape:
        raise ValueError(f"{key} has shape {values.shape}: {shape} was expected")
    if not np.all(np.abs(values) <= LARGEST_LEARNT):
        raise ValueError(f"{key} holds a number that is not finite, or beyond {LARGEST_LEARNT:g}")
    return values


def _texts_of(data: xr.Dataset, key: str) -> tuple[str, ...]:
    return tuple(str(text) for text in np.atleast_1d(data[key].values) if str(text)) if key in data else ()
