"""The runs of a sweep: laid out from its file, in dimensions; each becomes an outcome, with columns in the results."""

from __future__ import annotations

import itertools
import json
import math
import os
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from aerobat_description import MORPHOLOGIES
from aerobat_pin.aerobat import Aerobat, load_aerobat
from aerobat_pin.errors import AerobatError, ControlWarning, SweepError
from aerobat_pin.experiments.experiment import run
from aerobat_pin.experiments.flight_summary import FlightSummary
from aerobat_pin.experiments.sweep.sweep_file import DRAW, SEED, Draws, Span, SweepFile, read_sweep
from aerobat_pin.forces import TRUTH_SCORES, Score
from aerobat_pin.numerics import guarded
from aerobat_pin.scenario import RobotSection, Scenario, assign, load_scenario, parse_scenario

MOST_RUNS, MOST_DAYS = 100_000, 30.0  # of a sweep, the days on one processor
LONGEST_DIMENSION = 255  # bytes of a dimension's name
DAY = 86400.0  # [s]
SCORE_FIELDS = {item.name: item.metadata for item in fields(Score)}
SCORES = {name: (SCORE_FIELDS[name]["unit"], SCORE_FIELDS[name]["meaning"]) for name in TRUTH_SCORES}
JUDGED = {"rank": "of the equations for the forces", "condition": "of the equations for the forces"}
LOOP_UNITS = {"slew_rms": "N/s", "saturated_share": "1", "largest_ms": "1", "delay_margin": "s"}
LOOP_UNITS |= {f"rms_{axis}": "m" if axis in "xyz" else "rad" for axis in ("x", "y", "z", "roll", "pitch", "yaw")}
FLIGHT_UNITS = {item.name: item.metadata["unit"] for item in fields(FlightSummary)} | LOOP_UNITS
LISTS: dict[int, tuple[str, list[str]]] = {2: ("bound", ["lowest", "highest"]), 3: ("axis", ["x", "y", "z"])}
RESERVED_NAMES = frozenset(
    {"run", "failed", "warnings", "observer", "point", "axis", "bound", *SCORES, *JUDGED, *FLIGHT_UNITS}
)


@dataclass(frozen=True)
class Dimension:
    """One quantity that a sweep varies.

    Attributes:
        name: name of the dimension.
        labels: label of each value along the dimension.
        settings: dotted keys and values that each label stands for, in the order of the labels.
    """

    name: str
    labels: tuple[Any, ...]
    settings: tuple[dict[str, Any], ...]


@dataclass(frozen=True, repr=False)
class Sweep:
    """All runs of a sweep: every combination of its dimensions, of which the last changes fastest.

    Attributes:
        file: the sweep file.
        base: scenario that every run starts from, `[set]` included.
        dimensions: quantities that are varied.
    """

    file: SweepFile
    base: Scenario
    dimensions: tuple[Dimension, ...]

    def __repr__(self) -> str:
        return f"Sweep {self.file.name}: {self.file.size_text} runs of {self.base.name}\n  {self.file.description}"

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of labels of each dimension."""
        return tuple(len(dimension.labels) for dimension in self.dimensions)

    def labels(self, index: tuple[int, ...]) -> dict[str, Any]:
        """Return dimension -> label of the run at an index, and for random draws also dotted key -> drawn value."""
        chosen = {dimension.name: dimension.labels[i] for dimension, i in zip(self.dimensions, index, strict=True)}
        for dimension, i in zip(self.dimensions, index, strict=True):
            if dimension.name == DRAW:
                chosen |= dimension.settings[i]
        return chosen

    @cached_property
    def indices(self) -> list[tuple[int, ...]]:
        """The position of each run along every dimension, in the order of the runs."""
        return list(itertools.product(*(range(count) for count in self.shape)))

    @cached_property
    def scenarios(self) -> list[Scenario]:
        """The scenario of each run. Raises ScenarioError, which names the run's labels, if a value breaks its rule."""
        scenarios = []
        for index in self.indices:
            chosen = [dimension.settings[i] for dimension, i in zip(self.dimensions, index, strict=True)]
            labels = ", ".join(f"{name} = {value}" for name, value in self.labels(index).items())
            scenarios.append(_with_keys(self.base, chosen, f"of sweep {self.file.name} at {labels}"))
        return scenarios


