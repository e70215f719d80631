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

from typing import Any

POINT, TURN = "xyz", "xyzw"


def entries(message: Any) -> dict[str, float] | None:
    """Return column -> number of a message; None for a type that has no columns."""
    if hasattr(message, "name") and hasattr(message, "effort"):
        columns: dict[str, float] = {}
        for part in ("position", "velocity", "effort"):
            values = getattr(message, part)
            if len(values) == len(message.name):
                columns |= {f"{part}.{joint}": float(x) for joint, x in zip(message.name, values, strict=True)}
        return columns
    if hasattr(message, "linear_acceleration"):
        return {
            **_axes("orientation", message.orientation, TURN),
            **_axes("angular_velocity", message.angular_velocity),
            **_axes("linear_acceleration", message.linear_acceleration),
        }
    if hasattr(message, "wrench"):
        return {**_axes("force", message.wrench.force), **_axes("torque", message.wrench.torque)}
    columns = {}
    if hasattr(message, "pose"):
        pose = message.pose.pose if hasattr(message.pose, "pose") else message.pose
        columns |= {**_axes("position", pose.position), **_axes("orientation", pose.orientation, TURN)}
    if hasattr(message, "transform"):
        place = message.transform
        columns |= {**_axes("position", place.translation), **_axes("orientation", place.rotation, TURN)}
    if hasattr(message, "twist"):
        twist = message.twist.twist if hasattr(message.twist, "twist") else message.twist
        columns |= {**_axes("linear", twist.linear), **_axes("angular", twist.angular)}
    if columns:
        return columns
    data: Any = getattr(message, "data", None)
    if isinstance(data, int | float) and not isinstance(data, bool):
        return {"data": float(data)}
    if data is not None and not isinstance(data, str | bytes) and hasattr(data, "__len__"):
        try:
            return {f"data.{k}": float(x) for k, x in enumerate(data)} if len(data) <= 1000 else None
        except (TypeError, ValueError):
            return None
    return None


def stamp(message: Any) -> float:
    """Return the header's stamp of a message [s]; 0 if it has none."""
    header = getattr(message, "header", None)
    if header is None:
        return 0.0
    sub = header.stamp
    return float(sub.sec) + 1e-9 * float(getattr(sub, "nanosec", getattr(sub, "nanosecs", 0)))


def _axes(part: str, vector: Any, axes: str = POINT) -> dict[str, float]:
    return {f"{part}.{axis}": float(getattr(vector, axis)) for axis in axes}
