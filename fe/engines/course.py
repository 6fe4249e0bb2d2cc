"""The solution of a case along a path, from displacements that another program computed over the pressure.

A cubic spline runs through the program's increments; derivatives and pressure modes are absent. Nodes that
the program's elements do not have are interpolated by its shape functions.
"""

from collections.abc import Sequence

import numpy as np
from scipy.interpolate import CubicSpline

from fe.case import Case
from fe.element import Array, Integers
from fe.engines.engine import EngineResult
from fe.mesh.convert import filled, kept_nodes
from fe.path import Path
from fe.solver.curve import Curve
from fe.solving import Solution

LEAST = 4  # increments, rest included, through which a cubic spline goes


def over_pressure(result: EngineResult, case: Case, kind: str, *, top: float) -> tuple[Array, Array]:
    """Pressures (k,) MPa from 0 to the last one reached, and displacements (k, n, 3) mm of a case's nodes
    there.

    kind: the element that replaced hex27; top: the full pressure in MPa. ValueError where displacements of
    some nodes are missing.
    """
    order = np.argsort(result.labels)
    index = np.searchsorted(result.labels, case.labels, sorter=order)
    rows = order[np.minimum(index, len(order) - 1)]
    there = result.labels[rows] == case.labels
    needed = _needed(case, kind)
    if not there[needed].all():
        label = int(case.labels[needed][~there[needed]][0])
        raise ValueError(f"the result has no displacement of node {label}")
    u = np.where(there[:, None], result.course[:, rows], 0.0)
    if case.element.name == "hex27":
        u = filled(case, kind, u)
    share = result.share
    if share[0] > 0.0:  # nothing was put on before the pressure
        share, u = np.append(0.0, share), np.concatenate([np.zeros_like(u[:1]), u])
    return top * share, u


def _needed(case: Case, kind: str) -> Integers:
    """Rows of the nodes for which the program must return displacements."""
    return kept_nodes(case, kind) if case.element.name == "hex27" else np.unique(case.connectivity)


def along(case: Case, path: Path, courses: Sequence[tuple[Array, Array]], number: Integers) -> Solution:
    """The solution of a case along a path, from a course in each direction of gravity: pressures (k,) MPa and
    displacements (k, n, 3) mm; number (s,): which of them belongs to an output time."""
    output = path.at_output()
    return Solution(
        case=case, path=path, curves=tuple(_curve(*c) for c in courses), number=number, pressure=output,
        slopes=np.zeros((0, len(output))), history=None, iterations=0, reason="converged",
    )  # fmt: skip


def _curve(pressure: Array, u: Array) -> Curve:
    none, nothing = np.zeros(len(pressure)), np.zeros((len(pressure), 1, 1))
    return Curve(
        pressure=pressure, u=u, p=nothing, rotation=none,
        u_slope=np.asarray(CubicSpline(pressure, u, axis=0)(pressure, 1)), p_slope=nothing,
        rotation_slope=none, derivative=np.zeros((0, *u.shape)), p_derivative=np.zeros((0, *nothing.shape)),
        touch=np.zeros((len(u), 3)), touch_derivative=np.zeros((0, len(u), 3)),
        iterations=0, reason="converged",
    )  # fmt: skip
