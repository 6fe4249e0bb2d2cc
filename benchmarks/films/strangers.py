"""Films, boards, photographs and files of strangers: wrong ones that pass, right ones that are refused.

    python benchmarks/films/strangers.py [--quick] [--only PART ...] [--json]

mistakes: `strangers_mistakes.py`, planted in a drawn project, each with the sentence it got. right:
`strangers_right.py`, unusual inputs that must pass, photographs among them. coding: `strangers_coding.py`,
pulls on film as phones code it, and the speed. fuzz: `strangers_fuzz.py`, damaged files for every reader.
faults: `strangers_faults.py`, kills, interrupts and a full disk in every stage. dic: `dic.py`, pulls in a
strain gradient. --quick: fewer of each, but all damaged files. Without it kills take about half an hour.
"""

import argparse
import json
import os
import sys
from collections.abc import Callable
from contextlib import redirect_stdout
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
import benchmarks  # noqa: F401
from benchmarks.films import coding as strangers_coding
from benchmarks.tracking import dic

from tests.strangers import fuzz as strangers_fuzz
from tests.strangers import kills as strangers_faults
from tests.strangers import mistakes as strangers_mistakes
from tests.strangers import right as strangers_right

CASES = 10_000


def mistakes(quick: bool) -> dict[str, Any]:
    """How many planted mistakes were accepted, and the sentences that the others got."""
    del quick
    found = strangers_mistakes.figures()
    return {
        "planted": found["planted"], "accepted_wrong": found["accepted_wrong"],
        "doubtful": found["doubtful"], "untold": found["untold"],
        "sentences": found["sentences"], "unusual": found["right"], "unusual_refused": found["refused"],
    }  # fmt: skip


def right(quick: bool) -> dict[str, Any]:
    """How many right inputs were refused, the share of dots that was found, the pull on photographs."""
    return strangers_right.figures(quick)


def coding(quick: bool) -> dict[str, Any]:
    """Pulls on coded film at rest, in holds and in motion, and frames measured a second."""
    return strangers_coding.figures(quick)


def fuzz(quick: bool) -> dict[str, Any]:
    """Damaged files tried, and how many ended in an internal error or took too long."""
    del quick
    return dict(strangers_fuzz.fuzz(CASES).figures())


def faults(quick: bool) -> dict[str, Any]:
    """Kills, interrupts and disk faults after which a project ended with the same bits."""
    f = strangers_faults
    return f.kills(quick) | f.interrupts(quick) | f.disk(quick)


def strain(quick: bool) -> dict[str, Any]:
    """The pull of digital image correlation in a strain gradient."""
    return dict(dic.strained(2 if quick else 10))


PARTS: dict[str, Callable[[bool], dict[str, Any]]] = {
    "mistakes": mistakes,
    "right": right,
    "fuzz": fuzz,
    "dic": strain,
    "coding": coding,
    "faults": faults,
}


def main() -> int:
    """Print what the parts found; as one JSON line with --json."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="fewer of each")
    parser.add_argument("--only", nargs="+", choices=list(PARTS), default=list(PARTS), help="these alone")
    parser.add_argument("--json", action="store_true", help="one JSON line")
    options = parser.parse_args()
    found: dict[str, Any] = {}
    with redirect_stdout(sys.stderr):  # what the parts tell as they go
        for name in options.only:
            found |= PARTS[name](options.quick)
    print(json.dumps(found) if options.json else "\n".join(f"{key}: {value}" for key, value in found.items()))
    return 0


if __name__ == "__main__":
    sys.exit(main())
