"""What long scripts find, one file of rows each in `benchmarks/results`, and the keys that they fill in the
table of `identify.py`.

A script asks `Rows` what it has, and adds a row as soon as it has one, so that it goes on where it was
stopped. Rows count that were made by today's code (`trialbench.rule`), by that of the commit by which the
rule was frozen as the table says, or by that of a commit between them in which everything that DECIDES is as
it was frozen or as it is today; others are run again.
"""

import ast
import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from benchmarks import ROOT
from benchmarks.diagnosis.tally import (
    Row,
    clear,
    flagged,
    group,
    in_set,
    of_laws,
    rate,
    sizes,
    wrong_alone,
)
from benchmarks.diagnosis.trialbench import RULE, git, in_history, rule, rule_at

import numpy as np

RESULTS = ROOT / "benchmarks" / "results"
DECISION = ("judging/lawerrors", "diagnosis/shortlist", "diagnosis/refitting", "diagnosis/deciding")
DECIDES = (*DECISION, "judging/lawlevels", "judging/comparison", "diagnosis/evidence", "diagnosis/screening")


def frozen_by() -> str:
    """The commit by which the rule was frozen as the table says, or nothing."""
    return _plain(RESULTS / "identify.json").get("frozen") or ""


@lru_cache(maxsize=1)
def accepted(commit: str) -> set[str]:
    """The rules whose rows are counted: today's, that of a commit, where the history has it, and those since
    then that decide alike."""
    if not commit or not in_history(commit):
        return {rule()}
    files = [f"twin/{module}.py" for module in DECIDES]
    later = git("rev-list", f"{commit}..HEAD", "--", *RULE).split()

    def decides(rule: str) -> str:
        return git("ls-tree", rule, "--", *files)

    kept = decides(commit), decides("HEAD")
    alike = [c for c in later if decides(c) in kept]
    return {rule(), *map(rule_at, (commit, *alike))}


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
        counted = accepted(frozen_by())
        return [row for row in found.get("rows", ()) if row.get("rule") in counted]

    def has(self, key: str) -> bool:
        """Whether a row is there."""
        return any(row["key"] == key for row in self.every())

    def add(self, row: Row) -> None:
        """Keep a row, in place of one with its key."""
        rows = [r for r in self.every() if r["key"] != row["key"]]
        self.folder.mkdir(parents=True, exist_ok=True)
        scratch = self.file.with_suffix(".part")
        lines = ",\n".join(json.dumps(r) for r in [*rows, row | {"rule": rule()}])  # one a line
        scratch.write_text(f'{{"rule": "{rule()}", "rows": [\n{lines}\n]}}\n', encoding="utf-8")
        scratch.replace(self.file)


def collected(folder: Path = RESULTS) -> dict[str, Any]:
    """The keys of the table that other scripts fill; None where a script has not run."""
    film, full = Rows("film", folder).every(), Rows("full_fe", folder).every()
    costs, response = _plain(folder / "costs.json"), _plain(folder / "response.json")
    return {
        "film": group(film),
        "full_fe": agreeing_by_protocol([r for r in full if r["finger"] == "short"])
        | {"default_finger": agreeing_by_protocol([r for r in full if r["finger"] == "default"])},
        "ccx": engine(Rows("ccxdiagnosis", folder).every()),
        "solves": costs.get("solves", {}),
        "cpu_s": costs.get("cpu_s", {}),
        "response_pull": response.get("response_pull"),
        "constants": constants(),
    }


def agreeing_by_protocol(rows: Sequence[Row]) -> Row:
    """Of each protocol n, how many name the same with whole solves as by tables, how many are right, and
    the median of the processor's minutes."""
    return {p: agreeing([row for row in rows if row["protocol"] == p]) for p in ("P3", "P5")}


def agreeing(rows: Sequence[Row]) -> Row:
    told = rate([row["agree"] for row in rows])
    own = {"n": told["n"], "agree": told["rate"], "interval": told["interval"]}
    minutes = float(np.median([row["full_seconds"] for row in rows])) / 60 if rows else None
    return own | {"minutes": minutes, "truth": of_laws([row for row in rows if row["kinds"]])}


def engine(rows: Sequence[Row]) -> Row:
    """Of clear truths by another engine, how many verdicts hold the truth: what is hidden among the names,
    or for what no library holds, no wrong name alone; and how many are wrong and alone."""
    own = clear(rows)
    held = rate([in_set(r) if all(r["physics"]) else flagged(r) for r in own])
    refused = [r["key"] for r in own if r["named"] and r["add"] != "added"]
    return {
        "n": len(own), "in_set": held["rate"], "interval": held["interval"],
        "wrong_alone": rate([wrong_alone(r) for r in own])["rate"], "set_size": sizes(own),
        "add_refused": refused,
        "too_faint": len(rows) - len(own),
        "verdicts": {r["key"]: r["verdict"] for r in rows},
        "minutes": sum(r["seconds"] for r in rows) / 60,
    } | of_laws(rows)  # fmt: skip


def constants() -> dict[str, Any]:
    """How many numbers the decision has, and their names: constants at the head of its modules."""
    names = []
    for module in DECISION:
        tree = ast.parse((ROOT / "twin" / f"{module}.py").read_text(encoding="utf-8"))
        for node in tree.body:
            if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
                name = node.targets[0].id
                if name.isupper() and _numeric(node.value):
                    names.append(f"{module.partition('/')[2]}.{name}")
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


__all__ = ["RESULTS", "Rows", "collected", "constants"]
