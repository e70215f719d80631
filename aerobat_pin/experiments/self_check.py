"""Play known forces into a simulated robot, or into a record: is each recovered at its point, along its axis, alone?

That checks sign, frame and unit. The motion of a record stays as it was. What the efforts and the ground would have
shown less of while a force f pushed, J^T f, is taken off the known forces; the estimate with f less the estimate
without it must then be f. That tests the points, rows, axes and the gain on this very motion; what no row shows is not
recovered, and says so.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from aerobat_pin.aerobat import Aerobat, estimate_flight
from aerobat_pin.errors import LogError, ScenarioError
from aerobat_pin.estimation import Calibration
from aerobat_pin.flight import simulate
from aerobat_pin.forces import (
    TIME_CONSTANTS_TO_SETTLE,
    KnownInputs,
    fitted_forces,
    ignored_rows,
    inputs_of,
    observers_of,
    rows_of,
)
from aerobat_pin.numerics import Array, guarded
from aerobat_pin.observers import Applications, Observer, moving_weight
from aerobat_pin.records import Record
from aerobat_pin.scenario import Scenario, parse_scenario

PUSHED_SHARE = 0.1  # applied force divided by the weight
FORCE_TOLERANCE = 0.02  # allowed error of every component, divided by the applied force
MOST_CHECKED = 4000  # intervals that are checked: the beginning of the longest part
SHORTEST_FLIGHT = 0.06  # [s]: shortest simulated flight
RISES = 20.0  # [1/K]: shortest flight for slow observers, whose estimates settle within half of this time
SETTLED_AFTER = 0.5  # share of the flight after which the estimates are averaged


@dataclass(frozen=True)
class Check:
    """Result of applying one known force.

    Attributes:
        observer: name of the observer.
        frame: frame at which the force was applied.
        axis: world axis along which the force was applied.
        applied: applied force [N].
        found: estimated force at the frame, world axes [N].
        elsewhere: largest component of the estimated forces at all other frames [N].
        share: of the times, at which it is found: the rest has poses that do not show it.
        whole: whether all rows are believed, so that nothing but the pose can hide it.
    """

    observer: str
    frame: str
    axis: str
    applied: float
    found: tuple[float, float, float]
    elsewhere: float
    share: float = 1.0
    whole: bool = False

    @property
    def ok(self) -> bool:
        """Whether the estimate shows the force at its frame, along its axis, and no force elsewhere."""
        expected = np.array([self.applied * (axis == self.axis) for axis in "xyz"])
        worst = max(float(np.max(np.abs(np.array(self.found) - expected))), self.elsewhere)
        return worst <= FORCE_TOLERANCE * self.applied

    @classmethod
    def of(
        cls,
        observer: str,
        frames: tuple[str, ...],
        at: int,
        axis: str,
        applied: float,
        force: Array,
        share: float = 1,
        *,
        whole: bool = False,
    ) -> Check:
        """Return the result for a force (frames, 3) [N] that was estimated while one was applied at frame `at`."""
        others = np.delete(force, at, axis=0)
        x, y, z = (float(value) for value in force[at])
        elsewhere = float(np.max(np.abs(others))) if others.size else 0.0
        return cls(observer, frames[at], axis, applied, (x, y, z), elsewhere, share, whole)

    def __str__(self) -> str:
        """Return the result as one line of text."""
        estimate = ", ".join(f"{force:+.4f}" for force in self.found)
        mark = "ok " if self.ok else "BAD"
        where = f"{self.frame} along world {self.axis}"
        result = f"found ({estimate}), elsewhere {self.elsewhere:.4f}"
        hidden = "the pose hides it" if self.whole else "the map believes no row that shows it"
        why = f"; at no time: {hidden}" if self.share == 0.0 else ""
        why = f"; right at {self.share:.0%} of the times: else the pose hides it" if 0.0 < self.share < 1.0 else why
        return f"{mark}  {self.observer}: {self.applied:+.4f} N at {where}: {result}{why}"


@guarded()
def self_check(robot: Aerobat, belief: Scenario) -> list[Check]:
    """Apply a tenth of the weight to a simulated robot, at each frame of the observers and along each world axis.

    Args:
        robot: the assumed robot.
        belief: scenario whose robot, air, gravity and observers are checked; all joint torques are taken as known.

    Raises:
        ScenarioError: gravity is 0.
    """
    size = PUSHED_SHARE * robot.mass * belief.flight.gravity
    if size == 0.0:
        raise ScenarioError("flight.gravity = 0: the self-check pushes with a share of the weight; some was expected")
    duration = round(max(SHORTEST_FLIGHT, RISES / belief.observers.gain), 3)
    checks = []
    for frame in belief.observers.frames:
        for i, axis in enumerate("xyz"):
            step = {"signal": "step", "height": size, "start": 0.0}
            force = {**step, "frame": frame, "axes": "world", "direction": [float(i == k) for k in range(3)]}
            values = belief.model_dump(exclude_none=True)
            values["unknown_force"], values["simulation"] = [force], {"duration": duration}
            values["observers"] = {**values["observers"], "torque": "measured"}
            scenario = parse_scenario(values, "self-check")
            log = simulate(scenario)
            for name, estimate in estimate_flight(log, robot, scenario).estimates.items():
                settled = np.mean(estimate.force[int(SETTLED_AFTER * len(estimate.force)) :], axis=0)
                at = belief.observers.frames.index(frame)
                checks.append(Check.of(name, tuple(belief.observers.frames), at, axis, size, settled))
    return checks


@guarded()
def check_record(record: Record, calibration: Calibration | None = None) -> list[Check]:
    """Play a tenth of the weight into a record, at each of its points and along each world axis.

    Args:
        record: the record; its map names points and observers.
        calibration: what other records showed; its values are used in place of the map's fits.

    Raises:
        CalibrationError: the calibration belongs to another robot, or to a map that means something else.
        LogError: the map names no point of a force, or no part is long enough for the observers to settle.
    """
    frames = record.map.robot.points
    first, last = max(record.parts, key=lambda part: part[1] - part[0])
    last = min(last, first + MOST_CHECKED)
    wait = int(np.ceil(TIME_CONSTANTS_TO_SETTLE / float(record.map.observer.gain) * record.rate))
    if not frames or last - first <= 2 * wait:
        raise LogError(
            f"self-check: {len(frames)} points and {last - first} intervals: a point, and more than {2 * wait} "
            "intervals in one part, were expected"
        )
    rows, _ = rows_of(record.map, record.robot, record.joints, record.channels)
    forces = fitted_forces(record) if calibration is None else calibration.forces(calibration.applied(record))
    record = forces.record  # whose robot carries what was found
    inputs = inputs_of(record, first, last, forces, rows)
    size = PUSHED_SHARE * moving_weight(record.robot.model)
    return [check for observer in observers_of(record)[0] for check in _played(observer, record, inputs, size, wait)]


def _played(observer: Observer, record: Record, inputs: KnownInputs, size: float, wait: int) -> Iterator[Check]:
    """Yield the results of an observer, whose estimates count after `wait` intervals."""
    frames, known = record.map.robot.points, dict(inputs.known)
    whole = not ignored_rows(record)
    before = observer.run(inputs.time, inputs.q, inputs.v, inputs.tau, known)
    columns = [before.identifiability.components.index(f"{frame}.F{axis}") for frame in frames for axis in "xyz"]
    J = Applications(record.robot.model, frames).jacobian(inputs.q[:-1])
    for at in range(len(frames)):
        for k, axis in enumerate("xyz"):
            pushed = {**known, "self-check": -size * J[:, 3 * at + k]}
            after = observer.run(inputs.time, inputs.q, inputs.v, inputs.tau, pushed)
            change = (after.components - before.components)[wait:, columns]
            wrong = np.max(np.abs(change - size * np.eye(len(columns))[3 * at + k]), axis=1)
            share = float(np.mean(wrong <= FORCE_TOLERANCE * size))
            force = np.mean(change, axis=0).reshape(-1, 3)
            yield Check.of(observer.name, frames, at, axis, size, force, share, whole=whole)
