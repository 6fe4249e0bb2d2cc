"""Base classes of the JSON records: one model for each file, by which it is written and read.

A record lies in the room of its maker, and those of the project itself in `twin/project/record.py`.
"""

from typing import Annotated, Any, ClassVar

from pydantic import BaseModel, BeforeValidator, ConfigDict, ValidationInfo

from twin.tablemodel import Finite, NotNegative


class Record(BaseModel):
    """A JSON file, or a part of one: frozen, and a key that it does not know is an error.

    What was given is written, so a key with a default may be absent. A description is what docs/files.md says
    of a key; a key without one shares the row above it.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, validate_by_name=True)
    file: ClassVar[str] = ""  # its name in the folder of a run


class Loose(BaseModel):
    """A part of a record that other versions made too: what is named is checked, other keys may be there."""

    model_config = ConfigDict(extra="allow", frozen=True)


def _or_null(value: Any, info: ValidationInfo) -> Any:
    """Null for what is infinite or not known; a file says so itself."""
    unknown = info.mode == "python" and isinstance(value, float) and not abs(value) < float("inf")
    return None if unknown else value


Maybe = Annotated[Finite | None, BeforeValidator(_or_null)]
MaybeSize = Annotated[NotNegative | None, BeforeValidator(_or_null)]


Reach = Annotated[float, BeforeValidator(lambda value: float("inf") if value is None else value)]  # null: inf
