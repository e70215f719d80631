"""Read and check sweep files, which name a base scenario and the quantities that are varied in it.

The page docs/studies.md explains their tables and keys. The sweep runs every combination of the dimensions; the draws
are the same in all combinations.
"""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Discriminator, Field, Tag, ValidationError, model_validator

from aerobat_pin.errors import SweepError
from aerobat_pin.scenario import Number, Positive, Whole, explain_plainly, read_toml, shipped_names

SHIPPED_SWEEPS = Path(__file__).with_name("shipped")
SEED, DRAW = "seed", "draw"
OF_VALUES = frozenset({"from", "to", "count", "distribution", "low", "mean"})  # of a key's values
KINDS = ("list", "span", "number", "uniform", "log_uniform", "normal")  # tags that pydantic adds to error locations


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True)


class Span(_Table):
    """A number of values from one end to another, both ends included."""

    start: Number = Field(alias="from", description="first value")
    end: Number = Field(alias="to", description="last value")
    count: Whole = Field(ge=2, description="number of values")
    spacing: Literal["linear", "log"] = Field("linear", description="equal differences, or equal ratios")

    @model_validator(mode="after")
    def _ratio(self) -> Span:
        if self.spacing == "log" and not (self.start > 0.0 and self.end > 0.0):
            raise ValueError(f'from = {self.start}, to = {self.end}: spacing = "log" wants both above 0')
        return self

    @property
    def values(self) -> list[float]:
        """All values of the span, in order."""
        space = np.geomspace if self.spacing == "log" else np.linspace
        return [float(value) for value in space(self.start, self.end, self.count)]


class Uniform(_Table):
    """A random number between two bounds: the number, or its logarithm, is uniformly distributed."""

    distribution: Literal["uniform", "log_uniform"]
    low: Number
    high: Number

    @model_validator(mode="after")
    def _ordered(self) -> Uniform:
        if self.high <= self.low or (self.distribution == "log_uniform" and self.low <= 0.0):
            rule = "0 < low < high" if self.distribution == "log_uniform" else "low < high"
            raise ValueError(f"low = {self.low}, high = {self.high}: {rule} was expected")
        return self

    def draw(self, random: np.random.Generator, count: int) -> list[float]:
        """Draw numbers."""
        if self.distribution == "log_uniform":
            return [float(value) for value in np.exp(random.uniform(np.log(self.low), np.log(self.high), count))]
        return [float(value) for value in random.uniform(self.low, self.high, count)]


class Normal(_Table):
    """A normally distributed number."""

    distribution: Literal["normal"]
    mean: Number
    deviation: Positive

    def draw(self, random: np.random.Generator, count: int) -> list[float]:
        """Draw numbers."""
        return [float(value) for value in random.normal(self.mean, self.deviation, count)]


def _dotted(tables: Any) -> Any:
    """Return keys as they are meant that TOML reads as tables without quotation marks: `air.density = 1.1`."""
    if not isinstance(tables, dict):
        return tables
    keys: dict[str, Any] = {}
    for key, value in tables.items():
        whole = "." in key or not isinstance(value, dict) or not OF_VALUES.isdisjoint(value)
        below = {} if whole else _dotted(value)
        keys |= {f"{key}.{name}": item for name, item in below.items()} or {key: value}
    return keys


Keys = Annotated[dict[str, Any], BeforeValidator(_dotted)]


class Draws(_Table):
    """Random draws of several keys; the draws of a key do not change when other keys are added or removed."""

    count: Whole = Field(ge=1, description="number of draws")
    seed: Whole = Field(1, ge=0, description="of the draws alone, not of the flights")
    values: Annotated[
        dict[str, Annotated[Uniform | Normal, Field(discriminator="distribution")]], BeforeValidator(_dotted)
    ] = Field(min_length=1)


def _kind(value: Any) -> str:
    return "span" if isinstance(value, dict | Span) else "list" if isinstance(value, list) else "number"


Listed = Annotated[list[Any], Field(min_length=1), Tag("list")]
Numbers = Annotated[list[Number], Field(min_length=1), Tag("list")]
Spanned = Annotated[Span, Tag("span")]
Single = Annotated[Number, Tag("number")]


class Factors(_Table):
    """Several keys that are multiplied by a common factor, each starting from its own reference value."""

    values: Annotated[Numbers | Spanned, Discriminator(_kind)] = Field(description="the factors")
    of: Annotated[dict[str, Annotated[Single | Numbers, Discriminator(_kind)]], BeforeValidator(_dotted)] = Field(
        min_length=1, description="dotted key -> what a factor of 1 makes it: a number, or a list of them"
    )

    def settings(self, factor: float) -> dict[str, Any]:
        """Return the settings for one factor: dotted key -> reference value times the factor."""
        return {
            key: [factor * number for number in reference] if isinstance(reference, list) else factor * reference
            for key, reference in self.of.items()
        }


