"""A gymnasium environment: six thrusters fly the robot, with the physics and sensors of a scenario.

A step is one interval of the scenario's log, 10 ms by default: the command passes delay and lag of the thrusters, and
the plant flies on, in as many integration steps as its air needs. Needs `pip install aerobat-pinocchio[gym]`.

| action | range | |
|---|---|---|
| 0 to 5 | -1 .. 1 | commands of thrusters 1 to 6: -1 is off, 1 is the full thrust |

| observation | unit | as the sensors show it |
|---|---|---|
| 0 to 2 | m | position less the course's: world x, y, z |
| 3 to 5 | rad | twice the vector part of the quaternion from the course's attitude to the body's, its axes |
| 6 to 8 | m/s | velocity over ground less the course's, world axes |
| 9 to 11 | rad/s | body rate, body axes |
| 12, 13 | - | sine and cosine of the crank angle |
| 14 to 19 | - | modelled thrusts as shares of the full ones |

The course is the scenario's start, flown on with its velocity and heading, at the pitch of the table `control`. The
reward is 1 less what the course is missed by, `MISS` times (errors of position, attitude, velocity and rate)^2; an
episode is terminated where the robot is LOST (`monitor`), that is farther than `FARTHEST_OFF` from its course or tilted
by more than `TILTED`; `info["state"]` says so then. It is truncated after the scenario's duration. `reset(seed=...)`
seeds all noise, of forces and sensors, and what is drawn: with `draw`, each episode flies another start, wind or robot,

    {"flight.roll_deg": (-10, 10), "air.wind": ((-1, -1, 0), (1, 1, 0)), "air.turbulence.seed": (1, 1000)}

each a key of the scenario with its lowest and largest value; whole numbers where both are. The course stays.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, TypeAlias

import gymnasium
import numpy as np
import pinocchio as pin
from gymnasium import spaces

from aerobat_pin.aerobat import believed_robot, flown_robot
from aerobat_pin.control.allocation import Allocation
from aerobat_pin.control.monitor import FARTHEST_OFF, TILTED
from aerobat_pin.control.nominal_wrench import control_of, nominal_flight
from aerobat_pin.errors import ScenarioError, SimulationError
from aerobat_pin.flight import LaggedThrust, Plant, Sensing, interval_means, thrusters_of
from aerobat_pin.numerics import Array, checked, shown
from aerobat_pin.scenario import Scenario, assign, load_scenario, parse_scenario

MISS = (4.0, 1.0, 0.1, 0.01)  # [1/m2, 1/rad2, s2/m2, s2/rad2]: of position, attitude, velocity, rate
SIZE = 20
LowestLargest: TypeAlias = "tuple[float | tuple[float, ...], float | tuple[float, ...]]"  # lowest, largest
Draw: TypeAlias = Mapping[str, LowestLargest]


class AerobatEnv(gymnasium.Env[Array, Array]):  # type: ignore[misc]  # gymnasium is not followed
    """Fly Aerobat by its six thrusters.

    Args:
        scenario: name of a scenario with a table `control`, or path of a TOML file.
        settings: `dotted.key=value` texts, as for `load_scenario`; a `control.rate` of the scenario must fit `dt`.
        dt: time of a step [s].
        draw: keys of the scenario that are drawn anew at each reset, with their lowest and largest values.
        render_mode: nothing is drawn; write a log with `simulate` and replay it.

    Attributes:
        scenario: the scenario that is flown.
        neutral: (6,) action of the nominal flight.

    Raises:
        ScenarioError: the scenario is not found, or has no table `control`.
    """

    metadata: dict[str, Any] = {"render_modes": [], "render_fps": 100}  # noqa: RUF012

    def __init__(
        self,
        scenario: str = "hover_closed_loop",
        settings: Iterable[str] = (),
        dt: float = 0.01,
        draw: Draw | None = None,
        render_mode: str | None = None,
    ) -> None:
        self.scenario = load_scenario(scenario, [f"simulation.dt={dt}", *settings])
        control_of(self.scenario)
        self.render_mode, self._draw = render_mode, dict(draw or {})
        self._robot = flown_robot(self.scenario)
        self._plant = Plant(self._robot, self.scenario)
        self._thrusters = thrusters_of(self._robot.morphology)
        nominal = nominal_flight(self.scenario, believed_robot(self.scenario))
        self._trim = Allocation(self._thrusters, self.scenario.believed_thrusters.factor).thrusts(nominal.wrench)
        self._course = pin.Quaternion(nominal.quaternion)
        self.neutral: Array = 2.0 * self._trim / self._thrusters.limit - 1.0
        self.action_space = spaces.Box(-1.0, 1.0, (len(self._thrusters.limit),), np.float64)
        self.observation_space = spaces.Box(-np.inf, np.inf, (SIZE,), np.float64)
        self._done = -1

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """Start an episode; `options` may have a `draw` that takes the place of the environment's in this episode.

        Without a seed, noise and draws follow from those of the episodes before. Raises ScenarioError for a key or a
        value that the scenario cannot have.
        """
        super().reset(seed=seed)
        noise = int(self.np_random.integers(2**31))
        scenario = self._drawn({} if options is None else options)
        plant, dt = self._plant, scenario.simulation.dt
        self._edges = np.arange(scenario.simulation.count + 1) * dt
        plant.start(interval_means(plant.forces, self._edges, noise))
        self._sensing = Sensing(plant.robot, scenario.sensors, self._edges, noise)
        self._thrust = LaggedThrust(self._thrusters, scenario.thrusters, dt, self._trim)
        self._done = 0
        self._seen = self._observation()
        return self._seen

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Fly one interval with commanded thrusts; actions beyond -1 .. 1 are clipped, NaN is a ShapeError."""
        action = checked(action, len(self._trim), "action")
        if not 0 <= self._done < len(self._edges) - 1:
            raise SimulationError("the episode is over or has not begun: reset() must come before step()", 0.0)
        command = 0.5 * (np.clip(action, -1.0, 1.0) + 1.0) * self._thrusters.limit
        diverged = False
        self._done += 1
        try:
            self._plant.step(self._thrust.advance(command))
            self._seen = self._observation()
        except SimulationError:  # nothing is a number any more: what was seen before stays
            diverged = True
        seen, info = self._seen
        miss = [float(part @ part) for part in seen[:12].reshape(4, 3)]
        reward = 1.0 - sum(weight * part for weight, part in zip(MISS, miss, strict=True))
        x, y = info["q"][3:5]
        lost = diverged or miss[0] > FARTHEST_OFF**2 or 1.0 - 2.0 * (x * x + y * y) < np.cos(np.radians(TILTED))
        info = {**info, "state": "LOST" if lost else "OK"}
        truncated = self._done == len(self._edges) - 1
        return seen, -100.0 if diverged else float(max(reward, -100.0)), lost, truncated and not lost, info

    def _drawn(self, options: dict[str, Any]) -> Scenario:
        """Draw a scenario, and build its plant if it is another than that of the episode before."""
        wrong = sorted(set(options) - {"draw"})
        if wrong:
            raise ScenarioError(f"reset options {', '.join(wrong)}: draw was expected")
        values = self.scenario.model_dump(exclude_none=True)
        for key, limits in options.get("draw", self._draw).items():
            try:
                low, high = (np.asarray(limit) for limit in limits)
                whole = low.dtype.kind == high.dtype.kind == "i"
                drawn = self.np_random.integers(low, high + 1) if whole else self.np_random.uniform(low, high)
            except (TypeError, ValueError, OverflowError) as error:
                raise ScenarioError(f"draw: {key} = {shown(limits)}: lowest and largest value were expected") from error
            assign(values, key, drawn.tolist() if whole or low.ndim else float(drawn), f"draw: {key}")
        scenario, flown = parse_scenario(values, "draw"), self._plant.scenario
        if scenario != flown:
            if (scenario.robot, scenario.flight.gravity) != (flown.robot, flown.flight.gravity):
                self._robot = flown_robot(scenario)
            self._plant = Plant(self._robot, scenario)
        return scenario

    def _observation(self) -> tuple[Array, dict[str, Any]]:
        """Return what the sensors show, and in `info` the time [s] and q, v and crank angle that they make."""
        k, flight = self._done, self.scenario.flight
        time = float(self._edges[k])
        q, v, crank = self._plant.as_measured()
        q, v = self._sensing.read(k, q, v)
        crank = self._sensing.crank(k, crank)
        attitude = pin.Quaternion(q[3:7])
        error = (self._course.conjugate() * attitude).coeffs()
        seen = np.concatenate(
            [
                q[:3] - flight.position - time * np.array(flight.velocity),
                (2.0 if error[3] >= 0.0 else -2.0) * error[:3],
                attitude.matrix() @ v[:3] - flight.velocity,
                v[3:6],
                [np.sin(crank), np.cos(crank)],
                self._thrust.thrust / self._thrusters.limit,
            ]
        )
        return seen, {"time": time, "q": q, "v": v, "crank_angle": crank}
