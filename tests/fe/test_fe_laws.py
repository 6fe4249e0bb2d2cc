"""Every law: stress and tangent against differences of the energy, and the curves of real rubbers."""

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares

from fe import Material
from fe.element import Array
from fe.material import scaled
from tests.fe.lawpoints import energy, nominal_stress, stress, tangent

LAWS = {
    "neo-Hooke": Material(C10=0.2),
    "Mooney-Rivlin": Material(C10=0.2, C01=0.15),
    "Yeoh": Material(C10=0.2, C20=-0.02, C30=0.01),
    "Gent": Material(gent=(0.4, 3.0)),
    "Arruda-Boyce": Material(chains=(0.4, 1.5)),
    "Ogden": Material(ogden=((0.3, 1.8), (0.02, 6.0), (-0.05, -2.0))),
    "all terms": Material(0.2, 0.1, 0.05, C30=0.01, gent=(0.3, 4.0), ogden=((0.1, 3.0),), chains=(0.1, 2.0)),
}
EACH = pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)


def deformed(seed: int) -> Array:
    return np.eye(3) + np.random.default_rng(seed).uniform(-0.25, 0.25, (5, 3, 3))


def formula(F: Array, m: Material) -> Array:
    """The energy as `fe.material` states it, written out once more."""
    J = np.linalg.det(F)
    C = np.swapaxes(F, -1, -2) @ F * J[..., None, None] ** (-2 / 3)
    x = np.trace(C, axis1=-2, axis2=-1) - 3
    I2 = ((x + 3) ** 2 - np.trace(C @ C, axis1=-2, axis2=-1)) / 2
    W = m.C10 * x + m.C01 * (I2 - 3) + m.C20 * x**2 + m.C30 * x**3
    if m.gent:
        mu, limit = m.gent
        W = W + (mu / 2 * x if np.isinf(limit) else -mu * limit / 2 * np.log1p(-x / limit))
    if m.chains:
        mu, lock = m.chains
        series = (1 / 2, 1 / 20, 11 / 1050, 19 / 7000, 519 / 673750)
        W = W + mu * sum(a / lock ** (2 * i) * ((x + 3) ** (i + 1) - 3 ** (i + 1)) for i, a in enumerate(series))
    for mu, alpha in m.ogden:
        W = W + 2 * mu / alpha**2 * ((np.linalg.eigvalsh(C) ** (alpha / 2)).sum(-1) - 3)
    return np.asarray(W, float)


@EACH
def test_the_energy_is_its_formula(law: Material) -> None:
    F = deformed(4)
    np.testing.assert_allclose(energy(F, law), formula(F, law), rtol=1e-12, atol=1e-14)


@EACH
def test_the_stress_is_the_gradient_of_the_energy(law: Material) -> None:
    F, h = deformed(5), 1e-5
    P, a, J = stress(F, law)
    np.testing.assert_allclose(np.swapaxes(a, -1, -2) @ F, np.broadcast_to(np.eye(3), F.shape), atol=1e-13)
    np.testing.assert_allclose(J, np.linalg.det(F), rtol=1e-13)
    for i in range(3):
        for k in range(3):
            d = np.zeros((3, 3))
            d[i, k] = h
            # error h^2 times a third derivative of order 10
            change = (energy(F + d, law) - energy(F - d, law)) / (2 * h)
            np.testing.assert_allclose(change, P[:, i, k], atol=1e-8)


@EACH
@pytest.mark.parametrize("equal", [False, True])
def test_the_tangent_is_the_gradient_of_the_stress(law: Material, equal: bool) -> None:
    rng, h = np.random.default_rng(6), 1e-5
    F = deformed(6)
    if equal:  # two equal stretches, and three
        F[0], F[1] = np.diag([1.3, 1.3, 0.6]), np.eye(3)
    q, scale = rng.uniform(-1, 1, 5), rng.uniform(0.5, 1, 5)

    def total(F: Array) -> Array:
        P, a, J = stress(F, law)
        return scale[:, None, None] * P + (q * J)[:, None, None] * a

    A = tangent(F, law, q, scale)
    for i in range(3):
        for k in range(3):
            d = np.zeros((3, 3))
            d[i, k] = h
            np.testing.assert_allclose((total(F + d) - total(F - d)) / (2 * h), A[:, :, :, i, k], atol=1e-7)


