"""Turns facts into one self-contained HTML page. It computes nothing: every number comes in, as it is."""

import base64
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup

from twin import files
from twin.numerals import correlation, interval, probability, short, value

TEMPLATE, TABLES = (Path(__file__).with_name(name) for name in ("report.html", "tables.html"))


PLACES = ("top", "where", "held_out", "evidence", "more")  # of pictures, in the order of the page


@dataclass(frozen=True, kw_only=True)
class Picture:
    """A picture of a page with its title and caption: an SVG text, or a PNG as bytes or as a file; half: two
    stand beside each other. ValueError where it is neither, or for a place that no page has."""

    title: str
    caption: str = ""
    half: bool = False
    svg: str | None = None
    png: Path | bytes | None = None
    place: str = PLACES[-1]

    def __post_init__(self) -> None:
        if not self.svg and self.png is None:
            raise ValueError(f"the picture {self.title!r} has neither svg nor png; give one of them")
        if self.place not in PLACES:
            raise ValueError(f"the report knows no place {self.place!r}; it knows {', '.join(PLACES)}")


def write_report(path: Path, *, title: str, facts: Mapping[str, Any]) -> None:
    """Write the page to `path`, atomically; see `render` for the facts."""
    files.write_text(path, render(title=title, facts=facts))


def render(*, title: str, facts: Mapping[str, Any]) -> str:
    """The page as text. All facts are optional; what is absent, empty or None is left out.

    headline     the verdict in one plain sentence
    summary      the two sentences below it that a manager reads: the errors, and what to do
    where        where the model without effects fails, sentences
    mechanism    what the named effect does, sentences
    date         text
    errors       {before_mm, after_mm, expected_mm, before_note, after_note, expected_note}
    named        [{effect, text, note, parameters: [{name, value, low, high, unit, note}]}], low to high: 95 %
    evidence     what evidence.json holds, and branches [name], table [{marker, cells: [share or None]}]
    held_out     [ForetoldFilm], films that no fit has seen
    study        {sentences, rows: [{name, here, published}], starts, known, readings: [{within, rows}],
                 plans: of study.json,
                 pictures: [Picture]}
    ranking      [{effect, behind, delta_bic, z, p_value, note, named (bool)}], best first
    ties         [[effect, ...], ...]
    next_test    sentence
    cannot_tell  [sentence, ...]
    calibration  {parameters: as above, sentence (what can be identified)}
    earlier      {batches: [name], rows: [{name, unit, cells: [text], changed (bool)}], beside (name),
                 sentences}, the constants beside those of earlier batches, the last column this batch's
    budget       {markers: [name], rows: [{source, um: [1 sd of each marker], remedy}]}
    chain        [{name, value, unit, note}], the measurement: reprojection RMS, noise, lost markers, ...
    pictures     [Picture]
    notes        [sentence, ...]
    provenance   {name: text}, versions, seed, digests
    commands     [text, ...]
    ValueError for a fact of another name.
    """
    unknown = set(facts) - FACTS
    if unknown:
        raise ValueError(f"the report knows no fact {min(unknown)!r}; it knows {', '.join(sorted(FACTS))}")
    page = jinja2.Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True)
    page.filters |= FILTERS
    return page.from_string(TEMPLATE.read_text(encoding="utf-8")).render(title=title, facts=facts)


def _given(x: Any) -> Any:
    """A fact of the page, None where it is absent."""
    return None if isinstance(x, jinja2.Undefined) else x


def _notes(rows: Iterable[Mapping[str, Any]]) -> list[str]:
    """Notes on parameters, each once: with their names, unless it is noted of all."""
    rows = list(rows)
    notes = dict.fromkeys(row["note"] for row in rows if row.get("note"))
    named = {note: [row["name"] for row in rows if row.get("note") == note] for note in notes}
    return [n if len(names) == len(rows) else f"{', '.join(names)}: {n}" for n, names in named.items()]


def _at(pictures: Iterable[Picture] | None, place: str) -> list[Picture]:
    """The pictures of one place of the page."""
    return [p for p in pictures or [] if p.place == place]


def _groups(pictures: Iterable[Picture] | None) -> list[list[Picture]]:
    """Pictures as rows of the page: halves in a row stand beside each other, two by two."""
    rows: list[list[Picture]] = []
    for picture in pictures or []:
        if picture.half and rows and len(rows[-1]) == 1 and rows[-1][0].half:
            rows[-1].append(picture)
        else:
            rows.append([picture])
    return rows


def _drawing(picture: Picture) -> Markup:
    """A picture inside the page, as a data address: what stands in an image neither runs nor loads anything,
    also where a figure comes from the folder of a stranger."""
    if isinstance(picture.png, Path):
        kind, data = "png", picture.png.read_bytes()
    elif picture.png is not None:
        kind, data = "png", picture.png
    else:
        kind, data = "svg+xml", (picture.svg or "").encode()
    text = base64.b64encode(data).decode("ascii")
    return Markup('<img alt="{}" src="data:image/{};base64,{}">').format(picture.title, kind, text)


FACTS = frozenset(
    {"headline", "summary", "date", "errors", "named", "ranking", "ties", "next_test", "cannot_tell"}
    | {"study", "evidence", "calibration", "chain", "pictures", "notes", "provenance", "commands"}
    | {"where", "mechanism", "budget", "earlier", "held_out"}
)
FILTERS = {
    "short": lambda x: short(_given(x)),
    "interval": interval,
    "value": lambda x, *ends: value(_given(x), *ends),
    "probability": probability,
    "correlation": correlation,
    "notes": _notes,
    "groups": _groups,
    "at": _at,
    "drawing": _drawing,
}


# -- several batches, or two models -----------------------------------------------------------------------


def table_page(
    title: str, *, headline: str, sentences: Sequence[str], tables: Sequence[Mapping[str, Any]],
    pictures: Sequence[Picture],
) -> str:
    """The page as text, self-contained.

    tables: {title, head [text], rows [{cells [text], named (bool: stands out)}], note}.
    """
    report = TEMPLATE.read_text(encoding="utf-8")
    look = re.search(r"<style>.*?</style>", report, re.DOTALL)
    assert look is not None  # the report has a look
    page = jinja2.Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True)
    page.filters |= FILTERS
    return page.from_string(TABLES.read_text(encoding="utf-8")).render(
        title=title, headline=headline, sentences=sentences, tables=tables, pictures=pictures,
        style=Markup(look[0]),
    )  # fmt: skip
