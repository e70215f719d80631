"""Write forces, joints, pose and arrows of an estimate, or of a simulated flight, as an MCAP file: a ROS 2 bag.

| topic | type | content |
|---|---|---|
| `/force/<observer>/<point>` | geometry_msgs/WrenchStamped | force on the robot, world axes, at mid-interval |
| `/truth/<point>` | geometry_msgs/WrenchStamped | the force sensor's, or a simulation's true force |
| `/joint_states` | sensor_msgs/JointState | angles and rates, and efforts where they are known |
| `/pose` | geometry_msgs/PoseStamped | of a free base, world axes |
| `/scene` | foxglove_msgs/SceneUpdate | the forces as arrows at their points, 30 a second, for Foxglove |
| `/arrows` | visualization_msgs/MarkerArray | the same for RViz |
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import xarray as xr

from aerobat_pin.aerobat import FlightLog
from aerobat_pin.errors import LogError, OutputError, check_file, write_files
from aerobat_pin.estimation import Result
from aerobat_pin.flight import log_with_motion
from aerobat_pin.forces import blocks_of
from aerobat_pin.numerics import Array, frame_id, guarded
from aerobat_pin.observers import Estimate, has_free_base
from aerobat_pin.records import FREE_NQ

PACKAGE = "foxglove_msgs/msg"
POSED, SIZED, COLOUR = "geometry_msgs/Pose pose", "geometry_msgs/Vector3 size", "foxglove_msgs/Color color"
POINTS, COLOURS = "geometry_msgs/Point[] points", ("foxglove_msgs/Color[] colors", "uint32[] indices")
LENGTHS = tuple(f"float64 {part}" for part in ("shaft_length", "shaft_diameter", "head_length", "head_diameter"))
MODEL = ("bool override_color", "string url", "string media_type", "uint8[] data")
PRIMITIVES = {  # list in an entity -> type of its entries, and their fields
    "arrows": ("ArrowPrimitive", (POSED, *LENGTHS, COLOUR)),
    "cubes": ("CubePrimitive", (POSED, SIZED, COLOUR)),
    "spheres": ("SpherePrimitive", (POSED, SIZED, COLOUR)),
    "cylinders": ("CylinderPrimitive", (POSED, SIZED, "float64 bottom_scale", "float64 top_scale", COLOUR)),
    "lines": (
        "LinePrimitive",
        ("uint8 type", POSED, "float64 thickness", "bool scale_invariant", POINTS, COLOUR, *COLOURS),
    ),
    "triangles": ("TriangleListPrimitive", (POSED, POINTS, COLOUR, *COLOURS)),
    "texts": (
        "TextPrimitive",
        (POSED, "bool billboard", "float64 font_size", "bool scale_invariant", COLOUR, "string text"),
    ),
    "models": ("ModelPrimitive", (POSED, "geometry_msgs/Vector3 scale", COLOUR, *MODEL)),
}
DEFINITIONS = {
    "Color": tuple(f"float64 {part}" for part in "rgba"),
    "KeyValuePair": ("string key", "string value"),
    **dict(PRIMITIVES.values()),
    "SceneEntityDeletion": ("builtin_interfaces/Time timestamp", "uint8 type", "string id"),
    "SceneEntity": (
        "builtin_interfaces/Time timestamp",
        "string frame_id",
        "string id",
        "builtin_interfaces/Duration lifetime",
        "bool frame_locked",
        "foxglove_msgs/KeyValuePair[] metadata",
        *(f"foxglove_msgs/{kind}[] {name}" for name, (kind, _) in PRIMITIVES.items()),
    ),
    "SceneUpdate": ("foxglove_msgs/SceneEntityDeletion[] deletions", "foxglove_msgs/SceneEntity[] entities"),
}
HEAD_SHARE = 0.25  # of an arrow's length
SHAFT, HEAD_WIDTH = 0.01, 0.02  # diameters [m]
SHOWN_FOR = 100_000_000  # [ns]
ARROWS_PER_SECOND = 30.0
LATEST = 2.0**31  # [s]
LONGEST_MARKER = 0.5  # [m] of the largest force
TRUE_COLOUR = {"r": 0.0, "g": 0.0, "b": 0.0, "a": 1.0}
ESTIMATE_COLOUR = {"r": 0.835, "g": 0.369, "b": 0.0, "a": 1.0}


@guarded()
def write_mcap(result: Result, path: Path) -> None:
    """Write forces, joints, pose and arrows of an estimated recording. Raises OutputError if it cannot be written."""
    largest = 0.0
    for estimate in result.stored.values():
        for columns in force_columns(estimate.head).values():
            for block in estimate.blocks():
                largest = max(largest, _largest_force(block.components[:, columns]))
    write_mcap_stretches(_mcap_stretches(result, largest), path)


def _mcap_stretches(result: Result, largest: float) -> Iterator[McapStretch]:
    """Yield the stretches of an estimated recording, short enough for memory."""
    record = result.record
    assert record is not None
    for part in record.parts:
        for first, last in blocks_of(*part):
            block = record.block(first, last)
            forces: dict[str, tuple[str, Array]] = {}
            for name, estimate in result.stored.items():
                low = estimate.index(block.time[0])
                window = estimate.between(low, low + last - first)
                for frame, columns in force_columns(window).items():
                    forces[f"/force/{name}/{frame}"] = (frame, window.components[:, columns])
            low = next(iter(result.stored.values())).index(block.time[0])
            for reference in result.references:
                forces[f"/truth/{reference.frame}"] = (reference.frame, reference.values[low : low + last - first])
            tau = result.forces.torque(block) if result.forces and "joints.effort" in record.channels else None
            yield McapStretch(record.robot.model, block.time, block.q, block.v, tau, forces, largest)


@guarded()
def force_columns(estimate: Estimate) -> dict[str, list[int]]:
    """Return frame -> columns of its force, or of its force and moment, where these are in world axes."""
    columns: dict[str, list[int]] = {}
    for k, label in enumerate(estimate.identifiability.components):
        frame, _, axis = label.rpartition(".")
        if frame in estimate.frames and axis in ("Fx", "Fy", "Fz", "Mx", "My", "Mz"):
            columns.setdefault(frame, []).append(k)
    return columns


def _largest_force(forces: Array) -> float:
    """Return the largest size of forces (m, 3 or 6)."""
    return float(np.max(np.linalg.norm(forces[:, :3], axis=1), initial=0.0))


@guarded()
def write_flight_mcap(model: pin.Model, log: FlightLog, estimates: xr.Dataset, path: Path) -> None:
    """Write a simulated flight with its estimates and true forces.

    Args:
        model: the robot that flew.
        log: the flight log.
        estimates: content of `estimate.nc`, with `force_W`.
        path: the MCAP file.

    Raises:
        LogError: the log has no configuration, nor raw samples with their true motion.
        OutputError: the file cannot be written.
    """
    log = log_with_motion(log)
    if "q" not in log.measured or "v" not in log.measured:
        raise LogError("convert: the flight log has no channels q and v")
    q, v = log.measured["q"].values, log.measured["v"].values
    forces: dict[str, tuple[str, Array]] = {}
    for name in map(str, estimates["observer"].values):
        for point in map(str, estimates["point"].values):
            forces[f"/force/{name}/{point}"] = (point, estimates["force_W"].sel(observer=name, point=point).values)
    if log.truth is not None and "force_W" in log.truth:
        for point in map(str, log.truth["point"].values):
            forces[f"/truth/{point}"] = (point, log.truth["force_W"].sel(point=point).values)
    largest = max((_largest_force(force) for _, force in forces.values()), default=0.0)
    write_mcap_stretches([McapStretch(model, log.time, q, v, None, forces, largest)], path)


@dataclass(frozen=True)
class McapStretch:
    """A stretch of samples without a hole, and the forces there.

    Attributes:
        time: (m + 1,) samples [s].
        q: (m + 1, nq) configurations.
        v: (m + 1, nv) velocities.
        tau: (m, nv) joint torques, interval means; None if they are not known.
        forces: topic -> frame and (m, 3 or 6) force and moment, world axes [N, N m].
        largest: the largest force of the record [N], which scales the arrows.
    """

    model: pin.Model
    time: Array
    q: Array
    v: Array
    tau: Array | None
    forces: Mapping[str, tuple[str, Array]]
    largest: float


@guarded()
def check_mcap_file(path: Path, *, force: bool) -> None:
    """Raise OutputError if an MCAP file cannot be written here, as `check_file`, or if the extra is not installed."""
    check_file(path, force=force)
    try:
        for name in ("mcap.writer", "rosbags.typesys"):
            import_module(name)
    except ImportError as error:
        raise OutputError(f"{path}: writing MCAP needs the extra ros: pip install 'aerobat-pinocchio[ros]'") from error


def write_mcap_stretches(stretches: Iterable[McapStretch], path: Path) -> None:
    """Write one MCAP file, replacing an older one. Raises OutputError as `check_mcap_file` does."""
    check_mcap_file(path, force=True)
    from mcap.writer import CompressionType, Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    for kind, fields in DEFINITIONS.items():
        store.register(get_types_from_msg("\n".join(fields), f"{PACKAGE}/{kind}"))
    with tempfile.TemporaryDirectory() as folder:
        draft = Path(folder, "forces.mcap")
        with draft.open("wb") as file:
            writer = Writer(file, compression=CompressionType.NONE, enable_data_crcs=True)
            writer.start("ros2", "aerobat")
            topics = _Topics(writer, store)
            for part in stretches:
                if not 0.0 <= part.time[0] <= part.time[-1] < LATEST:
                    raise OutputError(f"{path}: {part.time[0]:g} to {part.time[-1]:g} s: ROS 2 has 0 to {LATEST:g} s")
                _write_stretch(topics, part)
            writer.finish()
        write_files({path: draft})


class _Topics:
    """Writes messages; a topic's schema and channel are made with its first one."""

    def __init__(self, writer: Any, store: Any) -> None:
        self._writer, self._store = writer, store
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}

    def put(self, topic: str, time: float, kind: str, values: Mapping[str, Any]) -> None:
        if kind not in self._schemas:
            text, _ = self._store.generate_msgdef(kind, ros_version=2)
            self._schemas[kind] = self._writer.register_schema(kind, "ros2msg", text.encode())
        if topic not in self._channels:
            quality = {"offered_qos_profiles": ""}
            self._channels[topic] = self._writer.register_channel(topic, "cdr", self._schemas[kind], quality)
        raw, stamp = self._store.serialize_cdr(_message(self._store, kind, values), kind), round(time * 1e9)
        self._writer.add_message(self._channels[topic], stamp, bytes(raw), stamp)


