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
from typing import Any, TypeVar, get_args

from pydantic import Field, ValidationError, model_validator

from aerobat_description import MORPHOLOGIES
from aerobat_description.reading import merge
from aerobat_pin.errors import ScenarioError
from aerobat_pin.sections import (
    AirSection,
    BelievedSection,
    CrankSection,
    FlightSection,
    HoldSection,
    ObserverSection,
    RobotSection,
    Section,
    SensorsSection,
    SimulationSection,
)
from aerobat_pin.signals import UnknownForceSection

LONGEST_WARM_UP = 60.0  # [s]


class Scenario(Section):
    """One experiment."""

    name: str = Field(
        min_length=1, pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$", description="also the default output folder"
    )
    description: str = Field("", description="what happens, in a line")
    robot: RobotSection = RobotSection()
    flight: FlightSection = FlightSection()
    crank: CrankSection = CrankSection()
    air: AirSection = AirSection()
    hold: HoldSection | None = None
    unknown_force: tuple[UnknownForceSection, ...] = ()
    sensors: SensorsSection = SensorsSection()
    simulation: SimulationSection = SimulationSection()
    observers: ObserverSection = ObserverSection()
    believed: BelievedSection = BelievedSection()

    @property
    def believed_robot(self) -> RobotSection:
        """The robot that the observers believe in."""
        return _laid_over(self.robot, self.believed.robot)

    @property
    def believed_air(self) -> AirSection:
        """The air that the observers believe in."""
        return _laid_over(self.air, self.believed.air)

    @model_validator(mode="after")
    def _believable(self) -> Scenario:
        for name in ("robot", "air"):
            try:
                getattr(self, f"believed_{name}")
            except ValidationError as error:
                told = [_explain({**item, "loc": (name, *item["loc"])}) for item in error.errors()]
                raise ValueError("; ".join(f"believed: {line}" for line in told)) from error
        return self

    @model_validator(mode="after")
    def _short_warm_up(self) -> Scenario:
        cycles, frequency = self.air.warm_up_cycles, self.crank.frequency
        if frequency > 0.0 and cycles / frequency > LONGEST_WARM_UP:
            raise ValueError(
                f"air.warm_up_cycles = {cycles} at crank.frequency = {frequency} Hz take {cycles / frequency:.0f} s "
                f"to fly; at most {LONGEST_WARM_UP:.0f} s are allowed"
            )
        return self

    @model_validator(mode="after")
    def _sensors_within_the_log(self) -> Scenario:
        for name, sensor in self.sensors.fitted.items():
            fastest = 1.0 / self.simulation.dt
            if sensor.rate is not None and sensor.rate > fastest * (1.0 + 1e-9):
                raise ValueError(
                    f"sensors.{name}.rate = {sensor.rate:g} Hz: the log has {fastest:g} samples a second; a smaller "
                    "simulation.dt, or no rate, were expected"
                )
        return self


Table = TypeVar("Table", bound=Section)


def _laid_over(section: Table, values: Mapping[str, Any]) -> Table:
    return type(section).model_validate(merge(section.model_dump(exclude_none=True), values)) if values else section


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
    if Path(source).is_file():
        _find_beside(Path(source).parent, values)
    return parse_scenario(with_settings(values, settings), str(source))


def with_settings(values: dict[str, Any], settings: Iterable[str]) -> dict[str, Any]:
    """Set dotted keys of plain values, in place; returns them. Raises ScenarioError for a setting that is none."""
    for setting in settings:
        key, equals, text = setting.partition("=")
        if not equals or not key.strip():
            raise ScenarioError(f"--set {setting}: dotted.key=value was expected")
        _assign(values, key.strip().split("."), _parsed(text.strip()), setting)
    return values


def _find_beside(folder: Path, values: Mapping[str, Any]) -> None:
    """Find the files that plain values name from where the scenario lies; shipped morphologies stay names."""
    robot, forces = values.get("robot"), values.get("unknown_force")
    named: list[tuple[Any, str]] = [(robot, "morphology")]
    named += [(force, "file") for force in forces] if isinstance(forces, list) else []
    for table, key in named:
        if isinstance(table, dict) and isinstance(table.get(key), str) and table[key] not in MORPHOLOGIES:
            table[key] = str((folder / table[key]).resolve())


