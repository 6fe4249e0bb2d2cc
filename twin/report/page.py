"""Turns facts into one self-contained HTML page. It computes nothing: every number comes in, as it is."""

import base64
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup

from twin.numerals import correlation, interval, probability, short, value
from twin.project import files

TEMPLATE = Path(__file__).with_name("report.html")


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
    errors       {before_mm, after_mm, noise_mm, before_note, after_note, noise_note}
    named        [{effect, text, note, parameters: [{name, value, low, high, unit, note}]}], low to high: 95 %
    evidence     what evidence.json holds, and branches [name], table [{marker, cells: [share or None]}]
    held_out     [{film, before_mm, after_mm, ratio, noise_mm}], films that no fit has seen
    study        {sentences, rows: [{name, here, published}], starts, known, readings: [{within, rows}],
                 plans: of study.json,
                 pictures: as below}
    ranking      [{effect, delta_bic, z, p_value, note, named (bool)}], best first
    ties         [[effect, ...], ...]
    next_test    sentence
    cannot_tell  [sentence, ...]
    calibration  {parameters: as above, sentence (what can be identified)}
    earlier      {batches: [name], rows: [{name, unit, cells: [text], changed (bool)}], beside (name),
                 sentences}, the constants beside those of earlier batches, the last column this batch's
    budget       {markers: [name], rows: [{source, um: [1 sd of each marker], remedy}]}
    chain        [{name, value, unit, note}], the measurement: reprojection RMS, noise, lost markers, ...
    pictures     [{title, caption, half (bool: two beside each other), svg (text) or png (path or bytes),
                 place: top, where, evidence or, without one, more}]
    notes        [sentence, ...]
    provenance   {name: text}, versions, seed, digests
    commands     [text, ...]
    ValueError for a picture that has neither svg nor png, and for a fact or a place of another name.
    """
    unknown = set(facts) - FACTS
    if unknown:
        raise ValueError(f"the report knows no fact {min(unknown)!r}; it knows {', '.join(sorted(FACTS))}")
    strange = {picture.get("place", PLACES[-1]) for picture in facts.get("pictures") or []} - set(PLACES)
    if strange:
        raise ValueError(f"the report knows no place {min(strange)!r}; it knows {', '.join(PLACES)}")
    page = jinja2.Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True)
    page.filters |= FILTERS
    return page.from_string(TEMPLATE.read_text(encoding="utf-8")).render(title=title, facts=facts)


def _notes(rows: Iterable[Mapping[str, Any]]) -> list[str]:
    """What is noted of parameters, each note once: with their names, unless it is noted of all."""
    rows = list(rows)
    notes = dict.fromkeys(row["note"] for row in rows if row.get("note"))
    named = {note: [row["name"] for row in rows if row.get("note") == note] for note in notes}
    return [n if len(own) == len(rows) else f"{', '.join(own)}: {n}" for n, own in named.items()]


def _at(pictures: Iterable[Mapping[str, Any]] | None, place: str) -> list[Mapping[str, Any]]:
    """The pictures of one place of the page."""
    return [p for p in pictures or [] if p.get("place", PLACES[-1]) == place]


def _groups(pictures: Iterable[Mapping[str, Any]] | None) -> list[list[Mapping[str, Any]]]:
    """Pictures as rows of the page: halves in a row stand beside each other, two by two."""
    rows: list[list[Mapping[str, Any]]] = []
    for picture in pictures or []:
        if picture.get("half") and rows and len(rows[-1]) == 1 and rows[-1][0].get("half"):
            rows[-1].append(picture)
        else:
            rows.append([picture])
    return rows


def _drawing(picture: Mapping[str, Any]) -> Markup:
    """A picture inside the page: SVG as elements, PNG as a data address. Our own plots, so not escaped."""
    if picture.get("svg"):
        return Markup(picture["svg"])
    if picture.get("png") is None:
        raise ValueError(f"the picture {picture.get('title')!r} has neither svg nor png; give one of them")
    data = picture["png"] if isinstance(picture["png"], bytes) else Path(picture["png"]).read_bytes()
    text = base64.b64encode(data).decode("ascii")
    return Markup('<img alt="{}" src="data:image/png;base64,{}">').format(picture.get("title", ""), text)


FACTS = frozenset(
    {"headline", "summary", "date", "errors", "named", "ranking", "ties", "next_test", "cannot_tell"}
    | {"study", "evidence", "calibration", "chain", "pictures", "notes", "provenance", "commands"}
    | {"where", "mechanism", "budget", "earlier", "held_out"}
)
PLACES = ("top", "where", "held_out", "evidence", "more")  # of pictures, in the order of the page
FILTERS = {
    "short": lambda x: short(None if isinstance(x, jinja2.Undefined) else x),
    "interval": interval,
    "value": value,
    "probability": probability,
    "correlation": correlation,
    "notes": _notes,
    "groups": _groups,
    "at": _at,
    "drawing": _drawing,
}