def _message(store: Any, kind: str, values: Mapping[str, Any]) -> Any:
    """Return a message with these fields; the others are zero or empty."""
    fields = store.get_msgdef(kind).fields
    return store.types[kind](**{name: _message_field(store, node, values.get(name)) for name, node in fields})


def _message_field(store: Any, node: tuple[Any, Any], value: Any) -> Any:
    """Return a field of a type of rosbags: a number or text, a message, or a list of one of them."""
    sort, about = node
    if sort.name == "NAME":
        return _message(store, about, value or {})
    if sort.name == "BASE":
        return value if value is not None else "" if about[0] == "string" else 0
    inner, kind = about[0]
    if inner.name == "NAME":
        return [_message(store, kind, entry) for entry in value or ()]
    return list(value or ()) if kind[0] == "string" else np.array([] if value is None else value, kind[0])


def _write_stretch(topics: _Topics, part: McapStretch) -> None:
    middle = 0.5 * (part.time[1:] + part.time[:-1])
    every = max(1, round(1.0 / ARROWS_PER_SECOND / float(np.median(np.diff(part.time)))))
    model, data = part.model, part.model.createData()
    named = zip(model.names.tolist()[1:], model.joints.tolist()[1:], strict=True)
    joints = {name: (int(joint.idx_q), int(joint.idx_v)) for name, joint in named if joint.nq == joint.nv == 1}
    for k, moment in enumerate(middle.tolist()):
        _put_motion(topics, part, joints, k)
        for topic, (_, force) in part.forces.items():
            wrench = {"force": _xyz(force[k, :3]), "torque": _xyz(force[k, 3:6]) if force.shape[1] == 6 else {}}
            topics.put(topic, moment, "geometry_msgs/msg/WrenchStamped", {"header": _header(moment), "wrench": wrench})
        if k % every == 0 and part.largest > 0.0:
            pin.framesForwardKinematics(part.model, data, part.q[k])
            _put_arrows(topics, part, data, k, moment)


