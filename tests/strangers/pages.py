"""A page in which a stranger's folder has put a script in place of every text and into every drawing.

`script_texts`: texts and drawings that are put into pages; `script_run`: of these pages' elements, those that
run or load something.
"""

import re
from html.parser import HTMLParser
from typing import Any

from twin.report.page import Picture, render, table_page

PNG = b"\x89PNG\r\n\x1a\n" + bytes(8)
SVG = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 1 1"><path d="M0 0"/></svg>'
FACTS = {
    "where": "It fails most at marker tip.",
    "mechanism": "The silicone keeps moving.",
    "budget": {"markers": ["tip<"], "rows": [{"source": "placement", "um": [313.7], "remedy": "use a jig"}, {"source": "all", "um": [340.2]}]},
    "headline": "The finger creeps.",
    "summary": "Four times the noise before.",
    "date": "2026-11-21",
    "errors": {
        "before_mm": 0.2123,
        "after_mm": 0.0531,
        "expected_mm": 0.0602,
        "before_note": "4.2 times the noise",
    },
    "named": [
        {
            "effect": "creep",
            "text": "one term",
            "note": "wrong law",
            "parameters": [
                {"name": "g", "value": 0.03412, "low": 0.03313, "high": 0.03508, "unit": "MPa/MPa"}
            ],
        }
    ],
    "evidence": {
        "effect": "creep:2", "raw_rms_before_mm": 0.4127, "raw_rms_after_mm": 0.1561, "expected_mm": 0.2843,
        "rms_before_mm": 0.2119, "rms_after_mm": 0.0529, "noise_sd_mm": 0.0501,
        "chi2_before": 5123.0, "chi2_after": 403.0, "more_parameters": 2,
        "held_out": {"left_out": "cycle", "folds": 2, "before_sd": 3.14, "after_sd": 1.07},
        "parameters": {"creep.g1": {"value": 0.0351, "low": None, "high": None, "unit": "", "plausible": "plausible (0.003 to 0.2)"}},
        "class": [{"effect": "lag", "ceiling": 0.331}], "branches": ["hold", "all"],
        "table": [{"marker": "tip<", "cells": [{"explained": 0.873, "before_mm": 0.3, "after_mm": 0.1}, None]}],
    },
    "ranking": [
        {
            "effect": "creep",
            "delta_bic": 10043.0,
            "behind": 9876.0,
            "z": 101.25,
            "p_value": 0.0,
            "named": True,
            "note": "named",
        },
        {"effect": "pressure_lag", "delta_bic": 412.4, "z": 20.1, "p_value": 3.2e-80},
        {
            "effect": "gravity",
            "delta_bic": None,
            "z": float("nan"),
            "p_value": None,
            "note": "one orientation",
        },
    ],
    "ties": [["clamp", "pressure_gain"]],
    "next_test": "Film it upside down.",
    "cannot_tell": ["C10 and C01 are one number."],
    "calibration": {
        "parameters": [{"name": "C10 + C01", "value": 0.29714, "low": 0.2962, "high": 0.298, "unit": "MPa"}],
        "sentence": "Only the sum is known.",
    },
    "chain": [{"name": "reprojection RMS", "value": 0.1423, "unit": "px", "note": "18 images"}],
    "pictures": [
        Picture(title="Fall", svg=SVG, place="top"),
        Picture(title="Left over", svg=SVG, place="where"),
        Picture(title="Map", caption="in sd", svg=SVG),
        Picture(title="Finger", png=PNG, half=True),
        Picture(title="Ridge", svg=SVG, half=True),
    ],
    "notes": ["no second camera"],
    "provenance": {"seed": "7", "film": "sha256 3f9a12"},
    "commands": ["twin diagnose"],
}
OWN_KEYS = {"seed", "film", "creep.g1"}  # what a folder says, too
VOID = {"meta", "img", "br", "link", "input", "hr"}


class Tags(HTMLParser):
    """Collects what a page would load, and checks that its elements close in order."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.loads: list[str] = []
        self.handlers: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in VOID:
            self.open.append(tag)
        self.loads += [
            text or "" for name, text in attrs if name in {"src", "href", "xlink:href", "action", "data"}
        ]
        self.handlers += [name for name, _ in attrs if name.startswith("on")]
        self.loads += [tag] if tag in {"script", "link", "iframe", "object", "embed"} else []

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def parsed(page: str) -> Tags:
    tags = Tags()
    tags.feed(page)
    tags.close()
    return tags


BAD = "'\"><script>alert('a & b')</script>"


def spoilt(fact: object) -> object:
    """A fact with a script in place of every text."""
    if isinstance(fact, Picture):
        return Picture(title=BAD, caption=BAD, half=fact.half, svg=fact.svg, png=fact.png, place=fact.place)
    if isinstance(fact, dict):
        return {(BAD if key in OWN_KEYS else key): spoilt(value) for key, value in fact.items()}
    if isinstance(fact, list | tuple):
        return [spoilt(one) for one in fact]
    return BAD if isinstance(fact, str) else fact


LIVE = (
    '<svg xmlns="http://www.w3.org/2000/svg"><script>alert(1)</script><image href="http://evil.example/x.png"/>'
    '<rect onload="alert(2)"/></svg>'
)


def pages() -> list[str]:
    """The report, a fact at a time and all of them, and a page of tables, with all texts and drawings spoilt."""
    drawing = Picture(title=BAD, caption=BAD, svg=LIVE)
    tables = [{"title": BAD, "head": [BAD], "rows": [{"cells": [BAD], "named": True}], "note": BAD}]
    every: dict[str, Any] = {key: spoilt(fact) for key, fact in FACTS.items()} | {"pictures": [drawing]}
    return [
        *(render(title=BAD, facts={key: fact}) for key, fact in every.items()),
        render(title=BAD, facts=every),
        render(title=BAD, facts={"study": {"pictures": [drawing], "known": {}}}),
        table_page(BAD, headline=BAD, sentences=[BAD], tables=tables, pictures=[drawing]),
    ]


def live(page: str) -> list[str]:
    """What of a page runs or loads something: elements, handlers, and addresses other than data."""
    tags = parsed(page)
    loads = [one for one in tags.loads if not one.startswith(("data:image/", "#"))]
    return loads + tags.handlers


def figures() -> dict[str, int]:
    """`script_texts` and `script_run` of all pages."""
    every = pages()
    shown = sum(len(re.findall("&lt;script&gt;|data:image/svg", page)) for page in every)
    return {"script_texts": shown, "script_run": sum(len(live(page)) for page in every)}
