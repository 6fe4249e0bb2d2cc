"""The base of the tables of twin.toml, frozen and strict, and the types of their values."""

import math
import re
from pathlib import PurePosixPath, PureWindowsPath
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field
from pydantic.fields import FieldInfo

NAMED = "a name of the letters A to Z and a to z, digits and _ . + -, which begins with none of . + -"

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


def _inside(path: str) -> str:
    if ".." in PurePosixPath(path).parts or ".." in PureWindowsPath(path).parts:
        raise ValueError("wanted a path inside the project folder, without ..; copy the file under raw/")
    return _relative(path)


def _relative(path: str) -> str:
    if PurePosixPath(path).is_absolute() or PureWindowsPath(path).is_absolute() or path.startswith("~"):
        raise ValueError(
            "wanted a path relative to the project folder, so that the folder can be moved; put the "
            "file under raw/ and write raw/..."
        )
    return path


def _name(name: str) -> str:
    # it goes into paths and into CSV cells, where a sign at the beginning makes a formula
    if not re.fullmatch(r"[A-Za-z0-9_][A-Za-z0-9_.+-]*", name):
        raise ValueError(f"wanted {NAMED}; rename it")
    return name


def _dictionary(name: str) -> str:
    if name.startswith("DICT_"):
        return name
    if PurePosixPath(name).suffix.lower() not in (".yml", ".yaml", ".xml", ".json"):
        raise ValueError(
            "wanted one of OpenCV's names, such as DICT_4X4_50 or DICT_APRILTAG_36h11, or a file such as "
            "raw/dictionary.yml"
        )
    return _inside(name)


def _density(kg_m3: float) -> float:
    if not 100.0 <= kg_m3 <= 20000.0:
        likely = "; is it in g/cm3?" if 0.1 <= kg_m3 <= 20.0 else ""
        raise ValueError(f"wanted the density of the silicone in kg/m3, such as 1070.0{likely}")
    return kg_m3


def _memory(text: str) -> str:
    if not re.fullmatch(r"[1-9][0-9]*(\.[0-9]+)? ?(MB|GB|mb|gb|%)", text) or text.startswith("%"):
        raise ValueError('wanted a size such as "4 GB" or "2000 MB", or a share of the memory such as "60%"')
    return text


def _program_name(name: str) -> str:
    # a project comes from others: it may name a solver on the search path, but no other program and no path
    if not re.fullmatch(r"(?i)(abaqus|abq|ccx|calculix)[a-z0-9_.+-]*", name):
        raise ValueError(
            "wanted the name of the program without its folder, which begins with abaqus, abq, ccx or "
            "calculix; put its folder on the search path (PATH)"
        )
    return name


def _share(sd: float) -> float:
    if not 0.0 < sd <= 0.2:
        raise ValueError("wanted a share above 0 and up to 0.2: 0.001 is 0.1 %")
    return sd


def _sd_mm(sd: float) -> float:
    if not 0.0 < sd <= 20.0:
        raise ValueError("wanted an sd in mm, above 0 and up to 20")
    return sd


Direction = Annotated[Position, AfterValidator(_direction)]
Density = Annotated[Positive, AfterValidator(_density)]
Share = Annotated[Positive, AfterValidator(_share)]
Memory = Annotated[str, AfterValidator(_memory)]
Program = Annotated[str, AfterValidator(_program_name)]
SdMm = Annotated[Positive, AfterValidator(_sd_mm)]
Dictionary = Annotated[str, AfterValidator(_dictionary)]
RelativePath = Annotated[str, Field(min_length=1), AfterValidator(_inside)]
OtherProject = Annotated[str, Field(min_length=1), AfterValidator(_relative)]
Name = Annotated[str, AfterValidator(_name)]
Bounds = tuple[Finite, Finite]
StaticStart = Annotated[
    Finite | None,
    Field(description="time of the static film's first frame on that clock, s; else the film's rest gives "
          "the noise of the gauge"),
]  # fmt: skip
Step = Annotated[int, Field(ge=0)]
StillSteps = tuple[tuple[Step, Step], ...] | Literal["holds"]


class TableModel(BaseModel):
    """A table of twin.toml: frozen, and an unknown key is an error."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, serialize_by_alias=True)


def keys_of(table: type[BaseModel]) -> dict[str, tuple[str, FieldInfo]]:
    """The keys of a table as twin.toml has them, with the attribute and the field of each: `import`, a word
    of Python, is the attribute `imported`."""
    return {field.alias or name: (name, field) for name, field in table.model_fields.items()}