def _put_motion(topics: _Topics, part: McapStretch, joints: Mapping[str, tuple[int, int]], k: int) -> None:
    """Put pose and joints of a sample; `joints` are the indices in q and in v of those with one coordinate."""
    time, q, v = float(part.time[k]), part.q[k], part.v[k]
    if has_free_base(part.model):
        pose = {"position": _xyz(q[:3]), "orientation": dict(zip("xyzw", q[3:FREE_NQ].tolist(), strict=True))}
        topics.put("/pose", time, "geometry_msgs/msg/PoseStamped", {"header": _header(time), "pose": pose})
    if joints:
        columns, rows = (list(indices) for indices in zip(*joints.values(), strict=True))
        state = {"header": _header(time, ""), "name": list(joints), "position": q[columns], "velocity": v[rows]}
        if part.tau is not None:
            state["effort"] = 0.5 * (part.tau[max(k - 1, 0)] + part.tau[k])[rows]  # of the intervals around the sample
        topics.put("/joint_states", time, "sensor_msgs/msg/JointState", state)


def _put_arrows(topics: _Topics, part: McapStretch, data: pin.Data, k: int, time: float) -> None:
    """Put each force as an arrow from its point, for Foxglove and for RViz."""
    markers, entities = [], []
    for number, (topic, (frame, force)) in enumerate(part.forces.items()):
        if not part.model.existFrame(frame):  # a sum is at no point
            continue
        start = data.oMf[frame_id(part.model, frame)].translation
        along = LONGEST_MARKER / part.largest * force[k, :3]
        length = float(np.linalg.norm(along))
        turn = pin.Quaternion.FromTwoVectors(np.array([1.0, 0.0, 0.0]), along) if length else pin.Quaternion.Identity()
        colour = TRUE_COLOUR if topic.startswith("/truth") else ESTIMATE_COLOUR
        orientation = {axis: float(getattr(turn, axis)) for axis in "xyzw"}
        arrow = {
            "pose": {"position": _xyz(start), "orientation": orientation},
            "shaft_length": (1.0 - HEAD_SHARE) * length,
            "shaft_diameter": SHAFT,
            "head_length": HEAD_SHARE * length,
            "head_diameter": HEAD_WIDTH,
            "color": colour,
        }
        header, lasting = _header(time), {"nanosec": SHOWN_FOR}
        about = {"timestamp": header["stamp"], "frame_id": header["frame_id"], "id": topic}
        entities.append({**about, "lifetime": lasting, "arrows": [arrow]})
        markers.append(
            {
                "header": header,
                "ns": topic,
                "id": number,
                "pose": {"orientation": {"w": 1.0}},
                "scale": {"x": SHAFT, "y": HEAD_WIDTH, "z": HEAD_WIDTH},
                "color": colour,
                "lifetime": lasting,
                "points": [_xyz(start), _xyz(start + along)],
            }
        )
    topics.put("/scene", time, "foxglove_msgs/msg/SceneUpdate", {"entities": entities})
    topics.put("/arrows", time, "visualization_msgs/msg/MarkerArray", {"markers": markers})


def _header(time: float, frame: str = "world") -> dict[str, Any]:
    sec, nanosec = divmod(round(time * 1e9), 10**9)
    return {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": frame}


def _xyz(values: Array) -> dict[str, float]:
    return dict(zip("xyz", values.tolist(), strict=True))
