"""The stated discretisation modes against the error of the mesh, which a much finer one shows.

benchmarks/modes.py does the same over random constants and pressures on the default mesh.
"""

import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fe import Case, Finger, Lattice, Material
from twin import virtual
from twin.effects.baselaw import Constants
from twin.effects.material import Elasticity
from twin.model.building import base_model
from twin.model.discretisation import Discretisation, discretisation_error
from twin.model.prediction import Model
from twin.model.structure import of_finger
from twin.stages import workbench
from twin.stages.workbench import Workbench
from twin.targets import Array, Noise, Targets

sys.path.append(str(Path(__file__).resolve().parents[3] / "benchmarks"))
import modes

THETA = np.array([0.26, 0.07])  # MPa, C10 and C01: other shares than the nominal ones
FILM = ((0.0, 0.0), (2.0, 0.0), (4.0, 27.0), (6.0, 27.0), (8.0, 0.0))  # s, kPa
BENCH = virtual.Bench(film_hz=2.0)


@dataclass(frozen=True)
class Draw:
    """A model, what a much finer mesh does at THETA, and the modes that the model states."""

    model: Model
    targets: Targets
    raw: Discretisation

    def row(self, changed: Array | None = None) -> modes.Row:
        """How the modes fare, or changed ones in their place."""
        raw = self.raw if changed is None else replace(self.raw, modes=changed)
        return modes.judged(self.model, self.targets, raw, theta=THETA, start=THETA)


@pytest.fixture(scope="module")
def draw(short: Finger, short_case: Case) -> Draw:
    points, nodes = modes.markers(short, short_case)
    course = virtual.path(BENCH, protocol=FILM)
    # of the other topology, and finer than the mesh that checks the modes
    lattice = Lattice(per_bellow=4, wall=2, across=2, up=2, centred=False)
    u, slope = virtual.displacements(virtual.Truth(Material(*THETA), lattice=lattice, finger=short), course, points)
    names = tuple(f"p{k}" for k in range(len(points)))
    film = virtual.noisy_targets(u, slope, course, points=virtual.at_nodes(names, nodes, points), bench=BENCH, seed=1)
    targets = modes.exact(film, u)
    model = base_model(targets, short_case)
    structure = of_finger(short, Lattice(per_bellow=2, ring=False, centred=False))
    return Draw(model, targets, discretisation_error(model, THETA, structure=structure))


def within(row: modes.Row) -> bool:
    """Whether the error is one that the modes state: every amplitude within 2 sd."""
    return max(abs(x) for x in (*row.modes, row.parameters, row.remainder)) < 2.0


def test_the_error_of_the_mesh_lies_within_its_modes(draw: Draw) -> None:
    found = draw.row()
    assert found.after_mm > 20 * BENCH.sd  # there is something to state
    assert within(found)
    assert found.left_sd < 0.25  # of the noise: it does not show in a test of fit
    assert found.chi2 < 0.1


@pytest.mark.parametrize("mutant", [lambda x: 0.5 * x, np.abs], ids=["halved", "without sign"])
def test_wrong_modes_do_not_hold_it(draw: Draw, mutant: Callable[[Array], Array]) -> None:
    assert not within(draw.row(mutant(draw.raw.modes)))


def test_finer_meshes_serve_for_constants_nearby_once_they_are_solved(
    short: Finger,
    make_targets: Callable[..., Targets],
    make_noise: Callable[..., Noise],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Constants at which they have no equilibrium must not serve for stiffer ones."""
    made: list[Constants] = []

    def solved(*_: object, made_for: Constants, **__: object) -> None:
        if made_for.total < 0.25:
            raise ValueError("no equilibrium")
        made.append(made_for)

    monkeypatch.setattr(workbench, "discretisation_error", solved)
    monkeypatch.setattr(workbench, "measured_remainder", lambda *_: None)
    structure = of_finger(short, Lattice(per_bellow=2, ring=False, centred=False))
    targets = make_targets(noise=make_noise(3, sd=0.01, rho=0.0, common=0.0))
    project: Any = SimpleNamespace(root=tmp_path)
    say: Any = None  # nothing is said
    bench = Workbench(project, targets, structure, Elasticity())
    with pytest.raises(ValueError, match="no equilibrium"):
        bench.mesh(np.array([0.2, 0.04]), bench.model(()), say)
    for C10 in (0.22, 0.2, 0.3, 0.5):  # the first has 1.08, 0.76 and 0.48 of the others' C10 + C01
        bench.mesh(np.array([C10, 0.04]), bench.model(()), say)
    assert made == [Constants(0.22, 0.04)] * 3 + [Constants(0.5, 0.04)]
