"""Turn the text of twin.toml into a configuration and back, with errors and comments for a person."""

import json
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from difflib import get_close_matches
from typing import Any, get_args

import tomlkit
from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from twin.project.config import FORMER, Config, with_first_film


def parse(data: bytes, *, name: str) -> Config:
    """The configuration in a file's bytes; ValueError is one sentence that begins with its name."""
    try:
        tables = tomllib.loads(decoded(data))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{name}: not valid TOML: {error}") from None
    try:
        # through JSON, where strict means strict numbers and text but an array is still a tuple
        filmed = with_first_film(_without_former(tables))
        return Config.model_validate_json(json.dumps(filmed, default=str))
    except ValidationError as error:
        raise ValueError(f"{name}: {_sentence(error)}") from None


def former_keys(data: bytes) -> list[str]:
    """The keys of a twin.toml that older versions had and that change nothing, such as model.geometry."""
    tables = tomllib.loads(decoded(data))
    return [f"{name}.{key}" for name, keys in FORMER.items() for key in keys if key in _keys(tables, name)]


def _keys(tables: dict[str, Any], name: str) -> dict[str, Any]:
    table = tables.get(name)
    return table if isinstance(table, dict) else {}


def _without_former(tables: dict[str, Any]) -> dict[str, Any]:
    kept = dict(tables)
    for name, keys in FORMER.items():
        if isinstance(tables.get(name), dict):
            kept[name] = {key: value for key, value in tables[name].items() if key not in keys}
    return kept


def decoded(data: bytes) -> str:
    """The text of a file's bytes, without the byte order mark that some editors write."""
    return data.decode("utf-8-sig")


def dump(config: Config) -> str:
    """A complete twin.toml: every key with its meaning and unit, what is optional commented out."""
    lines = [
        "# A softtwin project. Units: mm, MPa, s. World axes: x along the finger from the clamp,",
        "# y across the width, z up. Paths are relative to this folder. `twin check` says what is missing.",
    ]
    for key in Config.model_fields:
        value = getattr(config, key)
        if isinstance(value, BaseModel):
            lines += _table(key, value)
        elif value is not None:
            lines += _tables(key, value)
    if not config.cameras:
        lines += ["", "# There is no [[cameras]]: the targets were measured elsewhere and lie in targets/."]
    return "\n".join(lines) + "\n"


def with_effects(text: str, effects: Sequence[str]) -> str:
    """The text of a twin.toml with [model] effects replaced; comments, order and every other value stay."""
    return with_key(text, "model", "effects", list(effects))


def with_key(text: str, table: str, key: str, value: Any) -> str:
    """The text of a twin.toml with one key of one table set; comments, order and every other value stay."""
    document = tomlkit.parse(text)
    if table not in document:
        document[table] = tomlkit.table()
    document[table][key] = value
    changed = tomlkit.dumps(document)
    _check_only(text, changed, table, key, value)
    return changed


def with_point(text: str, point: Mapping[str, Any]) -> str:
    """The text of a twin.toml with one more [[points]] at its end; every other line stays."""
    lines = [f"{key} = {_value(value)}" for key, value in point.items()]
    changed = "\n".join([text.rstrip("\n"), "", "[[points]]", *lines, ""])
    wanted = tomllib.loads(text)
    wanted.setdefault("points", []).append(dict(point))
    if tomllib.loads(changed) != wanted:
        raise ValueError(f"twin.toml: the point {point['name']!r} could not be added; write by hand:\n"
                         + "\n".join(["[[points]]", *lines]))  # fmt: skip
    return changed


def _check_only(old: str, new: str, table: str, key: str, value: Any) -> None:
    """Raise ValueError unless the edit set that key and changed nothing else."""
    wanted = tomllib.loads(old)
    wanted.setdefault(table, {})[key] = value
    try:
        same = tomllib.loads(new) == wanted
    except tomllib.TOMLDecodeError:
        same = False
    if not same:
        raise ValueError(
            f"twin.toml: [{table}] {key} could not be set; write {key} = {_value(value)} by hand"
        )


# -- writing ------------------------------------------------------------------------------------------


def _table(path: str, table: BaseModel, *, item: int | None = None) -> list[str]:
    """The lines of a table and of the tables in it; of an array only the first item has comments."""
    plain, inner = [], []
    for key, field in type(table).model_fields.items():
        value = getattr(table, key)
        if isinstance(value, BaseModel):
            inner += _table(f"{path}.{key}", value)
        elif isinstance(value, tuple) and value and isinstance(value[0], BaseModel):
            inner += _tables(f"{path}.{key}", value)
        elif value is None and (absent := _inner(type(table), key)) is not None:
            inner += [] if path == "cameras" else _absent(f"{path}.{key}", absent)
        elif not (path == "frame" and key == "markers"):
            plain.append(_line(key, value, field, first=not item))
    head = [] if not plain else ["", f"[{path}]" if item is None else f"[[{path}]]"]
    return head + plain + inner


