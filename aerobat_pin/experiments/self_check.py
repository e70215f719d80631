"""Check sign, frame and unit of the estimates: apply known forces to a simulated robot and estimate them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aerobat_pin.aerobat import estimate_log
from aerobat_pin.errors import ScenarioError
from aerobat_pin.flight import simulate
from aerobat_pin.numerics import guarded
from aerobat_pin.robot import Aerobat
from aerobat_pin.scenario import Scenario, parse_scenario

SHARE = 0.1  # applied force divided by the weight
FORCE_TOLERANCE = 0.02  # allowed error of every component, divided by the applied force
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
    """

    observer: str
    frame: str
    axis: str
    applied: float
    found: tuple[float, float, float]
    elsewhere: float

    @property
    def ok(self) -> bool:
        """Whether the estimate shows the force at its frame, along its axis, and no force elsewhere."""
        expected = np.array([self.applied * (axis == self.axis) for axis in "xyz"])
        worst = max(float(np.max(np.abs(np.array(self.found) - expected))), self.elsewhere)
        return worst <= FORCE_TOLERANCE * self.applied

    def __str__(self) -> str:
        """Return the result as one line of text."""
        found = ", ".join(f"{force:+.4f}" for force in self.found)
        mark = "ok " if self.ok else "BAD"
        where = f"{self.frame} along world {self.axis}"
        result = f"found ({found}), elsewhere {self.elsewhere:.4f}"
        return f"{mark}  {self.observer}: {self.applied:+.4f} N at {where}: {result}"


@guarded()
def self_check(robot: Aerobat, belief: Scenario) -> list[Check]:
    """Apply a tenth of the weight to a simulated robot, at each frame of the observers and along each world axis.

    Args:
        robot: the assumed robot.
        belief: scenario whose robot, air, gravity and observers are checked; all joint torques are taken as known.

    Raises:
        ScenarioError: gravity is 0.
    """
    size = SHARE * robot.mass * belief.flight.gravity
    if size == 0.0:
        raise ScenarioError("flight.gravity = 0: the self-check pushes with a share of the weight; some was expected")
    duration = round(max(SHORTEST_FLIGHT, RISES / belief.observers.gain), 3)
    checks = []
    for frame in belief.observers.frames:
        for i, axis in enumerate("xyz"):
            force = {
                "frame": frame,
                "axes": "world",
                "direction": [float(i == k) for k in range(3)],
                "signal": "step",
                "height": size,
                "start": 0.0,
            }
            values = belief.model_dump(exclude_none=True)
            values["unknown_force"], values["simulation"] = [force], {"duration": duration}
            values["observers"] = {**values["observers"], "torque": "measured"}
            scenario = parse_scenario(values, "self-check")
            log = simulate(scenario)
            for name, estimate in estimate_log(log, robot, scenario)[1].items():
                settled = np.mean(estimate.force[int(SETTLED_AFTER * len(estimate.force)) :], axis=0)
                at = belief.observers.frames.index(frame)
                others = np.delete(settled, at, axis=0)
                x, y, z = (float(value) for value in settled[at])
                checks.append(
                    Check(name, frame, axis, size, (x, y, z), float(np.max(np.abs(others))) if others.size else 0.0)
                )
    return checks
