"""A real silicone beam under hung weights: fitted to one load, the others predicted, and what may be missing.

Dragon Skin 10, 30 x 30 x 100 mm, held at one end, lying; motion capture at 100 Hz of three markers at its tip
and three at its base (srl-ethz/diffPD_sim2real, arXiv 2201.12560). Each recording begins with the tip held up
by hand and ends at rest under the beam's own weight and none, 52 g or 101 g hung at the tip.

What is compared: how far the tip falls, comes back towards the clamp, and turns, from held to rest, by the
rigid motion of the three tip markers; that of the base markers is taken off, as the clamp gives way.

Assumed: the beam is straight and free of stress where the hand holds it; gravity is along -x of the files;
weights hang at the middle of the end face, 100 mm from the clamp; the tip markers follow the end face,
and their mean lies on its middle. How far the held tip differs between the three recordings is the error of
the first; the noise of the base markers that of the clamp's motion.
"""

from dataclasses import dataclass, replace
from pathlib import Path as File
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import f as f_distribution

from calibrate import Fit, Parameter, least_squares
from fe import Block, Case, Clamp, Material, Path, Support, solve

Array = NDArray[np.float64]
FILES = {0.0: "beam_gravity_V2_a", 52.0: "beam_load52_V2_a", 101.0: "beam_load101_V2_a"}  # by grams hung
LENGTH, SIDE, DENSITY, G = 100.0, 30.0, 1.07e-9, 9810.0  # mm, mm, tonne/mm3, mm/s2
HELD, REST = slice(20, 40), slice(-100, None)  # frames; in the first ten the markers jump
CELLS = (10, 2, 4)  # along, across half of it, up
ENDS = np.array([[LENGTH, 0.0, 0.0], [LENGTH, 0.0, SIDE / 2], [LENGTH, 0.0, -SIDE / 2]])
SEEN = ("falls mm", "comes back mm", "turns deg")
SILICONE = Parameter("C10", 0.01, 0.3, "MPa", start=0.05)
CLAMP = Parameter("clamp", 0.0, 5e-3, "rad/(N mm)", start=0.0)


@dataclass(frozen=True)
class Measured:
    """What the tip does under each load (3,) g: value (3, 3), a row a load, columns as SEEN; sd (3,)."""

    load: Array
    value: Array
    sd: Array


def measured(folder: File) -> Measured:
    """The motion of the tip against the base in every recording, from held to rest."""
    held, rest = zip(*(ends(folder / f"{name}.c3d") for name in FILES.values()), strict=True)
    value = np.array([motion(a, settled(b, a)) for a, b in zip(held, rest, strict=True)])
    poses = np.array([motion(held[0], settled(a, held[0])) for a in held])  # one hand, three times
    return Measured(np.array(list(FILES)), value, np.hypot(poses.std(axis=0, ddof=1), clamp_sd(held, rest)))


def ends(path: File) -> tuple[Array, Array]:
    """Mean positions (6, 3) mm of the markers while held and at rest, those of the tip first, in axes of the
    model: x along the beam, z up."""
    import ezc3d

    every = 1e3 * np.moveaxis(ezc3d.c3d(str(path))["data"]["points"][:3], 0, 2)[..., [2, 1, 0]]
    every[..., 1] *= -1.0
    return every[:, HELD].mean(axis=1), every[:, REST].mean(axis=1)


def rigid(a: Array, b: Array) -> tuple[Array, Array]:
    """Rotation (3, 3) and shift (3,) that bring points a (k, 3) nearest to b (Kabsch 1976, doi
    10.1107/S0567739476001873)."""
    U, _, Vt = np.linalg.svd((a - a.mean(axis=0)).T @ (b - b.mean(axis=0)))
    turn = Vt.T @ np.diag([1.0, 1.0, np.sign(np.linalg.det(Vt.T @ U.T))]) @ U.T
    return turn, b.mean(axis=0) - turn @ a.mean(axis=0)


def settled(markers: Array, base: Array) -> Array:
    """Markers (6, 3) with the motion of the base since `base` (6, 3) taken off."""
    turn, shift = rigid(markers[3:], base[3:])
    return markers @ turn.T + shift


def motion(a: Array, b: Array) -> Array:
    """How far the tip falls and comes back, mm, and turns, degrees, from markers a (6, 3) to b."""
    turn, _ = rigid(a[:3], b[:3])
    back, _, up = (b[:3] - a[:3]).mean(axis=0)
    return np.array([-up, -back, np.degrees(np.arctan2(-turn[2, 0], turn[0, 0]))])


def clamp_sd(held: tuple[Array, ...], rest: tuple[Array, ...]) -> Array:
    """The sd (3,) that the base markers' own error gives the tip: what a rigid motion leaves of them."""
    left = [settled(b, a)[3:] - a[3:] for a, b in zip(held, rest, strict=True)]
    noise = float(np.sqrt(np.sum(np.square(left)) / (3 * len(left))))  # 9 coordinates, 6 of a rigid motion
    base = held[0][3:] - held[0][3:].mean(axis=0)
    turn = noise / float(np.sqrt((base[:, [0, 2]] ** 2).sum()))
    arm = held[0][:3].mean(axis=0) - held[0][3:].mean(axis=0)
    return np.array([np.hypot(noise, turn * arm[0]), np.hypot(noise, turn * arm[2]), np.degrees(turn)])


