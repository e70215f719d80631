"""Write a calibration to a NetCDF file, and read it again."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from aerobat_pin.errors import CalibrationError, LogError
from aerobat_pin.estimation.accelerometer_mount import PLACE_AXES, Mount
from aerobat_pin.estimation.calibration.calibration import Belief, Calibration
from aerobat_pin.estimation.calibration.detection import Detection
from aerobat_pin.estimation.calibration.flight_state import STATES
from aerobat_pin.estimation.calibration.harmonics import Harmonics
from aerobat_pin.estimation.calibration.identified import Identified
from aerobat_pin.estimation.calibration.learnt_range import LearntRange
from aerobat_pin.estimation.calibration.parameters import PARAMETERS
from aerobat_pin.flight import netcdf_bytes, read_netcdf
from aerobat_pin.numerics import guarded
from aerobat_pin.observers import FRICTION_COEFFICIENTS, JointFriction
from aerobat_pin.robot import JOINTS
from aerobat_pin.scenario import AirSection

LARGEST_NUMBER_LEARNT, VELOCITIES = 1.0e6, 10  # of any number in the file; velocities of the robot
FARTHEST_PLACE = 1.0  # [m] from the body's centre of mass, of an accelerometer
KIND = "aerobat calibration 1"  # attribute `kind` of the file, with the number of its form


@guarded()
def calibration_bytes(calibration: Calibration) -> bytes:
    """Return the content of a calibration's file."""
    learnt, belief = calibration.learnt, calibration.belief
    variables: dict[str, Any] = {
        "range": (("state", "bound"), np.column_stack([learnt.low, learnt.high, learnt.margin])),
        "note": (("line",), _texts(calibration.notes)),
        "flight": (("file",), _texts(calibration.flights)),
    }
    coords: dict[str, Any] = {"state": list(STATES), "bound": ["low", "high", "margin"]}
    if calibration.harmonics is not None:
        series = calibration.harmonics
        variables["coefficients"] = (("factor", "term", "v_axis"), series.coefficients)
        variables["scaling"] = (("factor", "moment"), np.column_stack([[0.0, *series.centre], [1.0, *series.spread]]))
        coords |= {"factor": ["one", *series.varied], "moment": ["centre", "spread"]}
        coords["term"] = ["mean", *(f"{kind}{k}" for kind in ("cos", "sin") for k in range(1, series.order + 1))]
    if calibration.identified is not None:
        found = calibration.identified
        variables["change"] = (("parameter",), found.values)
        variables["covariance"] = (("parameter", "other"), found.covariance)
        variables["error"] = (("stage", "share"), np.array([found.before, found.after]))
        coords |= {"parameter": list(found.names), "other": list(found.names)}
        coords |= {"stage": ["before", "after"], "share": ["learnt", "held_out"]}
    if calibration.friction is not None:
        loss = calibration.friction
        variables["friction"] = (
            ("joint", "coefficient"),
            np.column_stack([getattr(loss, name) for name in FRICTION_COEFFICIENTS]),
        )
        variables["friction_deviation"] = (("joint", "coefficient"), loss.deviation)
        coords |= {"joint": list(JOINTS), "coefficient": list(FRICTION_COEFFICIENTS)}
    if calibration.accelerometer is not None:
        mount = calibration.accelerometer
        variables["accelerometer_place"] = (("body_axis",), mount.place, {"units": "m"})
        variables["accelerometer_turn"] = (("body_axis", "sensor_axis"), mount.turn)
        variables["accelerometer_covariance"] = (("mount", "mount_other"), mount.covariance)
        coords |= {"body_axis": list("xyz"), "sensor_axis": list("xyz")}
        coords |= {"mount": list(PLACE_AXES), "mount_other": list(PLACE_AXES)}
    if calibration.detection is not None:
        normal = calibration.detection
        limits = {"bias": normal.bias, "threshold": normal.threshold, "deviation": normal.deviation}
        variables["normal"] = (("component", "limit"), np.column_stack(list(limits.values())))
        variables["frame"] = (("point",), _texts(normal.frames))
        coords["limit"] = list(limits)
    attributes = {
        "kind": KIND,
        "morphology": belief.morphology,
        "fingerprint": belief.fingerprint,
        "air": belief.air.model_dump_json(),
        "torque": belief.torque,
        "kept": int(calibration.identified is not None and calibration.identified.kept),
        "allowed": 0.0 if calibration.identified is None else calibration.identified.allowed,
        "friction_rate": 0.0 if calibration.friction is None else calibration.friction.rate,
    }
    return netcdf_bytes(xr.Dataset(variables, coords, attributes))


@guarded()
def read_calibration(path: Path) -> Calibration:
    """Read a calibration's file. Raises CalibrationError if it is missing, damaged or something else."""
    name = f"calibration {path}"
    try:
        data = read_netcdf(path, "calibration")[""]
    except LogError as error:
        raise CalibrationError(str(error)) from error
    if data.attrs.get("kind") != KIND:
        raise CalibrationError(f"{name}: a file that `aerobat calibrate` wrote was expected")
    try:
        return _calibration(data)
    except (KeyError, ValueError, TypeError, AttributeError) as error:
        reason = " ".join(str(error).split())[:200]
        raise CalibrationError(f"{name}: a part is missing or damaged: {reason}") from error


