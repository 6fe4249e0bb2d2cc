"""How a finger with weight sags at rest, by its model, for the outline that is seen then."""

from dataclasses import dataclass

import numpy as np

from fe import Path, solve
from twin.bench.fits import former_fit
from twin.bench.workbench import elasticity_of
from twin.gravity import G, under
from twin.laws.law import Constants
from twin.model.structure import Structure, in_law
from twin.project.folder import Project
from twin.targets import Array

UNSURE, MESH = 0.2, 0.03  # of the modulus: until it is calibrated; by the mesh
STEP = 1e-4  # MPa, for slopes
DEGREE = 5  # along the body, of polynomials that stand for the sag


@dataclass(frozen=True)
class RestSag:
    """Motion of a body under its weight, smooth along it."""

    length: float  # mm
    terms: Array  # (k,3)
    sd: float  # of its size, as a share

    def __call__(self, x: Array) -> Array:
        """Displacements (...,3) mm of places (...,3) mm of the body that is free of stress."""
        flat = x.reshape(-1, 3)
        return np.asarray((_columns(flat / self.length) @ self.terms).reshape(x.shape))

    @staticmethod
    def of(structure: Structure, gravity: Array, sd: float) -> "RestSag":
        """That of a structure with its constants, under a direction of gravity (3,). ValueError where it
        has no equilibrium."""
        time = np.array([0.0, 1.0])
        path = Path(time, np.zeros(2), time[:1], gravity=G * gravity / np.linalg.norm(gravity))
        solution = solve(under(structure.case, path), path)
        if not solution.converged:
            raise ValueError(f"the model does not carry its own weight: {solution.reason}")
        nodes = structure.case.nodes
        sag = solution.fields([0])[0][: len(nodes)]
        length = float(np.ptp(nodes[:, 0]))
        return RestSag(length, np.linalg.lstsq(_columns(nodes / length), sag, rcond=None)[0], sd)


def rest_sag(project: Project, structure: Structure) -> RestSag | None:
    """How a project's finger sags, by its calibrated constants, or those that it begins with; None without
    weight. ValueError where nobody states the direction of gravity."""
    model = project.config.model
    if model.density_kg_m3 is None:
        return None
    gravity = model.gravity or next((film.gravity for film in project.config.films if film.gravity), None)
    if gravity is None:
        raise ValueError(
            f"the finger sags (model.density_kg_m3 = {model.density_kg_m3:g}), and which way is not stated: "
            "add gravity = [0.0, 0.0, -1.0] under [model]"
        )
    constants, sd = _constants(project, structure)
    return RestSag.of(in_law(structure, constants), np.array(gravity), float(np.hypot(sd, MESH)))


def _constants(project: Project, structure: Structure) -> tuple[Constants, float]:
    """The constants of the silicone, and the sd of its modulus as a share of that."""
    elasticity = elasticity_of(project, structure.nominal)
    law, fixed = elasticity.law, project.config.model.fixed
    fit = former_fit(project, project.config.model.effects)
    nominal = {name: fixed.get(name, structure.nominal[name]) for name in law.names}
    if fit is None:
        return Constants(law, tuple(nominal.values())), 0.0 if len(fixed) == len(nominal) else UNSURE
    fitted = {name: row.value for name, row in fit.parameters.items() if name in nominal}
    values = {**nominal, **fitted}
    scale = law.split(values)[0]
    rows = [list(fit.parameters).index(name) for name in fitted]
    slope = np.array([law.split({**values, n: x + STEP})[0] - scale for n, x in fitted.items()]) / STEP
    variance = float(slope @ np.array(fit.covariance, float)[np.ix_(rows, rows)] @ slope)
    sd = np.sqrt(variance) / scale if np.isfinite(variance) else UNSURE
    return Constants(law, tuple(values.values())), min(float(sd), UNSURE)


def _columns(x: Array) -> Array:
    """Polynomials (n,k) at places (n,3) over the length: of degree DEGREE along, linear up."""
    along = x[:, :1] ** np.arange(DEGREE + 1)
    return np.asarray(np.hstack([along, along * x[:, 2:]]))
