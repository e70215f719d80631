"""The base class of a scenario's tables, and the kinds of numbers that their keys take."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

LARGEST_NUMBER = 1.0e12  # no key needs a larger number, in any of its units
FARTHEST_START = 1.0e6  # [m]: further out, positions lose their digits
Number = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-LARGEST_NUMBER, le=LARGEST_NUMBER)]
Whole = Annotated[int, Field(strict=True)]
Positive = Annotated[Number, Field(gt=0.0)]
NonNegative = Annotated[Number, Field(ge=0.0)]
Triple = tuple[Number, Number, Number]
Coordinate = Annotated[Number, Field(ge=-FARTHEST_START, le=FARTHEST_START)]
PerAxis = Annotated[
    tuple[Number, ...], BeforeValidator(lambda given: (given,) if isinstance(given, int | float) else given)
]
Limits = tuple[Positive, Positive, Positive]
PerWorldAxis = Annotated[
    tuple[Positive, Positive, Positive],
    BeforeValidator(lambda given: (given,) * 3 if isinstance(given, int | float) else given),
]


class Section(BaseModel):
    """Base class of a scenario file's tables: unknown keys are errors, and values cannot change after reading."""

    # A table is built when one is first read, with those inside it: most commands read few of them.
    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)
