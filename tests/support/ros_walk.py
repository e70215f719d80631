"""A program: publish the quadruped's walk on real ROS 2 topics, and keep the forces that a node makes of it.

    python ros_walk.py NAME OUT.json RATE SAMPLES

The times are those of the walk, as Unix stamps. RATE [Hz] is how fast samples are published; the pose comes with every
second one.
"""

from __future__ import annotations

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
MOST_AHEAD = 100  # samples that are published before the forces of the first of them have come


def stamped(message: Any, t: float) -> Any:
    """Return a message with a stamp [s] since the begin."""
    whole = round(t * 1e9)
    message.header.stamp.sec, message.header.stamp.nanosec = BEGIN + whole // 10**9, whole % 10**9
    return message


def fill(target: Any, names: str, values: np.ndarray) -> None:
    """Write numbers to the fields of a vector or quaternion."""
    for name, value in zip(names, values, strict=True):
        setattr(target, name, float(value))


def messages(k: int) -> tuple[Any, ...]:
    """Return the messages of a sample: joints, IMU, pose and twist."""
    walked = walk()
    t, q, v = float(walked.time[k]), walked.q[k], walked.v[k]
    state = stamped(JointState(name=list(walked.joints)), t)
    state.position, state.velocity, state.effort = q[7:].tolist(), v[6:].tolist(), walked.tau[k].tolist()
    imu = stamped(Imu(), t)
    fill(imu.orientation, "xyzw", q[3:7])
    fill(imu.angular_velocity, "xyz", v[3:6])
    odom = stamped(Odometry(), t)
    fill(odom.pose.pose.position, "xyz", q[:3])
    fill(odom.pose.pose.orientation, "xyzw", q[3:7])
    fill(odom.twist.twist.linear, "xyz", v[:3])
    fill(odom.twist.twist.angular, "xyz", v[3:6])
    return state, imu, odom


def main(name: str, out: str, rate: float, samples: int) -> None:
    """Publish, listen, and write the forces that came, and how late after their joints [s].

    Where the node falls behind, as it does while other programs use all processors, publishing waits for it.
    """
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
        if foot == FEET[-1]:
            late.append(time.perf_counter() - sent[at.sec * 10**9 + at.nanosec])

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
    ready = [messages(k) for k in range(samples)]
    begin = time.perf_counter()
    for k, one in enumerate(ready):
        while k - len(late) > MOST_AHEAD:
            waited = time.perf_counter()
            listen(0.002)
            begin += time.perf_counter() - waited
        listen(begin + k / rate - time.perf_counter())
        at = one[0].header.stamp
        sent[at.sec * 10**9 + at.nanosec] = time.perf_counter()
        for publisher, message in zip(publishers, one[: 2 + (k + 1) % 2], strict=False):
            publisher.publish(message)
    listen(2.5)  # until diagnostics have said the last count
    touching = [[name for name, on in zip(one.name, one.position, strict=True) if on > 0.5] for one in contacts]
    found = {"late": late, "health": health, "contacts": touching, "forces": came}
    Path(out).write_text(json.dumps(found))
    node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], float(sys.argv[3]), int(sys.argv[4]))
