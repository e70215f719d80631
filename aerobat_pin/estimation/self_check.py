"""A known force on a simulated robot: does the estimate have the right sign, frame and unit?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aerobat_pin.errors import ScenarioError
from aerobat_pin.estimation.estimate import estimate_log
from aerobat_pin.flight import simulate
from aerobat_pin.robot import Aerobat
from aerobat_pin.scenario import Scenario, parse_scenario

SHARE = 0.1  # of the weight, applied as force
FORCE_TOLERANCE = 0.02  # of the force, on every component
SHORTEST_FLIGHT = 0.06  # [s]: a flight
RISES = 20.0  # [1/K]: shortest flight for slow observers, whose estimates settle within half of it
SETTLED_AFTER = 0.5  # share of the flight after which the mean is taken


@dataclass(frozen=True)
class Check:
    """One force applied at a frame along a world axis [N], and what an observer found there (3,) and elsewhere [N]."""

    observer: str
    frame: str
    axis: str
    applied: float
    found: tuple[float, float, float]
    elsewhere: float

    @property
    def ok(self) -> bool:
        """Whether the force was found where it acts, along its axis, and nowhere else."""
        expected = np.array([self.applied * (axis == self.axis) for axis in "xyz"])
        worst = max(float(np.max(np.abs(np.array(self.found) - expected))), self.elsewhere)
        return worst <= FORCE_TOLERANCE * self.applied

    def __str__(self) -> str:
        """Return a line about it."""
        found = ", ".join(f"{force:+.4f}" for force in self.found)
        mark = "ok " if self.ok else "BAD"
        where = f"{self.frame} along world {self.axis}"
        result = f"found ({found}), elsewhere {self.elsewhere:.4f}"
        return f"{mark}  {self.observer}: {self.applied:+.4f} N at {where}: {result}"


def self_check(robot: Aerobat, belief: Scenario) -> list[Check]:
    """Push on a simulated robot with a tenth of its weight, at every frame of the observers and along every world axis.

    Args:
        robot: the believed robot.
        belief: scenario whose robot, air, gravity and observers are checked; all joint torques are taken as known.

    Raises:
        ScenarioError: the robot weighs nothing.
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
