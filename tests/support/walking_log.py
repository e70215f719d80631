"""A quadruped with exactly known foot forces, by Pinocchio alone, as samples, as a table and as a ROS 2 bag."""

from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path

import numpy as np
import pandas as pd
import pinocchio as pin

from support.robot_parts import by_axis, channels, joint, link

LEGS = ("FL", "FR", "RL", "RR")
FEET = tuple(f"{leg}_FOOT" for leg in LEGS)
TINY = 1.0e-4  # [s] of the differences that give velocity and acceleration


def urdf() -> str:
    """Return the robot: a trunk of 6 kg, four legs of three joints and 0.9 kg, feet as fixed links."""
    cubes = {"hip": (0.3, "0 0 0", 0.06), "thigh": (0.4, "0 0 -0.1", 0.2), "shank": (0.2, "0 0 -0.1", 0.2)}
    parts = [link("trunk", 6.0, "0.01 0 0.01", 3 * (6.0 * 0.3**2 / 12.0,))]
    for leg, x, y in zip(LEGS, (0.2, 0.2, -0.2, -0.2), (0.1, -0.1, 0.1, -0.1), strict=True):
        for name, (mass, centre, size) in cubes.items():
            parts.append(link(f"{leg}_{name}", mass, centre, 3 * (mass * size**2 / 12.0,)))
        parts += [link(f"{leg}_FOOT"), joint(f"{leg}_HAA", "revolute", "trunk", f"{leg}_hip", f"{x} {y} 0", "1 0 0", 3)]
        parts += [joint(f"{leg}_HFE", "revolute", f"{leg}_hip", f"{leg}_thigh", f"0 {0.2 * y} 0", limit=3)]
        parts += [joint(f"{leg}_KFE", "revolute", f"{leg}_thigh", f"{leg}_shank", "0 0 -0.2", limit=3)]
        parts += [joint(f"{leg}_foot_joint", "fixed", f"{leg}_shank", f"{leg}_FOOT", "0 0 -0.2")]
    return f'<robot name="quadruped">{"".join(parts)}</robot>'


@dataclass(frozen=True)
class Walk:
    """Samples of a walk: time (n,) [s], q (n, 19), v (n, 18), tau (n, 12) [N m], force (n, 4, 3) [N] in world axes."""

    joints: tuple[str, ...]
    time: np.ndarray
    q: np.ndarray
    v: np.ndarray
    tau: np.ndarray
    force: np.ndarray

    @cached_property
    def specific_force(self) -> np.ndarray:
        """What an accelerometer at the trunk's origin shows (n, 3) [m/s2], body axes."""
        found = []
        for t in self.time:
            R = pin.Quaternion(_place(t)[3:7]).matrix()
            place = [_place(t + k * 1e-3)[:3] for k in (-1, 0, 1)]
            found.append(R.T @ ((place[0] - 2 * place[1] + place[2]) / 1e-6 + [0.0, 0.0, 9.81]))
        return np.array(found)


@cache
def walk(duration: float = 3.0, rate: float = 500.0) -> Walk:
    """Return a walk of some seconds, sampled evenly [Hz]."""
    model = pin.buildModelFromXML(urdf(), pin.JointModelFreeFlyer())
    model.gravity.linear = np.array([0.0, 0.0, -9.81])
    data, time = model.createData(), np.arange(round(duration * rate) + 1) / rate
    q = np.array([_place(t) for t in time])

    def velocity(t: float) -> np.ndarray:
        return pin.difference(model, _place(t - TINY), _place(t + TINY)) / (2 * TINY)

    v = np.array([velocity(t) for t in time])
    a = np.array([(velocity(t + TINY) - velocity(t - TINY)) / (2 * TINY) for t in time])
    tau, force = np.empty((len(time), 12)), np.empty((len(time), 4, 3))
    weight, axes = 9.81 * pin.computeTotalMass(model), pin.LOCAL_WORLD_ALIGNED
    feet = [model.getFrameId(foot) for foot in FEET]
    for k, t in enumerate(time):
        needed = pin.rnea(model, data, q[k], v[k], a[k])
        J = np.concatenate([pin.computeFrameJacobian(model, data, q[k], foot, axes)[:3] for foot in feet])
        share = 1.0 + 0.5 * np.sin(2 * np.pi * 0.8 * t + np.array([0.0, np.pi, np.pi, 0.0]))
        f = np.zeros((4, 3))
        f[:, 2] = 0.25 * weight * share
        f[:, 0] = 3.0 * np.sin(2 * np.pi * 1.1 * t + np.arange(4))
        wanted = f.ravel()
        base = J[:, :6].T
        f = (wanted + np.linalg.pinv(base) @ (needed[:6] - base @ wanted)).reshape(4, 3)
        tau[k], force[k] = (needed - J.T @ f.ravel())[6:], f
    return Walk(tuple(model.names.tolist()[2:]), time, q, v, tau, force)


