"""Types of the values in files, with bounds: numbers, names, lists."""

from __future__ import annotations

from typing import Annotated, Any, TypeVar

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field
from pydantic_core import PydanticCustomError

from graspless_pin.bounds import (
    DEEPEST_HALVINGS,
    LARGEST,
    LARGEST_FRICTION,
    LARGEST_LENGTH,
    LARGEST_REGULARIZATION,
    LONGEST_NAME,
    LONGEST_TIME,
    MOST_SAMPLES,
    SMALLEST,
    SMALLEST_LENGTH,
)

_Item = TypeVar("_Item")


def no_truth_value(value: Any) -> Any:
    """Refuse true and false where a number is wanted: pydantic reads them as 1 and 0."""
    if isinstance(value, bool):
        raise PydanticCustomError("number_type", "Input should be a number")
    return value


_NUMBER = BeforeValidator(no_truth_value)
Finite = Annotated[
    float, Field(ge=-LARGEST_LENGTH, le=LARGEST_LENGTH, allow_inf_nan=False), _NUMBER
]
"""A length, angle, velocity or factor."""
METRES = "m"
"""Annotation that marks a type as a length."""
Length = Annotated[
    float,
    Field(gt=0.0, ge=SMALLEST_LENGTH, le=LARGEST_LENGTH, allow_inf_nan=False),
    _NUMBER,
    METRES,
]
"""A positive length, m."""
Positive = Annotated[float, Field(gt=0.0, ge=SMALLEST, le=LARGEST, allow_inf_nan=False), _NUMBER]
"""A positive mass, density or force."""
NotNegative = Annotated[float, Field(ge=0.0, le=LARGEST, allow_inf_nan=False), _NUMBER]
"""A force or torque of at least zero."""
Share = Annotated[float, Field(ge=0.0, lt=1.0, allow_inf_nan=False), _NUMBER]
"""A relative deviation in [0, 1)."""
Signed = Annotated[float, Field(ge=-LARGEST, le=LARGEST, allow_inf_nan=False), _NUMBER]
"""A force or torque of either sign."""
Friction = Annotated[float, Field(ge=0.0, le=LARGEST_FRICTION, allow_inf_nan=False), _NUMBER]
Regularization = Annotated[
    float, Field(ge=0.0, le=LARGEST_REGULARIZATION, allow_inf_nan=False), _NUMBER
]
Seconds = Annotated[float, Field(gt=0.0, le=LONGEST_TIME), _NUMBER]
"""A time limit."""
Whole = Annotated[int, Field(ge=0, le=2**63 - 1), _NUMBER]
Count = Annotated[int, Field(ge=1, le=MOST_SAMPLES), _NUMBER]
Halvings = Annotated[int, Field(ge=1, le=DEEPEST_HALVINGS), _NUMBER]
Name = Annotated[str, Field(max_length=LONGEST_NAME)]
FilePath = Annotated[str, Field(max_length=4000)]
Description = Annotated[str, Field(max_length=20_000)]
Few = Annotated[list[_Item], Field(max_length=100)]
Many = Annotated[list[_Item], Field(max_length=1000)]
ByName = Annotated[dict[Name, _Item], Field(max_length=1000)]


def as_list(value: Any) -> Any:
    """Turn a single name into a list of one."""
    return [value] if isinstance(value, str) else value


class Entry(BaseModel):
    """A part of a file; unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)
