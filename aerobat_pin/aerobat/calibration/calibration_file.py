"""Write a calibration to a NetCDF file, and read it again."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from aerobat_pin.aerobat.accelerometer_mount import PLACE_AXES, Mount
from aerobat_pin.aerobat.calibration.calibration import Belief, Calibration
from aerobat_pin.aerobat.calibration.detection import Detection
from aerobat_pin.aerobat.calibration.flight_state import STATES
from aerobat_pin.aerobat.calibration.harmonics import Harmonics
from aerobat_pin.aerobat.calibration.identified import Identified
from aerobat_pin.aerobat.calibration.learnt_range import LearntRange
from aerobat_pin.aerobat.calibration.parameters import PARAMETERS
from aerobat_pin.estimation import KIND, CalibrationParts, lines_of, parts_bytes, read_parts
from aerobat_pin.numerics import guarded
from aerobat_pin.robot import JOINTS
from aerobat_pin.scenario import AirSection

VELOCITIES = 10  # of the robot
FARTHEST_PLACE = 1.0  # [m] from the body's centre of mass, of an accelerometer


@guarded()
def calibration_bytes(calibration: Calibration) -> bytes:
    """Return the content of a calibration's file."""
    learnt, belief = calibration.learnt, calibration.belief
    variables: dict[str, Any] = {
        "range": (("state", "bound"), np.column_stack([learnt.low, learnt.high, learnt.margin])),
        "note": (("line",), lines_of(calibration.notes)),
        "flight": (("file",), lines_of(calibration.flights)),
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
        variables["frame"] = (("point",), lines_of(normal.frames))
        coords["limit"] = list(limits)
    attributes = {
        "morphology": belief.morphology,
        "fingerprint": belief.fingerprint,
        "air": belief.air.model_dump_json(),
        "torque": belief.torque,
        "kept": int(calibration.identified is not None and calibration.identified.kept),
        "allowed": 0.0 if calibration.identified is None else calibration.identified.allowed,
    }
    return parts_bytes(KIND, variables, coords, attributes, calibration.friction, JOINTS)


@guarded()
def read_calibration(path: Path) -> Calibration:
    """Read a calibration's file. Raises CalibrationError if it is missing, damaged or something else."""
    return read_parts(path, KIND, _calibration)


def _calibration(parts: CalibrationParts) -> Calibration:
    noted = parts.attributes
    if parts.texts("state") != tuple(STATES):
        raise ValueError(f"states {', '.join(STATES)} were expected")
    return Calibration(
        belief=Belief(
            str(noted["morphology"]),
            str(noted["fingerprint"]),
            AirSection.model_validate_json(noted["air"]),
            str(noted["torque"]),
        ),
        learnt=LearntRange(*parts.numbers("range", len(STATES), 3).T),
        harmonics=_read_harmonics(parts) if "coefficients" in parts else None,
        identified=_read_identified(parts) if "change" in parts else None,
        friction=parts.friction(len(JOINTS)),
        detection=_read_detection(parts) if "normal" in parts else None,
        flights=parts.texts("flight"),
        notes=parts.texts("note"),
        accelerometer=_read_mount(parts) if "accelerometer_place" in parts else None,
    )


def _read_harmonics(parts: CalibrationParts) -> Harmonics:
    varied = parts.some_of("factor", ("one", *STATES), "states of flight, such as")[1:]
    terms = (parts.size("term") - 1) | 1  # mean, and as many sines as cosines
    centre, spread = parts.numbers("scaling", 1 + len(varied), 2)[1:].T
    coefficients = parts.numbers("coefficients", 1 + len(varied), terms, VELOCITIES)
    return Harmonics((terms - 1) // 2, varied, centre, spread, coefficients)


def _read_identified(parts: CalibrationParts) -> Identified:
    names = parts.some_of("parameter", PARAMETERS, "some of")
    values = parts.numbers("change", len(names))
    if np.any(values <= -1.0):
        raise ValueError("change of -1 or less: of a factor, more than -1 was expected")
    before, after = parts.numbers("error", 2, 2).tolist()
    return Identified(
        names=names,
        values=values,
        covariance=parts.numbers("covariance", len(names), len(names)),
        kept=bool(parts.attributes["kept"]),
        before=(before[0], before[1]),
        after=(after[0], after[1]),
        allowed=float(parts.attributes["allowed"]),
    )


def _read_detection(parts: CalibrationParts) -> Detection:
    frames = parts.texts("frame")
    bias, threshold, deviation = parts.numbers("normal", 3 * len(frames), 3).T
    if not np.all(deviation > 0.0):
        raise ValueError("normal: deviations above 0 were expected")
    return Detection(frames, bias, threshold, deviation)


def _read_mount(parts: CalibrationParts) -> Mount:
    place, turn = parts.numbers("accelerometer_place", 3), parts.numbers("accelerometer_turn", 3, 3)
    covariance = parts.numbers("accelerometer_covariance", 6, 6)
    if not (np.allclose(turn @ turn.T, np.eye(3), atol=1e-6) and np.linalg.det(turn) > 0.0):
        raise ValueError("accelerometer_turn: a rotation matrix was expected")
    if np.any(np.abs(place) > FARTHEST_PLACE) or np.any(np.diag(covariance) < 0.0):
        raise ValueError(f"accelerometer_place: within {FARTHEST_PLACE:g} m of the body's centre of mass was expected")
    return Mount(place, turn, covariance)
