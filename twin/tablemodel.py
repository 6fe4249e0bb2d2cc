"""What every table of twin.toml is made of: frozen, strict, and its kinds of numbers."""

import math
from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field
from pydantic.fields import FieldInfo

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, le=1e9, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Length = Annotated[float, Field(ge=-1e6, le=1e6, allow_inf_nan=False)]  # up to 1 km: the square of it is one
Position = tuple[Length, Length, Length]
Label = Annotated[int, Field(ge=1, le=10**9)]  # of a node, as Abaqus has them


def _direction(direction: Position) -> Position:
    if math.hypot(*direction) < 1e-6:
        raise ValueError("wanted a direction, such as [0.0, 0.0, -1.0]")
    return direction


Direction = Annotated[Position, AfterValidator(_direction)]


class TableModel(BaseModel):
    """A table of twin.toml: frozen, and a key it does not know is an error."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, serialize_by_alias=True)


def keys_of(table: type[BaseModel]) -> dict[str, tuple[str, FieldInfo]]:
    """The keys of a table as twin.toml has them, with the attribute and the field of each: `import`, a word
    of Python, is the attribute `imported`."""
    return {field.alias or name: (name, field) for name, field in table.model_fields.items()}
