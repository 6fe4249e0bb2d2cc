"""Does what is learned on one finger hold for another? An effect of the silicone, found in a film of finger
A, foretells finger B; beside it the constants alone, and a learned residual.

    python benchmarks/transfer.py [--quick] [--json] [--folder DIR] [--picture FILE]

A is the short finger of `benchmarks/diagnosis`, filmed in protocol P3 with five markers and noise; the truth
has an effect of the silicone that is hidden by code of its own, in 20-node elements. It is diagnosed with
the whole library (by the tables of `reduced`). B is another body of the same silicone under another course of
pressure: `thick`, a bellows finger with longer pleats and thicker walls, and `pneunet`, two chambers in a
row. B's truth is solved in 20-node elements as well, on meshes that the model does not have; the model of B
has its own mesh and the error that is known of it.

Three predictions of B, none of which has seen B: `named`, the constants and the effects that the diagnosis
names, but those of body and rig, as `twin init --like` takes them over; `constants`, the fit without an
effect; `learned`, that and a Gaussian process (scikit-learn; left out where it is not installed) of what it
leaves on A over pressure, place along the finger and time, scaled with the finger's length.

By trial and prediction: error, the rms of all markers and steps off the truth over the rms motion; cover,
the share of B's values, measured with noise, within 95 %; ratio, halved, named_better: the median of the
named error over it, the shares of trials in which that is at most a half, and less. mesh: what the model is
off without any effect. Trials and truths are kept in --folder, so that
the command goes on where it was stopped. --quick: every fourth trial.
"""

import io
import json
import os
import sys
import tempfile
import time
import warnings
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../.."))
from benchmarks.commandline import options
from benchmarks.diagnosis.bank import MAIN
from benchmarks.diagnosis.snapshots import SHORT
from benchmarks.diagnosis.trialbench import EVERY, START, Scene, Spec, beside, candidates
from benchmarks.otherfingers import Other, fingers

import numpy as np
from numpy.typing import NDArray

from twin.diagnosis.procedure import diagnose
from twin.effects.mechanism import Owner
from twin.effects.protocol import Effect
from twin.judging.judged import Judged
from twin.targets import Targets

Array = NDArray[np.float64]
KINDS: dict[str, tuple[float, float]] = {
    "creep": (0.04, 0.08), "log_creep": (0.075, 0.15), "stretched_creep": (0.1, 0.2),
    "mullins": (0.1, 0.2), "late_softening": (0.1, 0.2), "pressed_softening": (0.125, 0.25),
    "stiffening": (0.02, 0.1), "gent": (0.1, 0.2), "thermal": (-1.5e-3, 1.5e-3), "warming": (-0.2, 0.2),
}  # fmt: skip
OF_FILM = ("thermal",)  # belongs to a film: `twin init --like` leaves it behind
NORMAL = 1.96


# -- one trial -----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Learned:
    """Constants and effects learned on A, with their covariance."""

    effects: tuple[Effect, ...]
    values: dict[str, float]
    names: tuple[str, ...]
    covariance: Array

    @staticmethod
    def of(fitted: Any, *, carried: bool) -> "Learned":
        """Those of a fit on A; carried: with its effects of the silicone, else the constants alone."""
        model, fit = fitted.model, fitted.fit
        every = [e for e in model.effects if e.order != model.effects[0].order]
        effects = tuple(e for e in every if carried and e.owner is Owner.SILICONE)
        own = [p.name for e in (model.effects[0], *effects) for p in e.parameters]
        rows = [k for k, p in enumerate(fit.parameters) if p.name in own]
        names = tuple(fit.parameters[k].name for k in rows)
        covariance = fit.covariance[np.ix_(rows, rows)]
        known = np.isfinite(np.diag(covariance))  # the others stay as they were fitted, as in `twin export`
        covariance = np.where(np.outer(known, known), covariance, 0.0)
        return Learned(effects, {n: float(fitted.values[n]) for n in names}, names, covariance)

    def foretold(self, other: Other, targets: Targets) -> tuple[Array, Array]:
        """Displacements (s, p, 3) mm of another finger, and their variance (s, p, 3) mm2."""
        model = other.model(targets, self.effects)
        theta = model.theta(self.values)
        order = [self.names.index(p.name) for p in model.parameters]
        root = np.linalg.cholesky(
            self.covariance[np.ix_(order, order)] + 1e-18 * np.eye(len(order))
        )
        ways = np.tensordot(root.T, model.jacobian(theta), 1)
        return model.predict(theta), (ways**2).sum(axis=0) + (model.modes(theta) ** 2).sum(axis=0)


