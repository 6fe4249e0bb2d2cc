"""Makes the tables of docs/twin-toml.md, effects.md, files.md and nodes.md from the program itself, and that
of the protocols in filming.md from benchmarks/results/identify.json.

    python benchmarks/docs/reference.py

Run it after a key of twin.toml or an effect of the library has changed; `tests/test_docs.py` compares.
"""

import json
import os
import re
import sys
import textwrap
from collections.abc import Mapping
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks import ROOT

import numpy as np
from pydantic import BaseModel

from calibrate import Parameter
from fe import Finger, Material, finger_case
from twin.assets.card import AssetCard
from twin.chain import STAGES, Stage
from twin.commands.calibratelaws import LawsRecord
from twin.commands.confirm import Confirmation
from twin.commands.explore import ExploredRecord
from twin.commands.export import ModelRecord
from twin.commands.modes import VibrationsRecord
from twin.commands.pareto import ParetoRecord
from twin.commands.posterior import PosteriorRecord
from twin.commands.predict import PredictionRecord
from twin.commands.profile import ProfilesRecord
from twin.commands.ringing import RingingsRecord
from twin.diagnosis.diagnosisrecord import DiagnosisRecord
from twin.diagnosis.explanation import EvidenceRecord
from twin.effects.library import all_effects
from twin.effects.protocol import Effect
from twin.effects.requirements import MEANING
from twin.inputs.outlinechecks import OutlineRecord
from twin.judging.fitrecord import ComparisonRecord, FitRecord
from twin.project.config import Config
from twin.records import Record
from twin.study.record import Study
from twin.validation import table_of
from twin.virtual.protocols import PROTOCOLS, Protocol

DOCS = ROOT / "docs"
Schema = Mapping[str, Any]
RECORDS: tuple[type[Record], ...] = (
    FitRecord, ComparisonRecord, OutlineRecord, DiagnosisRecord, EvidenceRecord, Confirmation, ProfilesRecord,
    PosteriorRecord, LawsRecord, ParetoRecord, VibrationsRecord, RingingsRecord, ExploredRecord,
    PredictionRecord, ModelRecord, AssetCard, Study,
)  # fmt: skip
COLUMNS = 120
BEGIN, END = "<!-- made by benchmarks/docs/reference.py -->", "<!-- end -->"

WHAT = {
    "project": "The batch.",
    "model": "What is computed.",
    "model.finger": "Dimensions of your own finger of the built-in kind; without this table the reference "
    "study's. `twin look` draws it.",
    "model.pneunet": "Dimensions of a [PneuNet](bodies.md), for `body = \"pneunet\"`.",
    "model.tube": "Dimensions of a [tube](bodies.md), for `body = \"tube\"`.",
    "model.bar": "Dimensions of a [bar](bodies.md), for `body = \"bar\"`.",
    "cameras": "One for each camera. Without any, the targets were measured elsewhere.",
    "cameras.board": "The calibration board, the same for all cameras.",
    "films": "[Several films](your-own-test.md#several-films-of-one-finger) of one batch.",
    "pressure": "The pressure log. Needed with a film.",
    "material_tests": "[Tests of the silicone itself](material-tests.md), fitted beside the film.",
    "import": "Displacements from [another program](files.md#files-of-other-programs); "
    "`twin init --targets` writes this table, and one for each of "
    "[several recordings](files.md#several-recordings).",
    "import.loads": "What hangs on the body in a recording.",
    "measure": "How well things are known. Every sd is part of the stated error.",
    "frame": "The [printed sheet](your-own-test.md#2-build-the-rig) of markers round the finger; without one "
    "[[frame.markers]].",
    "frame.markers": "Markers on the rig, where no sheet has them.",
    "pose": "Where the finger stands in the axes of the frame markers. Left out with stated places: they are "
    "measured from the clamp on, and define the axes.",
    "outline": "The [outline](measuring-chain.md) of the moved finger beside the markers.",
    "points": "Points on the finger.",
    "dic": "A speckled part of the side face, in place of markers or beside them.",
    "calibrate": "The fit of the material.",
    "diagnose": "The search for what is missing.",
    "study": "What the source of the targets states of its own calibration, for `twin study`.",
}  # fmt: skip
KINDS = {"string": "text", "integer": "whole number", "number": "number", "boolean": "true/false"}


def key_lists() -> str:
    """One section a table of twin.toml: its keys with values, defaults in brackets, and meanings."""
    schema = Config.model_json_schema()
    return "\n".join(_table(*row) for row in _tables(schema, schema["$defs"], at=""))


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
            keys = {k: (f, k in needed) for k, f in plain.items()}
            yield name, field.get("type") == "array", keys
        yield from _tables(table, defined, at=f"{name}.")


