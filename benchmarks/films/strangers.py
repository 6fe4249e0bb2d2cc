"""Films, boards, photographs and files of strangers: wrong ones that pass, right ones that are refused.

    python benchmarks/films/strangers.py [--quick] [--only PART ...] [--json]

What is planted stands in tables under tests/strangers, which the tests read, too. mistakes: planted in a
drawn project, each with the sentence it got. right: unusual inputs that must pass, photographs among them.
fuzz: damaged files for every reader. faults: kills, interrupts and a full disk in every stage; kills,
interrupts, disk: each of these alone. coding: `coding.py`, pulls on film as phones code it, and the speed.
dic: pulls in a strain gradient. --quick: fewer of each, but all damaged files. Without it kills take about
half an hour.
"""

import os
import sys
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks.commandline import Part, parts
from benchmarks.films import coding
from benchmarks.tracking import dic

from tests.strangers import fuzz, kills, planted, right

CASES = 20_000


def mistakes(quick: bool) -> dict[str, Any]:
    """How many planted mistakes were accepted, and the sentences that the others got."""
    del quick
    found = planted.figures()
    unusual = {"unusual": found.pop("right"), "unusual_refused": found.pop("refused")}
    del found["refused_right"]  # of the part `right`
    return found | unusual


def faults(quick: bool) -> dict[str, Any]:
    """Kills, interrupts and disk faults after which a project ended with the same bits."""
    return kills.kills(quick) | kills.interrupts(quick) | kills.disk(quick)


PARTS: dict[str, Part] = {
    "mistakes": mistakes,
    "right": right.figures,
    "fuzz": lambda quick: fuzz.fuzz(CASES).figures(),
    "dic": lambda quick: dic.strained(2 if quick else 10),
    "coding": coding.figures,
    "faults": faults,
}
ALONE: dict[str, Part] = {"kills": kills.kills, "interrupts": kills.interrupts, "disk": kills.disk}


if __name__ == "__main__":
    sys.exit(parts(__doc__, PARTS, quick="fewer of each", alone=ALONE))