# -- the model -----------------------------------------------------------------------------------------------


def beam(cells: tuple[int, int, int] = CELLS) -> Case:
    """Half the beam, y >= 0, of 27-node hexahedra."""
    n = 2 * np.array(cells) + 1
    index = np.stack(np.meshgrid(*(np.arange(k) for k in n), indexing="ij"), axis=-1).reshape(-1, 3)
    step = np.array([1, n[0], n[0] * n[1]])
    row = np.empty(len(index), np.int64)
    row[index @ step] = np.arange(len(index))
    local = np.stack(np.meshgrid(*[np.arange(3)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)[:, ::-1]
    first = np.stack(np.meshgrid(*(2 * np.arange(k) for k in cells), indexing="ij"), axis=-1).reshape(-1, 3)
    nodes = index / (n - 1.0) * [LENGTH, SIDE / 2, SIDE] - [0.0, 0.0, SIDE / 2]
    return Case(
        nodes=nodes, labels=np.arange(1, len(nodes) + 1),
        blocks=(Block("hex27", row[(first[:, None] + local) @ step]),),
        node_sets={"base": np.flatnonzero(index[:, 0] == 0), "middle": np.flatnonzero(index[:, 1] == 0)},
        element_sets={"beam": np.arange(len(first))}, surfaces={},
        materials={"beam": Material(0.05, density=DENSITY)},
        supports=(Support("middle", (1,)),), clamp=Clamp("base", (0.0, 0.0)),
    )  # fmt: skip


def predicted(case: Case, load: Array, values: dict[str, float]) -> Array:
    """What the tip does under each load (k, 3), as SEEN, for a C10 and the clamp's compliance."""
    assert case.clamp
    clamp = replace(case.clamp, compliance=values["clamp"])
    case = replace(case.with_material(C10=values["C10"]), clamp=clamp)
    time = np.arange(len(load), dtype=float)
    pulls = np.zeros((len(load), 1, 3))
    pulls[:, 0, 2] = -1e-6 * load * G
    down = np.array([0.0, 0.0, -G])
    found = solve(case, Path(time, 0 * time, time, gravity=down, places=ENDS[:1], pulls=pulls))
    if not found.converged:
        raise ValueError(found.reason)
    u = found.at(ENDS)
    edge = ENDS[1] - ENDS[2] + u[:, 1] - u[:, 2]
    return np.stack([-u[:, 0, 2], -u[:, 0, 0], np.degrees(np.arctan2(edge[:, 0], edge[:, 2]))], axis=1)


def fitted(
    data: Measured, case: Case, rows: list[int], parameters: tuple[Parameter, ...], *, clamp: float = 0.0
) -> Fit:
    """The fit of parameters to the loads of these rows; clamp: its compliance where that is not fitted."""

    def residual(theta: Array) -> Array:
        values = {CLAMP.name: clamp} | {p.name: float(x) for p, x in zip(parameters, theta, strict=True)}
        return ((data.value[rows] - predicted(case, data.load[rows], values)) / data.sd).ravel()

    def jacobian(theta: Array) -> Array:
        h = 1e-3 * np.array([p.high for p in parameters])
        return np.array([(residual(theta + d) - residual(theta)) / d.sum() for d in np.diag(h)]).T

    return least_squares(residual, jacobian, parameters, start=np.array([p.start for p in parameters], float))


# -- what is said --------------------------------------------------------------------------------------------


def one(data: Measured, case: Case, k: int) -> dict[str, Any]:
    """The fit to one load, and the others predicted by it: residuals in sds, with the fit's own error."""
    fit, others = fitted(data, case, [k], (SILICONE,)), [n for n in range(len(data.load)) if n != k]
    sd = float(np.sqrt(fit.covariance[0, 0]))
    at = [
        predicted(case, data.load[others], {"C10": float(fit.theta[0]) + d, "clamp": 0.0}) for d in (0.0, sd)
    ]
    error = np.hypot(data.sd, at[1] - at[0])
    residual = data.value[others] - at[0]
    return told(fit) | {
        "load_g": float(data.load[k]),
        "held_out_g": data.load[others].tolist(),
        "predicted": at[0].tolist(),
        "residual": residual.tolist(),
        "residual_sd": (residual / error).tolist(),
    }


def chance(fit: Fit) -> float:
    """The probability of a chi2 at least as large, by the F test: three holds tell the sd of each of SEEN."""
    free, known = len(FILES) * len(SEEN) - len(fit.theta), (len(FILES) - 1) * len(SEEN)
    return float(f_distribution.sf(fit.chi2 / free, free, known))


def told(fit: Fit) -> dict[str, Any]:
    """Constants with 1 sd, Young's modulus 6 C10 in MPa, and chi2."""
    sd = np.sqrt(np.diag(fit.covariance))
    values = {p.name: [float(x), float(s)] for p, x, s in zip(fit.parameters, fit.theta, sd, strict=True)}
    young = {"young_MPa": 6 * float(fit.theta[0]), "young_sd": 6 * float(sd[0])}
    return {"values": values, "chi2": fit.chi2} | young
