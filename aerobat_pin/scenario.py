"""A scenario: what happens to which robot, and who estimates it. TOML in, TOML out, every value checked.

Units are SI; keys ending in `_deg` are degrees, because a person types them.
"""

from __future__ import annotations

import difflib
import json
import tomllib
from collections.abc import Iterable, Mapping
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from aerobat_description import MORPHOLOGIES
from aerobat_pin.errors import ScenarioError

Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Whole = Annotated[int, Field(strict=True)]
Positive = Annotated[Number, Field(gt=0.0)]
NonNegative = Annotated[Number, Field(ge=0.0)]
Triple = tuple[Number, Number, Number]
LONGEST_WARM_UP = 60.0  # [s]
Limits = tuple[Positive, Positive, Positive]


class Section(BaseModel):
    """A table of a scenario file: no unknown keys, no changes after reading."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class RobotSection(Section):
    """Which robot flies."""

    morphology: str = Field("aerobat", description="shipped name or TOML file")
    changes: dict[str, Any] = Field(default_factory=dict, description="nested values laid over the morphology")


class FlightSection(Section):
    """How the flight starts."""

    position: Triple = Field((0.0, 0.0, 0.0), description="body COM in world [m]")
    velocity: Triple = Field((3.0, 0.0, 0.0), description="of the body COM in world axes [m/s]")
    roll_deg: Number = Field(0.0, description="positive: right wing down [deg]")
    pitch_deg: Number = Field(0.0, description="positive: nose up [deg]")
    yaw_deg: Number = Field(0.0, description="positive: nose to the left [deg]")
    angular_velocity: Triple = Field((0.0, 0.0, 0.0), description="of the body in body axes [rad/s]")
    gravity: NonNegative = Field(9.81, description="[m/s2]")


class CrankSection(Section):
    """How the crank turns."""

    frequency: NonNegative = Field(4.75, description="flapping frequency, one turn a flap [Hz]")
    start_deg: Number = Field(-90.0, description="absolute crank angle t1 at the start [deg]")


class AirSection(Section):
    """The air."""

    density: Positive = Field(1.225, description="[kg/m3]")
    strips: Whole = Field(16, ge=2, le=200, description="strips over the full span")
    warm_up_cycles: Whole = Field(6, ge=0, description="flapping cycles flown with the body held before t = 0")


class HoldSection(Section):
    """Ideal attitude hold about the flight's start, a known body wrench; see `aerobat_pin.hold`."""

    attitude_stiffness: tuple[NonNegative, NonNegative, NonNegative] = Field(description="roll, pitch, yaw [N m/rad]")
    attitude_damping: tuple[NonNegative, NonNegative, NonNegative] = Field(description="roll, pitch, yaw [N m s/rad]")
    torque_limit: Limits = Field(description="roll, pitch, yaw [N m]")
    speed_gain: NonNegative = Field(description="world x [N s/m]")
    thrust_limit: Positive = Field(description="world x [N]")
    lift: Number = Field(description="constant, world z [N]")
    height_stiffness: NonNegative = Field(description="world z [N/m]")
    height_damping: NonNegative = Field(description="world z [N s/m]")
    lift_limit: Positive = Field(description="of stiffness and damping together, world z [N]")


class UnknownForceSection(Section):
    """One unknown force: the paper's signal along a direction at a frame."""

    frame: str = Field(description="frame at whose origin it acts")
    direction: Triple = Field((0.0, 0.0, 1.0), description="normalised on reading")
    axes: Literal["link", "body", "world"] = Field("link", description="axes in which the direction is fixed")
    amplitude: Number = Field(0.2, description="factor of sin(elbow angle) [N]")
    noise: NonNegative = Field(0.01, description="standard deviation [N], drawn per force")
    step: Number = Field(0.15, description="height of the step [N]")
    step_start: Number = Field(1.0, description="on for step_start < t <= step_end [s]")
    step_end: Number = Field(1.6, description="[s]")
    tick: Annotated[Number, Field(ge=1.0e-5)] = Field(
        1.0e-3, description="one value of noise and step is held this long [s]"
    )


