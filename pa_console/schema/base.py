"""The base of every schema model, and the scalar types that they share."""

from functools import cache
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, StringConstraints

Point = tuple[float, float]
"""A position in metres, (x east, y north)."""

Name = Annotated[str, StringConstraints(pattern=r"^[A-Za-z][A-Za-z0-9_]*$", max_length=64)]
"""An identifier, such as that of an asset, a frame, a lane or a zone."""

Hex32 = Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")]
"""32 bytes in hexadecimal: a SHA-256 or a public key."""

Hex64 = Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{128}$")]
"""64 bytes in hexadecimal: a signature."""

Percent = Annotated[float, Field(ge=0.0, le=100.0)]
Share = Annotated[float, Field(ge=0.0, le=1.0)]
Positive = Annotated[float, Field(gt=0.0)]
NonNegative = Annotated[float, Field(ge=0.0)]

AlarmPriority = Literal["emergency", "high", "medium", "low"]
ALARM_PRIORITIES: tuple[AlarmPriority, ...] = ("emergency", "high", "medium", "low")


class StrictModel(BaseModel):
    """An immutable value that refuses unknown fields, coercion and non-finite numbers."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, strict=True, allow_inf_nan=False, validate_default=True
    )

    @classmethod
    def of_valid(cls, values: dict[str, Any]) -> Self:
        """Return a model that holds the dictionary `values`: all fields, valid and in order.

        Nothing is checked, so this takes a quarter of the time of `model_construct`.
        """
        made = cls.__new__(cls)
        put = object.__setattr__
        put(made, "__dict__", values)
        put(made, "__pydantic_fields_set__", _field_names(cls))
        put(made, "__pydantic_extra__", None)
        put(made, "__pydantic_private__", None)
        return made


@cache
def _field_names(model: type[BaseModel]) -> set[str]:
    """Return the names of all fields, as a set that all instances of the immutable model share."""
    return set(model.__pydantic_fields__)


Role = Literal["planner", "judge", "outcome"]
"""The roles of a model: planner, judge of a plan, judge of an outcome."""

ServerUse = Literal["planner", "judge", "second reader"]
"""The purposes for which a model on a server is used."""


class Payload(StrictModel):
    """The base of all event payloads; transient payloads are not part of a recorded session.

    A `binding` payload is one for which a person is responsible: a decision, or a command to a
    device. The log is signed right after it.
    """

    transient: ClassVar[bool] = False
    binding: ClassVar[bool] = False