def _place(t: float) -> np.ndarray:
    """Return the configuration (19,) at a time [s]."""
    w = 2 * np.pi
    position = [0.4 * t, 0.03 * np.sin(w * 0.7 * t), 0.35 + 0.01 * np.sin(w * 1.6 * t)]
    rolled = 0.1 * np.sin(w * 0.9 * t), 0.08 * np.sin(w * 1.3 * t + 1.0), 0.3 * np.sin(w * 0.4 * t)
    turn = pin.Quaternion(pin.rpy.rpyToMatrix(*rolled))
    legs = []
    for k in range(4):
        phase = w * 1.2 * t + 0.5 * np.pi * k
        legs += [0.1 * np.sin(phase), 0.6 + 0.25 * np.sin(phase + 0.4), -1.2 + 0.3 * np.sin(phase + 1.1)]
    return np.concatenate([position, turn.coeffs(), legs])


def table(walked: Walk) -> pd.DataFrame:
    """Return a walk as a table in which every channel has the same rate."""
    R = np.array([pin.Quaternion(q[3:7]).matrix() for q in walked.q])
    columns: dict[str, np.ndarray] = {"t": walked.time}
    columns |= {name: walked.q[:, k] for k, name in enumerate(("px", "py", "pz", "qx", "qy", "qz", "qw"))}
    world = np.einsum("nij,nj->ni", R, walked.v[:, :3])
    columns |= {f"v{axis}": world[:, k] for k, axis in enumerate("xyz")}
    columns |= {f"gyro_{axis}": walked.v[:, 3 + k] for k, axis in enumerate("xyz")}
    felt = walked.specific_force
    columns |= {f"acc_{axis}": felt[:, k] for k, axis in enumerate("xyz")}
    for k, name in enumerate(walked.joints):
        columns |= {f"{name}_pos": walked.q[:, 7 + k], f"{name}_vel": walked.v[:, 6 + k]}
        columns[f"{name}_tau"] = walked.tau[:, k]
    columns |= {f"fl_f{axis}": walked.force[:, 0, k] for k, axis in enumerate("xyz")}
    return pd.DataFrame(columns)


def table_map(robot: Path) -> dict[str, object]:
    """Return the right map of the table, as nested values."""
    names = list(walk().joints)
    joints = {"names": names, **channels(names, position="{}_pos", velocity="{}_vel", effort="{}_tau")}
    for part, unit in (("position", "rad"), ("velocity", "rad/s"), ("effort", "N m")):
        joints[part]["unit"] = unit
    base = by_axis(position="p{}", quaternion="q{}", velocity="v{}", rate="gyro_{}")
    for part, unit in (("position", "m"), ("velocity", "m/s"), ("rate", "rad/s")):
        base[part]["unit"] = unit
    check = by_axis(specific_force="acc_{}", wrench="fl_f{}")
    check["specific_force"]["unit"], check["wrench"]["point"] = "m/s2", "FL_FOOT"
    tables = {"robot": {"urdf": str(robot), "points": list(FEET)}, "observer": {"gain": 1000.0}}
    return tables | {"base": base, "joints": joints, "check": check}