class SweepFile(_Table):
    """The content of a sweep file, checked."""

    name: str = Field(
        max_length=200, pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$", description="also the default output folder"
    )
    description: str = ""
    base: str = Field(description="shipped scenario, or TOML file beside this one")
    seeds: Whole = Field(1, ge=1, description="number of seeds, counted up from the base scenario's")
    set: Keys = Field(default_factory=dict)
    ranges: Annotated[dict[str, Annotated[Listed | Spanned, Discriminator(_kind)]], BeforeValidator(_dotted)] = {}
    factors: dict[str, Factors] = Field(default_factory=dict)
    variants: dict[str, Annotated[dict[str, Keys], Field(min_length=1)]] = Field(default_factory=dict)
    draws: Draws | None = None

    @property
    def sizes(self) -> dict[str, int]:
        """Number of labels of each dimension, in order; known without making the labels."""
        chosen = {**self.ranges, **{name: factors.values for name, factors in self.factors.items()}, **self.variants}
        sizes = {name: values.count if isinstance(values, Span) else len(values) for name, values in chosen.items()}
        return {**sizes, **({DRAW: self.draws.count} if self.draws else {}), SEED: self.seeds}

    @property
    def size_text(self) -> str:
        """The sizes as text, such as `5 crank.frequency x 3 seed`."""
        return " x ".join(f"{size} {name}" for name, size in self.sizes.items())

    @property
    def _varied(self) -> dict[str, list[str]]:
        """Dotted keys that each dimension sets, in the order in which a run's dimensions set them."""
        listed = {key: values if isinstance(values, list) else [None] for key, values in self.ranges.items()}
        ranges = {key: [leaf for value in values for leaf in _leaves(key, value)] for key, values in listed.items()}
        factors = {name: list(factors.of) for name, factors in self.factors.items()}
        variants = {
            name: [leaf for keys in sets.values() for key, value in keys.items() for leaf in _leaves(key, value)]
            for name, sets in self.variants.items()
        }
        return {**ranges, **factors, **variants, **({DRAW: list(self.draws.values)} if self.draws else {})}

    @model_validator(mode="after")
    def _distinct(self) -> SweepFile:
        names = [*self.ranges, *self.factors, *self.variants, DRAW, SEED]
        for name in (name for name in names if names.count(name) > 1):
            raise ValueError(f"'{name}' is the name of two dimensions")
        varied = list(self._varied.items())
        if any("simulation.seed" in keys for _, keys in varied):
            raise ValueError("simulation.seed is counted up by `seeds`; give their number there")
        for (_, before), (name, after) in itertools.combinations(varied, 2):
            for key, last in itertools.product(before, after):
                if _overwrites(last, key):
                    both = f"two dimensions, of which '{name}' sets '{last}'"
                    raise ValueError(f"'{key}' is varied by {both}; one was expected")
        return self


def _leaves(key: str, value: Any) -> list[str]:
    """Return a dotted key, and those of what a table contains that it is set to."""
    below = value.items() if isinstance(value, dict) else ()
    return [key, *(leaf for name, item in below for leaf in _leaves(f"{key}.{name}", item))]


def _overwrites(last: str, key: str) -> bool:
    """Return whether setting a dotted key sets another anew: itself, or a table or list (`*`: each item) above it."""
    above, parts = last.split("."), key.split(".")
    return len(above) <= len(parts) and all(
        part == other or "*" in (part, other) for part, other in zip(above, parts, strict=False)
    )


def shipped_sweeps() -> dict[str, str]:
    """Return the shipped sweeps: name -> description."""
    return {name: read_sweep(name).description for name in shipped_names(SHIPPED_SWEEPS)}


def read_sweep(source: str) -> SweepFile:
    """Read a sweep file, given as the name of a shipped sweep or as a path. Raises SweepError if it is none."""
    values = read_toml("sweep", source, SHIPPED_SWEEPS, SweepError)
    try:
        return SweepFile.model_validate(values)
    except ValidationError as error:
        lines = (_explain(dict(item)) for item in error.errors())
        raise SweepError(f"sweep {source}: " + "; ".join(lines)) from error


def _explain(error: dict[str, Any]) -> str:
    loc = [str(part) for part in error["loc"]]
    where = ".".join([*loc[:2], *(part for part in loc[2:] if part not in KINDS)])
    known = [field.alias or name for name, field in _table_at(error["loc"]).model_fields.items()]
    return explain_plainly(error, where, known)


def _table_at(loc: tuple[Any, ...]) -> type[_Table]:
    """Return the class of the table that contains the location of an error, given in pydantic's notation."""
    if not loc:
        return SweepFile
    if "span" in loc[2:]:
        return Span
    if loc[0] == "factors" and len(loc) > 2:
        return Factors
    if loc[0] == "draws" and len(loc) > 1:
        return Draws if len(loc) == 2 else Normal if loc[3:4] == ("normal",) else Uniform
    return SweepFile
