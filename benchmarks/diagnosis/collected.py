"""What long scripts find, one file of rows each in `benchmarks/results`, and the keys that they fill in the
table of `identify.py`.

A script asks `Rows` what it has, and adds a row as soon as it has one, so that it goes on where it was
stopped. Rows of another rule than today's (`trialbench.rule`) are not counted and are run again.
"""

import ast
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks import ROOT
from benchmarks.diagnosis.tally import Row, clear, group, of_laws, rate, scores
from benchmarks.diagnosis.trialbench import rule

RESULTS = ROOT / "benchmarks" / "results"
DECISION = ("hypotheses", "deciding", "attempts", "verdicts", "pairs", "refitting", "candidates")


@dataclass(frozen=True)
class Rows:
    """The rows of one script, `benchmarks/results/NAME.json`, each with its `key`."""

    name: str
    folder: Path = RESULTS

    @property
    def file(self) -> Path:
        """Where they are."""
        return self.folder / f"{self.name}.json"

    def every(self) -> list[Row]:
        """All rows of today's rule."""
        if not self.file.exists():
            return []
        found = json.loads(self.file.read_text(encoding="utf-8"))
        return [row for row in found.get("rows", ()) if row.get("rule") == rule()]

    def has(self, key: str) -> bool:
        """Whether a row is there."""
        return any(row["key"] == key for row in self.every())

    def add(self, row: Row) -> None:
        """Keep a row, in place of one with its key."""
        rows = [r for r in self.every() if r["key"] != row["key"]]
        self.folder.mkdir(parents=True, exist_ok=True)
        scratch = self.file.with_suffix(".part")
        text = json.dumps({"rule": rule(), "rows": [*rows, row | {"rule": rule()}]}, indent=1)
        scratch.write_text(text + "\n", encoding="utf-8")
        scratch.replace(self.file)


def collected(folder: Path = RESULTS) -> dict[str, Any]:
    """The keys of the table that other scripts fill; None where a script has not run."""
    film, full = Rows("film", folder).every(), Rows("full_fe", folder).every()
    costs, response = _plain(folder / "costs.json"), _plain(folder / "response.json")
    return {
        "film": group(film),
        "full_fe": {p: agreeing([r for r in full if r["protocol"] == p]) for p in ("P3", "P5")},
        "ccx": engine(Rows("ccxdiagnosis", folder).every()),
        "solves": costs.get("solves", {}),
        "cpu_s": costs.get("cpu_s", {}),
        "response_pull": response.get("response_pull"),
        "constants": constants(),
    }


def agreeing(rows: Sequence[Row]) -> Row:
    """n, and how many name the same with whole solves as by tables, on the same targets."""
    told = rate([row["agree"] for row in rows])
    return {"n": told["n"], "agree": told["rate"], "interval": told["interval"],
            "named": rate([bool(row["names"]) for row in rows]),
            "seconds": [round(row["full_seconds"]) for row in rows]}  # fmt: skip


def engine(rows: Sequence[Row]) -> Row:
    """The scores of truths by another engine, sizes that cannot be told from the constants apart; and those
    of them that no effect of the library names."""
    seen = [r for r in rows if not r.get("faint")]
    found = of_laws(seen)
    own = scores([r for r in seen if all(r["physics"])])
    return own | {"unknown": found["unknown"], "too_faint": len(rows) - len(seen),
                  "minutes": [round(r["seconds"] / 60, 1) for r in rows]}  # fmt: skip


def constants() -> dict[str, Any]:
    """How many numbers the decision has, and their names: constants at the head of its modules."""
    names = []
    for module in DECISION:
        path = ROOT / "twin" / "diagnosis" / f"{module}.py"
        tree = ast.parse(path.read_text(encoding="utf-8")) if path.exists() else ast.Module([], [])
        for node in tree.body:
            if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
                name = node.targets[0].id
                if name.isupper() and _numeric(node.value):
                    names.append(f"{module}.{name}")
    return {"n": len(names), "names": names}


def _numeric(node: ast.expr) -> bool:
    if isinstance(node, ast.Tuple):
        return bool(node.elts) and all(map(_numeric, node.elts))
    if isinstance(node, ast.UnaryOp):
        return _numeric(node.operand)
    return isinstance(node, ast.Constant) and isinstance(node.value, int | float)


def _plain(path: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    return found


__all__ = ["RESULTS", "Rows", "clear", "collected", "constants"]
