"""A pneumatic arm that nobody here made: three pressures fitted, twelve predicted, without and with fibres.

    python benchmarks/diagnosis/realarm.py [--plain] [--fit MBAR MBAR MBAR] [--ask] [--rib MM]
        [--evaluations N] [--json]

Some minutes; needs $SOFTTWIN_DATA. Without options it writes benchmarks/results/real_arm.json. Motion capture
of arXiv 2201.12560 at 100 Hz, a step of nominal pressure in each recording. Used is how the tip stands at the
end of it, 1 to 1.5 s after the step, against its first frame; the ringing in between is no equilibrium. The
rigid motion of the four base markers is taken off; the three tip markers, some 6 mm off the silicone, tell
the rigid motion of the end cap, and two feet of markers on the skin are compared. Assumed: what
`benchmarks/kernel/arm.py` assumes of the section; the plane in which the arm bends (its mean over the fitted
recordings) is that of its symmetry; that the cap at the tip is held by a stiff frame, and ribs of 6 mm. The
third fit has a sheet on the sides of the bore, as hoses would act, the fourth a silicone that stiffens beside
it. --plain: ribs of 2.3 mm, no frame. --ask: `twin.diagnosis` says what the constants alone lack.
"""

import json
import os
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks.commandline import options
from benchmarks.kernel.arm import SILICONE, Arm

import numpy as np

from calibrate import Fit
from fe.mesh.finger import NAMED_NODES
from twin.bench.workbench import as_far_as_it_carries
from twin.calibrated.effectstarts import nominal
from twin.calibrated.problem import CalibrationProblem, Carried
from twin.diagnosis.procedure import diagnose
from twin.effects.library import all_effects
from twin.effects.material import Elasticity
from twin.formats.basemotion import rigid
from twin.judging.fitting import fit_unweighted
from twin.judging.stillnoise import stated_noise
from twin.laws.mooneyrivlin import MOONEY_RIVLIN
from twin.model.prediction import Model
from twin.model.structure import Structure
from twin.targets import Array, PointKind, TargetPoint, Targets

ROOT = Path(__file__).resolve().parents[2]
DATA = Path(os.environ.get("SOFTTWIN_DATA", ROOT.parent / "shared" / "data")) / "pneumatic_arm"
FITTED = (100, 200, 300)  # mbar
EVERY = (50, 75, 100, 125, 150, 175, 200, 225, 250, 275, 300, 325, 350, 375, 400)
END = slice(100, 151)  # frames of a recording whose mean is compared
SD = 0.15  # mm: of that mean, by how the tip creeps meanwhile
TURN = np.diag([1.0, -1.0, -1.0])  # the room's axes in the model's: x along the arm, the free side up
LENGTH, RADIUS = 100.0, 22.2  # mm
FEET = np.array([[LENGTH, 0.0, -RADIUS], [LENGTH, 20.9, -7.5]])
BEAM_E = 0.263824  # MPa, the beam of the same silicone, as published
CELLS = (4, 1, 1)  # of the mesh: along the chambers, along half a side of one, across it
EVALUATIONS = 25  # of a fit
HOOP, SHEET, STIFFER = "hoop_reinforcement", "strain_limiting_layer", "stiffening"


@dataclass(frozen=True)
class Begun:
    """Where a fit begins: times the beam's modulus, and parameters of effects by name."""

    modulus: float
    values: dict[str, float] = field(default_factory=dict)

    @property
    def effects(self) -> tuple[str, ...]:
        """The names of its effects."""
        return tuple(name.partition(".")[0] for name in self.values)

    @property
    def constants(self) -> dict[str, float]:
        """C10 and C01 in MPa."""
        return dict(MOONEY_RIVLIN.at(BEAM_E / 6 * self.modulus, (0.3,)).named)


FIBRES, CORE, MORE = f"{HOOP}.stiffness", f"{SHEET}.stiffness", f"{STIFFER}.C20"  # N/mm, N/mm, MPa
ALONE = Begun(2.5)
PLAIN = {"constants alone": ALONE, HOOP: Begun(1.5, {FIBRES: 1.6})}
FITS = {"constants alone": ALONE, HOOP: Begun(1.3, {FIBRES: 1.6}),
        f"{HOOP} + {SHEET}": Begun(1.0, {FIBRES: 1.3, CORE: 40.0}),
        f"{HOOP} + {SHEET} + {STIFFER}": Begun(1.0, {FIBRES: 1.3, CORE: 40.0, MORE: 0.004})}  # fmt: skip
