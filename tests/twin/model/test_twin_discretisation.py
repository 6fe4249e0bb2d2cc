"""The stated discretisation modes against the error of the mesh, which a much finer one shows.

benchmarks/modes.py does the same over random constants and pressures on the default mesh.
"""

import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from fe import Case, Finger, Lattice, Material
from twin import virtual
from twin.model.building import base_model
from twin.model.discretisation import Discretisation, discretisation_error
from twin.model.prediction import Model
from twin.model.structure import of_finger
from twin.targets import Array, Targets

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
