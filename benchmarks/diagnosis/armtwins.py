"""A virtual pneumatic arm of another element: are fibres around it named where it has them?

    python benchmarks/diagnosis/armtwins.py [--films N] [--others N] [--markers SET] [--seconds S] [--json]

The truth is the section of `benchmarks/kernel/arm.py` in 20-node hexahedra on a finer mesh; the model has
27-node ones. Its ribs are 0.5 mm thicker or thinner than the model's. Its silicone is drawn, in half of the
arms with a third term (C20) that the law of the model has not. The regulator lags: the pressure is below the
nominal one by a share of exp(-1.25 s / tau), tau 0.1 to 0.4 s. The noise is that of the real record, 0.15 mm.
Hidden by kind: `fibres` of 0.5 to 2 N/mm, wound at 3 degrees; `limit`, the same, fitted up to 300 mbar from
the beam's constants, near their limit point; `stiffening`, a C20 of a tenth of C10 + C01; `wall_taper`, by
0.8 mm in all; `nothing`.

Fitted are three pressures, the highest 200 mbar, held out two between them and one beyond. Constants alone
are fitted, then `twin.diagnosis` is asked what they lack. --markers: `tip`, two on the end cap as the real
arm has; `half`, one more below, half way along; `bulge`, one more on the wall of the chamber there.

in_set: share whose names hold what is hidden; named: share whose verdict is this alone; refused: share whose
verdict is `none of these`; wrong: share that is named without it. Of constants alone, and with what is
named, medians: between and beyond, the error in mm of a point in the recordings held out; cover, the share of
their values within 95 %. Without options benchmarks/results/arm_twins.json is written.
"""

import json
import os
import sys
import time
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks import ROOT
from benchmarks.commandline import options
from benchmarks.diagnosis.realarm import BEAM_E, FEET, HOOP, SD, Begun, fitted
from benchmarks.kernel.arm import SILICONE, Arm

import numpy as np

from calibrate import Fit
from fe import Case, Material, Path, solve
from fe.case import Layer
from fe.mesh.convert import converted
from fe.mesh.points import nearest
from fe.mesh.skin import outer_skin
from twin.calibrated.problem import CalibrationProblem, Carried
from twin.diagnosis.deciding import NONE
from twin.diagnosis.procedure import diagnose
from twin.effects.library import all_effects
from twin.effects.material import Elasticity
from twin.effects.protocol import Unsolvable
from twin.judging.stillnoise import stated_noise
from twin.laws.mooneyrivlin import MOONEY_RIVLIN
from twin.model.structure import Structure
from twin.targets import Array, PointKind, TargetPoint, Targets, as_position

OUT = ROOT / "benchmarks" / "results" / "arm_twins.json"
MODEL = Arm(cells=(3, 1, 1), rib=6.0, framed=True)
CELLS, ELEMENT = (6, 2, 1), "C3D20H"  # of the truth
SHARES = np.array([1 / 2, 3 / 4, 1.0, 5 / 8, 7 / 8, 5 / 4])  # of the top pressure, three held out
FITTED, EVALUATIONS = 3, 12
FILMS, OTHERS = 20, 5  # arms with fibres, and of each other kind
TOP = {"limit": 300.0}  # mbar, the highest that is fitted; of the others 200
PLACES = {"m6": FEET[0], "m7": FEET[1], "half": [50.0, 0.0, -22.2], "bulge": [50.0, 0.0, 22.2]}  # mm
SETS = {"tip": ("m6", "m7"), "half": ("m6", "m7", "half"), "bulge": ("m6", "m7", "bulge")}
NAMES = {"fibres": HOOP, "limit": HOOP, "stiffening": "stiffening", "wall_taper": "wall_taper", "nothing": ""}


