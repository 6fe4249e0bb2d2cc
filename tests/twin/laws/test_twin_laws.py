"""Every law of the silicone: its energy against the kernel's stress and tangent, its scale and its shape."""

import pickle

import numpy as np
import pytest

from fe import Material
from fe.element import Array
from tests.fe.lawpoints import stress, tangent
from twin.effects.library import all_effects, effect
from twin.effects.material import ADDED, Elasticity, Stiffening, StrainEnergy
from twin.laws.catalogue import LAWS, law_of, named_law
from twin.laws.law import Constants, RubberLaw
from twin.laws.mooneyrivlin import MOONEY_RIVLIN

EACH = pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
STEP = 1e-30  # of the complex step, whose error is its square


def places(seed: int) -> Array:
    return np.eye(3) + np.random.default_rng(seed).uniform(-0.25, 0.25, (6, 3, 3))


def felt(law: RubberLaw) -> Constants:
    """Constants at which every term counts."""
    return law.of({p.name: (p.start or 0.0) + 0.5 * p.step for p in law.parameters})


def energy(c: Constants, F: Array) -> Array:
    """W (n,) MPa of the law's own line at F (n, 3, 3), at constant volume; complex where F is."""
    C = np.swapaxes(F, 1, 2) @ F
    C = C / np.linalg.det(F)[:, None, None] ** (2 / 3)
    I1 = np.trace(C, axis1=1, axis2=2)
    I2 = (I1**2 - np.trace(C @ C, axis1=1, axis2=2)) / 2
    # of a complex C, which is real but for a complex step, by the general solver
    squares = np.linalg.eigvals(C) if np.iscomplexobj(C) else np.linalg.eigvalsh(C)
    return np.asarray(c.law.energy(c.named, I1, I2, np.sqrt(squares)))


@EACH
def test_the_kernels_stress_is_the_complex_derivative_of_the_laws_own_line(law: RubberLaw) -> None:
    c, F = felt(law), places(1)
    P, _, _ = stress(F, c.material)
    for i in range(3):
        for k in range(3):
            step = np.zeros((3, 3), complex)
            step[i, k] = 1j * 1e-12  # eigenvectors of the stretches keep it from being smaller
            slope = energy(c, F + step).imag / 1e-12
            np.testing.assert_allclose(slope, P[:, i, k], rtol=1e-6, atol=1e-8)  # MPa; roundings of eigenvalues


@EACH
def test_the_kernels_tangent_is_the_difference_of_its_stress(law: RubberLaw) -> None:
    m, F, h = felt(law).material, places(2), 1e-5
    A = tangent(F, m, np.zeros(len(F)), np.ones(len(F)))
    for i in range(3):
        for k in range(3):
            d = np.zeros((3, 3))
            d[i, k] = h
            seen = (stress(F + d, m)[0] - stress(F - d, m)[0]) / (2 * h)
            np.testing.assert_allclose(seen, A[:, :, :, i, k], atol=1e-7)  # h^2 times a third derivative


@EACH
def test_a_law_is_its_scale_and_its_shape(law: RubberLaw) -> None:
    c = felt(law)
    assert c.scale == pytest.approx(c.material.shear / 2, rel=1e-12)
    again = law.at(c.scale, c.shape)
    assert again.values == pytest.approx(c.values, rel=1e-12)
    stiffer = law.of({n: 3 * v if n in law.moduli else v for n, v in c.named.items()})
    assert stiffer.scale == pytest.approx(3 * c.scale, rel=1e-12)
    assert stiffer.shape == pytest.approx(c.shape, rel=1e-12)
    np.testing.assert_allclose(stiffer.material.constants, c.material.stiffened(3.0).constants, rtol=1e-12)
    assert len(c.shape) == len(law.shapes)


@EACH
def test_a_law_reads_its_constants_off_a_material_and_is_sent_to_other_processes(law: RubberLaw) -> None:
    c = felt(law)
    assert law.of(law.read(c.material)) == c
    assert law_of(c.material) == law
    assert pickle.loads(pickle.dumps(c)) == c
    assert named_law(law.name) is law


