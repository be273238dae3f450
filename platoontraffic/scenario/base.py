"""Base of every table of a scenario or study file, and the kinds of values that their keys hold."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Annotated, Any, ClassVar

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, GetJsonSchemaHandler, model_validator
from pydantic_core import CoreSchema

from platoontraffic.errors import did_you_mean

MOST = 1e9  # of any length, time, speed and the like: more overflows somewhere, and is not meant
Finite = Annotated[float, Field(ge=-MOST, le=MOST, allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, le=MOST, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, le=MOST, allow_inf_nan=False)]
Speed = Annotated[float, Field(ge=0, le=100)]  # [m/s]
Size = Annotated[float, Field(ge=0.01, le=100)]  # of a body [m]
Angle = Annotated[float, Field(ge=-360, le=360)]  # [deg]
Fraction = Annotated[float, Field(ge=0, le=1)]
LaneIndex = Annotated[int, Field(ge=0)]
Text = Annotated[str, Field(min_length=1)]
NAME = r"^[A-Za-z0-9_-]+$"
Identifier = Annotated[str, Field(pattern=NAME)]


def listed(names: Any) -> Any:
    """A list of names, which may be given as `A,B`, or as the number that is the only name."""
    if type(names) is int:  # an edge of OpenStreetMap
        return [str(names)]
    return names.split(",") if isinstance(names, str) else names


Listed = BeforeValidator(listed)
Names = Annotated[list[str], Listed]


class Table(BaseModel):
    """A TOML table. An unknown key is a fault, and so is a value of another type.

    The string below a key is its description in the JSON schema.
    """

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, use_attribute_docstrings=True)


class Named(Table):
    """A table that a name may stand for: `vehicle = "car"` is `vehicle = { type = "car" }`."""

    short: ClassVar[str]  # the key that the name is the value of

    @model_validator(mode="before")
    @classmethod
    def by_name(cls, value: Any) -> Any:
        return {cls.short: value} if isinstance(value, str) else value

    @classmethod
    def __get_pydantic_json_schema__(cls, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {"anyOf": [{"type": "string"}, handler(schema)]}


def filled_in(*keys: str) -> ConfigDict:
    """Configuration of a table with keys that are filled in before validation: its schema does not require them."""

    def optional(schema: dict[str, Any]) -> None:
        schema["required"] = [key for key in schema["required"] if key not in keys]

    return ConfigDict(json_schema_extra=optional)


def one_of(name: str, known: Iterable[str]) -> str:
    """The name. raises: ValueError if it is not known"""
    if name not in known:
        raise ValueError(f"not known{did_you_mean(name, known)}")
    return name


def is_multiple(time: float, step: float) -> bool:
    """Whether a time is one step or a whole number of steps, up to rounding [s]."""
    ratio = time / step
    return 0.5 < ratio < math.inf and abs(ratio - round(ratio)) < 1e-6