def residual_of(targets: Targets, judged: Judged, places: Array, length: float) -> Any:
    """What a fit leaves on A, learned: (pressure MPa, place over length, time s) -> mean and sd over length
    of x and z. ImportError without scikit-learn."""
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

    x, rest = inputs(targets, places, length), targets.value - judged.predicted
    scale, out = x.std(axis=0), []
    for i in (0, 2):
        kernel = ConstantKernel(1.0) * RBF(np.ones(3), (0.01, 1e3)) + WhiteKernel(0.1, (1e-6, 10.0))
        process = GaussianProcessRegressor(kernel, normalize_y=True, n_restarts_optimizer=2, random_state=0)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a length at its bound: an input that does not matter
            out.append(process.fit(x / scale, rest[..., i].ravel() / length))

    def answered(other: Array) -> tuple[Array, Array]:
        found = [process.predict(other / scale, return_std=True) for process in out]
        mean, sd = (np.stack([f[k] for f in found], axis=-1) for k in (0, 1))
        return mean, sd

    return answered


def inputs(targets: Targets, places: Array, length: float) -> Array:
    """Rows (s p, 3) of pressure, place along the finger over its length, and time."""
    s, p = targets.value.shape[:2]
    rows = np.empty((s, p, 3))
    rows[..., 0], rows[..., 1] = targets.pressure[:, None], places[:, 0] / length
    rows[..., 2] = targets.time[:, None]
    return rows.reshape(-1, 3)


def told(u: Array, variance: Array, true: Array, targets: Targets) -> dict[str, float]:
    """Error of a prediction (s, p, 3) mm, and the share of the measured values within its band."""
    seen = targets.valid & np.isfinite(true)
    own = np.diagonal(targets.covariance, axis1=-2, axis2=-1) + (targets.modes**2).sum(axis=0)
    sd = np.sqrt(variance + own)
    off, band = (u - true)[seen], np.abs(targets.value - u)[seen] <= NORMAL * sd[seen]
    motion = float(np.sqrt(np.mean(true[seen] ** 2)))
    return {"error": float(np.sqrt(np.mean(off**2))) / motion, "cover": float(band.mean())}


def bare_error(other: Other) -> float:
    """What the model of another finger is off where nothing is hidden, at the true constants: of its mesh."""
    u, slope = other.true()
    targets = other.targets(u, slope, seed=0)
    known = Learned((), dict(zip(("C10", "C01"), MAIN.values, strict=True)), ("C10", "C01"), np.zeros((2, 2)))
    found, variance = known.foretold(other, targets)
    return told(found, variance, u - u[targets.reference].mean(axis=0), targets)["error"]


def trial(kind: str, size: float, other: Other, seed: int) -> dict[str, Any]:
    """The row of one pair of fingers."""
    scene = Scene.of(Spec("transfer", "P3", (kind,), 0.0, "white", seed))
    data = scene.targets(((EVERY[kind], size),))
    model = scene.model(data)
    found = diagnose(
        model, candidates(), data, seed=seed, start=START, beside=beside(model, ()), plan=False
    )
    assert found.base is not None
    u, slope = other.true(kind, size)
    targets = other.targets(u, slope, seed)
    true = u - u[targets.reference].mean(axis=0)
    row: dict[str, Any] = {
        "kind": kind, "physics": EVERY[kind].physics, "size": size, "other": other.name, "seed": seed,
        "verdict": found.verdict, "grade": found.grade,
    }  # fmt: skip
    kept_fit = found.kept if found.effects and found.kept is not None else found.base
    named = Learned.of(kept_fit, carried=True)
    row |= {"carried": [e.label for e in named.effects]}
    row["named"] = told(*named.foretold(other, targets), true, targets)
    base, variance = Learned.of(found.base, carried=False).foretold(other, targets)
    row["constants"] = told(base, variance, true, targets)
    try:
        moving = data.value[:, ~data.fixed], np.array([p.position for p in scene.points])
        answered = residual_of(data, found.base, moving[1], float(SHORT.length))
    except ImportError:
        return row
    mean, sd = answered(inputs(targets, other.places, other.length))
    more, wide = np.zeros_like(base), variance.copy()
    more[..., (0, 2)] = other.length * mean.reshape(*base.shape[:2], 2)
    wide[..., (0, 2)] += (other.length * sd.reshape(*base.shape[:2], 2)) ** 2
    row["learned"] = told(base + more - more[targets.reference].mean(axis=0), wide, true, targets)
    return row


