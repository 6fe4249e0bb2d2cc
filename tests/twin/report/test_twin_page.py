"""The report page: every fact given stands in it, text is escaped, nothing is fetched from elsewhere."""

import base64
import re
from pathlib import Path

import pytest

from tests.strangers.pages import BAD, FACTS, LIVE, SVG, figures, live, parsed, spoilt
from twin.numerals import interval, probability, short, value
from twin.report.page import Picture, render, table_page, write_report

WANTED = (
    *("batch-07", "The finger creeps.", "Four times the noise before.", "2026-11-21", "4.2 times the noise"),
    *("0.212 mm", "0.0531 mm", "0.0602 mm", "creep", "one term", "wrong law", "0.0341", "0.0331 to 0.0351"),
    *("MPa/MPa", "10,043", "9,876", "behind the best", "101", "&lt; 1e-99", "412", "20.1", "3.2e-80", "one orientation", "named"),
    *("clamp or pressure_gain", "Film it upside down.", "C10 and C01 are one number.", "C10 + C01"),
    *("0.2971", "0.2962 to 0.2980", "Only the sum is known.", "0.142 px", "18 images", "reprojection RMS"),
    *("What speaks for creep:2", "0.212", "0.0529", "5,123", "403", "2 more parameters", "each cycle from the others"),
    *("3.14", "1.07", "creep.g1 = 0.0351: plausible (0.003 to 0.2)", "lag (33.1 %)", "tip&lt;", ">87<", "hold"),
    *("It fails most at marker tip.", "The silicone keeps moving.", "placement", "314", "340", "use a jig", "Left over"),
    *("Map", "in sd", "Finger", "Ridge", "no second camera", "sha256 3f9a12", "twin diagnose", "iVBORw0KGgo"),
)


@pytest.mark.parametrize("text", WANTED)
def test_every_fact_stands_in_the_page(text: str) -> None:
    assert text in render(title="batch-07", facts=FACTS)


def test_the_page_is_well_formed_and_loads_nothing() -> None:
    page = render(title="batch-07", facts=FACTS)
    tags = parsed(page)
    assert tags.open == []
    assert [source for source in tags.loads if not source.startswith(("data:image/png;base64,", "data:image/svg+xml;base64,"))] == []
    assert len(tags.loads) == 5
    assert not re.search(r"@import|url\(|https?://", page)


@pytest.mark.parametrize("key", sorted(FACTS))
def test_each_fact_may_be_absent_or_stand_alone(key: str) -> None:
    without = {name: fact for name, fact in FACTS.items() if name != key}
    for facts in (without, {key: FACTS[key]}, {key: None}):
        page = render(title="batch-07", facts=facts)
        assert parsed(page).open == []
        assert "None" not in page
        assert "Undefined" not in page


@pytest.mark.parametrize("key", sorted(FACTS))
def test_every_text_is_escaped(key: str) -> None:
    page = render(title=BAD, facts={key: spoilt(FACTS[key])})
    assert "<script" not in page
    assert page.count("&lt;script&gt;") > 1  # of the title, and of the fact
    assert parsed(page).open == []


def test_every_text_of_a_page_of_tables_is_escaped() -> None:
    tables = [{"title": BAD, "head": [BAD], "rows": [{"cells": [BAD], "named": True}], "note": BAD}]
    page = table_page(BAD, headline=BAD, sentences=[BAD], tables=tables, pictures=[Picture(title=BAD, caption=BAD, svg=SVG)])
    assert "<script" not in page
    assert page.count("&lt;script&gt;") == 11
    assert parsed(page).open == []


def test_a_drawing_is_an_image_so_nothing_in_it_runs_or_loads() -> None:
    picture = Picture(title='"><script>alert(3)</script>', svg=LIVE)
    table = table_page("t", headline="h", sentences=[], tables=[], pictures=[picture])
    for page in (render(title="t", facts={"pictures": [picture]}), render(title="t", facts={"study": {"pictures": [picture], "known": {}}}), table):
        assert not re.search(r"<script|<svg|evil|onload", page)
        (source,) = parsed(page).loads
        assert base64.b64decode(source.removeprefix("data:image/svg+xml;base64,")).decode() == LIVE


def test_what_would_run_or_load_is_counted() -> None:
    found = figures()
    assert found["script_run"] == 0
    assert found["script_texts"] > 100
    assert live('<p onclick="x()"><a href="javascript:x()">x</a></p><script>x()</script>') == ["javascript:x()", "script", "onclick"]


def test_halves_stand_in_pairs() -> None:
    page = render(title="t", facts={"pictures": FACTS["pictures"]})
    rows = re.findall(r'<div class="(pair)?">', page)
    assert rows == ["", "", "", "pair"]


def test_a_manager_finds_the_answer_first_and_the_digests_last() -> None:
    page = render(title="batch-07", facts=FACTS)
    order = [
        "The finger creeps.", "Four times the noise before.", "error before", "<b>Fall</b>", "Where it fails", "<b>Left over</b>",
        "What speaks for creep:2", "What these data cannot show", "Next test:", "Where the uncertainty of the measurement",
        "The calibrated twin", "<b>Map</b>", "Where this comes from",
    ]  # fmt: skip
    assert order == sorted(order, key=page.index)


def test_a_misspelt_fact_and_an_empty_picture_are_refused() -> None:
    with pytest.raises(ValueError, match="knows no fact 'rankings'"):
        render(title="t", facts={"rankings": []})
    with pytest.raises(ValueError, match="picture 'Map' has neither svg nor png"):
        Picture(title="Map")
    with pytest.raises(ValueError, match="knows no place 'side'; it knows top"):
        Picture(title="Map", svg=SVG, place="side")


def test_the_file_is_written_whole_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    write_report(path, title="batch-07", facts=FACTS)
    before = path.read_text(encoding="utf-8")
    assert before.startswith("<!doctype html>")
    with pytest.raises(ValueError, match="knows no fact"):
        write_report(path, title="batch-07", facts={"picture": []})
    assert path.read_text(encoding="utf-8") == before
    assert list(tmp_path.iterdir()) == [path]


def test_numbers_have_the_digits_that_they_deserve() -> None:
    assert [
        short(number) for number in (0.05312, 12.0, 1234.5, -0.0, 3.2e-9, -2.0, None, float("nan"), 1500)
    ] == [*("0.0531", "12", "1,234", "0", "3.20e-09", "-2", "–", "–", "1,500")]
    assert (value(143.217, 120.0, 166.0), interval(120.0, 166.0)) == ("143", "120 to 166")
    assert value(0.2, None, None) == "0.2"
    assert interval(float("nan"), 1.0) == "–"
    assert [probability(p) for p in (0.012345, 0.0, None)] == ["0.012", "< 1e-99", "–"]


def test_a_note_stands_once_and_names_the_parameters_that_it_is_of() -> None:
    def page(*notes: str) -> str:
        rows = [{"name": f"p{k}", "value": 0.1, "low": None, "high": None, "note": note} for k, note in enumerate(notes)]
        return render(title="t", facts={"calibration": {"parameters": rows}})

    assert page("no interval: x", "no interval: x").count("no interval: x") == 1
    assert "p1: ends at its bound" in page("", "ends at its bound")
    assert "class=\"note\"" not in page("", "")
