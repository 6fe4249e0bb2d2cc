"""Writes the rates of benchmarks/results/identify.json into the sentences that tell them.

    python benchmarks/docs/rates.py            writes
    python benchmarks/docs/rates.py --check    names each sentence that says something else

The table of protocols in docs/filming.md is made by `reference.py`.
"""

import json
import os
import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks import ROOT
from benchmarks.commandline import options

from twin import files

Table = dict[str, Any]
LIMITS, LABORATORY = "docs/how-it-decides.md", "docs/virtual-laboratory.md"


@dataclass(frozen=True)
class Told:
    """A sentence of a file with a hole {} for each count, and what fills them."""

    file: str
    sentence: str
    counts: Callable[[Table], Sequence[int]]

    @property
    def pattern(self) -> re.Pattern[str]:
        """The sentence with any counts, over any line ends."""
        words = re.escape(self.sentence).replace(r"\ ", r"\s+").replace(r"\{\}", r"(\d+)")
        return re.compile(words)


def count(cell: Table, *keys: str) -> list[int]:
    """How many of a cell's n trials have each of these."""
    return [round((cell[key] or 0.0) * cell["n"]) for key in keys]


def of_grade(grade: str) -> Callable[[Table], list[int]]:
    """n of a grade, and how often name and mechanism were right."""

    def counts(table: Table) -> list[int]:
        rows = table["said"][grade]
        rights = (round((rows[key]["rate"] or 0.0) * rows[key]["n"]) for key in ("name", "mechanism"))
        return [rows["name"]["n"], *rights]

    return counts


def held(table: Table) -> list[int]:
    """P5: what is in the set, of n, for both laws; a wrong name alone, of those in another law."""
    same, other = table["P5"]["same"], table["P5"]["other"]
    wrong = count(other, "wrong_alone")
    return [*count(same, "in_set"), same["n"], *count(other, "in_set"), other["n"], *wrong, other["n"]]


def outside(table: Table) -> list[int]:
    """Unknown causes with a wrong name, with and without stand-ins of their kind, of n each."""
    both = table["unknown"], table["left_out"]
    return [x for cell in both for x in (*count(cell, "misnamed"), cell["n"])]


def together(table: Table) -> list[int]:
    """Pairs that are named exactly, of n; of fresh seeds; second effects that are spurious, of n."""
    pairs, fresh = table["pairs"], table["fresh"]["pairs"]
    both = [x for cell in (pairs, fresh) for x in (*count(cell, "exact"), cell["n"])]
    return [*both, round((pairs["spurious"] or 0.0) * pairs["spurious_n"]), pairs["spurious_n"]]


def known(table: Table) -> list[int]:
    """Strangers' causes that the library has in another law: n, in the nearest, wrong alone, as `named`."""
    cell = table["strangers"]["known"]
    return [cell["n"], *count(cell, "in_nearest", "wrong_alone", "named")]


def unknown(table: Table) -> list[int]:
    """Strangers' causes that the library lacks: n, misnamed, as `named`, as `likely`, mechanism right."""
    cell = table["strangers"]["unknown"]
    wrong = count(table["kinds_after_freeze"]["unknown"], "misnamed")
    return [cell["n"], *wrong, *count(cell, "named", "likely", "mechanism")]


GRADES = {grade: of_grade(grade) for grade in ("named", "likely", "like")}
TOLD = (
    *(Told("twin/diagnosis/grades.py", f"Grade.{g.upper()}: Rate(n={{}}, name={{}}, mechanism={{}})", c)
      for g, c in GRADES.items()),
    *(Told(LIMITS, f"| `{grade}` | {{}} | {{}} | {{}} |", counts) for grade, counts in GRADES.items()),
    Told("README.md",
         "How sure: like: its law is another than those tried. Of {} virtual trials with this "
         "grade the name was right in {}, the mechanism in {}.",
         GRADES["like"]),
    Told(LIMITS,
         "of {} films whose cause the library has, in another law, the nearest names hold it in "
         "{}; a wrong name stands alone in {}; {} reach the grade `named`",
         known),
    Told(LIMITS,
         "Of {} films whose cause it lacks, {} get a wrong name, {} of them as `named`, {} as "
         "`likely`; the mechanism is right in {}",
         unknown),
    Told(LIMITS,
         "by {} of its {} trials",
         lambda t: [t["trials"], t["planned"]]),
    Told(LIMITS,
         "the verdict holds the truth in {} of {} trials where it has the library's law, in {} of "
         "{} where it has another; {} of these {} are a wrong name alone",
         held),
    Told(LIMITS,
         "gets a wrong name in {} of {} trials where a stand-in of its kind is tried, in {} of {} "
         "where none is",
         outside),
    Told(LIMITS,
         "and no third, in {} of {} films ({} of {} on seeds that no rule was made on). Of one "
         "effect {} in {} verdicts have a second",
         together),
    Told(LIMITS,
         "in a pneunet {} of {} films have a wrong name alone",
         lambda t: [t["bodies"]["wrong"], t["bodies"]["n"]]),
    Told(LABORATORY,
         "in this release has {} of them",
         lambda t: [t["trials"]]),
)  # fmt: skip


def renewed(text: str, told: Told, table: Table) -> str:
    """A text whose sentence has today's counts. ValueError for a text without it."""
    found = told.pattern.search(text)
    if found is None:
        raise ValueError(f"{told.file} has no sentence {told.sentence!r}")
    for k, value in reversed(list(enumerate(told.counts(table), start=1))):
        text = text[: found.start(k)] + str(value) + text[found.end(k) :]
    return text


def differing(table: Table) -> list[str]:
    """The sentences that tell other counts than a table has."""
    texts = {t.file: (ROOT / t.file).read_text(encoding="utf-8") for t in TOLD}
    return [f"{t.file}: {t.sentence}: wanted {list(t.counts(table))}" for t in TOLD
            if renewed(texts[t.file], t, table) != texts[t.file]]  # fmt: skip


def main() -> int:
    typed = options(__doc__, {"--check": "name what differs, write nothing"})
    table = json.loads((ROOT / "benchmarks" / "results" / "identify.json").read_text(encoding="utf-8"))
    wrong = differing(table)
    print("\n".join(wrong) or "every sentence tells the rates of the table")
    if typed.check:
        return bool(wrong)
    for told in TOLD:
        path = ROOT / told.file
        files.write_text(path, renewed(path.read_text(encoding="utf-8"), told, table))
    return 0


if __name__ == "__main__":
    sys.exit(main())