def bag(walked: Walk, path: Path, *, odometry_ahead=0.0, odometry_fast=0.0, unmeasured=(), unstamped=0.0) -> None:
    """Write a walk as a ROS 2 bag: topics at their own rates, recorded 3 ms after their stamps, with scatter."""
    # The odometry's clock is `ahead` [s] and drifts; efforts of unmeasured joints are NaN; 0 stamps until `unstamped`.
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store, rng = get_typestore(Stores.ROS2_HUMBLE), np.random.default_rng(1)
    make = store.types
    begin = 1_700_000_000.0

    def header(t: float) -> object:
        whole = round((begin + t) * 1e9) if t >= unstamped else 0
        stamp = make["builtin_interfaces/msg/Time"](sec=whole // 10**9, nanosec=whole % 10**9)
        return make["std_msgs/msg/Header"](stamp=stamp, frame_id="world")

    def vector(values: np.ndarray, kind: str = "Vector3") -> object:
        return make[f"geometry_msgs/msg/{kind}"](*(float(x) for x in values))

    def turn(values: np.ndarray) -> object:
        return make["geometry_msgs/msg/Quaternion"](*(float(x) for x in values))

    messages: list[tuple[float, str, object]] = []
    felt = walked.specific_force
    none9, none36 = np.zeros(9), np.zeros(36)
    for k, t in enumerate(walked.time):
        q, v = walked.q[k], walked.v[k]
        tau = np.where(np.isin(walked.joints, unmeasured), np.nan, walked.tau[k])
        state = make["sensor_msgs/msg/JointState"](header(t), list(walked.joints), q[7:], v[6:], tau)
        messages.append((t, "/joint_states", state))
        imu = make["sensor_msgs/msg/Imu"](header(t), turn(q[3:7]), none9, vector(v[3:6]), none9, vector(felt[k]), none9)
        messages.append((t, "/imu", imu))
        if k % 2 == 0:
            place = make["geometry_msgs/msg/Pose"](vector(q[:3], "Point"), turn(q[3:7]))
            pose = make["geometry_msgs/msg/PoseWithCovariance"](place, none36)
            twist = make["geometry_msgs/msg/Twist"](vector(v[:3]), vector(v[3:6]))
            twist = make["geometry_msgs/msg/TwistWithCovariance"](twist, none36)
            stamp = header((1.0 + odometry_fast) * t + odometry_ahead)
            odometry = make["nav_msgs/msg/Odometry"](stamp, "trunk", pose, twist)
            messages.append((t, "/odom", odometry))
            wrench = make["geometry_msgs/msg/Wrench"](vector(walked.force[k, 0]), vector(np.zeros(3)))
            messages.append((t, "/ft", make["geometry_msgs/msg/WrenchStamped"](header(t), wrench)))
    recorded = [(begin + t + 3.0e-3 + 1.0e-3 * rng.standard_normal(), topic, message) for t, topic, message in messages]
    with Writer(path, version=8, storage_plugin=StoragePlugin.MCAP) as writer:
        connections = {}
        for stamp, topic, message in sorted(recorded, key=lambda item: item[0]):
            kind = message.__msgtype__  # type: ignore[attr-defined]
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(connections[topic], round(stamp * 1e9), store.serialize_cdr(message, kind))


def bag_map(robot: Path, clock: str = "header") -> dict[str, object]:
    """Return the right map of the bag, as nested values."""
    return {
        "robot": {"urdf": str(robot), "points": list(FEET)},
        "log": {"clock": clock},
        "base": {"topic": "/odom", "rate": {"topic": "/imu"}},
        "observer": {"gain": 1000.0},
        "joints": {"topic": "/joint_states"},
        "check": {"wrench": {"topic": "/ft", "point": "FL_FOOT"}, "specific_force": {"topic": "/imu"}},
    }
