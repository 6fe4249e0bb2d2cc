"""A page of sentences, pictures and tables in the look of the report: several batches, or two models."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup

from twin.report.page import FILTERS, TEMPLATE, Picture

TABLES = Path(__file__).with_name("tables.html")


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
