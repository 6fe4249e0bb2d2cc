"""What every table of twin.toml is made of: frozen, strict, and its kinds of numbers."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field
from pydantic.fields import FieldInfo

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Position = tuple[Finite, Finite, Finite]


class TableModel(BaseModel):
    """A table of twin.toml: frozen, and a key it does not know is an error."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, serialize_by_alias=True)


def keys_of(table: type[BaseModel]) -> dict[str, tuple[str, FieldInfo]]:
    """The keys of a table as twin.toml has them, with the attribute and the field of each: `import`, a word
    of Python, is the attribute `imported`."""
    return {field.alias or name: (name, field) for name, field in table.model_fields.items()}
