"""A ROS 2 node around a stream: the topics that a map names come in, forces, contacts and the stream's health go out.

| topic | type | holds |
|---|---|---|
| `/aerobat/<observer>/<point>/force` | geometry_msgs/WrenchStamped | the estimate [N, N m], world axes |
| `/aerobat/<observer>/<point>/deviation` | geometry_msgs/WrenchStamped | its standard deviations [N, N m] |
| `/aerobat/<observer>/contacts` | sensor_msgs/JointState | of a robot that walks: `name` the points, `position` 1 for \
contact, else 0, `effort` its probability |
| `/diagnostics` | diagnostic_msgs/DiagnosticArray | `OnlineEstimator.health`, once a second: the stream, the belief |

The stamp is the end of the estimate's interval. Topics are heard with the type that they have, and best effort, so that
publishers of any reliability are; one that comes later, or comes again, is heard from then on.
"""

from __future__ import annotations

import gc
import importlib
import re
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from aerobat_pin.errors import ExtraError, MapError, until_signal
from aerobat_pin.estimation import Calibration, OnlineEstimator, OnlineSample
from aerobat_pin.forces import ContactWatch, contact_probability
from aerobat_pin.records import Map, stamp

QUEUE = 1000  # messages of a topic that wait at most: two seconds of 500 Hz
READ_PACKAGES = ("sensor_msgs", "geometry_msgs", "nav_msgs", "std_msgs")
LOOK_PERIOD, SAY_PERIOD = 0.1, 1.0  # [s] between looks for topics, and between diagnostics
OTHER_SIGNS = re.compile(r"\W")


