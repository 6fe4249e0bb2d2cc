"""Targets and several laws of the silicone -> each fitted alike, what speaks for it, and which are one class.

Every law begins at its nominal shape and the scale that fits best there, and is fitted by least squares with
whole solves. The errors of gauge and mesh are those at its fit; those of the mesh are made once, as a finer
mesh adds to a displacement, whatever law leads there. Laws are compared by evidence (2 ln B by Laplace's
approximation, with even priors over the bounds) and BIC: of two that are no more than LAW_TIE apart on one of
both scales the targets prefer neither.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fe.solver.limits import largest_stretch
from fe.solver.newton import Problem
from twin.bench.workbench import Workbench
from twin.diagnosis.evidence import occam
from twin.effects.material import Elasticity
from twin.judging.judged import Judged, judge
from twin.judging.materialcurves import curve_jacobian
from twin.laws.law import Constants, RubberLaw
from twin.laws.stability import drucker_limit
from twin.messages import Say
from twin.model.discretisation import Discretisation
from twin.model.structure import in_law
from twin.study.loadpathfit import OnPaths
from twin.targets import Array

LAW_TIE = 6.0  # 2 ln B: below it neither of two laws is preferred (Kass & Raftery 1995, doi 10.2307/2291091)


@dataclass(frozen=True, kw_only=True)
class LawFit:
    """A law fitted: its constants, -2 ln evidence and BIC but for a constant that all laws share, the highest
    principal stretch in the model, and up to which stretch it is stable, and in which mode not beyond."""

    law: RubberLaw
    judged: Judged
    constants: Constants
    evidence: float
    bic: float
    stretch: float
    stable_to: float
    mode: str


def bench_of(bench: Workbench, law: RubberLaw) -> Workbench:
    """The workbench of a project with another law, between its usual bounds; its own as twin.toml has it."""
    if law == bench.law:
        return bench
    elasticity = Elasticity(law)
    return replace(bench, elasticity=elasticity, structure=in_law(bench.structure, elasticity.nominal))


def starts_of(bench: Workbench, say: Say) -> Array:
    """Constants (m, d) at which the law of a workbench is fitted: each shape at the scale that fits best.
    ValueError where none is solved."""
    elasticity, starts = bench.elasticity, []
    usual = elasticity.nominal == bench.law.nominal and not elasticity.fixed
    shapes = bench.law.starts if usual else (elasticity.initial.shape,)
    for shape in shapes:
        theta, costs = OnPaths.of(bench, say, held=shape).over_scales(shape)
        if np.isfinite(costs).any():
            starts.append(theta[int(costs.argmin())])
    if not starts:
        raise ValueError(
            f"law {bench.law.name!r}: no scale within its bounds has an equilibrium at the highest pressure"
        )
    return np.array(starts)


def fitted(bench: Workbench, starts: Array, mesh: Discretisation | None, *, seed: int) -> LawFit:
    """The law of a workbench fitted from constants (m, d). Raises Unsolvable where it cannot be solved."""
    discretisation = None if mesh is None else replace(mesh, law=bench.law)
    model = bench.model(()).on_mesh(discretisation)
    judged = judge(model, bench.targets, starts=starts, seed=seed)
    constants = bench.elasticity.constants(judged.values)
    stretch = _stretch(judged)
    stable_to, mode = drucker_limit(constants.material, stretch)
    return LawFit(
        law=bench.law, judged=judged, constants=constants, evidence=judged.deviance + _occam(bench, judged),
        bic=judged.deviance + len(judged.fit.theta) * float(np.log(_count(bench, judged))),
        stretch=stretch, stable_to=stable_to, mode=mode,
    )  # fmt: skip


def _occam(bench: Workbench, judged: Judged) -> float:
    """Occam factor of the evidence, for priors of the variance of the bounds about their middle."""
    bounds = {p.name: (p.low, p.high) for p in bench.elasticity.parameters}
    free = [p.name for p in judged.fit.parameters if p.name not in judged.at_bound]
    low, high = np.array([bounds[name] for name in free]).reshape(-1, 2).T
    sd = (high - low) / np.sqrt(12)
    away = (np.array([judged.values[name] for name in free]) - (low + high) / 2) / sd
    rows = judged.fitted * sd
    if bench.targets.curves:
        every = [p.name not in judged.at_bound for p in judged.model.parameters]
        curves = curve_jacobian(judged.model, bench.targets, judged.theta)[:, every]
        rows = np.concatenate([rows, curves * sd])
    return occam(away, rows.T @ rows)


def _count(bench: Workbench, judged: Judged) -> int:
    """Number of values that are fitted, of the film and of tests of the silicone."""
    return judged.whitener.count + sum(len(curve.strain) for curve in bench.targets.curves)


def _stretch(judged: Judged) -> float:
    """The highest principal stretch in the model at the highest pressure."""
    solution = judged.model.solution(judged.theta)
    test = judged.model.put(judged.values)
    step = int(np.argmax(test.path.at_output()))
    (u,) = solution.fields([step])
    return largest_stretch(Problem.of(solution.case), u)[0]


def classes(fits: Sequence[LawFit]) -> list[list[LawFit]]:
    """The laws in classes, the best first: each law joins the first class whose best is not ahead of it by
    LAW_TIE in both evidence and BIC."""
    out: list[list[LawFit]] = []
    for fit in sorted(fits, key=lambda f: f.evidence):
        for group in out:
            if not min(fit.evidence - group[0].evidence, fit.bic - group[0].bic) >= LAW_TIE:
                group.append(fit)
                break
        else:
            out.append([fit])
    return out
