"""Write forces, joints, pose and arrows as an MCAP file in the form of a ROS 2 bag.

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
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from aerobat_pin.errors import OutputError, write_files
from aerobat_pin.experiments.scene_update import register_scene, scene_update
from aerobat_pin.numerics import Array
from aerobat_pin.records import FREE_NQ, FREE_NV, seal_mcap

ARROWS_PER_SECOND = 30.0
LONGEST_MARKER = 0.5  # [m] of the largest force
COLOURS = {"truth": (0.0, 0.0, 0.0), "force": (0.835, 0.369, 0.0)}


@dataclass(frozen=True)
class Telling:
    """What an MCAP file tells.

    Attributes:
        model: the robot.
        time: (m + 1,) samples [s], of one stretch without a hole.
        q: (m + 1, nq) configurations.
        v: (m + 1, nv) velocities.
        tau: (m, nv) joint torques; None if they are not known.
        forces: topic -> frame and (m, 3 or 6) force and moment, world axes [N, N m].
        joints: joint -> index in q and in v.
        largest: the largest force of the record [N], which scales the arrows.
    """

    model: pin.Model
    time: Array
    q: Array
    v: Array
    tau: Array | None
    forces: Mapping[str, tuple[str, Array]]
    joints: Mapping[str, tuple[int, int]] = field(default_factory=dict)
    largest: float = 0.0


def write_telling(parts: Iterable[Telling], path: Path) -> None:
    """Write one MCAP file. Raises OutputError if it cannot be written, or if the package `rosbags` is missing."""
    try:
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise OutputError(f"{path}: writing MCAP needs the extra ros: pip install 'aerobat-pinocchio[ros]'") from error
    store = get_typestore(Stores.ROS2_HUMBLE)
    register_scene(store)
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder, "forces")
        with Writer(place, version=8, storage_plugin=StoragePlugin.MCAP) as writer:
            teller = _Teller(writer, store)
            for part in parts:
                teller.tell(part)
        made = next(place.glob("*.mcap"))
        seal_mcap(made)
        write_files({path: made})


class _Teller:
    """Writes messages; connections are made when a topic is first used."""

    def __init__(self, writer: Any, store: Any) -> None:
        self._writer, self._store = writer, store
        self._connections: dict[str, Any] = {}

    def tell(self, part: Telling) -> None:
        """Write all messages of a stretch."""
        middle = 0.5 * (part.time[1:] + part.time[:-1])
        free = part.model.njoints > 1 and part.model.joints[1].shortname() == "JointModelFreeFlyer"
        step = float(np.median(np.diff(part.time)))
        every = max(1, round(1.0 / ARROWS_PER_SECOND / step))
        largest = part.largest
        data = part.model.createData()
        for k, moment in enumerate(middle):
            self._motion(part, k, free)
            for topic, (_, force) in part.forces.items():
                self._wrench(topic, float(moment), force[k])
            if k % every == 0 and largest > 0.0:
                pin.framesForwardKinematics(part.model, data, part.q[k])
                self._arrows(part, data, k, float(moment), LONGEST_MARKER / largest)

    def _put(self, topic: str, time: float, message: Any) -> None:
        kind = message.__msgtype__
        if topic not in self._connections:
            self._connections[topic] = self._writer.add_connection(topic, kind, typestore=self._store)
        raw = self._store.serialize_cdr(message, kind)
        self._writer.write(self._connections[topic], round(time * 1e9), raw)

    def _make(self, kind: str, **values: Any) -> Any:
        return self._store.types[kind](**values)

    def _header(self, time: float, frame: str = "world") -> Any:
        whole = round(time * 1e9)
        stamp = self._make("builtin_interfaces/msg/Time", sec=whole // 10**9, nanosec=whole % 10**9)
        return self._make("std_msgs/msg/Header", stamp=stamp, frame_id=frame)

    def _vector(self, values: Array, kind: str = "Vector3") -> Any:
        x, y, z = (float(value) for value in values)
        return self._make(f"geometry_msgs/msg/{kind}", x=x, y=y, z=z)

    def _motion(self, part: Telling, k: int, free: bool) -> None:
        time, q, v = float(part.time[k]), part.q[k], part.v[k]
        if free:
            x, y, z, w = (float(value) for value in q[3:FREE_NQ])
            turn = self._make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)
            pose = self._make("geometry_msgs/msg/Pose", position=self._vector(q[:3], "Point"), orientation=turn)
            self._put("/pose", time, self._make("geometry_msgs/msg/PoseStamped", header=self._header(time), pose=pose))
        if part.joints:
            rows = list(part.joints.values())
            effort = np.empty(0) if part.tau is None else part.tau[min(k, len(part.tau) - 1)][[row for _, row in rows]]
            state = self._make(
                "sensor_msgs/msg/JointState",
                header=self._header(time, ""),
                name=list(part.joints),
                position=np.array([q[row] for row, _ in rows]),
                velocity=np.array([v[row] for _, row in rows]),
                effort=np.array(effort),
            )
            self._put("/joint_states", time, state)

    def _wrench(self, topic: str, time: float, values: Array) -> None:
        moment = values[3:6] if len(values) == 6 else np.zeros(3)
        wrench = self._make("geometry_msgs/msg/Wrench", force=self._vector(values[:3]), torque=self._vector(moment))
        self._put(topic, time, self._make("geometry_msgs/msg/WrenchStamped", header=self._header(time), wrench=wrench))

    def _arrows(self, part: Telling, data: pin.Data, k: int, time: float, scale: float) -> None:
        markers, arrows = [], {}
        for number, (topic, (frame, force)) in enumerate(part.forces.items()):
            start = data.oMf[part.model.getFrameId(frame)].translation
            red, green, blue = colour = COLOURS["truth" if topic.startswith("/truth") else "force"]
            arrows[topic] = (start, scale * force[k, :3], colour)
            markers.append(
                self._make(
                    "visualization_msgs/msg/Marker",
                    header=self._header(time),
                    ns=topic,
                    id=number,
                    type=0,
                    action=0,
                    pose=self._make(
                        "geometry_msgs/msg/Pose",
                        position=self._vector(np.zeros(3), "Point"),
                        orientation=self._make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0),
                    ),
                    scale=self._vector(np.array([0.01, 0.02, 0.02])),
                    color=self._make("std_msgs/msg/ColorRGBA", r=red, g=green, b=blue, a=1.0),
                    lifetime=self._make("builtin_interfaces/msg/Duration", sec=0, nanosec=100_000_000),
                    frame_locked=False,
                    points=[self._vector(start, "Point"), self._vector(start + scale * force[k, :3], "Point")],
                    colors=[],
                    texture_resource="",
                    texture=self._make(
                        "sensor_msgs/msg/CompressedImage",
                        header=self._header(time),
                        format="",
                        data=np.empty(0, np.uint8),
                    ),
                    uv_coordinates=[],
                    text="",
                    mesh_resource="",
                    mesh_file=self._make("visualization_msgs/msg/MeshFile", filename="", data=np.empty(0, np.uint8)),
                    mesh_use_embedded_materials=False,
                )
            )
        self._put("/scene", time, scene_update(self._store, time, arrows))
        self._put("/arrows", time, self._make("visualization_msgs/msg/MarkerArray", markers=markers))


def joint_rows(model: pin.Model) -> dict[str, tuple[int, int]]:
    """Return joint -> index in q and in v, for the joints with one coordinate."""
    return {
        name: (int(joint.idx_q), int(joint.idx_v))
        for joint, name in zip(model.joints.tolist()[1:], model.names.tolist()[1:], strict=True)
        if joint.nq == joint.nv == 1 and joint.nv < FREE_NV
    }