def _absent(path: str, table: type[BaseModel]) -> list[str]:
    """A table that is not stated, in comments: its keys with their defaults."""
    head, *lines = _table(path, table())[1:]
    about = (table.__doc__ or "").strip().splitlines()[0]
    return ["", f"# {head}  # {about}", *(f"# {line}" for line in lines)]


def _tables(path: str, items: Sequence[BaseModel]) -> list[str]:
    """The lines of an array of tables."""
    return [line for number, item in enumerate(items) for line in _table(path, item, item=number)]


def _line(key: str, value: Any, field: FieldInfo, *, first: bool) -> str:
    comment = f"  # {field.description}" if field.description and first else ""
    return f"# {key} = ...{comment}" if value is None else f"{key} = {_value(value)}{comment}"


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {_value(item)}" for key, item in value.items()) + "}"
    if isinstance(value, tuple | list):
        return "[" + ", ".join(_value(item) for item in value) + "]"
    return repr(value)


# -- errors -------------------------------------------------------------------------------------------


def _sentence(error: ValidationError) -> str:
    """The first error as one sentence, and how many more there are."""
    first, more = error.errors()[0], error.error_count() - 1
    return _problem(first) + (f" (and {more} more)" if more else "")


def _problem(error: Any) -> str:
    where, kind, message = error["loc"], error["type"], error["msg"]
    if kind == "value_error":
        text = message.removeprefix("Value error, ")
        of_value = where and _field(where) and not isinstance(error["input"], dict)  # a table names its keys
        return f"{_key(where)} = {error['input']!r}: {text}" if of_value else text
    key, field = _key(where), _field(where)
    about = f" ({field.description})" if field is not None and field.description else ""
    if kind == "extra_forbidden":
        return _unknown(where)
    if kind == "missing":
        return f"{key} is missing{about}; add it"
    wanted = message.replace("Input should", "it should", 1)
    return f"{key} = {_short(error['input'])}: {wanted[0].lower()}{wanted[1:]}{about}{_example(where, field)}"


def _unknown(where: tuple[str | int, ...]) -> str:
    """The sentence for a key that does not exist, with the nearest one that does."""
    keys = list(_model(where[:-1]).model_fields)
    near = get_close_matches(str(where[-1]), keys, n=1, cutoff=0.5)
    hint = f"did you mean {near[0]!r}?" if near else f"known here: {', '.join(keys)}"
    return f"{_key(where)} is not a known key; {hint}"


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _example(where: tuple[str | int, ...], field: FieldInfo | None) -> str:
    default = field.get_default() if field is not None and not field.is_required() else None
    key = [part for part in where if isinstance(part, str)][-1]
    return f"; for example {key} = {_value(default)}" if isinstance(default, str | int | float) else ""


def _key(where: tuple[str | int, ...]) -> str:
    """The name cameras[1].film for its location, counted from 1 as a person does."""
    parts = "".join(f"[{part + 1}]" if isinstance(part, int) else f".{part}" for part in where)
    return parts.removeprefix(".")


def _models(where: tuple[str | int, ...]) -> Iterator[tuple[type[BaseModel], str]]:
    """Each table on the way to a location with the key taken there."""
    model: type[BaseModel] | None = Config
    for part in where:
        if isinstance(part, str) and model is not None:
            yield model, part
            model = _inner(model, part)


def _inner(model: type[BaseModel], key: str) -> type[BaseModel] | None:
    """The table under a key: its type itself, or the one that an optional or an array holds."""
    if key not in model.model_fields:
        return None
    found = [model.model_fields[key].annotation]
    while found:
        kind = found.pop(0)
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            return kind
        found += get_args(kind)
    return None


def _model(where: tuple[str | int, ...]) -> type[BaseModel]:
    """The table at a location."""
    model: type[BaseModel] = Config
    for parent, key in _models(where):
        model = _inner(parent, key) or parent
    return model


def _field(where: tuple[str | int, ...]) -> FieldInfo | None:
    """The field that a location lies in: bounds for calibrate.bounds.C10[1]."""
    field = None
    for model, key in _models(where):
        field = model.model_fields.get(key, field)
    return field
