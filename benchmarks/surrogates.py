"""How many whole solves does an answer between them need: the response, or a learned Gaussian process?

    python benchmarks/surrogates.py [--quick] [--json]

The short finger's film with holds and a way down, over three boxes: C10 and C01 alone, and with stiffening
and a wall's taper, which are smooth, or stiffening and a lag of the pressure, which has corners. The response
knows solves with their derivatives, the process of scikit-learn solves alone: principal components of the
displacements, each with one length a parameter, squared exponential (`gp rbf`) or Matern 5/2 (`gp matern`).
Both learn from the middle of the box and the same Sobol points after it. They are asked at random points of
it, whose truth are whole solves. Errors are of all markers, axes and steps; the pull is the root mean square,
over the points, of what is off over what is stated. --quick: fewer solves, one box; not written. The rows
are written to `benchmarks/results/surrogates.json`.
"""

import json
import os
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../.."))
from benchmarks.commandline import options
from benchmarks.diagnosis.collected import RESULTS
from benchmarks.diagnosis.response import FILM, model_of
from benchmarks.diagnosis.snapshots import SHORT

import numpy as np
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, Matern, WhiteKernel

from fe import Lattice
from twin.effects.library import effect
from twin.model.answering import Answer, RangedResponse, spread
from twin.model.memo import KeptModel
from twin.model.prediction import Model
from twin.targets import Array

CONSTANTS = {"C10": (0.15, 0.28), "C01": (0.06, 0.11)}  # MPa
STIFFER = CONSTANTS | {"stiffening.C20": (0.0, 0.04)}
BOXES: dict[str, dict[str, tuple[float, float]]] = {
    "constants": CONSTANTS,
    "wall taper": STIFFER | {"wall_taper.mm": (-0.4, 0.4)},
    "pressure lag": STIFFER | {"pressure_lag.tau": (0.0, 1.0)},
}
SEED = 3
SOLVES = (1, 2, 4, 8, 16)  # of the response
LEARNT = (4, 8, 16, 32, 64)  # of the process
SHOWN = ("rms_mm", "error_95_mm", "max_mm", "stated_mm", "pull")
KEPT = 1e-12  # of the variance: principal components with less are left out
KERNELS: dict[str, Callable[[Array], Any]] = {
    "gp rbf": lambda one: RBF(one, (0.05, 100.0)),
    "gp matern": lambda one: Matern(one, (0.05, 100.0), nu=2.5),
}


@dataclass(frozen=True)
class Learned:
    """A Gaussian process for each principal component of the displacements."""

    low: Array
    high: Array
    mean: Array
    ways: Array  # (q, n) mm
    processes: tuple[Any, ...]

    @staticmethod
    def of(x: Array, u: Array, low: Array, high: Array, kernel: Callable[[Array], Any]) -> "Learned":
        """Of solves u (k, n) mm at parameters x (k, d) between low (d,) and high (d,)."""
        mean = u.mean(axis=0)
        left, size, right = np.linalg.svd(u - mean, full_matrices=False)
        some = size**2 > KEPT * (size**2).sum()
        unit = (x - low) / (high - low)
        found = []
        for amount in (left * size).T[some]:
            own = ConstantKernel(1.0, (1e-3, 1e4)) * kernel(np.ones(x.shape[1]))
            own += WhiteKernel(1e-8, (1e-12, 1e-2))
            process = GaussianProcessRegressor(own, normalize_y=True, n_restarts_optimizer=1, random_state=0)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", ConvergenceWarning)  # a length at its bound is an answer
                found.append(process.fit(unit, amount))
        return Learned(low, high, mean, right[some], tuple(found))

    def answer(self, theta: Array) -> tuple[Array, Array]:
        """Displacements (n,) mm at theta (d,), and their sd."""
        unit = ((theta - self.low) / (self.high - self.low))[None]
        found = [one.predict(unit, return_std=True) for one in self.processes]
        amount, sd = (np.array(column)[:, 0] for column in zip(*found, strict=True))
        return self.mean + amount @ self.ways, np.sqrt(sd**2 @ self.ways**2)


def judged(answer: Callable[[Array], tuple[Array, Array]], held: Array, truth: Array) -> dict[str, float]:
    """What an answer is off at points held (k, d) where the truth (k, n) mm is known, and what it states."""
    began = time.process_time()
    told = [answer(theta) for theta in held]
    took = (time.process_time() - began) / len(held)
    u, sd = (np.array(part) for part in zip(*told, strict=True))
    off, stated = (np.sqrt(np.mean(x**2, axis=1)) for x in (u - truth, sd))
    return {
        "rms_mm": float(np.sqrt(np.mean(off**2))),
        "error_95_mm": float(np.quantile(np.abs(u - truth), 0.95)),
        "max_mm": float(np.abs(u - truth).max()),
        "stated_mm": float(np.sqrt(np.mean(stated**2))),
        "pull": float(np.sqrt(np.mean((off / stated) ** 2))),
        "answer_ms": 1e3 * took,
    }


