"""Calibrations in the two older forms of the file, brought to the present one, as far as a use of them needs it.

What they do not have stays away: error bar, noise of the rows, units of states, and how well each fit holds.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import xarray as xr

DAILY_AIR = {"wind", "gust", "warm_up_cycles"}  # keys of the air that need not agree
POWERS = 3  # columns of a thrust's table, for the powers 1, 2, 3


def _of_flights(data: xr.Dataset) -> xr.Dataset:
    """Return a file that was learnt from flights of Aerobat."""
    noted = dict(data.attrs)
    missing: dict[str, Any] = {"mass": ((), 1.0)}
    air = json.loads(noted["air"])
    settings = {"observers.torque": str(noted["torque"])}
    settings |= {f"air.{key}": str(value) for key, value in air.items() if key not in DAILY_AIR}
    names = {"flight": "record"}
    names |= {key: f"extra_{key}" for key in map(str, data.data_vars) if key.startswith("accelerometer_")}
    if "range" in data and "coefficients" in data:
        missing["state_unit"] = (("state",), ["-"] * data.sizes["state"])
    if "change" in data:
        missing["parameter_unit"] = (("parameter",), ["-"] * data.sizes["parameter"])
        missing["expected"] = (("parameter",), np.ones(data.sizes["parameter"]))
    if "friction" in data:
        missing["effort_factor"] = (("joint",), np.ones(data.sizes["joint"]))
    found = data.rename({old: new for old, new in names.items() if old in data}).assign(missing)
    return found.assign_attrs(robot=noted["morphology"], settings=json.dumps(settings), fits="[]")


def _by_map(data: xr.Dataset) -> xr.Dataset:
    """Return a file that was learnt from a recording by a map."""
    noted = dict(data.attrs)
    missing: dict[str, Any] = {"record": (("file",), [str(noted["log"])])}
    laws = {str(name): str(law) for name, law in json.loads(noted["laws"]).items()}
    settings = {f"known.{name}": law for name, law in laws.items()}
    if "friction" in data:
        for joint, torque in zip(data["joint"].values, data["torque_per_unit"].values, strict=True):
            settings[f"the effort of {joint}"] = f"{float(torque):.9g} N m per unit"
            settings[f"the encoder of {joint}"] = f"1 {joint}"
    if "error_bar" in data:
        data = data.rename({"component": "force"})
    if "thrust" in data:
        table = np.full(data["thrust"].shape, np.nan)
        for row, name, values in zip(table, data["known"].values, data["thrust"].values, strict=True):
            powers = [int(word) for word in laws[str(name)].partition(" of commands")[0].split()[1:]]
            row[: len(powers)] = values[[power - 1 for power in powers]]
        missing["thrust"] = (("known", "coefficient_of"), table)
    return data.assign(missing).assign_attrs(settings=json.dumps(settings), fits="[]", kept=0, allowed=0.0)


RENEWED = {"aerobat calibration 1": _of_flights, "aerobat calibration by a map 1": _by_map}  # kind -> its new form
