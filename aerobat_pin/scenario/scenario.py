"""A scenario: the robot, its flight, the forces on it and the observers that estimate them. Every value is checked.

Units are SI, except that keys ending in `_deg` are in degrees, which are easier to type. How large a flight would be is
estimated before it begins, and one that is too large is refused.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from pydantic import Field, ValidationError, model_validator

from aerobat_description import MORPHOLOGIES
from aerobat_description.reading import merge
from aerobat_pin.errors import ScenarioError
from aerobat_pin.numerics import guarded
from aerobat_pin.scenario.air_tables import AirSection
from aerobat_pin.scenario.feedback_tables import ControlSection, SensorsSection, ThrustersSection
from aerobat_pin.scenario.messages import explain, validated
from aerobat_pin.scenario.tables import (
    BelievedSection,
    CrankSection,
    FlightSection,
    HoldSection,
    ObserverSection,
    PlantSection,
    RobotSection,
    Section,
    SimulationSection,
)
from aerobat_pin.scenario.toml import read_toml, shipped_names, with_settings
from aerobat_pin.scenario.unknown_forces import RecordedForce, UnknownForceSection

SECONDS_PER_STEP = 1.0e-4  # measured: 30 to 200 us for 16 to 200 strips, half of it more for two observers
BYTES_PER_STEP, BYTES_PER_STRIP = 980, 72  # of a step of the log; measured with 4, 16 and 60 strips
MOST_SECONDS, LARGEST_LOG = 3600.0, 2.0e9  # of one flight; the simulation takes twice the memory of its log
SHIPPED_SCENARIOS = Path(__file__).with_name("shipped")
MOST_WARM_UP = 60.0  # [s]
IN_STEP = 1e-6  # share by which a control.rate may miss a whole number of steps
SCENARIO_NAME_LENGTH = 200  # characters


@dataclass(frozen=True)
class FlightSize:
    """What a flight would take: steps (warm-up included), bytes of its log, and seconds on one processor."""

    steps: float
    log_bytes: float
    seconds: float

    def __str__(self) -> str:
        return f"{self.steps:.3g} steps, a log of {self.log_bytes / 1e9:.3g} GB and about {self.seconds:.3g} s"


class Scenario(Section):
    """One experiment: the content of a scenario file."""

    name: str = Field(
        min_length=1,
        max_length=SCENARIO_NAME_LENGTH,
        pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$",
        description="also the default output folder",
    )
    description: str = Field("", description="what happens, in a line")
    robot: RobotSection = RobotSection()
    flight: FlightSection = FlightSection()
    crank: CrankSection = CrankSection()
    air: AirSection = AirSection()
    hold: HoldSection | None = None
    thrusters: ThrustersSection = ThrustersSection()
    control: ControlSection | None = None
    unknown_force: tuple[UnknownForceSection, ...] = ()
    sensors: SensorsSection = SensorsSection()
    simulation: SimulationSection = SimulationSection()
    observers: ObserverSection = ObserverSection()
    believed: BelievedSection = BelievedSection()
    plant: PlantSection = PlantSection()

    def __repr__(self) -> str:
        frames = ", ".join(dict.fromkeys(force.frame for force in self.unknown_force)) or "no frame"
        return (
            f"Scenario {self.name}\n"
            f"  robot {self.robot.morphology}; {self.simulation.duration:g} s in steps of {self.simulation.dt:g} s, "
            f"seed {self.simulation.seed}; unknown forces at {frames}; observers {', '.join(self.observers.names)}"
        )

    @property
    def flown_air(self) -> AirSection:
        """The air that the robot flies in: the table `air` with the density of `plant`."""
        factor = self.plant.air_density
        return self.air if factor == 1.0 else self.air.model_copy(update={"density": factor * self.air.density})

    @property
    def believed_robot(self) -> RobotSection:
        """The robot that the observers assume: the table `robot` with the values of `believed.robot` laid over it."""
        return _laid_over(self.robot, self.believed.robot)

    @property
    def believed_air(self) -> AirSection:
        """The air that the observers assume: the table `air` with the values of `believed.air` laid over it."""
        return _laid_over(self.air, self.believed.air)

    @property
    def believed_thrusters(self) -> ThrustersSection:
        """The thrusters that the controller assumes: `thrusters` with the values of `believed.thrusters` over it."""
        return _laid_over(self.thrusters.model_copy(update={"fault": None}), self.believed.thrusters)

    @property
    def believed_sensors(self) -> SensorsSection:
        """The sensors that the controller assumes: `sensors` with the values of `believed.sensors` over it."""
        return _laid_over(self.sensors, self.believed.sensors)

    @property
    def files(self) -> list[str]:
        """The files that a flight reads: of morphologies that are not shipped, and of recorded forces."""
        robots = [self.robot.morphology, self.believed_robot.morphology]
        forces = [force.file for force in self.unknown_force if isinstance(force, RecordedForce)]
        return [name for name in robots if name not in MORPHOLOGIES] + forces

    @property
    def size(self) -> FlightSize:
        """What the flight would take, estimated from constants that were measured."""
        times, frequency = self.simulation, self.crank.frequency
        flown = times.duration / times.dt
        warm_up = self.air.warm_up_cycles / frequency / times.dt if frequency > 0.0 else 0.0
        log_bytes = flown * (BYTES_PER_STEP + BYTES_PER_STRIP * self.air.strips) + self._tick_bytes
        return FlightSize(flown + warm_up, log_bytes, SECONDS_PER_STEP * (flown + warm_up))

    @property
    def _tick_bytes(self) -> float:
        """Memory [bytes] of the noise of all unknown forces."""
        return 8.0 * sum(self.simulation.duration / force.tick for force in self.unknown_force)

    def check_size(self) -> None:
        """Raise ScenarioError if the flight is too large; a copy with other values has not been checked yet."""
        size, times = self.size, self.simulation
        if size.log_bytes <= LARGEST_LOG and size.seconds <= MOST_SECONDS:
            return
        limit = f"at most {LARGEST_LOG / 1e9:g} GB and {MOST_SECONDS:g} s are allowed"
        advice = "a shorter simulation.duration or a longer simulation.dt was expected"
        if self._tick_bytes > 0.5 * size.log_bytes:
            advice = "a longer unknown_force.*.tick was expected"
        what = f"simulation.duration = {times.duration:g} s in steps of simulation.dt = {times.dt:g} s"
        raise ScenarioError(f"{what}: {size}; {limit}: {advice}")

    @model_validator(mode="after")
    def _believable(self) -> Scenario:
        for name in ("robot", "air", "thrusters", "sensors"):
            try:
                getattr(self, f"believed_{name}")
            except ValidationError as error:
                lines = [explain({**item, "loc": (name, *item["loc"])}, Scenario) for item in error.errors()]
                raise ValueError("; ".join(f"believed: {line}" for line in lines)) from error
        return self

    @model_validator(mode="after")
    def _short_warm_up(self) -> Scenario:
        cycles, frequency = self.air.warm_up_cycles, self.crank.frequency
        if frequency > 0.0 and cycles / frequency > MOST_WARM_UP:
            raise ValueError(
                f"air.warm_up_cycles = {cycles} at crank.frequency = {frequency} Hz take {cycles / frequency:.0f} s "
                f"to fly; at most {MOST_WARM_UP:.0f} s are allowed"
            )
        return self

    @model_validator(mode="after")
    def _small_enough(self) -> Scenario:
        self.check_size()
        return self

    @model_validator(mode="after")
    def _sensors_within_the_log(self) -> Scenario:
        for name, sensor in self.sensors.sampled.items():
            fastest = 1.0 / self.simulation.dt
            if sensor.rate is not None and sensor.rate > fastest * (1.0 + 1e-9):
                raise ValueError(
                    f"sensors.{name}.rate = {sensor.rate:g} Hz: the log has {fastest:g} samples a second; a smaller "
                    "simulation.dt, or no rate, were expected"
                )
        return self

    @model_validator(mode="after")
    def _law_in_step(self) -> Scenario:
        if self.control is None or self.control.rate is None:
            return self
        rate, fastest = self.control.rate, 1.0 / self.simulation.dt
        slower = max(1, round(fastest / rate))
        if abs(fastest / rate - slower) > IN_STEP * slower:
            raise ValueError(
                f"control.rate = {rate:g} Hz: the law has its turn at samples, {fastest:g} a second (1/simulation.dt); "
                f"that rate, or it divided by a whole number, was expected, such as {fastest / slower:.9g} Hz"
            )
        return self

    @model_validator(mode="after")
    def _loop_can_fly(self) -> Scenario:
        if self.control is not None and self.sensors.raw:
            raise ValueError(
                "control with sensors.motion_capture: a controller sees position, attitude, velocity and rates, which "
                "a raw log has not; one of the two alone was expected"
            )
        if self.control is not None and self.flight.gravity == 0.0:
            raise ValueError(
                "flight.gravity = 0 with control: to move sideways, a controller banks the thrust that carries the "
                "weight; some gravity was expected"
            )
        return self


Table = TypeVar("Table", bound=Section)


def _laid_over(section: Table, values: Mapping[str, Any]) -> Table:
    return type(section).model_validate(merge(section.model_dump(exclude_none=True), values)) if values else section


def shipped_scenarios() -> dict[str, str]:
    """Return the shipped scenarios: name -> description."""
    return {name: load_scenario(name).description for name in shipped_names(SHIPPED_SCENARIOS)}


@guarded()
def load_scenario(source: str | Path, settings: Iterable[str] = ()) -> Scenario:
    """Read a scenario and apply settings.

    A copy of a shipped scenario takes the name of its file, so that its results are not taken for the shipped one's;
    `scenario.toml`, as a run writes it, keeps its name.

    Args:
        source: name of a shipped scenario, or path of a TOML file.
        settings: `dotted.key=value` texts; the value is TOML, or a string without quotes.

    Raises:
        ScenarioError: the scenario is not found or is not TOML, or a value breaks its rule; the message then names
            key, value and rule.
    """
    values = read_toml("scenario", str(source), SHIPPED_SCENARIOS, ScenarioError)
    if os.path.isfile(source):
        _find_beside(Path(source).parent, values)
    scenario = parse_scenario(with_settings(values, settings), str(source))
    return _named_by_file(scenario, Path(source).stem) if os.path.isfile(source) else scenario


def name_for(stem: str) -> str:
    """Return what a scenario can be called that belongs to a file of this name; empty where no letter is left."""
    return re.sub(r"[^\w.-]+", "_", stem, flags=re.ASCII).lstrip("_.-")[:SCENARIO_NAME_LENGTH]


def _named_by_file(scenario: Scenario, stem: str) -> Scenario:
    name = name_for(stem)
    if scenario.name not in shipped_names(SHIPPED_SCENARIOS) or name in ("", scenario.name, "scenario"):
        return scenario
    shipped = read_toml("scenario", scenario.name, SHIPPED_SCENARIOS, ScenarioError)["description"]
    description = f"made from {scenario.name}" if scenario.description == shipped else scenario.description
    return scenario.model_copy(update={"name": name, "description": description})


@guarded()
def scenario_of_run(folder: Path, settings: Iterable[str] = ()) -> Scenario:
    """Read the scenario in the folder of a run, and apply settings.

    Raises:
        ScenarioError: as `load_scenario`, or it names a file outside the folder; a run has copies of all that it needs.
    """
    source = str(folder / "scenario.toml")
    stored = load_scenario(source)
    for name in stored.files:
        if not Path(name).is_relative_to(os.path.realpath(folder)):
            raise ScenarioError(f"scenario {source}: names {name}, outside the folder of its run; a copy was expected")
    return load_scenario(source, settings)


def _find_beside(folder: Path, values: Mapping[str, Any]) -> None:
    """Make the paths of morphologies and recorded forces absolute; relative ones start at the scenario's folder."""
    believed, forces = values.get("believed"), values.get("unknown_force")
    robots = values.get("robot"), believed.get("robot") if isinstance(believed, dict) else None
    named: list[tuple[Any, str]] = [(robot, "morphology") for robot in robots]
    named += [(force, "file") for force in forces] if isinstance(forces, list) else []
    for table, key in named:
        if isinstance(table, dict) and isinstance(table.get(key), str) and table[key] not in MORPHOLOGIES:
            table[key] = os.path.realpath(folder / table[key])


@guarded()
def parse_scenario(values: Mapping[str, Any], source: str) -> Scenario:
    """Build a scenario from nested plain values. Raises ScenarioError, which names every broken rule."""
    return validated(Scenario, values, f"scenario {source}", ScenarioError)
