"""`self_contact` of twin.toml: the structure whose walls may touch each other, and who cannot solve it."""

import pytest

from fe import Finger, Lattice
from fe.mesh.inner import SKIN
from fe.solver.newton import Problem
from tests.messages import saying
from twin.model.structure import closed, of_finger, weighed
from twin.project.config import ModelTable


def test_walls_of_a_closed_structure_may_touch_on_every_mesh() -> None:
    open_one = of_finger(Finger(), Lattice(per_bellow=1, ring=False, centred=False))
    structure = closed(open_one)
    assert not open_one.case.self_contact
    assert [(c.first, c.second) for c in structure.case.self_contact] == [(SKIN, SKIN), ("chamber", "chamber")]
    assert structure.key != open_one.key  # what is kept of the one is not taken for the other
    assert {m.key for m in structure.finer.values()}.isdisjoint(m.key for m in open_one.finer.values())
    assert structure.base.build().self_contact
    assert weighed(structure, 1e-9).case.self_contact
    # load paths over pressure over the moduli hold
    assert structure.scales
    assert Problem.of(structure.case).proportional


def test_only_the_embedded_engine_finds_what_meets() -> None:
    assert ModelTable(self_contact=True).self_contact
    with pytest.raises(ValueError, match=saying("self_contact = true", "engine = 'calculix'")):
        ModelTable(self_contact=True, engine="calculix")
