"""Makes docs/twin-toml.md and the tables of docs/effects.md from the program itself.

    python docs/make_reference.py

Run it after a key of twin.toml or an effect of the library has changed; `tests/test_docs.py` compares.
"""

import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

DOCS = Path(__file__).resolve().parent
sys.path.insert(0, str(DOCS.parent))

from calibrate import Parameter  # noqa: E402
from twin.effects.library import all_effects, on_request  # noqa: E402
from twin.effects.protocol import Effect  # noqa: E402
from twin.project.config import Config  # noqa: E402

Schema = Mapping[str, Any]

INTRO = """# Which keys does twin.toml have?

`twin init` writes this file with every key, its unit and its meaning; you fill it in. `twin check` reads it and says what is wrong
or missing. A key that does not exist is an error, and the message names the nearest one. Paths are relative to the project folder.
World axes: x along the finger from the clamp, y across the width, z up. Step by step: [your-own-test.md](your-own-test.md).

The shortest one is for displacements that were measured elsewhere and lie in `targets/` ([files.md](files.md)):

```toml
[[points]]
name = "tip"
node = 4401

[calibrate]
objective_points = ["tip"]
```

*needed* in the column "default" means that the key must stand there. A table with double brackets may stand several times.

*This page is made by* `python docs/make_reference.py`.
"""
WHAT = {
    "project": "The batch.",
    "model": "What is computed.",
    "cameras": "One for each camera. Without any, the targets were measured elsewhere.",
    "cameras.board": "The calibration board; the same for all cameras.",
    "pressure": "The pressure log. Needed with a film.",
    "measure": "How well things are known. Every sd here becomes a part of the stated error.",
    "frame.markers": "Markers on the rig, which do not move.",
    "points": "Markers on the finger, and the nodes that they show.",
    "dic": "A speckled part of the side face, in place of markers or beside them.",
    "calibrate": "The fit of the material.",
    "diagnose": "The search for what is missing.",
    "study": "For targets whose source contradicts itself.",
}  # fmt: skip
KINDS = {"string": "text", "integer": "whole number", "number": "number", "boolean": "true or false"}


def twin_toml() -> str:
    """The page docs/twin-toml.md."""
    schema = Config.model_json_schema()
    rows = list(_tables(schema, schema["$defs"], at=""))
    return INTRO + "".join(_table(at, repeats, keys) for at, repeats, keys in rows)


def _tables(schema: Schema, defined: Schema, *, at: str) -> Any:
    """Every table of the file in its order: name, whether it repeats, its keys with their schema."""
    for key, field in schema["properties"].items():
        name, inner = at + key, _inner(field)
        if inner is None:
            continue
        table = defined[inner]
        plain = {k: f for k, f in table["properties"].items() if _inner(f) is None}
        if plain:
            needed = set(table.get("required", ()))
            yield name, '"array"' in str(field).replace("'", '"'), {k: (f, k in needed) for k, f in plain.items()}
        yield from _tables(table, defined, at=f"{name}.")


def _inner(field: Schema) -> str | None:
    """The name of the table that a key holds, None where it holds a value."""
    found = re.search(r"#/\$defs/(\w+)", str(field))
    return found[1] if found else None


def _table(name: str, repeats: bool, keys: Mapping[str, tuple[Schema, bool]]) -> str:
    head = f"[[{name}]]" if repeats else f"[{name}]"
    lines = [f"\n## {head}", f"{WHAT[name]}\n", "| key | value | default | meaning |", "|---|---|---|---|"]
    for key, (field, needed) in keys.items():
        default = "needed" if needed else _default(field.get("default"))
        lines.append(f"| `{key}` | {_value(field)} | {default} | {field.get('description', '')} |")
    return "\n".join(lines) + "\n"


def _value(field: Schema) -> str:
    """What a key takes, in words."""
    options = [o for o in field.get("anyOf", [field]) if o.get("type") != "null"]
    return " or ".join(_one(o) for o in options)


def _one(field: Schema) -> str:
    if "enum" in field:
        return ", ".join(f"`{_literal(v)}`" for v in field["enum"])
    if "const" in field:
        return f"`{_literal(field['const'])}`"
    if "prefixItems" in field:
        return f"{len(field['prefixItems'])} numbers"
    if field.get("type") == "array":
        return f"list of {_one(field['items'])}s"
    if field.get("type") == "object":
        return f"table of {_value(field['additionalProperties'])} by name"
    return KINDS[field["type"]] + _limits(field)


def _limits(field: Schema) -> str:
    signs = {"minimum": ">=", "exclusiveMinimum": ">", "maximum": "<=", "exclusiveMaximum": "<"}
    parts = [f"{sign} {field[key]:g}" for key, sign in signs.items() if key in field]
    return f" {', '.join(parts)}" if parts else ""


def _default(value: Any) -> str:
    return "none" if value is None or value in ([], {}, ()) else f"`{_literal(value)}`"


def _literal(value: Any) -> str:
    """A value as TOML writes it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, list | tuple):
        return f"[{', '.join(_literal(v) for v in value)}]"
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{k} = {_literal(v)}" for k, v in value.items()) + "}"
    return f"{value:g}" if isinstance(value, float) else str(value)


# -- effects --------------------------------------------------------------------------------------------------


def effect_tables() -> str:
    """One section an effect: its sentence, its labels, what it needs, its parameters."""
    return "\n".join(_section(label, effects) for label, effects in _by_name().items())


def _by_name() -> dict[str, list[Effect]]:
    """The laws of every effect, from narrow to wide, by its name."""
    found: dict[str, list[Effect]] = {}
    for effect in (*all_effects(), *on_request()):
        law: Effect | None = effect
        while law is not None:
            found.setdefault(law.name, []).append(law)
            law = law.wider()
    return found


def _section(name: str, laws: list[Effect]) -> str:
    sentence = laws[0].sentence
    lines = [f"### {name}", f"{sentence[:1].upper()}{sentence[1:]}.\n"]
    if len(laws) > 1:
        lines.append(f"Laws: {', '.join(f'`{law.label}`' for law in laws)}.\n")
    if laws[0].requires:
        lines.append(f"Needs in the data: {', '.join(_need(need) for need in laws[0].requires)}.\n")
    lines += ["| parameter | unit | bounds | without the effect |", "|---|---|---|---|"]
    return "\n".join([*lines, *(_parameter(p) for p in laws[-1].parameters)]) + "\n"


def _need(need: Any) -> str:
    return NEEDS[str(getattr(need, "value", need))]


NEEDS = {
    "history": "a dense pressure log (targets/pressure.csv)",
    "unloading": "steps while the pressure falls",
    "gravity": "the direction of gravity",
}


def _parameter(p: Parameter) -> str:
    null = "not defined" if p.null is None else f"{p.null:g}"
    return f"| `{p.name}` | {p.unit or '-'} | {p.low:g} to {p.high:g} | {null} |"


BEGIN, END = "<!-- made by docs/make_reference.py -->", "<!-- end -->"


def with_effects(page: str) -> str:
    """The page docs/effects.md with the part between its two marks made anew."""
    before, _, rest = page.partition(BEGIN)
    return f"{before}{BEGIN}\n\n{effect_tables()}\n{END}{rest.partition(END)[2]}"


def main() -> None:
    (DOCS / "twin-toml.md").write_text(twin_toml(), encoding="utf-8")
    page = DOCS / "effects.md"
    page.write_text(with_effects(page.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    main()
