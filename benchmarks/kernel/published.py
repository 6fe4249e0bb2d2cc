"""Decks of a folder that others published: how many are read, and how far their solutions are from CalculiX.

    python benchmarks/kernel/published.py FOLDER [--json]

Each deck is read as it stands. One that is refused for its step alone, which is without NLGEOM, is read once
more with NLGEOM, as the message asks. Both programs solve what is read, CalculiX with its direct solver; the
difference is the largest of a node's displacement at the end, over the largest displacement. internal: decks
that ended in anything but one sentence. FOLDER may be the examples of CalculiX itself (the package
calculix-ccx-test of Debian, unpacked).
"""

import json
import os
import re
import sys
import tempfile
from pathlib import Path
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks.commandline import options

import numpy as np

from fe.deck.calculix import CalculiX
from fe.deck.embedded import Embedded
from fe.deck.reader import Deck, read_deck

LARGE = "*STEP without NLGEOM"


def read(path: Path) -> tuple[Deck | None, str, str]:
    """A deck as it is read, or none with the sentence that refused it; its text."""
    text = path.read_text(encoding="latin-1")
    for _ in range(2):
        with tempfile.TemporaryDirectory() as folder:
            for other in path.parent.glob("*.inc"):
                (Path(folder) / other.name).write_bytes(other.read_bytes())
            copy = Path(folder) / path.name
            copy.write_text(text, encoding="latin-1")
            try:
                return read_deck(copy), "", text
            except ValueError as error:
                sentence = str(error).replace(f"{folder}/", "")
        if LARGE not in sentence:
            break
        text = re.sub(r"(?im)^\*STEP(?!.*NLGEOM).*$", r"\g<0>, NLGEOM", text)
    return None, sentence, text


def difference(deck: Deck, text: str) -> tuple[float | None, str]:
    """The largest difference over the largest displacement, or why there is none."""
    silent = re.sub(r"(?im)^\*(NODE|EL) (PRINT|FILE)[^*]*|, *SOLVER=[A-Z ]*", "", text)
    told = re.sub(r"(?im)^\*END STEP", "*NODE FILE\nU\n*END STEP", silent)
    ours, theirs = Embedded().solve(deck.case, deck.pressures[-1], gravity=deck.gravity), CalculiX().run(told)
    if not ours.converged or not theirs.converged:
        return None, f"softtwin: {ours.reason}; CalculiX: {theirs.reason}"
    _, a, b = np.intersect1d(ours.labels, theirs.labels, return_indices=True)
    size = np.abs(theirs.u[b]).max()
    return (float(np.abs(ours.u[a] - theirs.u[b]).max() / size), "") if size else (None, "nothing moves")


def figures(folder: Path) -> dict[str, Any]:
    """Counts, differences by deck, and the first words of what refused the others."""
    out: dict[str, Any] = {"decks": 0, "read": 0, "internal": 0}
    out |= {"differences": {}, "unsolved": {}, "refused": {}}
    for path in sorted(folder.glob("*.inp")):
        out["decks"] += 1
        try:
            deck, sentence, text = read(path)
        except Exception as error:  # what must not happen is counted
            out["internal"] += 1
            out["refused"][path.name] = f"INTERNAL {error!r}"
            continue
        if deck is None:
            out["refused"][path.name] = sentence[:200]
            continue
        out["read"] += 1
        found, why = difference(deck, text)
        out["differences" if found is not None else "unsolved"][path.name] = why if found is None else found
        print(path.name, found, why, file=sys.stderr, flush=True)
    return out


if __name__ == "__main__":
    typed = options(__doc__, {"folder": (Path, "where the decks are")}, json="one JSON line")
    print(json.dumps(figures(typed.folder), indent=None if typed.json else 1))