class ForceNode:
    """The node; `spin` runs it until Ctrl-C. Its kernels are compiled before it hears anything.

    Args:
        chosen: the map.
        folder: where relative paths of the map begin.
        say: called with a line when a topic is heard for the first time, and when one cannot be.
        name: of the node, and where its topics begin.
        calibration: see `OnlineEstimator`, like `wait`.
        wait: by how much messages may arrive late [s].
        heard: called with each estimate, beside publishing it.

    Raises:
        ExtraError: rclpy, or a package of messages, is not installed.
        CalibrationError, MapError, LogError: see `OnlineEstimator`.
    """

    def __init__(
        self,
        chosen: Map,
        folder: Path,
        say: Callable[[str], None],
        name: str = "aerobat",
        calibration: Calibration | None = None,
        *,
        wait: float = 0.0,
        heard: Callable[[OnlineSample], None] | None = None,
    ) -> None:
        rclpy, quality = _imported("rclpy"), _imported("rclpy.qos")
        signals = _imported("rclpy.signals").SignalHandlerOptions.NO
        self._wrench = _imported("geometry_msgs.msg").WrenchStamped
        self._contact = _imported("sensor_msgs.msg").JointState
        self._diagnostic = _imported("diagnostic_msgs.msg")
        self._quality = quality.QoSProfile(depth=QUEUE, reliability=quality.ReliabilityPolicy.BEST_EFFORT)
        self.estimator = OnlineEstimator(chosen, folder, self._publish, calibration, wait=wait)
        self._say, self._name, self._heard = say, name, heard
        self._wanted = {column.partition(".")[0] for column in self.estimator.columns}
        if columns := sorted(name for name in self._wanted if not name.startswith("/")):
            raise MapError(f"map: '{columns[0]}' is a column: a node hears topics, such as topic = \"/joint_states\"")
        self._publishers: dict[str, Any] = {}
        self._watches: dict[str, ContactWatch] = {}
        self._stamps: dict[float, Any] = {}  # time [s] -> the stamp that it was
        self._estimates, self._doubted = 0, False
        self._context = rclpy.Context()
        rclpy.init(context=self._context, signal_handler_options=signals)
        self.node = rclpy.create_node(name, context=self._context)
        self._diagnostics = self.node.create_publisher(self._diagnostic.DiagnosticArray, "/diagnostics", 10)
        self.node.create_timer(LOOK_PERIOD, self._look)
        self.node.create_timer(SAY_PERIOD, self._diagnose)
        self._executor = _imported("rclpy.experimental").EventsExecutor(context=self._context)
        self._executor.add_node(self.node)

    def spin(self) -> None:
        """Run until Ctrl-C, SIGTERM or SIGHUP."""
        gc.collect()
        gc.freeze()  # what stays need not be walked again: a tenth of a second, in which no message is heard
        until_signal(lambda: self.turn(LOOK_PERIOD))  # `spin` of this executor does not let Python handle signals

    def turn(self, seconds: float) -> None:
        """Handle what comes next, within some time [s]."""
        self._executor.spin_once(timeout_sec=seconds)

    def close(self) -> None:
        """Leave the network."""
        self.node.destroy_node()
        self._context.try_shutdown()

    def _look(self) -> None:
        """Hear the topics that somebody publishes by now."""
        if not self._wanted:
            return
        for topic, kinds in self.node.get_topic_names_and_types():
            if topic not in self._wanted:
                continue
            self._wanted.discard(topic)
            package, _, kind = kinds[0].partition("/msg/")
            if len(kinds) > 1 or package not in READ_PACKAGES:
                self._say(f"{topic} cannot be heard: its type is {' and '.join(kinds)}")
                continue
            message_class = getattr(_imported(f"{package}.msg"), kind)
            self.node.create_subscription(message_class, topic, partial(self._hear, topic), self._quality)
            self._say(f"hears {topic} ({kinds[0]})")

    def _hear(self, topic: str, message: Any) -> None:
        """Take a message, and remember its stamp as it is: a double has Unix time to 2e-7 s only."""
        if (time := stamp(message)) > 0.0:
            self._stamps[time] = message.header.stamp
        if len(self._stamps) > 2 * QUEUE:
            del self._stamps[next(iter(self._stamps))]
        self.estimator.message(topic, message)

    def _publish(self, sample: OnlineSample) -> None:
        """Publish an estimate, and which point is in contact, as far as somebody listens."""
        if self._heard is not None:
            self._heard(sample)
        at = self._stamps.get(sample.end)
        if at is None:
            at = self.node.get_clock().now().to_msg()
            at.sec, at.nanosec = divmod(round(sample.end * 1e9), 10**9)
        force, deviation = sample.components, sample.deviation
        points: dict[str, list[str]] = {}
        for label in force:
            points.setdefault(label.rpartition(".")[0], []).append(label)
        for point, labels in points.items():
            for what, values in (("force", force), ("deviation", deviation)):
                publisher = self._publisher(self._wrench, sample.observer, point, what)
                if values and publisher.get_subscription_count():
                    message = self._wrench()
                    message.header.stamp, message.header.frame_id = at, "world"
                    for label in labels:
                        part = message.wrench.force if label[-2] == "F" else message.wrench.torque
                        setattr(part, label[-1], values[label])
                    publisher.publish(message)
        if self.estimator.walks and all(f"{point}.Fz" in force for point in points):
            self._publish_contacts(sample, list(points), at)

    def _publish_contacts(self, sample: OnlineSample, points: list[str], at: Any) -> None:
        """Publish which of the points are in contact."""
        force, deviation = sample.components, sample.deviation
        publisher = self._publisher(self._contact, sample.observer, "contacts")
        watch = self._watches.setdefault(sample.observer, ContactWatch(self.estimator.robot.weight))
        up = np.array([force[f"{point}.Fz"] for point in points])
        on = watch.take(up)
        if publisher.get_subscription_count():
            message = self._contact()
            message.header.stamp, message.header.frame_id, message.name = at, "world", points
            message.position = on.astype(float).tolist()
            if deviation:
                sigma = np.array([deviation[f"{point}.Fz"] for point in points])
                message.effort = contact_probability(up, sigma, watch.weight).tolist()
            publisher.publish(message)

    def _publisher(self, kind: Any, *parts: str) -> Any:
        topic = "/".join(["", self._name, *(OTHER_SIGNS.sub("_", part) for part in parts)])
        if topic not in self._publishers:
            self._publishers[topic] = self.node.create_publisher(kind, topic, QUEUE)
        return self._publishers[topic]

    def _diagnose(self) -> None:
        """Publish the health of the stream."""
        health, kind = self.estimator.health, self._diagnostic.DiagnosticStatus
        fates = {fate for tally in health.samples.values() for fate in tally}
        values = {"estimates": health.estimates, "starts": health.starts, "skipped": health.skipped}
        values |= {"failed": health.failed} | {fate: health.count(fate) for fate in sorted(fates)}
        idle, self._estimates = health.estimates == self._estimates, health.estimates
        troubles = {  # the first counts
            "; ".join(health.obstacles): health.obstacles,
            f"no samples of {', '.join(health.stalled)}": health.stalled,
            f"{', '.join(health.stuck)}: the same value again and again": health.stuck,
            f"nobody publishes {', '.join(sorted(self._wanted))}": self._wanted,
            "the observers have just started": not health.settled,
        }
        trouble = next((words for words, applies in troubles.items() if applies), None)
        level = kind.STALE if idle else kind.WARN if trouble else kind.OK
        words = trouble or ("no estimates in the last second" if idle else "estimates")
        pairs = [self._diagnostic.KeyValue(key=key, value=str(value)) for key, value in values.items()]
        status = kind(level=level, name=f"{self._name}: stream", message=words, values=pairs)
        belief = kind(level=kind.WARN if health.doubts else kind.OK, name=f"{self._name}: belief")
        belief.message = health.doubts[0] if health.doubts else "fits" if health.k > 0.0 else "cannot be judged"
        if health.doubts and not self._doubted:
            self._say(health.doubts[0])
        self._doubted = bool(health.doubts)
        belief.values = [self._diagnostic.KeyValue(key="k", value=f"{health.k:.3g}")]
        message = self._diagnostic.DiagnosticArray(status=[status, belief])
        message.header.stamp = self.node.get_clock().now().to_msg()
        self._diagnostics.publish(message)


def _imported(module: str) -> Any:
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise ExtraError(
            f"node: {module} cannot be imported ({error}): ROS 2's own installation, sourced, or "
            "`pip install 'aerobat-pinocchio[ros2]'` (Linux, Python 3.11 to 3.13) was expected"
        ) from error
