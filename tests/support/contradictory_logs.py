"""Logs that contradict themselves: each function changes the measured channels of a good log by one mistake.

`CONTRADICTIONS` lists them by the name of the warning that they must cause.
"""

from collections.abc import Callable

import numpy as np
import xarray as xr

Rng = np.random.Generator


def off_the_linkage(rng: Rng, data: xr.Dataset) -> xr.Dataset:
    """One joint angle with an offset of 2 to 10 deg, or both joints of a wing swapped."""
    q = data["q"].values
    if rng.random() < 0.3:
        q[:, 7:9] = q[:, [8, 7]]
    else:
        q[:, rng.integers(7, 11)] += rng.choice([-1.0, 1.0]) * rng.uniform(0.035, 0.17)
    return data


def gyro_in_degrees(rng: Rng, data: xr.Dataset) -> xr.Dataset:
    """A gyro in deg/s."""
    data["v"].values[:, 3:6] *= 180.0 / np.pi
    return data


def height_in_millimetres(rng: Rng, data: xr.Dataset) -> xr.Dataset:
    """The height z in mm."""
    data["q"].values[:, 2] *= 1000.0
    return data


def held(rng: Rng, data: xr.Dataset) -> xr.Dataset:
    """A channel of 60 to 500 Hz that repeats its last sample at the log's rate."""
    rate = 1.0 / float(np.median(np.diff(data["time"].values)))
    every = max(2, round(rate / rng.choice([60.0, 100.0, 200.0, 500.0])))
    index = np.arange(data.sizes["time"]) // every * every
    name, columns = [("q", slice(0, 3)), ("q", slice(3, 7)), ("v", slice(3, 6)), ("v", slice(0, 3))][rng.integers(4)]
    values = data[name].values
    values[:, columns] = values[index, columns]
    return data


def w_first(rng: Rng, data: xr.Dataset) -> xr.Dataset:
    """Quaternions written as w, x, y, z."""
    data["q"].values[:, 3:7] = data["q"].values[:, [6, 3, 4, 5]]
    return data


def late(rng: Rng, data: xr.Dataset) -> xr.Dataset:
    """Gyro, velocity, pose or joints that are 4 to 15 ms late."""
    step = float(np.median(np.diff(data["time"].values)))
    index = np.maximum(np.arange(data.sizes["time"]) - round(rng.uniform(0.004, 0.015) / step), 0)
    name, columns = [("q", slice(0, 7)), ("v", slice(0, 6)), ("q", slice(7, 11))][rng.integers(3)]
    values = data[name].values
    values[:, columns] = values[index, columns]
    return data


CONTRADICTIONS: dict[str, Callable[[Rng, xr.Dataset], xr.Dataset]] = {
    "joints off the linkage": off_the_linkage,
    "gyro against attitude": gyro_in_degrees,
    "position against velocity": height_in_millimetres,
    "held channel": held,
    "quaternion order": w_first,
    "late channel": late,
}
