"""Turn the text of twin.toml into a configuration and back, with errors and comments for a person."""

import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import tomlkit
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from twin import files
from twin.bodies.kinds import BODIES
from twin.project.config import FORMER, Config, with_first_film, with_join, with_recordings
from twin.tablemodel import keys_of
from twin.validation import checked, table_of, tables_of, value_text


def parse(data: bytes, *, name: str) -> Config:
    """The configuration in a file's bytes; ValueError is one sentence that begins with its name."""
    tables = with_join(with_first_film(_without_former(tables_of(data, name=name))))
    try:
        return checked(Config, with_recordings(tables), name=name)
    except ValueError as error:
        if isinstance(tables.get("import"), dict):  # [import], of one recording
            raise ValueError(str(error).replace("import[1].", "import.")) from None
        raise


def former_keys(data: bytes) -> list[str]:
    """The keys of a twin.toml that older versions had and that change nothing, such as model.geometry."""
    tables = tables_of(data, name="twin.toml")
    return [f"{name}.{key}" for name, keys in FORMER.items() for key in keys if key in _keys(tables, name)]


def _keys(tables: dict[str, Any], name: str) -> dict[str, Any]:
    table = tables.get(name)
    return table if isinstance(table, dict) else {}


def _without_former(tables: dict[str, Any]) -> dict[str, Any]:
    current = dict(tables)
    for name, keys in FORMER.items():
        if isinstance(tables.get(name), dict):
            current[name] = {key: value for key, value in tables[name].items() if key not in keys}
    return current


def dump(config: Config) -> str:
    """A complete twin.toml: every key with its meaning and unit, what is optional commented out."""
    lines = [
        "# A softtwin project. Units: mm, MPa, s. World axes: x along the finger from the clamp,",
        "# y across the width, z up. Paths are relative to this folder. `twin check` says what is missing.",
    ]
    for key, (name, _) in keys_of(Config).items():
        value = getattr(config, name)
        if key == "frame" and not (config.cameras or value.markers):
            continue  # of a film alone
        if isinstance(value, BaseModel):
            lines += _table(key, value)
        elif value is not None and key == "import" and len(value) == 1:
            lines += _table(key, value[0])
        elif value is not None:
            lines += _tables(key, value)
    if not config.cameras and not config.imports:
        lines += ["", "# There is no [[cameras]]: the targets were measured elsewhere and lie in targets/."]
    return "\n".join(lines) + "\n"


def write(path: Path, text: str, *, name: str = "twin.toml") -> Config:
    """The configuration in a text, which replaces the file. ValueError where the text cannot be read again;
    the file then stays."""
    config = parse(text.encode(), name=name)
    files.write_text(path, text)
    return config


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
    lines = [f"{key} = {value_text(value)}" for key, value in point.items()]
    changed = "\n".join([text.rstrip("\n"), "", "[[points]]", *lines, ""])
    expected = tomllib.loads(text)
    expected.setdefault("points", []).append(dict(point))
    if tomllib.loads(changed) != expected:
        raise ValueError(f"twin.toml: the point {point['name']!r} could not be added; write by hand:\n"
                         + "\n".join(["[[points]]", *lines]))  # fmt: skip
    return changed


def _check_only(old: str, new: str, table: str, key: str, value: Any) -> None:
    """Raise ValueError unless the edit set that key and changed nothing else."""
    expected = tomllib.loads(old)
    expected.setdefault(table, {})[key] = value
    try:
        same = tomllib.loads(new) == expected
    except tomllib.TOMLDecodeError:
        same = False
    if not same:
        raise ValueError(
            f"twin.toml: [{table}] {key} could not be set; write {key} = {value_text(value)} by hand"
        )


# -- writing ------------------------------------------------------------------------------------------


def _table(path: str, table: BaseModel, *, item: int | None = None) -> list[str]:
    """The lines of a table and of the tables in it; of an array only the first item has comments."""
    plain, inner = [], []
    for key, field in type(table).model_fields.items():
        value = getattr(table, key)
        if isinstance(value, BaseModel):
            inner += _table(f"{path}.{key}", value)
        elif key == "markers" and getattr(table, "sheet", None) is not None:
            continue  # they stand in the sheet's file
        elif isinstance(value, tuple) and value and isinstance(value[0], BaseModel):
            inner += _tables(f"{path}.{key}", value)
        elif value is None and (absent := table_of(type(table), key)) is not None:
            other_body = key in BODIES and key != getattr(table, "kind", key)
            inner += [] if path == "cameras" or other_body else _absent(f"{path}.{key}", absent)
        elif not (path == "frame" and key == "markers"):
            plain.append(_line(field.alias or key, value, field, commented=not item))
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


def _line(key: str, value: Any, field: FieldInfo, *, commented: bool) -> str:
    comment = f"  # {field.description}" if field.description and commented else ""
    return f"# {key} = ...{comment}" if value is None else f"{key} = {value_text(value)}{comment}"
