"""Former place of `twin.tablemodel`, for imports that have not moved yet."""

from twin.tablemodel import (
    Direction,
    Finite,
    Label,
    Length,
    NotNegative,
    Position,
    Positive,
    TableModel,
    keys_of,
)

__all__ = [
    "Direction", "Finite", "Label", "Length", "NotNegative", "Position", "Positive", "TableModel", "keys_of",
]  # fmt: skip