@EACH
def test_the_shear_modulus_is_the_slope_at_rest(law: Material) -> None:
    h = 1e-4
    F = np.array([[[1, h, 0], [0, 1, 0], [0, 0, 1]]])
    assert stress(F, law)[0][0, 0, 1] / h == pytest.approx(law.shear, rel=1e-6)
    assert nominal_stress(law, np.array([1 + h]), "uniaxial")[0] / h == pytest.approx(3 * law.shear, rel=1e-3)


def test_one_law_is_another_in_its_special_case() -> None:
    F = deformed(7)
    two = Material(ogden=((0.4, 2.0),))
    np.testing.assert_allclose(stress(F, two)[0], stress(F, LAWS["neo-Hooke"])[0], atol=1e-13)
    minus = Material(C10=0.2, ogden=((0.3, -2.0),))
    np.testing.assert_allclose(stress(F, minus)[0], stress(F, LAWS["Mooney-Rivlin"])[0], atol=1e-13)
    for far in (Material(gent=(0.4, 1e9)), Material(chains=(0.4, 1e5))):
        np.testing.assert_allclose(stress(F, far)[0], stress(F, LAWS["neo-Hooke"])[0], rtol=1e-8, atol=1e-9)


# Every field of a material, with something in it, and what of it times a factor stiffens the material by that.
STIFFENED: dict[str, tuple[Any, Any]] = {
    "C10": (0.2, 0.6),
    "C01": (0.1, 0.3),
    "C20": (0.05, 0.15),
    "C30": (0.01, 0.03),
    "gent": ((0.3, 4.0), (0.9, 4.0)),
    "chains": ((0.3, 2.0), (0.9, 2.0)),
    "ogden": (((0.1, 3.0), (0.02, -2.0)), ((0.3, 3.0), (0.06, -2.0))),
    "mullins": ((0.4, 0.002, 0.5), (0.4, 0.006, 0.5)),  # its m is compared with energies
    "bulk_ratio": (500.0, 500.0),
    "prony": (((0.1, 2.0),), ((0.1, 2.0),)),
    "density": (1e-9, 1e-9),
}


