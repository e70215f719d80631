"""Write what a recording showed by a map to a NetCDF file, and read it again."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from aerobat_pin.estimation.calibration_parts import MAP_KIND, CalibrationParts, lines_of, parts_bytes, read_parts
from aerobat_pin.estimation.fit_joint_friction import friction_values
from aerobat_pin.estimation.known_forces import Fit, FittedValues
from aerobat_pin.estimation.map_calibration import MASS_NAME, MapCalibration
from aerobat_pin.numerics import Array, guarded

POWERS = (1, 2, 3)  # of a thrust's polynomial
LEFT_OVER = ("before", "inside", "outside")  # columns of what a fit leaves


@guarded()
def map_calibration_bytes(calibration: MapCalibration) -> bytes:
    """Return the content of a calibration's file."""
    values = calibration.values
    variables: dict[str, Any] = {
        "note": (("line",), lines_of(calibration.notes)),
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
        variables["effort_factor"] = (("joint",), values.scale)
        variables["effort_fitted"] = (("joint",), np.array(_scaled(values), np.int8))
        variables["torque_per_unit"] = (("joint",), [calibration.torque_per_unit[name] for name in values.joints])
    if values.coefficients:
        table = np.zeros((len(values.coefficients), len(POWERS)))
        for row, name in zip(table, values.coefficients, strict=True):
            row[_power_columns(calibration.laws[name])] = values.coefficients[name]
        variables["thrust"] = (("known", "power"), table, {"units": "N"})
        coords |= {"known": list(values.coefficients), "power": list(POWERS)}
    attributes = {
        "robot": calibration.robot,
        "fingerprint": calibration.fingerprint,
        "log": calibration.log,
        "laws": json.dumps(dict(calibration.laws)),
    }
    return parts_bytes(MAP_KIND, variables, coords, attributes, values.friction, values.joints)


@guarded()
def read_map_calibration(path: Path) -> MapCalibration:
    """Read a calibration's file. Raises CalibrationError if it is missing, damaged or something else."""
    return read_parts(path, MAP_KIND, _map_calibration)


def _map_calibration(parts: CalibrationParts) -> MapCalibration:
    noted, joints = parts.attributes, parts.texts("joint")
    laws = json.loads(str(noted["laws"]))
    if not isinstance(laws, dict) or not all(isinstance(law, str) for law in laws.values()):
        raise ValueError("laws: name and law of each thrust were expected")
    friction, torques = parts.friction(len(joints)), {}
    scale: Array = np.ones(0)
    if friction is not None:
        scale = parts.numbers("effort_factor", len(joints))
        torques = dict(zip(joints, parts.numbers("torque_per_unit", len(joints)).tolist(), strict=True))
    coefficients: dict[str, Array] = {}
    if known := parts.texts("known"):
        rows = parts.numbers("thrust", len(known), len(POWERS))
        coefficients = {name: row[_power_columns(laws[name])] for name, row in zip(known, rows, strict=True)}
    mass = float(parts.numbers("mass"))
    if not 0.0 < mass:
        raise ValueError(f"mass {mass:g}: a factor above 0 was expected")
    bar = {}
    if labels := parts.texts("component"):
        sizes = parts.numbers("error_bar", len(labels), 2, finite=False).tolist()
        bar = {label: (before, after) for label, (before, after) in zip(labels, sizes, strict=True)}
    values = FittedValues(coefficients, joints, friction, scale, mass)
    return MapCalibration(
        robot=str(noted["robot"]),
        fingerprint=str(noted["fingerprint"]),
        torque_per_unit=torques,
        laws=laws,
        values=replace(values, fits=tuple(_read_fits(parts, values, laws))),
        error_bar=bar,
        log=str(noted["log"]),
        notes=parts.texts("note"),
    )


def _read_fits(parts: CalibrationParts, found: FittedValues, laws: dict[str, str]) -> Iterator[Fit]:
    """Yield what a file says about how well each fit holds."""
    names, units, joint = parts.texts("fit"), parts.texts("left_unit"), 0
    left = parts.numbers("left", len(names), len(LEFT_OVER), finite=False)
    for name, unit, sizes in zip(names, units, left.tolist(), strict=True):
        thrust = name.removeprefix("known.")
        if name == MASS_NAME:
            values = {"times": found.mass, "deviation": float(parts.numbers("mass_deviation", finite=False))}
        elif thrust in found.coefficients:
            powers = [POWERS[k] for k in _power_columns(laws[thrust])]
            values = {f"of power {p}": float(c) for p, c in zip(powers, found.coefficients[thrust], strict=True)}
        elif found.friction is not None:
            scaled = np.any(parts.numbers("effort_fitted", len(found.joints)))
            values = friction_values(found.friction, float(found.scale[joint]) if scaled else None, joint)
            joint += 1
        else:
            raise ValueError(f"fit {name}: of what the file does not have")
        yield Fit(name, values, unit, *sizes)


def _scaled(values: FittedValues) -> list[bool]:
    """Return whether the factor of each joint's effort was fitted."""
    fits = {fit.name: fit for fit in values.fits}
    return ["effort times" in fits[f"friction of {joint}"].values for joint in values.joints]


def _power_columns(law: str) -> list[int]:
    """Return the columns of the powers of a law such as `polynomial 1 2 of commands ...`."""
    words = law.partition(" of commands")[0].split()[1:]
    return [POWERS.index(int(word)) for word in words]