RIB, PLAIN_RIB = 6.0, 2.3  # mm
SEED = 1


def moved(mbar: int) -> Array:
    """Displacements (2, 3) mm of the feet in the axes of the model at the end of a recording."""
    rows = np.loadtxt(DATA / f"arm_{mbar:03d}mbar.csv", delimiter=",", skiprows=1)[:, 1:].reshape(-1, 7, 3)
    rest, end = rows[0], rows[END].mean(axis=0)
    turn, shift = rigid(end[:4], rest[:4])
    before, after = rest[4:] @ TURN, (end[4:] @ turn.T + shift) @ TURN
    middle = np.array([LENGTH, 0.0, -15.8]) - before.mean(axis=0)  # of the three tip markers, in the model
    turned, pushed = rigid(before + middle, after + middle)
    return np.asarray(FEET @ turned.T + pushed - FEET, float)


def measured(fit: tuple[int, ...]) -> Targets:
    """A block a recording, at rest and at the end, those that are not fitted held out."""
    every = (*fit, *(mbar for mbar in EVERY if mbar not in fit))
    u = np.array([moved(mbar) for mbar in every])
    aside = np.arctan2(*-u[: len(fit), :, 1:].sum(axis=(0, 1)))
    c, s = np.cos(aside), np.sin(aside)
    u = u @ np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]]).T
    n = 2 * len(every)
    value = np.zeros((n, 2, 3))
    value[1::2] = u
    valid = np.zeros((n, 2, 3), bool)
    valid[1::2] = True
    pressure = np.zeros(n)
    pressure[1::2] = 1e-4 * np.array(every)
    points = tuple(
        TargetPoint(name, PointKind.PLACE, None, (float(x), float(y), float(z)))
        for name, (x, y, z) in zip(("m6", "m7"), FEET, strict=True)
    )
    return Targets(
        time=np.arange(float(n)), pressure=pressure, block=np.arange(n) // 2, points=points, value=value,
        covariance=np.tile(SD**2 * np.eye(3), (n, 2, 1, 1)), valid=valid,
        held_out=np.arange(n) // 2 >= len(fit), modes=np.zeros((0, n, 2, 3)), mode_names=(),
        noise=stated_noise(value, SD, 0.0), log_time=np.arange(float(n)), log_pressure=pressure,
        reference=np.arange(0, n, 2), gravity=None, pressure_sd=np.zeros(n),
    )  # fmt: skip


def problem(arm: Arm, fit: tuple[int, ...]) -> CalibrationProblem:
    """The arm with what was measured of it."""
    case = arm.case(SILICONE)
    structure = Structure(case, repr(arm), {}, case.face_nodes("outside"))
    assert set(NAMED_NODES.values()) <= set(case.labels.tolist())
    return CalibrationProblem(measured(fit), structure, Elasticity(MOONEY_RIVLIN), mesh_error=False)


def fitted(
    whole: CalibrationProblem, begun: Begun, evaluations: int
) -> tuple[CalibrationProblem, Model, Fit]:
    """The model with effects, all values alike, fitted as far as it carries the test."""
    def fit(p: CalibrationProblem) -> tuple[CalibrationProblem, Model, Fit]:
        model = p.model(begun.effects)
        theta = model.theta({**nominal_of(model), **begun.constants, **begun.values})
        model.predict(theta)  # raises where the model does not carry the test there
        return p, model, fit_unweighted(model, p.targets, start=theta, evaluations=evaluations)

    return as_far_as_it_carries(whole, fit)  # type: ignore[arg-type]


def nominal_of(model: Any) -> dict[str, float]:
    """Default start values of the parameters of a model's effects."""
    values: dict[str, float] = {}
    for e in model.effects:
        values |= nominal(e, model.test)
    return values


