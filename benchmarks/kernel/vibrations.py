"""Natural frequencies by CalculiX: *FREQUENCY about a static step."""

from pathlib import Path

from fe import Case
from fe.element import Array
from fe.engines.calculix import CalculiX
from fe.engines.process import numbers
from fe.engines.writer import deck

ABOUT = "*STEP, PERTURBATION\n*FREQUENCY\n{count}\n*END STEP\n"


def theirs(case: Case, pressure: float, *, count: int, folder: Path) -> Array:
    """Frequencies (count,) in Hz of a case of Abaqus elements about its state under a pressure in MPa, its
    files in `folder`. RuntimeError where CalculiX gives none."""
    CalculiX().run(deck(case, pressure) + ABOUT.format(count=count), folder=folder)
    result = folder / "job.dat"
    lines = result.read_text(encoding="utf-8").splitlines() if result.exists() else []
    heads = [k for k, line in enumerate(lines) if "E I G E N V A L U E" in line]
    if not heads:
        raise RuntimeError(f"CalculiX gave no frequencies: see {folder.name}/job.log")
    rows = [line.split() for line in lines[heads[0] + 1 :]]
    return numbers([row[3] for row in rows if len(row) == 5 and row[0].isdigit()][:count])
