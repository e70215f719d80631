"""The numbers of a ROS message, by the names that columns of a bag have. Works for messages of any client library.

| type | columns of a topic `/x` |
|---|---|
| sensor_msgs/JointState | `/x.position.<joint>`, `/x.velocity.<joint>`, `/x.effort.<joint>` |
| sensor_msgs/Imu | `/x.orientation.x ... w`, `/x.angular_velocity.x ... z`, `/x.linear_acceleration.x ... z` |
| geometry_msgs/PoseStamped, TransformStamped | `/x.position.x ... z`, `/x.orientation.x ... w` |
| nav_msgs/Odometry | the pose, and `/x.linear.x ... z`, `/x.angular.x ... z` in body axes |
| geometry_msgs/TwistStamped | `/x.linear.x ... z`, `/x.angular.x ... z` |
| geometry_msgs/WrenchStamped | `/x.force.x ... z`, `/x.torque.x ... z` |
| std_msgs/Float64MultiArray and other arrays `data` | `/x.data.0 ...` |
"""

from __future__ import annotations

from contextlib import suppress
from typing import Any

LONGEST_ARRAY = 1000  # of an array


def entries(message: Any) -> dict[str, float] | None:
    """Return column -> number of a message; None for a type that has no columns."""
    if hasattr(message, "name") and hasattr(message, "effort"):
        columns: dict[str, float] = {}
        for part in ("position", "velocity", "effort"):
            values = getattr(message, part)
            if len(values) == len(message.name):  # NaN is how ROS 2's broadcaster writes that a joint has no effort
                pairs = [(joint, float(x)) for joint, x in zip(message.name, values, strict=True)]
                columns |= {f"{part}.{joint}": x for joint, x in pairs if x == x or part != "effort"}
        return columns
    if vectors := _vectors(message):
        return {
            f"{part}.{axis}": float(getattr(vector, axis))
            for part, vector in vectors.items()
            for axis in ("xyzw" if part == "orientation" else "xyz")
        }
    data: Any = getattr(message, "data", None)
    if isinstance(data, int | float) and not isinstance(data, bool):
        return {"data": float(data)}
    if hasattr(data, "__len__") and not isinstance(data, str | bytes) and len(data) <= LONGEST_ARRAY:
        with suppress(TypeError, ValueError):
            return {f"data.{k}": float(x) for k, x in enumerate(data)}
    return None


def _vectors(message: Any) -> dict[str, Any]:
    """Return part -> vector or quaternion of a message that has such parts."""
    if hasattr(message, "linear_acceleration"):
        return {part: getattr(message, part) for part in ("orientation", "angular_velocity", "linear_acceleration")}
    if hasattr(message, "wrench"):
        return {"force": message.wrench.force, "torque": message.wrench.torque}
    vectors: dict[str, Any] = {}
    if hasattr(message, "pose"):
        pose = getattr(message.pose, "pose", message.pose)
        vectors |= {"position": pose.position, "orientation": pose.orientation}
    if hasattr(message, "transform"):
        vectors |= {"position": message.transform.translation, "orientation": message.transform.rotation}
    if hasattr(message, "twist"):
        twist = getattr(message.twist, "twist", message.twist)
        vectors |= {"linear": twist.linear, "angular": twist.angular}
    return vectors


def stamp(message: Any) -> float:
    """Return the header's stamp of a message [s]; 0 if it has none."""
    header = getattr(message, "header", None)
    if header is None:
        return 0.0
    sub = header.stamp
    return float(sub.sec) + 1e-9 * float(getattr(sub, "nanosec", getattr(sub, "nanosecs", 0)))
