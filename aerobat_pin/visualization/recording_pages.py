"""Write figures, report and replay of what was estimated from a recording."""

from __future__ import annotations

from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import tomli_w

from aerobat_pin.errors import LogError
from aerobat_pin.estimation import RecordingEstimate
from aerobat_pin.visualization import style
from aerobat_pin.visualization.figures.recording import draw_recording
from aerobat_pin.visualization.replay.any_robot import load_any_robot
from aerobat_pin.visualization.replay.recording import Recording
from aerobat_pin.visualization.template import fill_template

LONGEST_REPLAY = 60.0  # [s] of the longest part
REPLAY_RATE = 240.0  # [Hz] of the samples that a replay is made from
STICK = 0.04  # radius of a stick, in lengths of the robot
SCORE_HEADER = (
    "observer",
    "component",
    "R2",
    "rms of the difference",
    "R2 outside the fit",
    "sensor per estimate",
    "offset",
    "lag",
)


def write_recording_pages(found: RecordingEstimate, folder: Path) -> None:
    """Write `figures/`, `report.html` and `replay.html` into an existing folder."""
    (folder / "figures").mkdir()
    images = {}
    for name, figure in draw_recording(found).items():
        style.save_figure(figure, folder / "figures" / name)
        images[name] = folder / "figures" / f"{name}.png"
    (folder / "report.html").write_text(recording_report(found, images), encoding="utf-8")
    (folder / "replay.html").write_text(replay_recording(found).html(1.0), encoding="utf-8")


def recording_report(found: RecordingEstimate, images: dict[str, Path]) -> str:
    """Return the report as one page of HTML."""
    record = found.record
    values = record.map.model_dump(exclude_none=True, exclude_defaults=True, by_alias=True, mode="json")
    return fill_template(
        "recording.html",
        found=found,
        record=record,
        title=found.record.title,
        warnings=found.warnings,
        force_rows=_force_rows(found),
        score_header=SCORE_HEADER,
        score_rows=_score_rows(found),
        toml=tomli_w.dumps(values),
        images=images,
    )


def replay_recording(found: RecordingEstimate) -> Recording:
    """Return the replay of the longest used part, at most its first minute, with the forces as arrows."""
    record = found.record
    first, last = max(record.parts, key=lambda part: part[1] - part[0])
    last = min(last, first + round(LONGEST_REPLAY * record.rate))
    block, every = record.block(first, last), max(1, round(record.rate / REPLAY_RATE))
    rows = np.arange(0, len(block.time), every)
    name, stored = next(iter(found.stored.items()))
    model, visual = _visible(found)
    recording = Recording(
        model, visual, block.time[rows] - record.start, block.q[rows], title=f"{found.record.title}: {name}"
    )
    low = stored.index(block.time[0])
    estimate = stored.between(low, low + last - first)
    at = np.minimum(rows, len(estimate.components) - 1)
    side = found.compared.get(name)
    if side is not None and side.labels[:3] == ("Fx", "Fy", "Fz"):
        recording.add_forces("force sensor", style.TRUTH, {side.point: side.sensor[low : low + last - first][at, :3]})
    labels = estimate.identifiability.components
    forces = {}
    for frame in estimate.frames:
        columns = [labels.index(f"{frame}.{axis}") for axis in ("Fx", "Fy", "Fz") if f"{frame}.{axis}" in labels]
        if len(columns) == 3:
            forces[frame] = estimate.components[at][:, columns]
    if forces:
        recording.add_forces("estimate", style.ESTIMATES[0], forces, inner=True)
    return recording


def _visible(found: RecordingEstimate) -> tuple[pin.Model, pin.GeometryModel]:
    """Return the model with its own shapes if its file names any that can be read, else with sticks."""
    record = found.record
    path = record.map.robot.urdf
    if path is not None:
        try:
            model, visual = load_any_robot(record.folder / path, int(record.robot.model.nq), Path(record.title))
            if visual.ngeoms > 0:
                return model, visual
        except LogError:
            pass
    return record.robot.model, sticks(record.robot.model)


def sticks(model: pin.Model) -> pin.GeometryModel:
    """Return shapes for a robot without any: a stick from each joint to the next ones and to its frames, and a box."""
    visual, data = pin.GeometryModel(), model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    places = [data.oMi[k].translation.copy() for k in range(1, model.njoints)]
    places += [data.oMf[k].translation.copy() for k in range(len(model.frames))]
    length = max(float(np.max(np.ptp(np.array(places), axis=0))), 0.05)
    ends: dict[int, list[np.ndarray]] = {k: [] for k in range(1, model.njoints)}
    for k in range(2, model.njoints):
        if model.parents[k] > 0:
            ends[model.parents[k]].append(model.jointPlacements[k].translation)
    for frame in model.frames.tolist():
        if frame.parentJoint > 0 and not any(
            True for _ in ends[frame.parentJoint] if np.allclose(_, frame.placement.translation)
        ):
            ends[frame.parentJoint].append(frame.placement.translation)
    for joint, others in ends.items():
        colour = np.array([*style.rgb(style.BLUE if joint > 1 else style.GREEN), 1.0])
        if joint == 1:
            box = coal.Box(0.3 * length, 0.2 * length, 0.08 * length)
            _add(visual, "box", joint, box, pin.SE3.Identity(), colour)
        for k, end in enumerate(others):
            size = float(np.linalg.norm(end))
            if size > 1e-3 * length:
                turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), end / size).matrix()
                stick = coal.Cylinder(0.5 * STICK * length, size)
                _add(visual, f"stick_{joint}_{k}", joint, stick, pin.SE3(turn, 0.5 * end), colour)
    return visual


def _add(visual: pin.GeometryModel, name: str, joint: int, shape: object, place: pin.SE3, colour: np.ndarray) -> None:
    part = pin.GeometryObject(name, joint, place, shape)
    part.meshColor = colour
    visual.addGeometryObject(part)


def _force_rows(found: RecordingEstimate) -> list[tuple[str, ...]]:
    """Return the table of sizes of all components."""
    rows = []
    for name, estimate in found.stored.items():
        labels, units = estimate.head.identifiability.components, estimate.head.units
        for label, unit, *sizes in zip(labels, units, estimate.mean, estimate.rms, *estimate.extremes, strict=True):
            rows.append((name, label, *(f"{size:.4g} {unit}" for size in sizes)))
    return rows


def _score_rows(found: RecordingEstimate) -> list[tuple[str, ...]]:
    """Return the table of scores against the sensor."""
    rows: list[tuple[str, ...]] = []
    for name, side in found.compared.items():
        for label, score in side.scores(found.record.dt).items():
            unit = "N" if label[0] == "F" else "N m"
            rows.append(
                (
                    name,
                    f"{side.point}.{label}",
                    "no signal" if score.r2 is None else f"{score.r2:.3f}",
                    f"{score.rmse:.3g} {unit}",
                    "-" if score.r2_outside_fit is None else f"{score.r2_outside_fit:.3f}",
                    "-" if score.factor is None else f"{score.factor:.3f}",
                    f"{score.offset:.3g} {unit}",
                    "-" if score.lag_s is None else f"{1e3 * score.lag_s:.1f} ms",
                )
            )
    return rows
