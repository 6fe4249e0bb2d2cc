"""Families of thirds: as the effect itself where all are alike, each in its own part alone."""


import numpy as np
import pytest

from fe.case import Layer
from fe.kernel.layer import LayerFaces
from tests.few import few
from twin.contract.promises import check_effect
from twin.contract.specimen import small_test
from twin.effects.families import Parts, in_parts
from twin.effects.library import all_effects, effect
from twin.effects.protocol import Effect
from twin.effects.supports import StrainLimitingLayer
from twin.model.prediction import respond

PARTS = [wide for e in all_effects() if isinstance(wide := e.wide(), Parts)]
NEW = [*PARTS, effect("stiffening:wide"), effect("eccentric_core_y:wide")]


def test_thirds_are_the_families_of_effects_that_have_no_other() -> None:
    assert [w.label for w in PARTS] == ["gravity:wide", "strain_limiting_layer:wide", "compressibility:wide"]
    assert effect("compressibility:wide").start({"compressibility.excess": 0.1, "C10": 0.2}) == {
        "C10": 0.2, **{f"compressibility.excess{k}": 0.1 for k in (1, 2, 3)}
    }  # fmt: skip


@pytest.mark.parametrize("wide", PARTS, ids=lambda e: e.label)
def test_thirds_alike_are_the_effect_itself(wide: Parts) -> None:
    test, size = small_test(), wide.only.step
    one = wide.effect.before(test, {wide.only.name: size})
    thirds = wide.before(test, {p.name: size for p in wide.parameters})
    found, wanted = (respond(t, (), start=None)[0] for t in (thirds, one))
    assert np.abs(wanted - respond(test, (), start=None)[0]).max() > 1e-5
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-9)


def test_each_third_has_its_own_material_and_sheet() -> None:
    case = small_test().case
    (name,) = case.materials
    changed = in_parts([case.with_material(density=float(k)) for k in (1, 2, 3)])
    x = changed.nodes[changed.connectivity].mean(axis=1)[:, 0] / changed.nodes[:, 0].max()
    np.testing.assert_array_equal(changed.per_element("density"), np.floor(3 * x) + 1)
    assert in_parts([case, case, case]).materials == {name: case.materials[name]}
    sheets = StrainLimitingLayer().wide()
    assert sheets is not None
    stiff = sheets.before(small_test(), {f"strain_limiting_layer.stiffness{k}": k - 1.0 for k in (1, 2, 3)}).case
    assert stiff.layer is not None
    faces = stiff.face_nodes(stiff.layer.surface)
    middle = stiff.nodes[faces, 0].mean(axis=1) / stiff.nodes[:, 0].max()
    np.testing.assert_array_equal(stiff.layer.per_face(stiff), np.floor(3 * middle))


def test_a_sheet_in_parts_pulls_where_it_is_stiff() -> None:
    case = effect("strain_limiting_layer").before(small_test(), {"strain_limiting_layer.stiffness": 1.0}).case
    x = case.nodes * 1.05
    whole = LayerFaces(case, case.sheets[0]).force(x)
    thirds = [
        LayerFaces(case, Layer("strain_limiting_layer", tuple(row))).force(x) for row in np.eye(3)
    ]
    np.testing.assert_allclose(sum(thirds), whole, rtol=0, atol=1e-12)
    assert not thirds[0][case.nodes[:, 0] > 0.67 * case.nodes[:, 0].max()].any()


def test_terms_in_both_invariants_are_what_they_say() -> None:
    stretches = np.array([[1.3, 0.9], [0.7, 1.1], [1.6, 1.2]])
    l1, l2 = stretches.T
    every = np.stack([l1, l2, 1 / (l1 * l2)])
    x, y = (every**2).sum(axis=0) - 3, (every**-2.0).sum(axis=0) - 3
    test = small_test()
    (old,) = test.case.materials.values()
    theta = {"stiffening.C20": 0.02, "stiffening.C30": 0.003, "stiffening.C11": 0.01, "stiffening.C02": -0.004}
    (m,) = effect("stiffening:wide").before(test, theta).case.materials.values()
    energy = m.C10 * x + m.C01 * y + m.C20 * x**2 + m.C30 * x**3
    energy += sum(2 * mu / a**2 * ((every**a).sum(axis=0) - 3) for mu, a in m.ogden)
    wanted = old.C10 * x + old.C01 * y + 0.02 * x**2 + 0.003 * x**3 + 0.01 * x * y - 0.004 * y**2
    np.testing.assert_allclose(energy, wanted, rtol=1e-12)
    assert m.shear == pytest.approx(old.shear, rel=1e-12)


@pytest.mark.parametrize("wide", NEW, ids=lambda e: e.label)
def test_families_state_what_they_should(wide: Effect) -> None:
    assert check_effect(wide, solves=False) == ()


@pytest.mark.parametrize("wide", few(NEW, NEW[:2]), ids=lambda e: e.label)
def test_families_keep_the_promises_of_an_effect(wide: Effect) -> None:
    assert check_effect(wide) == ()