@dataclass(frozen=True)
class Film:
    """One arm: what it hides, its seed, and its markers, a name of SETS; top: the highest fitted pressure in
    mbar, if not that of its kind."""

    kind: str
    seed: int
    markers: str = "tip"
    top: float | None = None

    @cached_property
    def drawn(self) -> dict[str, float]:
        """E over the beam's, C01 and C20 over E / 6, mm of ribs and taper, N/mm of fibres, tau in s."""
        rng = np.random.default_rng(1000 * self.seed + 7)
        sign = rng.choice([-1.0, 1.0], 2)
        return {
            "E": float(rng.uniform(1.0, 1.3)), "C01": float(rng.uniform(0.15, 0.35)),
            "C20": 0.1 if self.kind == "stiffening" else 0.007 * (self.seed % 2),
            "rib": float(MODEL.rib + 0.5 * sign[0]), "tau": float(rng.uniform(0.1, 0.4)),
            "taper": float(0.8 * sign[1] * (self.kind == "wall_taper")),
            "fibres": float(np.exp(rng.uniform(*np.log([0.5, 2.0]))) * (self.kind in ("fibres", "limit"))),
        }  # fmt: skip

    @property
    def pressure(self) -> Array:
        """Nominal pressures (r,) MPa of the recordings."""
        return 1e-4 * (self.top or TOP.get(self.kind, 200.0)) * SHARES

    def true_case(self) -> Case:
        """The arm with what is hidden in it."""
        drawn = self.drawn
        mu, rib, taper = drawn["E"] * BEAM_E / 6, drawn["rib"], drawn["taper"] / 2
        rubber = Material((1 - drawn["C01"]) * mu, drawn["C01"] * mu, drawn["C20"] * mu)
        base, tip = (
            replace(MODEL, cells=CELLS, rib=rib, wall=MODEL.wall + s * taper).case(rubber) for s in (-1, 1)
        )
        x = base.nodes[:, :1] / MODEL.length
        case = converted(replace(base, nodes=(1 - x) * base.nodes + x * tip.nodes), ELEMENT)
        if not drawn["fibres"]:
            return case
        surfaces = {**case.surfaces, "sleeve": outer_skin(case)}
        sleeve = Layer("sleeve", drawn["fibres"], wound=True, angle=3.0)
        return replace(case, surfaces=surfaces, layers=(sleeve,))

    @cached_property
    def true(self) -> Array:
        """True displacements (r, p, 3) mm of PLACES. ValueError where there is no equilibrium."""
        case, reached = self.true_case(), self.pressure * (1 - np.exp(-1.25 / self.drawn["tau"]))
        course = np.concatenate([[0.0], np.sort(reached)])
        solution = solve(case, Path(course, course, course), count=8)
        if not solution.converged:
            raise ValueError(f"the truth {solution.reason}")
        u = solution.at(np.array([nearest(case, np.array(x)) for x in PLACES.values()]))
        return np.asarray(u[1 + np.argsort(np.argsort(reached))], float)

    def targets(self) -> Targets:
        """What a user has: a block a recording, at rest and at its end, the last ones held out."""
        u = self.true + SD * np.random.default_rng(self.seed).standard_normal(self.true.shape)
        names, r = SETS[self.markers], len(u)
        value, valid, pressure = np.zeros((2 * r, len(names), 3)), np.zeros(2 * r, bool), np.zeros(2 * r)
        value[1::2] = u[:, [list(PLACES).index(name) for name in names]]
        valid[1::2], pressure[1::2] = True, self.pressure
        t, block = np.arange(2.0 * r), np.arange(2 * r) // 2
        places = [as_position(np.array(PLACES[name])) for name in names]
        points = [TargetPoint(n, PointKind.PLACE, None, x) for n, x in zip(names, places, strict=True)]
        return Targets(
            time=t, pressure=pressure, block=block, points=tuple(points), value=value,
            covariance=np.tile(SD**2 * np.eye(3), (*value.shape[:2], 1, 1)),
            valid=np.broadcast_to(valid[:, None, None], value.shape), held_out=block >= FITTED,
            modes=np.zeros((0, *value.shape)), mode_names=(), noise=stated_noise(value, SD, 0.0),
            log_time=t, log_pressure=pressure, reference=np.arange(0, 2 * r, 2), gravity=None,
            pressure_sd=np.zeros(2 * r),
        )  # fmt: skip


def problem(film: Film) -> CalibrationProblem:
    """The model of the arm, with what was measured of it."""
    case = MODEL.case(SILICONE)
    structure = Structure(case, repr(MODEL), {}, case.face_nodes("outside"))
    return CalibrationProblem(film.targets(), structure, Elasticity(MOONEY_RIVLIN), mesh_error=False)