def _inner(field: Schema) -> str | None:
    """The name of the table that a key holds, None where it holds a value."""
    found = re.search(r"#/\$defs/(\w+)", str(field))
    return found[1] if found else None


def _table(name: str, repeats: bool, keys: Mapping[str, tuple[Schema, bool]]) -> str:
    head = f"[[{name}]]" if repeats else f"[{name}]"
    lines = [f"## {head}", f"{WHAT[name]}\n"]
    for key, (field, needed) in keys.items():
        default = "(needed)" if needed else _default(field.get("default"))
        value = f"{_value(field)} {default}".strip()
        lines.append(_item(f"`{key}`, {value}: {field.get('description', '')}"))
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
        return f"list of {_one(field['items']).removesuffix('s')}s"
    if field.get("type") == "object":
        return f"table of {_value(field['additionalProperties'])} by name"
    if field["type"] == "number" and "exclusiveMinimum" in field:
        return "positive number"
    return KINDS[field["type"]] + _limits(field)


def _limits(field: Schema) -> str:
    signs = {"minimum": ">=", "exclusiveMinimum": ">", "maximum": "<=", "exclusiveMaximum": "<"}
    parts = [f"{sign} {field[key]:g}" for key, sign in signs.items() if key in field]
    return f" {', '.join(parts)}" if parts else ""


def _default(value: Any) -> str:
    """The default in brackets; "" where a key has none."""
    return "" if value is None or value in ([], {}, ()) else f"(`{_literal(value)}`)"


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
    return repr(value)


# -- effects -----------------------------------------------------------------------------------------------


def effect_tables() -> str:
    """One section an effect: its sentence, its laws, what it needs, its picture; then all parameters."""
    sections = "\n".join(_section(effect) for effect in all_effects())
    rows = [_parameter(p) for effect in all_effects() for p in effect.laws()[-1].parameters]
    table = ["| parameter | unit | bounds | plausible |", "|---|---|---|---|", *rows]
    return "\n".join([sections, "## Parameters", *table]) + "\n"


def _section(effect: Effect) -> str:
    name, laws = effect.name, effect.laws()
    about = [_sentence(effect.sentence)]
    about += [f"Laws: {', '.join(f'`{law.label}`' for law in laws)}."] * (len(laws) > 1)
    about += [_sentence(MEANING[need][1]) for need in effect.requires]
    lines = [f"### {name}", " ".join(about), "", f"![{name}](pictures/effects/{name}.png)"]
    return "\n".join(lines) + "\n"


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}."


def _parameter(p: Parameter) -> str:
    likely = _range(*p.plausible) if p.plausible else "-"
    return f"| `{p.name}` | {p.unit or '-'} | {_range(p.low, p.high)} | {likely} |"


NO_BOUND = 1e4  # a bound as large as this keeps nothing out: it is there because a search needs one


def _range(low: float, high: float) -> str:
    """A range for people: "any" where its bounds keep nothing out, and 5e-9, not 5e-09."""
    if high >= NO_BOUND:
        return "any"
    return re.sub(r"e-0(?=\d)", "e-", f"{low:g} to {high:g}")


# -- nodes -------------------------------------------------------------------------------------------------


def node_table() -> str:
    """Where markers may sit on the built-in finger: x and node label, six pairs a line."""
    cells = [f"{x:.2f} | {label}" for x, label in edge_nodes()]
    width = 6
    cells += [" | "] * (-len(cells) % width)
    head = ["| " + " | ".join(["x mm | node"] * width) + " |", "|" + "---|" * 2 * width]
    rows = [cells[i : i + width] for i in range(0, len(cells), width)]
    return "\n".join([*head, *("| " + " | ".join(row) + " |" for row in rows)]) + "\n"


def edge_nodes() -> list[tuple[float, int]]:
    """x (mm) and label of the nodes at ends and quarters of the bellows, on the side face's lower edge."""
    case, finger = finger_case(Material(0.214, 0.083)), Finger()
    on = np.flatnonzero(
        np.isclose(case.nodes[:, 1], finger.width / 2) & np.isclose(case.nodes[:, 2], 0.0, atol=1e-9)
    )
    start, end = finger.base_cap, finger.length - finger.tip_cap
    wanted = [*np.linspace(start, end, 4 * finger.bellows + 1), finger.length]
    rows = [on[np.argmin(np.abs(case.nodes[on, 0] - x))] for x in wanted]
    return [(float(case.nodes[r, 0]), int(case.labels[r])) for r in rows]


# -- commands ----------------------------------------------------------------------------------------------


def command_table() -> str:
    """What files every command that runs on a project reads and writes."""
    head = ["| command | reads | writes |", "|---|---|---|"]
    return "\n".join([*head, *(_command(stage) for stage in STAGES)]) + "\n"


