"""The command line that the benchmarks share: --quick, --json, and parts that may be run alone.

A script puts the root of the checkout on the path of imports, as it is started from a folder below, and asks
`options`; one that is a function of `quick` into figures calls `whole`, one that collects several `parts`.
"""

import argparse
import json
import resource
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import redirect_stdout
from typing import Any

Part = Callable[[bool], Mapping[str, Any]]


def options(doc: str, more: Mapping[str, Any] | None = None, *, quick: str = "", json: str = "") -> Any:
    """What was typed. `quick` and `json`: help of these options, where there are any. `more`: others by name;
    help alone for one that is on or off, (type or default, help), or a dict of what argparse takes."""
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    given = {"--quick": quick, "--json": json, **(more or {})}
    for name, how in given.items():
        if how:
            parser.add_argument(name, **_as_argparse(how))
    return parser.parse_args()


def _as_argparse(how: Any) -> dict[str, Any]:
    if isinstance(how, str):
        return {"action": "store_true", "help": how}
    if isinstance(how, dict):
        return how
    first, text = how
    if isinstance(first, type):
        return {"type": first, "help": text}
    return {"type": type(first), "default": first, "help": text}


def parts(
    doc: str, every: Mapping[str, Part], *, quick: str, alone: Mapping[str, Part] | None = None
) -> int:
    """Prints the figures of the parts that were asked for, as one JSON line or a table. What they tell as
    they go, their seconds and those of the processor go to stderr. `alone`: parts that run only if named."""
    known = {**every, **(alone or {})}
    typed = options(
        doc,
        {"--only": {"nargs": "+", "choices": list(known), "default": list(every), "help": "these alone"}},
        quick=quick,
        json="one JSON line",
    )
    found: dict[str, Any] = {}
    with redirect_stdout(sys.stderr):
        for name in typed.only:
            began, spent = time.perf_counter(), processor()
            found |= known[name](typed.quick)
            took, spent = time.perf_counter() - began, processor() - spent
            print(f"{name}: {took:.0f} s, {spent:.0f} s of the processor", flush=True)
    told(found, typed.json)
    return 0


def whole(doc: str, figures: Part, *, quick: str) -> int:
    """Prints the figures of a benchmark of one part; what it tells as it goes stands before the table."""
    typed = options(doc, quick=quick, json="one JSON line")
    with redirect_stdout(sys.stderr if typed.json else sys.stdout):
        found = figures(typed.quick)
    told(found, typed.json)
    return 0


def processor() -> float:
    """Seconds of the processor so far, of this process and of those that it ran to their end."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(u.ru_utime + u.ru_stime for u in used)


def told(found: Mapping[str, Any], as_json: bool) -> None:
    """Prints figures by name, as one JSON line or a table."""
    if as_json:
        print(json.dumps(found))
        return
    print("| figure | measured |\n|---|---|")
    for key, value in found.items():
        print(f"| {key} | {f'{value:.4g}' if isinstance(value, float) else json.dumps(value)} |")