def foretold(
    whole: CalibrationProblem, top: float, labels: tuple[str, ...], fit: Fit
) -> dict[str, float | None]:
    """The error of a point in mm, rms, of a fit with effects in the recordings held out, up to the top one
    in MPa that was fitted and beyond (None: not carried), and the share of their values within 95 %."""
    for q in (whole, whole.carrying(Carried(top, top))):
        model, data = q.model(labels), q.targets
        theta = model.theta({name.name: x for name, x in zip(fit.parameters, fit.theta, strict=True)})
        try:
            u, jacobian = model.predict(theta), model.jacobian(theta)
            break
        except Unsolvable:
            continue
    else:
        return dict.fromkeys(("between", "beyond", "cover"))
    seen = data.held_out & data.valid.any(axis=(1, 2))
    error, scale = (data.value - u)[seen], max(fit.chi2 / max(fit.degrees_of_freedom, 1), 1.0)
    j, covariance = jacobian[:, seen], np.nan_to_num(fit.covariance, posinf=0.0)
    sd = np.sqrt(np.einsum("fspi,fg,gspi->spi", j, covariance, j) * scale + SD**2 * scale)
    between = data.pressure[seen] <= top * (1 + 1e-9)

    def rms(rows: Array) -> float | None:
        return round(float(np.sqrt((rows**2).sum(axis=2).mean())), 3) if rows.size else None

    return {"between": rms(error[between]), "beyond": rms(error[~between]),
            "cover": round(float((np.abs(error) < 1.96 * sd).mean()), 3)}  # fmt: skip


def trial(film: Film) -> dict[str, Any]:
    """The row of one arm."""
    began, whole = time.process_time(), problem(film)
    p, model, fit = fitted(whole, Begun(1.0 if film.kind == "limit" else 2.5), EVALUATIONS)
    top = float(p.targets.pressure[p.targets.used.any(axis=(1, 2))].max())
    p = p.carrying(Carried(top, top))
    model = p.model(())
    found = diagnose(model, all_effects(MOONEY_RIVLIN), p.targets, seed=film.seed, start=fit, plan=False)
    near = sorted({name for each in found.nearest for name in each.split(" + ")})
    hidden, named = NAMES[film.kind], bool(found.named)
    row = {
        "kind": film.kind, "seed": film.seed, "drawn": film.drawn, "verdict": found.verdict, "nearest": near,
        "carried_mbar": round(1e4 * top, 1),
        "left_mm": round(p.targets.rms(p.targets.value - model.predict(fit.theta)), 3),
        "in_set": named and hidden in near, "named": found.verdict == hidden,
        "wrong": named and hidden not in near, "alone": foretold(whole, top, (), fit),
    }  # fmt: skip
    if found.named and found.kept is not None:
        row["with_it"] = foretold(whole, top, tuple(e.label for e in found.effects), found.kept.fit)
        row["values"] = found.kept.values
    return row | {"seconds": round(time.process_time() - began, 1)}


def share(flags: list[bool]) -> float:
    """The share of those that are true."""
    return round(float(np.mean(flags)), 3)


def median(rows: list[dict[str, Any]], which: str, key: str) -> float | None:
    """The median over rows of a figure that a fit foretells; None where no row has it."""
    some = [r[which][key] for r in rows if which in r and r[which][key] is not None]
    return round(float(np.median(some)), 3) if some else None


def rates(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Shares and medians of the arms of one kind."""
    refused = share([r["verdict"].startswith(NONE) for r in rows])
    out: dict[str, Any] = {"n": len(rows), "wrong": share([r["wrong"] for r in rows]), "refused": refused}
    if rows[0]["kind"] == "nothing":
        out["false_alarms"] = share([r["verdict"] != "none needed" for r in rows])
    else:
        out |= {key: share([r[key] for r in rows]) for key in ("in_set", "named")}
    for key in ("between", "beyond", "cover"):
        out[key] = [median(rows, which, key) for which in ("alone", "with_it")]
    return out


def main() -> None:
    """Make the arms, print and keep what they give."""
    more = {
        "--films": (FILMS, "arms with fibres"),
        "--others": (OTHERS, "arms of each other kind"),
        "--markers": {"choices": list(SETS), "default": "tip", "help": "by default two at the tip"},
        "--seconds": (float, "of processor, after which no arm is begun"),
    }
    typed = options(__doc__, more, json="one JSON line")
    counts = {kind: typed.films if kind == "fibres" else typed.others for kind in NAMES}
    every = [(k / max(n, 1), (kind, k)) for kind, n in counts.items() for k in range(n)]
    rows: list[dict[str, Any]] = []
    for _, (kind, seed) in sorted(every, key=lambda row: row[0]):
        if time.process_time() > (typed.seconds or np.inf):
            break
        rows.append(trial(Film(kind, seed, typed.markers)))
        print(json.dumps(rows[-1]), file=sys.stderr, flush=True)
    kinds = dict.fromkeys(r["kind"] for r in rows)
    result = {kind: rates([r for r in rows if r["kind"] == kind]) for kind in kinds}
    if len(sys.argv) == 1 and len(rows) == len(every):
        OUT.write_text(json.dumps({"rates": result, "arms": rows}, indent=1) + "\n")
    print(json.dumps(result, indent=None if typed.json else 1))


if __name__ == "__main__":
    main()