@guarded()
def load_sweep(source: str | Path) -> Sweep:
    """Read a sweep, a shipped name or the path of a TOML file, and lay out its runs.

    Raises:
        SweepError: the file is not found, is not TOML, or is not a sweep; the message names key, value and rule.
        ScenarioError: the base scenario, or the scenario of one of the runs, breaks a rule.
    """
    file = read_sweep(str(source))
    beside = Path(source).parent / file.base
    base = load_scenario(beside if os.path.isfile(source) and os.path.isfile(beside) else file.base)
    base = _with_keys(base, [file.set], f"of sweep {file.name}")
    _check_names_and_size(file, base)
    dimensions = []
    for key, given in file.ranges.items():
        values = _each_value(given)
        dimensions.append(_dimension(f"ranges.{key}", key, values, [{key: value} for value in values]))
    for name, factors in file.factors.items():
        values = _each_value(factors.values)
        dimensions.append(_dimension(f"factors.{name}.values", name, values, list(map(factors.settings, values))))
    dimensions += [Dimension(name, tuple(sets), tuple(sets.values())) for name, sets in file.variants.items()]
    if file.draws is not None:
        dimensions.append(_draw_dimension(file.draws))
    seeds = tuple(base.simulation.seed + k for k in range(file.seeds))
    dimensions.append(Dimension(SEED, seeds, tuple({"simulation.seed": seed} for seed in seeds)))
    sweep = Sweep(file, base, tuple(dimensions))
    days = sum(scenario.size.seconds for scenario in sweep.scenarios) / DAY
    if days > MOST_DAYS:
        raise SweepError(_too_large(file, len(sweep.scenarios), days))
    return sweep


def _check_names_and_size(file: SweepFile, base: Scenario) -> None:
    """Raise SweepError if a dimension has a name that no file of results can hold, or if the runs are too many.

    The sizes of the dimensions are enough for this, so that no list of a thousand million seeds is made.
    """
    for name in (*file.sizes, *(file.draws.values if file.draws else {})):
        if name in RESERVED_NAMES:
            raise SweepError(f"sweep {file.name}: '{name}' is a name in the results; another one was expected")
        if not name.strip(". ") or "/" in name or not name.isprintable() or len(name.encode()) > LONGEST_DIMENSION:
            rule = f"a name without / of 1 to {LONGEST_DIMENSION} bytes was expected, as NetCDF takes it"
            raise SweepError(f"sweep {file.name}: dimension {name!r}: {rule}")
    count = math.prod(file.sizes.values())
    if count > MOST_RUNS:
        raise SweepError(_too_large(file, count, count * base.size.seconds / DAY))


def _too_large(file: SweepFile, count: int, days: float) -> str:
    return (
        f"sweep {file.name}: {file.size_text} are {count} runs, about {days:.3g} days on one processor; at most "
        f"{MOST_RUNS} runs and {MOST_DAYS:g} days are allowed"
    )


def _each_value(given: list[Any] | Span) -> list[Any]:
    return given.values if isinstance(given, Span) else given


def _dimension(where: str, name: str, values: list[Any], settings: list[dict[str, Any]]) -> Dimension:
    """Return the dimension of values that a file gives `where`, each with the settings that it stands for."""
    plain = all(isinstance(value, int | float) and not isinstance(value, bool) for value in values)
    labels = tuple(values) if plain else tuple(v if isinstance(v, str) else json.dumps(v) for v in values)
    if len(set(labels)) < len(labels):
        raise SweepError(f"{where} = {list(labels)}: each value once was expected")
    return Dimension(name, labels, tuple(settings))


