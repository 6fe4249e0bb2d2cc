"""Natural frequencies by CalculiX: *FREQUENCY about a static step."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from fe import Case
from fe.case import Support
from fe.element import Array
from fe.engines.calculix import CalculiX
from fe.engines.process import numbers
from fe.engines.writer import deck

ABOUT = "*STEP, PERTURBATION\n*FREQUENCY\n{count}\n*END STEP\n"
SPRING = "*ELEMENT, TYPE=SPRING1, ELSET=SPRUNG\n{label}, {node}\n*SPRING, ELSET=SPRUNG\n3\n0.05\n"  # N/mm


def theirs(case: Case, pressure: float, *, count: int, folder: Path, spring: str = "") -> Array:
    """Frequencies (count,) in Hz of a case of Abaqus elements about its state under a pressure in MPa, its
    files in `folder`; spring: more of its deck. RuntimeError where CalculiX gives none."""
    text = deck(case, pressure).replace("*STEP", f"{spring}*STEP", 1) + ABOUT.format(count=count)
    CalculiX().run(text, folder=folder)
    result = folder / "job.dat"
    lines = result.read_text(encoding="utf-8").splitlines() if result.exists() else []
    heads = [k for k, line in enumerate(lines) if "E I G E N V A L U E" in line]
    if not heads:
        raise RuntimeError(f"CalculiX gave no frequencies: see {folder.name}/job.log")
    rows = [line.split() for line in lines[heads[0] + 1 :]]
    return numbers([row[3] for row in rows if len(row) == 5 and row[0].isdigit()][:count])


def turning(case: Case, folder: Path, pressure: float = 0.003) -> float:
    """By what share a pressure in MPa inside a half model changes the frequency at which it all turns about
    a hinge at the bottom of its base, on a spring at its tip: by next to nothing, if all is right."""
    x, (plane,) = case.nodes, (s for s in case.supports if s.components == (1,))
    low = x[:, 2] < x[:, 2].min() + 1e-9
    hinge = np.flatnonzero(low & (x[:, 0] < x[:, 0].min() + 1e-9))
    tip = int(case.labels[np.flatnonzero(low)[x[low, 0].argmax()]])
    free = replace(case, supports=(plane, Support("hinge", (0, 2))), clamp=None,
                   node_sets={**case.node_sets, "hinge": hinge})  # fmt: skip
    spring = SPRING.format(label=10**6, node=tip)
    found = [
        theirs(free, p, count=1, folder=folder / f"turning-{p}", spring=spring)[0] for p in (0.0, pressure)
    ]
    return float(found[1] / found[0] - 1)