def trials(quick: bool) -> list[tuple[str, float, str, int]]:
    """Kind, size, finger B and seed of every trial: each kind at two sizes for each finger."""
    every = product((0, 1), KINDS, ("thick", "pneunet"))
    return [
        (kind, KINDS[kind][k], name, seed)
        for seed, (k, kind, name) in enumerate(every) if not quick or seed % 4 == 0
    ]  # fmt: skip


def rates(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Medians of the errors, shares of trials in which the named effect halves them, and coverage."""
    out: dict[str, Any] = {"n": len(rows)}
    for way in ("named", "constants", "learned"):
        seen = [row for row in rows if way in row]
        if not seen:
            continue
        error, own = (np.array([row[w]["error"] for row in seen]) for w in (way, "named"))
        out[way] = {
            "n": len(seen), "error": round(float(np.median(error)), 4), "worst": round(float(error.max()), 4),
            "cover": round(float(np.mean([row[way]["cover"] for row in seen])), 3),
            "ratio": round(float(np.median(own / error)), 3),
            "halved": round(float(np.mean(own <= 0.5 * error)), 3),
            "named_better": round(float(np.mean(own < error)), 3),
        }  # fmt: skip
    return out


def groups(rows: list[dict[str, Any]]) -> dict[str, list[dict[str, Any]]]:
    """The trials of the silicone's effects, those of them in which one was carried over and in which none
    was, and by finger; and those of a drift with time, which belongs to a film."""
    silicone = [r for r in rows if r["physics"] not in OF_FILM]
    return {
        "silicone": silicone, "carried": [r for r in silicone if r["carried"]],
        "nothing_carried": [r for r in silicone if not r["carried"]],
        **{name: [r for r in silicone if r["other"] == name] for name in ("thick", "pneunet")},
        "drift": [r for r in rows if r["physics"] in OF_FILM],
    }  # fmt: skip


def draw(rows: list[dict[str, Any]], path: Path) -> None:
    """A picture of the errors on B, a row a kind and finger: named, constants, learned."""
    from matplotlib.figure import Figure
    from PIL import Image

    figure = Figure(figsize=(8, 4.6), layout="constrained")
    axes = figure.subplots()
    kinds = list(dict.fromkeys(r["kind"] for r in rows))[::-1]
    ways = {"constants": ("tab:orange", "s"), "learned": ("tab:purple", "^"), "named": ("tab:blue", "o")}
    for name, (colour, mark) in ways.items():
        seen = [r for r in rows if name in r]
        y = [kinds.index(r["kind"]) + (0.15 if r["other"] == "thick" else -0.15) for r in seen]
        label = {"constants": "constants alone", "learned": "with a learned residual",
                 "named": "with the named effect"}[name]  # fmt: skip
        axes.plot([100 * r[name]["error"] for r in seen], y, mark, color=colour, label=label, alpha=0.8)
    axes.set(xscale="log", xlabel="error on finger B, % of its motion", yticks=range(len(kinds)))
    axes.set_yticklabels([k.replace("_", " ") for k in kinds])
    axes.grid(axis="x", which="both", alpha=0.3)
    axes.legend(loc="lower left", fontsize="small")
    figure.savefig(drawn := io.BytesIO(), dpi=80)
    Image.open(drawn).convert("RGB").quantize(8).save(path, optimize=True)


def main() -> int:
    """Run the trials, print what they give."""
    typed = options(
        __doc__,
        {
            "--folder": (Path(tempfile.gettempdir()) / "softtwin-transfer", "where trials are kept"),
            "--picture": (Path, "file for a picture of the errors"),
        },
        quick="every fourth trial", json="one JSON line",
    )  # fmt: skip
    typed.folder.mkdir(parents=True, exist_ok=True)
    other, rows = fingers(typed.folder), []
    for kind, size, name, seed in trials(typed.quick):
        path = typed.folder / f"trial-{kind}@{size:g}-{name}-{seed}.json"
        if not path.exists():
            began = time.process_time()
            row = trial(kind, size, other[name], seed)
            path.write_text(json.dumps(row), encoding="utf-8")
            print(f"{row} {time.process_time() - began:.0f} s", file=sys.stderr, flush=True)
        rows.append(json.loads(path.read_text(encoding="utf-8")))
    if not all("learned" in row for row in rows):
        print("the learned residual is left out: pip install scikit-learn", file=sys.stderr)
    found: dict[str, Any] = {name: rates(some) for name, some in groups(rows).items()}
    found["mesh"] = {name: round(bare_error(each), 4) for name, each in other.items()}
    print(json.dumps(found, indent=None if typed.json else 1))
    if typed.picture:
        draw(rows, typed.picture)
    return 0


if __name__ == "__main__":
    sys.exit(main())