def _draw_dimension(draws: Draws) -> Dimension:
    drawn = {}
    for key, distribution in draws.values.items():
        stream = np.random.default_rng([draws.seed, *key.encode()])
        drawn[key] = distribution.draw(stream, draws.count)
    rows = tuple({key: values[k] for key, values in drawn.items()} for k in range(draws.count))
    return Dimension(DRAW, tuple(range(draws.count)), rows)


def _with_keys(scenario: Scenario, settings: list[dict[str, Any]], source: str) -> Scenario:
    """Return a scenario with dotted keys set. Raises ScenarioError, which names the source."""
    values = scenario.model_dump(mode="json", exclude_none=True)
    for key, value in (item for chosen in settings for item in chosen.items()):
        assign(values, key, value)
    return parse_scenario(values, source)


def flight_columns(metrics: Mapping[str, Any]) -> dict[str, Any]:
    """Return the numbers of a run's flight and of its control, without nested tables, as columns of the results.

    Margins are those of a loop that is stable by its gains; another has none.
    """
    columns = dict(metrics["flight"])
    columns |= {f"rms_{axis}": value for axis, value in columns.pop("rms", {}).items()}
    control = metrics.get("control")
    if control is not None:
        margins = control["margins"].values()
        columns |= {name: control[name] for name in ("slew_rms", "saturated_share")}
        if all(margin["stable"] for margin in margins):
            columns["largest_ms"] = max(margin["ms"] for margin in margins)
            columns["delay_margin"] = min(margin["delay"] for margin in margins if margin["delay"] is not None)
    return columns


def outcome_of(scenario: Scenario) -> str:
    """Simulate and score a scenario; a failure is returned, not raised.

    The result is JSON text: `"observers"` and `"flight"` as in `metrics.json`, or the reason why it `"failed"`; and
    `"warnings"` if there are any.
    """
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("default")
        try:
            robots = _load_once(scenario.robot, scenario), _load_once(scenario.believed_robot, scenario)
            experiment = run(scenario, robots=robots)
            metrics = experiment.metrics
            if experiment.failed:
                warnings.warn(f"the controller is {experiment.failed}", ControlWarning, stacklevel=2)
            outcome: dict[str, Any] = {"observers": metrics["observers"], "flight": flight_columns(metrics)}
            json.dumps(outcome, allow_nan=False)
        except AerobatError as error:
            outcome = {"failed": str(error)}
        except Exception as error:  # a bug that shows in one run must not end the others
            outcome = {"failed": f"{type(error).__name__}: {error}"}
    texts = dict.fromkeys(str(item.message) for item in caught if issubclass(item.category, UserWarning))
    return json.dumps(outcome | ({"warnings": list(texts)} if texts else {}))


def _load_once(section: RobotSection, scenario: Scenario) -> Aerobat:
    """Return a robot of a scenario, kept from a run before if it can be; what loading it warned of is said anew."""
    from_file = section.morphology not in MORPHOLOGIES and os.path.isfile(section.morphology)
    stamp = Path(section.morphology).stat().st_mtime_ns if from_file else 0
    robot, said = _loaded(section.morphology, json.dumps(section.changes), scenario.flight.gravity, stamp)
    for warning in said:
        warnings.warn(warning.message, warning.category, stacklevel=2)
    return robot


@lru_cache(maxsize=16)
def _loaded(morphology: str, changes: str, gravity: float, stamp: int) -> tuple[Aerobat, list[warnings.WarningMessage]]:
    """Load a robot, with changes as JSON text; another `stamp`, the time of its file, loads a changed file again.

    With it are the warnings of loading, so that they do not depend on which runs a process has flown before.
    """
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("default")
        return load_aerobat(morphology, json.loads(changes), gravity=gravity), said