def _command(stage: Stage) -> str:
    files = ([name for name in stage.reads if not name.startswith("[")], stage.writes)
    reads, writes = (", ".join(f"`{name}`" for name in names) for names in files)
    return f"| `twin {stage.name}` | {reads} | {writes} |"


# -- records -----------------------------------------------------------------------------------------------


def record_lists() -> str:
    """The keys of every record that a run writes, as its model describes them."""
    return "\n".join(_record(model) for model in RECORDS)


def _record(model: type[Record]) -> str:
    rows = (f"{keys}: {text}" if text else keys for keys, text in _rows(model))
    return "\n".join([f"**{model.file}**", "", *map(_item, rows)]) + "\n"


def _item(text: str) -> str:
    """One row of a list, its lines no longer than those of the page."""
    return textwrap.fill(
        f"- {text}", COLUMNS, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False
    )


def _rows(model: type[Record]) -> list[tuple[str, str]]:
    """Keys and what they mean; a key without a description shares the row above it."""
    rows: list[tuple[list[str], str]] = []
    said: set[str] = set()
    seen: dict[type, str] = {}
    for name, field in model.model_fields.items():
        if field.exclude:
            continue
        key, inner = f"`{field.serialization_alias or name}`", table_of(model, name)
        shown = inner is not None and issubclass(inner, Record) and not inner.file
        each = f": {', '.join(_inside(inner, said, seen, key))}" if shown and inner is not None else ""
        if rows and not field.description and not each:
            rows[-1][0].append(key)
        else:
            rows.append(([key], f"{field.description or ''}{each}"))
    return [(", ".join(keys), text) for keys, text in rows]


def _inside(model: type[BaseModel], said: set[str], seen: dict[type, str], key: str) -> list[str]:
    """The keys of one of the rows that a key holds; what was said of one before is not said again."""
    kinds = [kind for kind in model.__mro__ if issubclass(kind, Record) and kind.model_fields]
    former = next((kind for kind in kinds if kind in seen), None)
    known = set(former.model_fields) if former else set()
    fields = model.model_fields.items()
    about = {name: f.description or "" for name, f in fields if not f.exclude and name not in known}
    cells = [
        f"`{name}` ({text})" if text and text not in said else f"`{name}`" for name, text in about.items()
    ]
    said |= set(about.values())
    cells[:0] = [f"as {seen[former]}"] if former else []
    seen.update({kind: key for kind in kinds if kind not in seen})
    return cells


# -- protocols ---------------------------------------------------------------------------------------------


def protocol_table() -> str:
    """What each protocol films, and how often a diagnosis of it was right."""
    rates = json.loads((ROOT / "benchmarks" / "results" / "identify.json").read_text(encoding="utf-8"))
    told = "same law: holds it; names | another law: holds it; names"
    head = [f"| | markers | pressure | {told} |", "|---|---|---|---|---|"]
    rows = (_protocol(p, rates.get(p.name, {})) for p in PROTOCOLS.values())
    return "\n".join([*head, *rows]) + "\n"


def _protocol(p: Protocol, rates: Mapping[str, Any]) -> str:
    markers = "the tip" if p.along == 1 else f"{p.along} along the edge"
    markers += f", {p.off_axis} off the axis, {p.fixed} fixed on the rig" if p.fixed else ""
    course = "one ramp" if p.ramp else "two cycles at two rates, with holds"
    course = "a slow rise, then two fast steps" if p.fast else course
    course += f", in {p.recordings} orientations" if p.recordings > 1 else ""
    course += "; the finger is weighed" if p.weighed else ""
    return f"| {p.name} | {markers} | {course} | {_right(rates.get('same'))} | {_right(rates.get('other'))} |"


def _right(rate: Mapping[str, Any] | None) -> str:
    """How many trials have a verdict that holds what was hidden, of how many; the mean size of a verdict."""
    if rate is None or not rate["n"]:
        return "-"
    return f"{round(rate['in_set'] * rate['n'])} of {rate['n']}; {rate['set_size']:.1f}"


# -- pages -------------------------------------------------------------------------------------------------


def renewed(page: str, *made: str) -> str:
    """A page with the parts between its pairs of marks replaced, in their order."""
    if not made:
        return page
    before, _, rest = page.partition(BEGIN)
    return f"{before}{BEGIN}\n\n{made[0]}\n{END}{renewed(rest.partition(END)[2], *made[1:])}"


def pages() -> dict[str, str]:
    """The text of every page that is made, by its name in docs/."""
    made = {
        "twin-toml.md": (key_lists(),), "effects.md": (effect_tables(),), "nodes.md": (node_table(),),
        "files.md": (command_table(), record_lists()), "filming.md": (protocol_table(),),
    }  # fmt: skip
    return {name: renewed((DOCS / name).read_text(encoding="utf-8"), *parts) for name, parts in made.items()}


def main() -> None:
    for name, text in pages().items():
        (DOCS / name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
