"""The channels that a flight log can contain: dimensions, unit and meaning of each, and the labels of its axes.

Every reader and writer of logs uses this table. Labels decide what a column means, not its place: `checked_channels`
puts the columns of each channel in the order of `LABELS`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import xarray as xr

from aerobat_description.reading import did_you_mean
from aerobat_pin.aerobat.aerobat import JOINTS
from aerobat_pin.aerobat.wing import LINKS
from aerobat_pin.errors import LogError
from aerobat_pin.numerics import Array
from aerobat_pin.records import LARGEST_VALUE

KNOWN = "known_"  # prefix of the channels with known generalised forces or body wrenches
POSE_AXIS = ("x", "y", "z", "qx", "qy", "qz", "qw")
TWIST_AXIS = ("vx", "vy", "vz", "wx", "wy", "wz")
LABELS = {
    "q_axis": (*POSE_AXIS, *JOINTS),
    "v_axis": (*TWIST_AXIS, *JOINTS),
    "pose_axis": POSE_AXIS,
    "twist_axis": TWIST_AXIS,
    "quaternion_axis": POSE_AXIS[3:],
    "joint": JOINTS,
    "axis": ("x", "y", "z"),
    "link": LINKS,
    "wrench_axis": ("fx", "fy", "fz", "mx", "my", "mz"),
}
QUATERNION_ERROR = 0.01  # allowed deviation of a quaternion's length from 1
FASTEST_CRANK = 60.0  # [Hz]: if the crank seems faster, its angle is in degrees
LARGEST_JOINT_ANGLE = 2.0 * np.pi  # [rad]: no joint turns that far; a larger angle is in degrees


@dataclass(frozen=True)
class ChannelSpec:
    """What a channel must look like: its dimensions, its unit, and its meaning in words."""

    dims: tuple[str, ...]
    unit: str
    meaning: str


def _channel(dims: str, unit: str, meaning: str) -> ChannelSpec:
    return ChannelSpec(tuple(dims.split()), unit, meaning)


MEASURED = {
    "q": _channel("time q_axis", "m, -, rad", "configuration: position in world, quaternion, joints"),
    "pose": _channel("time pose_axis", "m, -", "body placement in world: position, quaternion"),
    "v": _channel("time v_axis", "m/s, rad/s", "velocity: body twist in body axes, joint rates"),
    "twist": _channel("time twist_axis", "m/s, rad/s", "body twist in body axes"),
    "crank_angle": _channel("time", "rad", "absolute crank angle t1"),
    "crank_rate": _channel("time", "rad/s", "rate of the crank angle"),
    "joint_angle": _channel("time joint", "rad", "joint angles"),
    "joint_rate": _channel("time joint", "rad/s", "joint rates"),
    "airspeed": _channel("time", "m/s", "airspeed along the body's x axis, at its COM"),
    "wind_W": _channel("time axis", "m/s", "velocity of the air over ground, world axes"),
    "motor_torque": _channel("interval v_axis", "N m", "motor torque at the joints, interval mean"),
    "joint_torque": _channel("interval joint", "N m", "motor torque at the joints, interval mean"),
    "crank_torque": _channel("interval", "N m", "motor torque at the crank, interval mean"),
    "thruster_command": _channel("interval thruster", "N", "thrust that was commanded at the start of the interval"),
    "mocap_position": _channel("mocap_time axis", "m", "motion capture: markers' origin in world axes"),
    "mocap_quaternion": _channel("mocap_time quaternion_axis", "-", "motion capture: markers' axes, body to world"),
    "gyro": _channel("gyro_time axis", "rad/s", "angular velocity in the gyro's axes"),
    "accelerometer": _channel("accelerometer_time axis", "m/s2", "specific force in the accelerometer's axes"),
    "encoder": _channel("encoder_time", "rad", "absolute crank angle t1, as the encoder counts"),
    "joint_torque_sample": _channel("torque_time joint", "N m", "motor torque at the joints, samples"),
    "crank_torque_sample": _channel("torque_time", "N m", "motor torque at the crank, samples"),
}
RAW_CLOCKS = ("mocap_time", "gyro_time", "accelerometer_time", "encoder_time", "torque_time")
KNOWN_FORCE = _channel("interval v_axis", "N, N m", "known generalised force, interval mean")
THRUSTERS = f"{KNOWN}thrusters"
THRUST_CHANNEL = _channel("interval twist_axis", "N, N m", "known wrench at the body COM")
REQUIRED_TRUTH = {
    "force_W": _channel("interval point axis", "N", "unknown force in world axes, interval mean"),
    "force_noise_free_W": _channel("interval point axis", "N", "unknown force without its noise, interval mean"),
    "unknown": _channel("interval v_axis", "N, N m", "unknown generalised force, interval mean"),
    "aerodynamic": _channel("interval v_axis", "N, N m", "aerodynamic generalised force, interval mean"),
    "added_mass": _channel("interval v_axis", "N, N m", "generalised force of the wings' added mass, interval mean"),
    "motor_power": _channel("interval", "W", "motor power, interval mean"),
    "air_power": _channel("interval", "W", "power of air and added mass, interval mean"),
    "link_wrench": _channel("interval link wrench_axis", "N, N m", "air on links, at and in their frames"),
    "airspeed": _channel("interval strip", "m/s", "air past the strip, in its plane, at start"),
    "incidence": _channel("interval strip", "rad", "incidence at the 3/4 chord, at start"),
    "downwash": _channel("interval strip", "m/s", "downwash of the wake, at start"),
    "circulation": _channel("interval strip", "m2/s", "bound circulation, at start"),
    "strip_force_z": _channel("interval strip", "N", "force along the link's z, at start"),
    "strip_force_x": _channel("interval strip", "N", "force along the link's x, at start"),
}
OPTIONAL_TRUTH = {
    "air_state": _channel("time air_axis", "m, m, m2/s", "zeta_1, zeta_2, circulation"),
    "event_start": _channel("event", "s", "when an unknown force comes"),
    "event_end": _channel("event", "s", "when it goes; infinity where it stays"),
    "body_airspeed": MEASURED["airspeed"],  # in the truth, `airspeed` is that of the strips
    "thruster_power": _channel("interval", "W", "power of attitude hold or thrusters, interval mean"),
    "thrust": _channel("interval thruster", "N", "thrust of each thruster, interval mean"),
    "thruster_wrench": _channel("interval wrench_axis", "N, N m", "of all thrusters on the body, interval mean"),
    "unrealised_wrench": _channel("interval wrench_axis", "N, N m", "what the limits left of the wanted wrench"),
    "seen_disturbance": _channel("interval wrench_axis", "N, N m", "what the controller's observer saw last"),
    "unknown_power": _channel("interval", "W", "power of the unknown forces, interval mean"),
    "crank_rate": MEASURED["crank_rate"],  # this and the next four: if a motor turns the crank
    "crank_torque": _channel("interval", "N m", "torque from crank to linkage, interval mean"),
    "drive_torque": _channel("interval", "N m", "torque of the motor on the crank, interval mean"),
    "drive_power": _channel("interval", "W", "power of the motor on the crank, interval mean"),
    "friction_power": _channel("interval", "W", "power lost to friction, interval mean"),
    **{name: MEASURED[name] for name in ("q", "v", "crank_angle", "motor_torque")},  # exact, if others are measured
    "deflection": _channel("time joint", "rad", "elastic joints beyond the linkage"),
}
TRUE_CHANNELS = REQUIRED_TRUTH | OPTIONAL_TRUTH


def channel(values: Any, dims: tuple[str, ...], unit: str, meaning: str) -> xr.Variable:
    """Make one labelled channel. A Variable has no coordinates, so adding it to a Dataset is ten times faster."""
    return xr.Variable(dims, np.asarray(values), attrs={"units": unit, "long_name": meaning})


def filled(name: str, values: Any, table: Mapping[str, ChannelSpec] = MEASURED) -> xr.Variable:
    """Make the channel of a name in the table from its values."""
    row = table[name]
    return channel(values, row.dims, row.unit, row.meaning)


def is_unit(text: str, unit: str) -> bool:
    """Return whether a text names a unit of the table.

    `N·m` and `Nm` are `N m`. A list of units may be longer, as that of `q` is where `pose` is a part of `q`.
    """
    units, expected = ([word.strip().replace("·", " ") for word in words.split(",")] for words in (text, unit))
    alike = [a in (b, b.replace(" ", "")) for a, b in zip(units, expected, strict=False)]
    return all(alike) and (len(units) == len(expected) or 1 < len(expected) < len(units))


def checked_channels(data: xr.Dataset, table: Mapping[str, ChannelSpec], name: str, *, complete: bool) -> xr.Dataset:
    """Return a dataset whose channels are those of a table, with columns in the order of `LABELS`.

    If it is `complete`, as in a file, every axis must have labels and every channel its unit. Else labels and units
    that are missing are added, and units are not checked: arithmetic on a Dataset does not keep them.

    Raises:
        LogError: a channel or label is unknown, doubled or missing, or a dimension, a unit, a type or a value is
            wrong. The message names the channel and what was expected.
    """
    variables = {}
    for key, values in data.variables.items():
        if key in data.data_vars:
            row = _row(str(key), table, values.dims, name)
            _check_form(values, row, f"{name}: channel '{key}'", complete=complete)
            variables[key] = row, values
    order = {
        dim: _columns_in_order(dim, data, name, complete=complete) for row, _ in variables.values() for dim in row.dims
    }
    checked, changed = {}, any(column is not None for column in order.values())
    for key, (row, values) in variables.items():
        new = values if values.dims == row.dims else values.transpose(*row.dims)
        new = new.isel({dim: column for dim in row.dims if (column := order[dim]) is not None})
        if new.dtype != float or "units" not in new.attrs:
            attributes = {"units": row.unit, "long_name": row.meaning, **new.attrs}
            new = xr.Variable(new.dims, new.values.astype(float), attributes)
        _check_values(str(key), new, data, name)
        checked[key], changed = new, changed or new is not values
    if not changed:
        return data
    labels = {dim: list(LABELS[dim]) for dim, column in order.items() if column is not None}
    return data.drop_vars([dim for dim in labels if dim in data.coords]).assign(checked).assign_coords(labels)


def _row(key: str, table: Mapping[str, ChannelSpec], dims: tuple[Any, ...], name: str) -> ChannelSpec:
    """Return the row of the table for a channel. Raises LogError if there is none."""
    if key.startswith(KNOWN) and table is MEASURED:
        return replace(KNOWN_FORCE, dims=("interval", "twist_axis")) if "twist_axis" in dims else KNOWN_FORCE
    if key not in table:
        raise LogError(f"{name}: unknown channel '{key}'; {did_you_mean(key, table)}")
    return table[key]


def _check_form(values: xr.Variable, row: ChannelSpec, where: str, *, complete: bool) -> None:
    """Raise LogError unless a channel has the dimensions and the unit of its row, and contains numbers."""
    if sorted(map(str, values.dims)) != sorted(row.dims):
        dims = ", ".join(map(str, values.dims))
        raise LogError(f"{where} has the dimensions ({dims}): ({', '.join(row.dims)}) were expected")
    if values.dtype.kind not in "fiu":
        kind = {"M": "dates", "m": "durations", "c": "complex numbers", "b": "true or false"}
        content = kind.get(values.dtype.kind, "text")
        raise LogError(f"{where} contains {content}: real numbers [{row.unit}] were expected")
    unit = values.attrs.get("units")
    if complete and unit is None:
        raise LogError(f"{where} has no attribute units: '{row.unit}' was expected")
    if complete and not (isinstance(unit, str) and is_unit(unit, row.unit)):
        raise LogError(f"{where} has units = {str(unit)[:40]!r}: '{row.unit}' was expected; units are not converted")


def _columns_in_order(dim: str, data: xr.Dataset, name: str, *, complete: bool) -> list[int] | None:
    """Return the columns of an axis in the order of `LABELS`, or None if they stand in it.

    Raises LogError for labels that are missing or others.
    """
    expected = LABELS.get(dim)
    if expected is None:
        return None
    if dim not in data.variables:
        if data.sizes[dim] != len(expected) or complete:
            raise LogError(f"{name}: {dim} has no labels for its {data.sizes[dim]} columns: {_list(expected)}")
        return list(range(len(expected)))
    labels = [str(label) for label in data.variables[dim].values.tolist()]
    if labels == list(expected):
        return None
    for label in labels:
        if label not in expected:
            raise LogError(f"{name}: {dim} has the unknown label '{label[:40]}': {_list(expected)}")
        if labels.count(label) > 1:
            raise LogError(f"{name}: {dim} has the label '{label}' twice: {_list(expected)}")
    missing = [label for label in expected if label not in labels]
    if missing:
        raise LogError(f"{name}: {dim} has no label '{missing[0]}': {_list(expected)}")
    return [labels.index(label) for label in expected]


def _list(labels: Iterable[str]) -> str:
    return f"{', '.join(labels)} were expected"


def _check_values(key: str, variable: xr.Variable, data: xr.Dataset, name: str) -> None:
    """Raise LogError for a number that is not finite or too large, and for a quaternion of wrong length."""
    values = variable.values
    if values.size == 0 or key == "event_end":
        return
    if not (values.min() >= -LARGEST_VALUE and values.max() <= LARGEST_VALUE):  # also false for NaN
        at = np.unravel_index(int(np.argmax(~(np.abs(values) <= LARGEST_VALUE))), values.shape)
        labels = [
            str(data.variables[dim].values[i])
            for dim, i in zip(variable.dims[1:], at[1:], strict=True)
            if dim in data.variables
        ]
        what = f", {' '.join(labels)}" if labels else ""
        raise LogError(
            f"{name}: channel '{key}', {_sample_name(variable, data, int(at[0]))}{what} = {values[at]:g}: a number "
            f"between -{LARGEST_VALUE:g} and {LARGEST_VALUE:g} was expected"
        )
    if key in ("q", "pose", "mocap_quaternion"):
        quaternion = values if key == "mocap_quaternion" else values[:, 3:7]
        length = np.sqrt(np.einsum("ij,ij->i", quaternion, quaternion))
        wrong = np.abs(length - 1.0) > QUATERNION_ERROR
        if np.any(wrong):
            at_row = int(np.argmax(wrong))
            raise LogError(
                f"{name}: channel '{key}', {_sample_name(variable, data, at_row)}: the quaternion has length "
                f"{length[at_row]:.3g}: 1 was expected"
            )


def _sample_name(variable: xr.Variable, data: xr.Dataset, row: int) -> str:
    """Return where a row of a channel is: `sample 12 (0.012 s)`."""
    dim = variable.dims[0]
    what = "sample" if dim == "time" or dim in RAW_CLOCKS else str(dim)
    at = data.variables.get(dim)
    return f"{what} {row}" + (f" ({float(at.values[row]):g} s)" if at is not None and at.dtype.kind == "f" else "")


def angle_fault(time: Array, crank: Array | None, joints: Array | None) -> str | None:
    """Return which angles at times (n,) [s], crank (n,) or joints (n, 4), are in degrees: they turn too fast or far."""
    if crank is not None:
        steps = np.diff(time)
        turned = np.abs(np.diff(crank))[steps > 0.0] / steps[steps > 0.0]
        rate = float(np.median(turned)) / (2.0 * np.pi) if len(turned) else 0.0
        if rate > FASTEST_CRANK:
            return f"crank_angle turns at {rate:.0f} Hz: radians were expected"
    if joints is not None and np.any(large := np.abs(joints) > LARGEST_JOINT_ANGLE):
        at, joint = np.argwhere(large)[0]
        return f"sample {at} ({time[at]:g} s): {JOINTS[joint]} = {joints[at, joint]:g}: radians were expected"
    return None