def rows_of(box: str, *, quick: bool, seed: int) -> Iterator[dict[str, Any]]:
    """The rows of a box, one a method and number of solves."""
    model = model_of(SHORT, Lattice(per_bellow=2, centred=False, ring=False), FILM)
    for name in dict.fromkeys(p.partition(".")[0] for p in BOXES[box] if "." in p):
        model = model.with_effect(effect(name))
    low, high = np.array([BOXES[box][p.name] for p in model.parameters]).T
    most = 16 if quick else LEARNT[-1]
    x = np.concatenate([[(low + high) / 2], spread(low, high, LEARNT[-1], seed=seed)])[:most]
    held = low + (high - low) * np.random.default_rng(seed).random((8 if quick else 32, len(low)))
    truth, _ = whole(model, held)
    for response, n, seconds in responses(model, box, x):
        if n in SOLVES:
            row = judged(lambda theta, one=response: flat(one.answer(theta)), held, truth)
            yield {"box": box, "method": "response", "solves": n, "solve_s": seconds, **row}
    u, seconds = whole(model, x)
    for name, kernel in KERNELS.items():
        for n in (n for n in LEARNT if n <= most):
            learned = Learned.of(x[:n], u[:n], low, high, kernel)
            row = judged(learned.answer, held, truth)
            yield {"box": box, "method": name, "solves": n, "solve_s": n * seconds, **row}


def whole(model: KeptModel, x: Array) -> tuple[Array, float]:
    """Displacements (k, n) mm of whole solves at x (k, d), by a model that remembers nothing, and the seconds
    of one."""
    alone = Model(model.test, model.effects, model.reference)
    began = time.process_time()
    u = np.array([alone.predict(theta).ravel() for theta in x])
    return u, (time.process_time() - began) / len(x)


def responses(model: KeptModel, box: str, x: Array) -> Iterator[tuple[RangedResponse, int, float]]:
    """The responses of the first of x (k, d), one more at a time, with their number and seconds so far."""
    began = time.process_time()
    out = RangedResponse.of(model, x[0], within=BOXES[box], solves=1)
    for n, theta in enumerate(x[: SOLVES[-1]], start=1):
        out = out.certified(theta)  # the first is in it
        yield out, n, time.process_time() - began


def flat(answer: Answer) -> tuple[Array, Array]:
    """Displacements and their error (n,) mm."""
    return answer.u.ravel(), answer.error.ravel()


def needed(rows: list[dict[str, Any]], box: str, method: str) -> dict[str, Any]:
    """How many solves a learned process needs for the rms of the response of so many; None: more than all."""
    own = {row["solves"]: row["rms_mm"] for row in rows if (row["box"], row["method"]) == (box, method)}
    told = [row for row in rows if (row["box"], row["method"]) == (box, "response")]
    return {
        str(row["solves"]): next((n for n, rms in own.items() if rms <= row["rms_mm"]), None) for row in told
    }


def table(rows: list[dict[str, Any]]) -> None:
    """Prints the rows."""
    print("| box | method | solves | their time, s | rms, mm | 95 %, mm | most, mm | stated, mm | pull |")
    print("|---|---|---|---|---|---|---|---|---|")
    for row in rows:
        told = " | ".join(f"{row[key]:.2g}" for key in SHOWN)
        print(f"| {row['box']} | {row['method']} | {row['solves']} | {row['solve_s']:.1f} | {told} |")


def main() -> int:
    typed = options(
        __doc__,
        {"--seed": (SEED, "of the points; others are not written")},
        quick="16 solves, one box, 8 points; not written",
        json="print it on one line",
    )
    rows: list[dict[str, Any]] = []
    for box in list(BOXES)[1:2] if typed.quick else BOXES:
        for row in rows_of(box, quick=typed.quick, seed=typed.seed):
            rows.append(row)
            told = f"{box}: {row['method']} of {row['solves']}: {row['rms_mm']:.5f} mm"
            print(told, file=sys.stderr, flush=True)
    own = [row["answer_ms"] for row in rows if row["method"] == "response"]
    found = {
        "answer_ms": float(np.median(own)),
        "needed": {f"{box}: {name}": needed(rows, box, name) for box in BOXES for name in KERNELS},
        "rows": rows,
    }
    if not typed.quick and typed.seed == SEED:
        (RESULTS / "surrogates.json").write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    if typed.json:
        print(json.dumps(found))
    else:
        table(rows)
    return 0


if __name__ == "__main__":
    sys.exit(main())
