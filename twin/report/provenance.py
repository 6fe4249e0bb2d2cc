"""Where the numbers of a report come from: the uncertainty by its sources, and files, seed and versions."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from twin.bench.fits import fresh
from twin.chain import FIT, kinds_writing
from twin.project.folder import Project, versions

SMALL = 0.01  # of the largest source of uncertainty: smaller ones are not shown
SHOWN = 16  # digits of a SHA-256


def budget_facts(project: Project, names: Sequence[str]) -> dict[str, Any]:
    """What the uncertainty of some markers consists of in um, the largest source first; nothing where the
    targets were measured elsewhere."""
    path = project.newest("measure", "budget.csv")
    if path is None:
        return {}
    from vision.errors.errorbudget import SOURCES, from_csv

    table, marks = from_csv(path.read_text(encoding="utf-8"))
    own = [p for p, name in enumerate(marks) if name in names]
    um = 1e3 * np.sqrt((table.sd[:, own] ** 2).sum(axis=2))
    order = [r for r in np.argsort(-um.max(axis=1)) if um[r].max() > SMALL * um.max()]
    named = [(table.sources[r], list(um[r])) for r in order]
    rows = [{"source": name, "um": cells, "remedy": SOURCES.get(name)} for name, cells in named]
    total = {"source": "all", "um": list(np.sqrt((um**2).sum(axis=0)))}
    return {"markers": [marks[p] for p in own], "rows": [*rows, total]}


def provenance_of(project: Project, *, seed: Any) -> dict[str, str]:
    """Seed, run, SHA-256 of every file that the newest fit was made from, and versions."""
    fit = fresh(project, kinds_writing(FIT), FIT)
    inputs = project.info(fit.parent).inputs if fit else {}
    digests = {name: f"SHA-256 {digest[:SHOWN]}" for name, digest in inputs.items()}
    run = {"fit of run": fit.parent.name} if fit else {}
    return {"seed": str(seed), **run, **digests, **versions()}
