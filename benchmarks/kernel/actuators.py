"""Other actuators, laws, contacts and decks: what the kernel makes of them, beside CalculiX where it can.

    python benchmarks/kernel/actuators.py [--quick] [--json] [--only PART ...]

Each part is a benchmark of its own, named in its docstring: bodies (`bodies.py`), laws (`laws.py`),
self_contact (`selfcontact.py`), object (`objects.py`), decks (`decks.py`), named (`lawsnamed.py`) and joint
(`coupons.py`). CalculiX must be installed. --quick: coarser meshes, fewer draws, six trials of `named`.
"""

import os
import sys
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks.commandline import Part, parts
from benchmarks.kernel import bodies, coupons, decks, laws, lawsnamed, objects, selfcontact

FEW, MANY = 3, 30  # geometries of each body


def of_bodies(quick: bool) -> dict[str, Any]:
    """`bodies`: tried, solved and the error of the mesh of each kind, by its name."""
    return {"bodies": bodies.bodies(FEW if quick else MANY)}


def of_laws(quick: bool) -> dict[str, Any]:
    """`laws`: the errors of each by its name."""
    del quick
    return {"laws": laws.measured()}


def of_decks(quick: bool) -> dict[str, Any]:
    """`decks`: by feature how far the deck as it is read is from CalculiX, of the largest displacement."""
    del quick
    return {"decks": decks.differences()}


PARTS: dict[str, Part] = {
    "bodies": of_bodies,
    "laws": of_laws,
    "self_contact": selfcontact.figures,
    "object": objects.objects,
    "decks": of_decks,
    "named": lawsnamed.law_named,
    "joint": coupons.figures,
}


if __name__ == "__main__":
    sys.exit(parts(__doc__, PARTS, quick="coarser meshes, fewer draws"))