@pytest.mark.parametrize("name", [field.name for field in fields(Material)])
def test_a_stiffened_material_is_stiffer_in_every_term(name: str) -> None:
    value, wanted = STIFFENED[name]  # a new field says here what becomes of it
    plain = Material(**{"C10": 0.2, name: value})
    stiff, F = plain.stiffened(3.0), deformed(11)
    np.testing.assert_allclose(getattr(stiff, name), wanted, rtol=1e-12)
    np.testing.assert_allclose(energy(F, stiff), 3 * energy(F, plain), rtol=1e-12)
    np.testing.assert_allclose(stress(F, stiff)[0], 3 * stress(F, plain)[0], rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(stiff.constants, scaled(plain.constants[None], 3.0)[0], rtol=1e-12)
    assert (stiff.shear, stiff.bulk) == pytest.approx((3 * plain.shear, 3 * plain.bulk))


def test_beyond_the_limit_of_gent_there_is_no_stress() -> None:
    F = np.diag([2.5, 2.5**-0.5, 2.5**-0.5])[None]  # I1 - 3 = 4.05
    assert np.isnan(stress(F, replace(LAWS["Gent"], gent=(0.4, 4.0)))[0]).all()
    assert np.isfinite(stress(F, replace(LAWS["Gent"], gent=(0.4, 4.1)))[0]).all()


def curves(source: str, h5py: Any, data: Any) -> dict[str, tuple[Array, Array]]:
    """Stretch and nominal stress (k,) MPa of the uniaxial, equibiaxial and planar tests of one source."""
    with h5py.File(data / "hyperelastic" / "data.h5") as file:
        return {
            mode: (np.array(file[source][key]["stretch"]), np.array(file[source][key]["stress"])[:, 0, 0])
            for mode, key in (("uniaxial", "UT"), ("equibiaxial", "ET"), ("planar", "PS"))
        }


def misfit(law: Material, tests: dict[str, tuple[Array, Array]], modes: Sequence[str]) -> Array:
    """Residuals, measured minus predicted, MPa."""
    return np.concatenate([tests[m][1] - nominal_stress(law, tests[m][0], m) for m in modes])


def rms(x: Array) -> float:
    return float(np.sqrt((x**2).mean()))


def test_ogdens_constants_of_treloars_rubber(shared_data: Any) -> None:
    h5py = pytest.importorskip("h5py")
    tests = curves("Treloar_1944", h5py, shared_data)
    # Ogden 1972, doi 10.1098/rspa.1972.0026, in his form sum mu / alpha (l^alpha ..): mu alpha / 2 in Abaqus's
    published = [(0.63, 1.3), (0.0012, 5.0), (-0.01, -2.0)]
    law = Material(ogden=tuple((mu * alpha / 2, alpha) for mu, alpha in published))
    assert law.shear == pytest.approx(0.4225)
    every = tuple(tests)
    largest = max(np.abs(stress).max() for _, stress in tests.values())
    assert rms(misfit(law, tests, every)) < 0.05 * largest

    def residual(x: Array) -> Array:
        return misfit(Material(ogden=tuple(zip(x[:3], x[3:]))), tests, every)

    start = np.array([*(mu for mu, _ in law.ogden), *(alpha for _, alpha in law.ogden)])
    found = least_squares(residual, start, x_scale=np.abs(start))
    assert rms(found.fun) < rms(residual(start))


def test_one_kind_of_test_does_not_tell_mooney_rivlin(shared_data: Any) -> None:
    h5py = pytest.importorskip("h5py")
    tests = curves("Meunier_2008", h5py, shared_data)

    def fit(modes: Sequence[str]) -> Material:
        x = least_squares(lambda x: misfit(Material(*x), tests, modes), [0.1, 0.05]).x
        return Material(*x)

    stretch, stress = tests["uniaxial"]
    joint = fit(list(tests))
    tests["uniaxial"] = stretch[stretch >= 1], stress[stretch >= 1]  # tension alone
    alone = fit(["uniaxial"])
    # measured: 0.085 MPa, and the constants of tension alone are no use for a bubble
    assert rms(misfit(joint, tests, ["equibiaxial"])) == pytest.approx(0.085, abs=0.002)
    assert rms(misfit(alone, tests, ["uniaxial"])) < rms(misfit(joint, tests, ["uniaxial"]))
    assert rms(misfit(alone, tests, ["equibiaxial"])) > 10 * rms(misfit(joint, tests, ["equibiaxial"]))


@pytest.mark.parametrize("stretch", [1.2, 1.63, 2.0])
def test_mooney_rivlin_is_stable_where_C10_outweighs_the_square_of_the_stretch_times_C01(stretch: float) -> None:
    share = -1 / (stretch**2 - 1)
    assert Material(C10=1 - share, C01=share).steadiness(stretch) == pytest.approx(0.0, abs=1e-12)
    assert Material(C10=0.2).steadiness(stretch) == pytest.approx(1.0)


def test_stability_is_that_of_the_principal_stresses() -> None:
    law = Material(C10=0.1, C01=0.05, C20=-0.01, C30=0.004, ogden=((0.05, -3.0), (0.02, 5.0)))
    least = np.inf
    for powers in ((1, -0.5, -0.5), (1, 0, -1), (1, 1, -2)):
        for stretch in np.geomspace(1.0, 1.5, 16)[1:]:
            l = stretch ** np.array(powers)  # noqa: E741
            h = 1e-5

            def energy(l: np.ndarray) -> float:  # noqa: E741
                x, y = (l**2).sum() - 3, (l**-2.0).sum() - 3
                own = 0.1 * x + 0.05 * y - 0.01 * x**2 + 0.004 * x**3
                return float(own + sum(2 * mu / a**2 * (l**a).sum() for mu, a in law.ogden))

            t = [(energy(l * np.exp(h * e)) - energy(l * np.exp(-h * e))) / (2 * h) for e in np.eye(3)]
            pairs = [(i, j) for i, j in ((0, 1), (1, 2), (0, 2)) if abs(l[i] - l[j]) > 1e-9]
            least = min(least, *((t[i] - t[j]) / (l[i] ** 2 - l[j] ** 2) for i, j in pairs))
    assert law.steadiness(1.5) == pytest.approx(least / law.shear, rel=1e-6)


def test_gent_is_stable_as_far_as_its_limit_lets_it_stretch() -> None:
    assert Material(gent=(0.5, 0.4)).steadiness(1.63) >= 1.0
    assert Material(C10=-0.1).steadiness(1.63) == -np.inf
