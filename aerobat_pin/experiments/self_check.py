"""Check sign, frame and unit of the estimates: apply known forces to a simulated robot and estimate them."""

from __future__ import annotations

import numpy as np

from aerobat_pin.aerobat import Aerobat, estimate_flight
from aerobat_pin.errors import ScenarioError
from aerobat_pin.estimation import PUSHED_SHARE, Check
from aerobat_pin.flight import simulate
from aerobat_pin.numerics import guarded
from aerobat_pin.scenario import Scenario, parse_scenario

SHORTEST_FLIGHT = 0.06  # [s]: shortest simulated flight
RISES = 20.0  # [1/K]: shortest flight for slow observers, whose estimates settle within half of this time
SETTLED_AFTER = 0.5  # share of the flight after which the estimates are averaged


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
