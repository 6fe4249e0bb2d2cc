"""Validation of plain data by a table model; an error is one sentence with the way out."""

import json
import re
import tomllib
from collections.abc import Iterator
from difflib import get_close_matches
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from twin.tablemodel import keys_of

Checked = TypeVar("Checked", bound=BaseModel)
LONGEST, DEEPEST = 10_000_000, 100  # letters of a file; parts of a key, as in model.fixed.C10
_PART = r"""(?:[A-Za-z0-9_-]+|"[^"\n]*"|'[^'\n]*')[ \t]*"""
_DEEP = re.compile(rf"""(?<![\w"'.-]){_PART}(?:\.[ \t]*{_PART}){{{DEEPEST}}}""")


def tables_of(data: bytes, *, name: str) -> dict[str, Any]:
    """The tables of a TOML file's bytes; ValueError where they are no TOML, or far longer than any."""
    try:
        text = decoded(data)
        if len(text) > LONGEST or _DEEP.search(text):  # its time grows with their square
            raise ValueError(f"wanted at most {LONGEST // 10**6} MB, and keys of at most {DEEPEST} parts")
        return tomllib.loads(text)
    except ValueError as error:  # of TOML, of UTF-8, or for a number of more than 4300 digits
        raise ValueError(f"{name}: not valid TOML: {error}") from None
    except RecursionError:
        raise ValueError(f"{name}: its brackets lie in each other too deeply; wanted at most a few") from None


def decoded(data: bytes) -> str:
    """The text of a file's bytes, without the byte order mark that some editors write."""
    return data.decode("utf-8-sig")


def checked(model: type[Checked], data: Any, *, name: str) -> Checked:
    """The model of plain data, such as the tables of a TOML file; ValueError is one sentence that begins with
    the file's name."""
    try:
        # through JSON, where strict means strict numbers and text but an array is still a tuple
        return model.model_validate_json(json.dumps(data, default=str), strict=True)
    except ValidationError as error:
        raise ValueError(f"{name}: {_sentence(error, model)}") from None
    except RecursionError:
        raise ValueError(f"{name}: its tables lie in each other too deeply; wanted at most a few") from None


def value_text(value: Any) -> str:
    """A value as TOML writes it.

    >>> print(value_text({"fixed": True, "at": (1.0, 2.0)}))
    {fixed = true, at = [1.0, 2.0]}
    """
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_bare(key)} = {value_text(item)}" for key, item in value.items()) + "}"
    if isinstance(value, tuple | list):
        return "[" + ", ".join(value_text(item) for item in value) + "]"
    return repr(value)


def _bare(key: str) -> str:
    """A key as TOML writes it: in quotes where it holds other than letters, digits, _ and -."""
    return key if re.fullmatch("[A-Za-z0-9_-]+", key) else json.dumps(key, ensure_ascii=False)


def _sentence(error: ValidationError, root: type[BaseModel]) -> str:
    """The first error as one sentence, and how many more there are."""
    error_details, more = error.errors()[0], error.error_count() - 1
    return _problem(error_details, root) + (f" (and {more} more)" if more else "")


def _problem(error: Any, root: type[BaseModel]) -> str:
    where, kind, message = error["loc"], error["type"], error["msg"]
    if kind == "value_error":
        text = message.removeprefix("Value error, ")
        # a table names its keys itself
        of_value = where and _field(where, root) and not isinstance(error["input"], dict)
        return f"{_key(where)} = {_short(error['input'])}: {text}" if of_value else text
    key, field = _key(where), _field(where, root)
    about = f" ({field.description})" if field is not None and field.description else ""
    if kind == "extra_forbidden":
        return _unknown(where, root)
    if kind == "missing":
        return f"{key} is missing{about}; add it"
    key = key or "all of it"
    needed = message.replace("Input should", "it should", 1)
    return f"{key} = {_short(error['input'])}: {needed[0].lower()}{needed[1:]}{about}{_example(where, field)}"


def _unknown(where: tuple[str | int, ...], root: type[BaseModel]) -> str:
    """The sentence for a key that does not exist, with the nearest one that does."""
    keys = list(keys_of(_model(where[:-1], root)))
    near = get_close_matches(str(where[-1]), keys, n=1, cutoff=0.5)
    hint = f"did you mean {near[0]!r}?" if near else f"known here: {', '.join(keys)}"
    return f"{_key(where)} is not a known key; {hint}"


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _example(where: tuple[str | int, ...], field: FieldInfo | None) -> str:
    default = field.get_default() if field is not None and not field.is_required() else None
    key = next((part for part in reversed(where) if isinstance(part, str)), "")
    return f"; for example {key} = {value_text(default)}" if isinstance(default, str | int | float) else ""


def _key(where: tuple[str | int, ...]) -> str:
    """The name cameras[1].film for its location, counted from 1 as a person does."""
    parts = "".join(f"[{part + 1}]" if isinstance(part, int) else f".{part}" for part in where)
    return parts.removeprefix(".")


def _models(
    where: tuple[str | int, ...], root: type[BaseModel]
) -> Iterator[tuple[type[BaseModel], str]]:
    """Each table on the way to a location with the key taken there."""
    model: type[BaseModel] | None = root
    for part in where:
        if isinstance(part, str) and model is not None:
            yield model, part
            model = table_of(model, part)


def table_of(model: type[BaseModel], key: str) -> type[BaseModel] | None:
    """The table type under a key, also inside an optional or an array; None where there is none."""
    if key not in keys_of(model):
        return None
    annotations = [keys_of(model)[key][1].annotation]
    while annotations:
        kind = annotations.pop(0)
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            return kind
        annotations += get_args(kind)
    return None


def _model(where: tuple[str | int, ...], root: type[BaseModel]) -> type[BaseModel]:
    """The table at a location."""
    model = root
    for parent, key in _models(where, root):
        model = table_of(parent, key) or parent
    return model


def _field(where: tuple[str | int, ...], root: type[BaseModel]) -> FieldInfo | None:
    """The field that a location lies in: bounds for calibrate.bounds.C10[1]."""
    field = None
    for model, key in _models(where, root):
        field = keys_of(model).get(key, ("", field))[1]
    return field
