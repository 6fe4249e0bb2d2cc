"""Films, boards, photographs and files of strangers: wrong ones that pass, right ones that are refused.

    python benchmarks/films/strangers.py [--quick] [--only PART ...] [--json]

What is planted stands in tables under tests/strangers, which the tests read, too. mistakes: planted in a
drawn project, and in files of other programs, each with the sentence it got. right: unusual inputs that must
pass, photographs among them. folders: links and scripts in a folder from a stranger. old_project: a project
of a former release. fuzz: damaged files for every reader. faults: kills, interrupts and a full disk in every
stage; kills, interrupts, disk: each of these alone. coding: `coding.py`, pulls on film as phones code it, and
the speed. --quick: fewer of each, but all damaged files. Without it kills take about half an hour.
"""

import os
import sys
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks.commandline import Part, parts
from benchmarks.films import coding

from tests.strangers import fuzz, kills, older, pages, planted, received, right

CASES = 20_000


def mistakes(quick: bool) -> dict[str, Any]:
    """How many planted mistakes were accepted or told with another cause, and the sentences they got."""
    del quick
    return planted.wrong_figures()


def unusual(quick: bool) -> dict[str, Any]:
    """How many right inputs were refused: unusual projects, and what `right` puts in."""
    projects, found = planted.refused_right(), right.figures(quick)
    refused = {name: sentence for name, sentence in projects.items() if sentence}
    count = {"right_inputs": found.pop("right_inputs") + len(projects),
             "refused_right": found.pop("refused_right") + len(refused)}  # fmt: skip
    return count | {"refused_projects": refused} | found


def folders(quick: bool) -> dict[str, Any]:
    """Files outside a stranger's folder that were read, and scripts that a page of it would run."""
    del quick
    return received.figures() | pages.figures()


def faults(quick: bool) -> dict[str, Any]:
    """Kills, interrupts and disk faults after which a project ended with the same bits."""
    return kills.kills(quick) | kills.interrupts(quick) | kills.disk(quick)


PARTS: dict[str, Part] = {
    "mistakes": mistakes,
    "right": unusual,
    "folders": folders,
    "old_project": lambda quick: older.figures(),
    "fuzz": lambda quick: fuzz.fuzz(CASES).figures(),
    "coding": coding.figures,
    "faults": faults,
}
ALONE: dict[str, Part] = {"kills": kills.kills, "interrupts": kills.interrupts, "disk": kills.disk}


if __name__ == "__main__":
    sys.exit(parts(__doc__, PARTS, quick="fewer of each", alone=ALONE))