def test_mooney_rivlin_is_the_sum_and_the_share() -> None:
    c = MOONEY_RIVLIN.of({"C10": 0.21, "C01": 0.07})
    assert (c.scale, c.shape) == (0.21 + 0.07, (0.07 / (0.21 + 0.07),))
    assert MOONEY_RIVLIN.at(0.3, (0.25,)).values == (0.75 * 0.3, 0.25 * 0.3)
    assert MOONEY_RIVLIN.nominal.values == (0.2, 0.1)
    assert MOONEY_RIVLIN.at_rest == MOONEY_RIVLIN.moduli == ("C10", "C01")
    assert LAWS["yeoh"].at_rest == ("C10",)


def test_a_material_of_no_law_and_an_unknown_name() -> None:
    assert law_of(Material(C10=0.2, gent=(0.1, 3.0))) is None
    assert law_of(Material(C10=0.2, prony=((0.1, 1.0),), density=1e-9)) == LAWS["neo-hooke"]
    with pytest.raises(ValueError, match="law 'hooke': wanted one of neo-hooke, mooney-rivlin, yeoh"):
        named_law("hooke")


@EACH
def test_bounds_around_known_constants_hold_them(law: RubberLaw) -> None:
    nominal = law.nominal
    assert law.around(nominal) == law.bounds
    soft = law.of({n: 0.05 * v if n in law.moduli else 2 * v for n, v in nominal.named.items()})
    for name, (low, high) in law.around(soft).items():
        assert low <= soft[name] <= high
    Elasticity(law, bounds=law.around(soft), nominal=soft)


# -- effects beside a law ------------------------------------------------------------------------------------


def test_stiffening_adds_what_the_law_has_not() -> None:
    yeoh = LAWS["yeoh"]
    assert [p.name for p in Stiffening(2).parameters] == ["stiffening.C20", "stiffening.C30"]
    assert [p.name for p in Stiffening(2, yeoh).parameters] == ["stiffening.C11", "stiffening.C02"]
    assert Stiffening(1, yeoh).parameters[0].name == "stiffening.C11"
    for made in (effect("stiffening", law=yeoh), *(e for e in all_effects(yeoh) if e.name == "stiffening")):
        wider, wide = made.wider(), made.wide()
        assert isinstance(wider, Stiffening)
        assert isinstance(wide, StrainEnergy)
        assert wider.base == wide.base == yeoh
        assert made.sentence == wide.sentence == "the silicone stiffens or softens with strain, other than the Yeoh law says"
        assert "other than the Yeoh law says" in made.told({"stiffening.C11": 0.01})
    assert "other than the Mooney-Rivlin law says" in effect("stiffening").sentence


@EACH
def test_what_is_absent_leaves_the_law_as_it_is(law: RubberLaw, coarsest_case: object) -> None:
    from twin.contract.specimen import small_test

    test = Elasticity(law).before(small_test(), law.nominal.named)
    for e in (Stiffening(1, law), Stiffening(2, law), StrainEnergy(law)):
        own = e.before(test, {p.name: 0.0 for p in e.parameters}).case.materials
        for name, m in own.items():
            F = places(3)
            np.testing.assert_array_equal(stress(F, m)[0], stress(F, test.case.materials[name])[0])


@EACH
def test_no_added_term_changes_the_modulus_at_rest(law: RubberLaw) -> None:
    from twin.contract.specimen import small_test

    test = Elasticity(law).before(small_test(), law.nominal.named)
    wide = StrainEnergy(law)
    own = wide.before(test, {p.name: 0.01 for p in wide.parameters}).case.materials
    for name, m in own.items():
        assert m.shear == pytest.approx(test.case.materials[name].shear, rel=1e-12)
    assert {p.name.partition(".")[2] for p in wide.parameters} == set(ADDED) - set(law.names)