class SimulationSection(Section):
    """Time and chance."""

    duration: Positive = Field(2.0, description="[s]")
    dt: Annotated[Number, Field(gt=0.0, le=0.02)] = Field(1.0e-3, description="integration and logging step [s]")
    seed: Whole = Field(1, ge=0, description="of all random numbers")

    @property
    def count(self) -> int:
        """Number of steps."""
        return round(self.duration / self.dt)

    @model_validator(mode="after")
    def _whole_steps(self) -> SimulationSection:
        steps = self.duration / self.dt
        if steps < 0.5 or abs(steps - round(steps)) > 1e-6 * steps:
            raise ValueError(f"duration = {self.duration} s is not a whole number of steps of dt = {self.dt} s")
        return self


class ObserverSection(Section):
    """Who estimates the unknown forces."""

    names: tuple[str, ...] = Field(("momentum", "force_level"), description="observers to run")
    gain: Positive = Field(1000.0, description="K [1/s]")
    torque: Literal["measured", "modelled", "motor_only", "none"] = Field(
        "measured",
        description="what is known of the joint torques: all of them; a model without the unknown force; the motor's "
        "torque at the crank alone; nothing",
    )
    frames: tuple[str, ...] = Field(
        ("left_force_point", "right_force_point"), description="frames at which forces are sought"
    )


class Scenario(Section):
    """One experiment."""

    name: str = Field(
        min_length=1, pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$", description="also the default output folder"
    )
    description: str = ""
    robot: RobotSection = RobotSection()
    flight: FlightSection = FlightSection()
    crank: CrankSection = CrankSection()
    air: AirSection = AirSection()
    hold: HoldSection | None = None
    unknown_force: tuple[UnknownForceSection, ...] = ()
    simulation: SimulationSection = SimulationSection()
    observers: ObserverSection = ObserverSection()

    @model_validator(mode="after")
    def _short_warm_up(self) -> Scenario:
        cycles, frequency = self.air.warm_up_cycles, self.crank.frequency
        if frequency > 0.0 and cycles / frequency > LONGEST_WARM_UP:
            raise ValueError(
                f"air.warm_up_cycles = {cycles} at crank.frequency = {frequency} Hz take {cycles / frequency:.0f} s "
                f"to fly; at most {LONGEST_WARM_UP:.0f} s are allowed"
            )
        return self


def shipped_scenarios() -> dict[str, str]:
    """Return the shipped scenarios: name -> description."""
    folder = resources.files("aerobat_pin") / "scenarios"
    names = sorted(item.name.removesuffix(".toml") for item in folder.iterdir() if item.name.endswith(".toml"))
    return {name: load_scenario(name).description for name in names}


def load_scenario(source: str | Path, settings: Iterable[str] = ()) -> Scenario:
    """Read a scenario and apply settings.

    Args:
        source: shipped name, or path of a TOML file.
        settings: `dotted.key=value` texts; the value is TOML, or a bare word.

    Raises:
        ScenarioError: not found, not TOML, or a value that breaks its rule; the message names key, value and rule.
    """
    values = _read(str(source))
    robot = values.get("robot")
    if isinstance(robot, dict) and isinstance(robot.get("morphology"), str) and Path(source).is_file():
        robot["morphology"] = _beside(Path(source), robot["morphology"])
    for setting in settings:
        key, equals, text = setting.partition("=")
        if not equals or not key.strip():
            raise ScenarioError(f"--set {setting}: dotted.key=value was expected")
        _assign(values, key.strip().split("."), _parsed(text.strip()), setting)
    return parse_scenario(values, str(source))


def _beside(scenario: Path, morphology: str) -> str:
    """Find a morphology file from where the scenario lies; shipped names stay as they are."""
    return morphology if morphology in MORPHOLOGIES else str((scenario.parent / morphology).resolve())


def parse_scenario(values: Mapping[str, Any], source: str) -> Scenario:
    """Check plain values. Raises ScenarioError with every broken rule."""
    try:
        return Scenario.model_validate(dict(values))
    except ValidationError as error:
        lines = [_explain(dict(item)) for item in error.errors()]
        raise ScenarioError(f"scenario {source}: " + "; ".join(lines)) from error