def lacking(p: CalibrationProblem, model: Model, fit: Fit) -> dict[str, Any]:
    """What `twin.diagnosis` says that a fit lacks, by the recordings that it was made of."""
    top = float(p.targets.pressure[p.targets.used.any(axis=(1, 2))].max())
    known = {e.name for e in model.effects}
    p = p.carrying(Carried(top, top))
    effects = [e for e in all_effects(MOONEY_RIVLIN) if e.name not in known]
    model = p.model([e.label for e in model.effects[1:]])
    found = diagnose(model, effects, p.targets, seed=SEED, start=fit, plan=False)
    return {"verdict": found.verdict, "named": list(found.named), "nearest": list(found.nearest),
            "mechanisms": [str(m) for m in found.mechanisms], "sentence": found.sentence}  # fmt: skip


def told(p: CalibrationProblem, model: Model, fit: Fit) -> dict[str, Any]:
    """Figures of a fit in the recordings that it has not seen, as far as the model carries them. The band of
    95 % holds what the fit leaves of its own data for the error of a value."""
    t, u = p.targets, model.predict(fit.theta)
    seen = t.held_out & t.valid.any(axis=(1, 2))
    error, motion = (t.value - u)[seen], t.value[seen]
    scale = fit.chi2 / max(fit.degrees_of_freedom, 1)
    covariance = np.nan_to_num(fit.covariance, posinf=0.0) * scale
    jacobian = model.jacobian(fit.theta)[:, seen]
    variance = np.einsum("fspi,fg,gspi->spi", jacobian, covariance, jacobian) + SD**2 * scale
    rms = float(np.sqrt((error**2).sum(axis=2).mean()))
    values = model.named(fit.theta)
    return {
        "fitted_to_kPa": 1e3 * float(t.pressure[t.used.any(axis=(1, 2))].max()),
        "recordings": int(seen.sum()), "heldout_mm": rms,
        "heldout_pct": 100 * rms / float(np.sqrt((motion**2).sum(axis=2).mean())),
        "cover": float((np.abs(error) < 1.96 * np.sqrt(variance)).mean()), "fitted_mm": t.rms(t.value - u),
        "E_over_beam": 6 * (values["C10"] + values["C01"]) / BEAM_E, "converged": fit.converged,
        "values": values,
    }  # fmt: skip


def main() -> None:
    """Fit, predict, write the figures."""
    mbar = {"nargs": 3, "type": int, "choices": EVERY, "default": list(FITTED), "help": "that are fitted"}
    own = {
        "--plain": {"action": "store_true", "help": f"ribs of {PLAIN_RIB} mm, no frame"},
        "--fit": {"metavar": "MBAR", **mbar},
        "--rib": (float, f"thickness of the ribs, mm; by default {RIB:g}"),
        "--evaluations": (EVALUATIONS, "of a fit, at most"),
        "--ask": {"action": "store_true", "help": "ask twin.diagnosis what the constants alone lack"},
    }  # fmt: skip
    typed = options(__doc__, own, json="one JSON line")
    rib = typed.rib or (PLAIN_RIB if typed.plain else RIB)
    whole = problem(Arm(cells=CELLS, rib=rib, framed=not typed.plain), tuple(typed.fit))
    rows, asked = dict[str, Any](), None
    for name, begun in (PLAIN if typed.plain else FITS).items():
        found = fitted(whole, begun, typed.evaluations)
        rows[name] = told(*found)
        print(name, json.dumps(rows[name]), file=sys.stderr, flush=True)
        if begun == ALONE and typed.ask:
            asked = lacking(*found)
            print(name, json.dumps(asked), file=sys.stderr, flush=True)
    alone, chosen = rows["constants alone"], rows[list(rows)[-1]]
    result = {
        "named": asked,  # null: not asked
        "heldout_ratio": alone["heldout_mm"] / chosen["heldout_mm"], "heldout_pct": chosen["heldout_pct"],
        "cover": chosen["cover"], "E_over_beam": chosen["E_over_beam"], "fitted_mbar": typed.fit,
        "rib_mm": rib, "framed": not typed.plain, "cells": list(CELLS), "rows": rows,
    }  # fmt: skip
    if len(sys.argv) == 1:
        (ROOT / "benchmarks" / "results" / "real_arm.json").write_text(json.dumps(result, indent=1) + "\n")
    if typed.json:
        print(json.dumps(result))


if __name__ == "__main__":
    main()
