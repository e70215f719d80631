"""A program, `ros_walk.py NAME OUT.json RATE SAMPLES AHEAD`: publish the walk on ROS 2 topics, keep a node's forces."""

# RATE [Hz]; stamps are 2 ms apart, a pose with every second; it waits where AHEAD samples have no forces yet.

import gc
import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from nav_msgs.msg import Odometry
from rclpy.experimental import EventsExecutor
from sensor_msgs.msg import Imu, JointState

from support.walking_log import FEET, walk

BEGIN = 1_700_000_000
STEP = 2_000_000  # [ns]


def fill(target: Any, names: str, values: np.ndarray) -> None:
    """Write numbers to the fields of a vector or quaternion."""
    for name, value in zip(names, values, strict=True):
        setattr(target, name, float(value))


def messages(k: int) -> tuple[Any, ...]:
    """Return the messages of a sample: joints, IMU, pose and twist."""
    walked = walk()
    q, v = walked.q[k], walked.v[k]
    state, imu, odom = JointState(name=list(walked.joints)), Imu(), Odometry()
    state.position, state.velocity, state.effort = q[7:].tolist(), v[6:].tolist(), walked.tau[k].tolist()
    fill(imu.orientation, "xyzw", q[3:7])
    fill(imu.angular_velocity, "xyz", v[3:6])
    fill(odom.pose.pose.position, "xyz", q[:3])
    fill(odom.pose.pose.orientation, "xyzw", q[3:7])
    fill(odom.twist.twist.linear, "xyz", v[:3])
    fill(odom.twist.twist.angular, "xyz", v[3:6])
    return state, imu, odom


def main(name: str, out: str, rate: float, samples: int, ahead: int) -> None:
    """Publish, listen, and write the forces that came, and how late after their joints [s]."""
    rclpy.init()
    node = rclpy.create_node("walk")
    publishers = [
        node.create_publisher(kind, topic, 200)
        for kind, topic in ((JointState, "/joint_states"), (Imu, "/imu"), (Odometry, "/odom"))
    ]
    came: dict[str, list[tuple[float, ...]]] = {foot: [] for foot in FEET}
    sent: dict[int, float] = {}
    late: list[float] = []
    contacts: list[JointState] = []
    health: dict[str, str] = {}

    def hear(foot: str, message: WrenchStamped) -> None:
        at, force = message.header.stamp, message.wrench.force
        came[foot].append((at.sec - BEGIN + 1e-9 * at.nanosec, force.x, force.y, force.z))
        begun = sent.pop((at.sec - BEGIN) * 10**9 + at.nanosec, None) if foot == FEET[-1] else None
        if begun is not None:
            late.append(time.perf_counter() - begun)

    for foot in FEET:
        topic = f"/{name}/momentum/{foot}/force"
        node.create_subscription(WrenchStamped, topic, lambda message, foot=foot: hear(foot, message), 1000)
    node.create_subscription(JointState, f"/{name}/momentum/contacts", contacts.append, 1000)
    node.create_subscription(
        DiagnosticArray, "/diagnostics", lambda m: health.update({one.key: one.value for one in m.status[0].values}), 10
    )
    executor = EventsExecutor()
    executor.add_node(node)

    def listen(seconds: float) -> None:
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0.0:
            executor.spin_once(timeout_sec=left)

    while any(publisher.get_subscription_count() == 0 for publisher in publishers):
        listen(0.05)
    listen(1.0)  # a subscription that is counted is not yet served
    ready = [messages(k) for k in range(min(samples, len(walk().time)))]
    gc.disable()  # a collection would count as lateness of the node
    begin = time.perf_counter()
    for k in range(samples):
        one, (second, rest) = ready[k % len(ready)], divmod(k * STEP, 10**9)
        for message in one:
            message.header.stamp.sec, message.header.stamp.nanosec = BEGIN + second, rest
        while k - len(late) > ahead:
            waited = time.perf_counter()
            listen(0.002)
            begin += time.perf_counter() - waited
        listen(begin + k / rate - time.perf_counter())
        sent[k * STEP] = time.perf_counter()
        for publisher, message in zip(publishers, one[: 2 + (k + 1) % 2], strict=False):
            publisher.publish(message)
    listen(2.5)  # until diagnostics have said the last count
    touching = [[name for name, on in zip(one.name, one.position, strict=True) if on > 0.5] for one in contacts]
    found = {"late": late, "health": health, "contacts": touching, "forces": came}
    Path(out).write_text(json.dumps(found))
    node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], float(sys.argv[3]), int(sys.argv[4]), int(sys.argv[5]))