def parse_scenario(values: Mapping[str, Any], source: str) -> Scenario:
    """Check plain values. Raises ScenarioError with every broken rule."""
    try:
        return Scenario.model_validate(dict(values))
    except ValidationError as error:
        lines = dict.fromkeys(_explain(dict(item)) for item in error.errors())  # each missing number is an error
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
        raise ScenarioError(nothing_there("scenario", source, names))
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ScenarioError(f"scenario {source}: not valid TOML: {error}") from error


def nothing_there(kind: str, source: str, shipped: Iterable[str]) -> str:
    """Say that neither a file nor something shipped is there; a name that can only be a file's is called one.

    Args:
        kind: of what was looked for.
        source: what it was looked for by.
        shipped: names of what is shipped.
    """
    if source.endswith(".toml") or "/" in source:
        return f"{kind} file {source}: there is no such file"
    return f"no {kind} '{source}': shipped are {', '.join(shipped)}; or give a TOML file"


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
    parts, section = _place(error["loc"])
    where = ".".join(parts)
    if error["type"] == "extra_forbidden":
        known = list(section.model_fields)
        close = difflib.get_close_matches(parts[-1], known, n=1)
        return f"unknown key '{where}'" + (f"; did you mean '{close[0]}'?" if close else f"; known: {', '.join(known)}")
    if error["type"] == "union_tag_invalid":
        tag, known = error["ctx"]["tag"], error["ctx"]["expected_tags"].replace("'", "").split(", ")
        close = difflib.get_close_matches(tag, known, n=1)
        guess = f"did you mean '{close[0]}'? There are" if close else "there are"
        return f"{where}.signal = '{tag}': {guess} {', '.join(known)}"
    if error["type"] == "missing" and isinstance(error["loc"][-1], int):
        count = _length(section, parts[-2])
        return f"{'.'.join(parts[:-1])} = {list(error['input'])}: {count or 'more'} numbers were expected"
    if error["type"] == "missing":
        return f"missing key '{where}'"
    if error["type"] == "value_error":
        return str(error["ctx"]["error"])
    rule = error["msg"].replace("tuple", "list")
    if error["type"] == "tuple_type":
        rule += f", such as {_as_list(error['input'], _length(section, parts[-1]))}"
    return f"{where} = {error['input']!r}: {rule[:1].lower()}{rule[1:]}"


def _length(section: type[Section], key: str) -> int:
    """Return how many entries a list has, or 0 where that is not fixed."""
    field = section.model_fields.get(key)
    entries = () if field is None else get_args(field.annotation)
    return 0 if Ellipsis in entries else len(entries)


def _as_list(given: Any, count: int) -> str:
    """Write as a list what was not given as one: words and numbers between commas, zeros for what is missing."""
    entries = [_parsed(part.strip()) for part in given.split(",")] if isinstance(given, str) else [given]
    return scenario_value(entries + [0.0] * (count - len(entries)))


def _place(loc: tuple[Any, ...]) -> tuple[list[str], type[Section]]:
    """Return the dotted key that pydantic's location means, and the last section on the way to it."""
    section: type[Section] = Scenario
    parts: list[str] = []
    kinds: dict[str, type[Section]] = {}
    for part in loc:
        if part in kinds and len(kinds) > 1:  # not a key: which of several kinds of section it is
            section, kinds = kinds[part], {}
            continue
        parts.append(str(part))
        if not isinstance(part, int):
            field = section.model_fields.get(part)
            kinds = {} if field is None else sections_of(field.annotation)
        if len(kinds) == 1:
            section = next(iter(kinds.values()))
    return parts, section


def sections_of(annotation: Any) -> dict[str, type[Section]]:
    """Return the sections that a field may hold: by their `signal` where there are several kinds, else by their name.

    Args:
        annotation: of the field.
    """
    if isinstance(annotation, type) and issubclass(annotation, Section):
        signal = annotation.model_fields.get("signal")
        return {annotation.__name__ if signal is None else get_args(signal.annotation)[0]: annotation}
    return {name: kind for inner in get_args(annotation) for name, kind in sections_of(inner).items()}


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
            lines.append(f"{key} = {scenario_value(value)}")
    return lines + tables + lists


def scenario_value(value: Any) -> str:
    """Write one value as TOML."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, tuple | list):
        return "[" + ", ".join(scenario_value(item) for item in value) + "]"
    return repr(value)
