"""Damaged files, as hypothesis strategies: a good file of the corpus with a few things done to it.

Text is damaged by letters, words and lines; JSON and TOML also as trees, so that brackets stay whole; arrays
by their type, shape and numbers.
"""

import io
import json
import re
from collections.abc import Callable
from copy import deepcopy
from typing import Any

import numpy as np
from hypothesis import strategies as st

WORDS = (
    "", "0", "-1", "1", "0.5", "nan", "inf", "-inf", "1e308", "-1e308", "1e-320", "1e12", "50.5", "1,5",
    "1_000", "99999999999999999999", "0x10", "true", "false", "null", "[]", "{}", "[[", "]]", '"', "'",
    '"""', "\\", "\x00", "\ufeff", "\u00e9", "\u5b57", "\u0661", "\U0001f600", ",", ";", "\t", "=", ":", "*",
    "**", "#", "../..", "/etc/hostname", "~", "*Include, input=tube.inp",
    "*Nset, nset=x, generate\n1, 1000000000",
    "S9", "-", "--",
    "[" * 3000, '{"a":' * 3000, "a" * 70_000, "9" * 6000, "1, " * 5000, '"' + "a, " * 5000,
)  # fmt: skip
VALUES: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 0.5, 1e308, -1e308, 10**25, float("nan"), float("inf"), "", "x",
    "nan", "\x00", [], [1], [[1]], [None], {}, {"a": 1}, [[[[[[]]]]]], "a" * 5000, list(range(300)),
)  # fmt: skip

Edit = tuple[str, float, float, str]
edits = st.lists(
    st.tuples(
        st.sampled_from(("word", "word", "word", "insert", "delete", "twice", "away", "swap", "cut")),
        st.floats(0, 1), st.floats(0, 1), st.sampled_from(WORDS) | st.text(max_size=6),
    ),
    max_size=4,
)  # fmt: skip


def damaged_text(text: str, done: list[Edit]) -> str:
    """The text after these edits; places are shares of its length."""
    for kind, here, there, word in done:
        a, b = sorted((int(here * len(text)), int(there * len(text))))
        lines = text.split("\n")
        i, k = int(here * (len(lines) - 1)), int(there * (len(lines) - 1))
        if kind == "word":
            found = list(re.finditer(r"[^\s,;=\[\]{}:]+", text))
            if found:
                m = found[int(here * (len(found) - 1))]
                text = text[: m.start()] + word + text[m.end() :]
        elif kind == "insert":
            text = text[:a] + word + text[a:]
        elif kind == "delete":
            text = text[:a] + text[min(b, a + 40) :]
        elif kind == "cut":
            text = text[:b]
        else:
            if kind == "twice":
                lines.insert(k, lines[i])
            elif kind == "away":
                del lines[i]
            else:
                lines[i], lines[k] = lines[k], lines[i]
            text = "\n".join(lines)
    return text


def places(tree: Any, so_far: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """The ways to every value of a tree of tables and lists."""
    pairs = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    found = [so_far] if so_far else []
    for key, value in pairs:
        found += places(value, (*so_far, key))
    return found


Change = tuple[str, float, Any]
changes = st.lists(
    st.tuples(
        st.sampled_from(("put", "put", "put", "remove", "add")), st.floats(0, 1), st.sampled_from(VALUES)
    ),
    min_size=1, max_size=3,
)  # fmt: skip


def damaged_tree(tree: Any, done: list[Change]) -> Any:
    """A copy of a tree of tables and lists after these changes."""
    tree = json.loads(json.dumps(tree))
    for kind, where, stated in done:
        value, ways = deepcopy(stated), places(tree)
        if not ways:
            return value
        *way, last = ways[int(where * (len(ways) - 1))]
        inner = tree
        for key in way:
            inner = inner[key]
        if kind == "put":
            inner[last] = value
        elif kind == "remove":
            del inner[last]
        elif isinstance(inner, dict):
            inner[f"{last}t"] = value
        else:
            inner.insert(0, value)
    return tree


ARRAYS: dict[str, Callable[[Any], Any]] = {
    "text": lambda a: a.astype(str),
    "bytes": lambda a: a.astype("S8"),
    "whole": lambda a: np.nan_to_num(a).astype(int),
    "complex": lambda a: a.astype(complex),
    "short": lambda a: a[:-1],
    "flat": lambda a: a.ravel(),
    "deep": lambda a: a[None],
    "none": lambda a: a[:0],
    "one": lambda a: np.array(1.0),
    "nan": lambda a: a * np.nan,
    "huge": lambda a: a * 1e200 * 1e105,
    "minus": lambda a: -a,
    "zero": lambda a: a * 0,
    "turned": lambda a: a.swapaxes(-1, -2) * np.triu(np.ones(a.shape[-2:])),
}
arrays = st.lists(st.tuples(st.floats(0, 1), st.sampled_from(sorted(ARRAYS))), min_size=1, max_size=2)


def damaged_arrays(data: bytes, done: list[tuple[float, str]]) -> bytes:
    """The bytes of an npz file after these changes of its arrays; a change that an array cannot take is left
    out."""
    with np.load(io.BytesIO(data), allow_pickle=False) as file:
        own = dict(file)
    for where, kind in done:
        name = sorted(own)[int(where * (len(own) - 1))]
        try:
            with np.errstate(all="ignore"):
                own[name] = ARRAYS[kind](own[name])
        except (ValueError, TypeError, IndexError):
            continue
    out = io.BytesIO()
    np.savez(out, **own)
    return out.getvalue()


Bits = list[tuple[float, int]]
bits = st.lists(st.tuples(st.floats(0, 1), st.integers(0, 255)), min_size=1, max_size=8)


def damaged_bytes(data: bytes, done: Bits) -> bytes:
    """The bytes with some of them replaced."""
    out = bytearray(data)
    for where, value in done:
        out[int(where * (len(out) - 1))] = value
    return bytes(out)