def _read(source: str) -> dict[str, Any]:
    shipped = resources.files("aerobat_pin") / "scenarios" / f"{source}.toml"
    path = Path(source)
    if "/" not in source and shipped.is_file():
        text = shipped.read_text(encoding="utf-8")
    elif path.is_file():
        try:
            text = path.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise ScenarioError(f"scenario file {path}: cannot be read: {error}") from error
    else:
        folder = resources.files("aerobat_pin") / "scenarios"
        names = sorted(item.name.removesuffix(".toml") for item in folder.iterdir() if item.name.endswith(".toml"))
        raise ScenarioError(f"no scenario '{source}': shipped are {', '.join(names)}; or give a TOML file")
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ScenarioError(f"scenario {source}: not valid TOML: {error}") from error


def _parsed(text: str) -> Any:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


def _assign(values: dict[str, Any], keys: list[str], value: Any, setting: str) -> None:
    """Set a nested value; a list of tables is reached by its index."""
    here: Any = values
    for depth, key in enumerate(keys):
        last = depth == len(keys) - 1
        if isinstance(here, list):
            if not key.isdigit() or int(key) >= len(here):
                raise ScenarioError(f"--set {setting}: '{key}' is not an index of a list of {len(here)}")
            if last:
                here[int(key)] = value
            else:
                here = here[int(key)]
        elif isinstance(here, dict):
            if last:
                here[key] = value
            else:
                here = here.setdefault(key, {})
        else:
            raise ScenarioError(f"--set {setting}: '{'.'.join(keys[:depth])}' is a value, not a table")


def _explain(error: dict[str, Any]) -> str:
    where = ".".join(str(part) for part in error["loc"])
    if error["type"] == "extra_forbidden":
        known = _known_keys(error["loc"][:-1])
        close = difflib.get_close_matches(str(error["loc"][-1]), known, n=1)
        return f"unknown key '{where}'" + (f"; did you mean '{close[0]}'?" if close else f"; known: {', '.join(known)}")
    if error["type"] == "missing" and isinstance(error["loc"][-1], int):
        return (
            f"{'.'.join(str(part) for part in error['loc'][:-1])} = {list(error['input'])}: more numbers were expected"
        )
    if error["type"] == "missing":
        return f"missing key '{where}'"
    if error["type"] == "value_error":
        return str(error["ctx"]["error"])
    rule = error["msg"].replace("tuple", "list")
    return f"{where} = {error['input']!r}: {rule[:1].lower()}{rule[1:]}"


def _known_keys(loc: tuple[Any, ...]) -> list[str]:
    kind: Any = Scenario
    sections = {section.__name__: section for section in Section.__subclasses__()}
    for part in loc:
        if isinstance(part, str):
            annotation = str(kind.model_fields[part].annotation)
            kind = next((section for name, section in sections.items() if name in annotation), kind)
    return list(kind.model_fields)


def scenario_toml(scenario: Scenario) -> str:
    """Write a resolved scenario, every default included, as TOML that `load_scenario` reads back."""
    values = scenario.model_dump(exclude_none=True)
    return "\n".join(_table_lines(values, ())).strip() + "\n"


def _table_lines(values: Mapping[str, Any], path: tuple[str, ...]) -> list[str]:
    """Write plain values first, then tables, then lists of tables."""
    lines, tables, lists = [], [], []
    for key, value in values.items():
        if isinstance(value, Mapping):
            if value:
                tables += ["", f"[{'.'.join((*path, key))}]", *_table_lines(value, (*path, key))]
        elif isinstance(value, tuple | list) and value and isinstance(value[0], Mapping):
            for item in value:
                lists += ["", f"[[{'.'.join((*path, key))}]]", *_table_lines(item, (*path, key))]
        else:
            lines.append(f"{key} = {_toml_value(value)}")
    return lines + tables + lists


def _toml_value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, tuple | list):
        return "[" + ", ".join(_toml_value(item) for item in value) + "]"
    return repr(value)