def _check_forged(data: xr.Dataset) -> None:
    """Raise ValueError for numbers and shapes that no calibration has."""
    if list(map(str, data["state"].values)) != list(STATES):
        raise ValueError(f"states {', '.join(STATES)} were expected")
    counts: dict[str, tuple[int, ...]] = {
        "range": (len(STATES), 3),
        "friction": (len(JOINTS), 4),
        "friction_deviation": (len(JOINTS), 4),
        "accelerometer_place": (3,),
        "accelerometer_turn": (3, 3),
        "accelerometer_covariance": (6, 6),
    }
    if "coefficients" in data:
        factors, terms, _ = data["coefficients"].shape
        counts |= {"coefficients": (factors, terms - 1 + terms % 2, VELOCITIES), "scaling": (factors, 2)}
    if "change" in data:
        n = len(data["parameter"])
        counts |= {"change": (n,), "covariance": (n, n), "error": (2, 2)}
        if np.any(data["change"].values <= -1.0):
            raise ValueError("change of -1 or less: of a factor, more than -1 was expected")
    if "normal" in data:
        counts["normal"] = (3 * len(np.atleast_1d(data["frame"].values)), 3)
    for key, shape in counts.items():
        if key in data and data[key].shape != shape:
            raise ValueError(f"{key} has shape {data[key].shape}: {shape} was expected")
    if "normal" in data and not np.all(data["normal"].values[:, 2] > 0.0):
        raise ValueError("normal: deviations above 0 were expected")
    for name, values in data.data_vars.items():
        if values.dtype.kind == "f" and name != "friction_deviation":
            if not np.all(np.abs(values.values) <= LARGEST_NUMBER_LEARNT):
                raise ValueError(f"{name} holds a number that is not finite, or beyond {LARGEST_NUMBER_LEARNT:g}")


def _calibration(data: xr.Dataset) -> Calibration:
    noted = data.attrs
    _check_forged(data)
    air = AirSection.model_validate_json(noted["air"])
    series = found = friction = None
    if "coefficients" in data:
        varied = tuple(map(str, data["factor"].values[1:]))
        if not set(varied) <= set(STATES):
            raise ValueError(f"factors {', '.join(varied)}: states of flight were expected")
        scaling = data["scaling"].values[1:]
        coefficients = np.asarray(data["coefficients"].values, float)
        series = Harmonics((coefficients.shape[1] - 1) // 2, varied, scaling[:, 0], scaling[:, 1], coefficients)
    if "change" in data:
        before, after = data["error"].values.tolist()
        names = tuple(map(str, data["parameter"].values))
        if not set(names) <= set(PARAMETERS):
            raise ValueError(f"parameters {', '.join(names)}: of {', '.join(PARAMETERS)} some were expected")
        found = Identified(
            names=names,
            values=np.asarray(data["change"].values, float),
            covariance=np.asarray(data["covariance"].values, float),
            kept=bool(noted["kept"]),
            before=(before[0], before[1]),
            after=(after[0], after[1]),
            allowed=float(noted["allowed"]),
        )
    if "friction" in data:
        coulomb, viscous, inertia, offset = np.asarray(data["friction"].values, float).T
        deviation = np.asarray(data["friction_deviation"].values, float)
        friction = JointFriction(coulomb, viscous, inertia, offset, float(noted["friction_rate"]), deviation)
    detection = None
    if "normal" in data:
        detection = Detection(_read_texts(data, "frame"), *np.asarray(data["normal"].values, float).T)
    mount = None
    if "accelerometer_place" in data:
        place, turn, covariance = (
            np.asarray(data[f"accelerometer_{part}"].values, float) for part in ("place", "turn", "covariance")
        )
        if not (np.allclose(turn @ turn.T, np.eye(3), atol=1e-6) and np.linalg.det(turn) > 0.0):
            raise ValueError("accelerometer_turn: a rotation matrix was expected")
        if np.any(np.abs(place) > FARTHEST_PLACE) or np.any(np.diag(covariance) < 0.0):
            raise ValueError(
                f"accelerometer_place: within {FARTHEST_PLACE:g} m of the body's centre of mass was expected"
            )
        mount = Mount(place, turn, covariance)
    return Calibration(
        belief=Belief(str(noted["morphology"]), str(noted["fingerprint"]), air, str(noted["torque"])),
        learnt=LearntRange(*np.asarray(data["range"].values, float).T),
        harmonics=series,
        identified=found,
        friction=friction,
        detection=detection,
        flights=_read_texts(data, "flight"),
        notes=_read_texts(data, "note"),
        accelerometer=mount,
    )


def _texts(lines: tuple[str, ...]) -> Any:
    return np.array(list(lines) or [""])


def _read_texts(data: xr.Dataset, key: str) -> tuple[str, ...]:
    return tuple(str(line) for line in np.atleast_1d(data[key].values) if str(line))
