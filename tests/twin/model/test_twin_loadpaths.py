"""Displacements from the table of load paths against full finite elements, and where the table ends."""

from dataclasses import replace

import numpy as np
import pytest

from fe import Case, Finger, Lattice, Material, Path, solve
from tests.messages import saying
from twin.contract.specimen import COARSE, SMALL
from twin.laws.catalogue import LAWS
from twin.laws.mooneyrivlin import MOONEY_RIVLIN, mooney_rivlin
from twin.model.arraycache import no_cache
from twin.model.loadpaths import LoadPaths, load_paths, sheets
from twin.model.structure import base_case
from twin.targets import Array


@pytest.fixture(scope="module")
def case() -> Case:
    """The whole finger, coarse: its tip moves far, which is what the table must follow."""
    return base_case(lattice=Lattice(per_bellow=1, ring=False, centred=False))


@pytest.fixture(scope="module")
def points(case: Case) -> Array:
    return np.array([case.position(4401), case.position(5848)])


@pytest.fixture(scope="module")
def bellow() -> tuple[Case, Array]:
    """One bellow and its tip."""
    case = base_case(finger=SMALL, lattice=COARSE)
    return case, case.position(4401)[None]


@pytest.fixture(scope="module")
def paths(bellow: tuple[Case, Array]) -> LoadPaths:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("twin.model.loadpaths.LEVELS", 6)
        return load_paths(*bellow, cache=no_cache, key="k")


@pytest.mark.slow
def test_the_table_is_full_finite_elements_within_a_hundredth(case: Case, points: Array) -> None:
    rng, paths = np.random.default_rng(3), load_paths(case, points, cache=no_cache, key="k")
    moved = []
    for _ in range(6):
        C10, C01 = rng.uniform(0.05, 0.4), rng.uniform(0.0, 0.3)
        top = rng.uniform(0.05, 0.2) * (C10 + C01)
        pressure = top * np.array([0.0, 0.37, 1.0])
        full = solve(case.with_material(C10=C10, C01=C01), Path(pressure, pressure, pressure), count=6)
        assert full.converged
        quick = paths.predict(mooney_rivlin(C10, C01), pressure)
        assert quick is not None
        # mm: 0.01 of the 58 that the fine finger moves is what the table is held to; this one moves 4.5, so
        # that it gets as small a share. In between the full solve itself interpolates: the ends are compared.
        np.testing.assert_allclose(quick[[0, 2]], full.at(points)[[0, 2]], rtol=0, atol=8e-4)
        moved.append(np.abs(quick).max())
    assert max(moved) > 4.4  # mm


def test_of_negative_shares_a_table_from_0_knows_nothing(paths: LoadPaths) -> None:
    assert paths.predict(MOONEY_RIVLIN.at(0.29, (-0.05,)), np.array([0.0, 0.04])) is None
    assert paths.predict(MOONEY_RIVLIN.at(0.29, (-1e-6,)), np.array([0.0, 0.04])) is not None


@pytest.mark.slow
def test_negative_shares_have_a_table_of_their_own(case: Case, points: Array) -> None:
    wide = load_paths(case, points, cache=no_cache, key="k", wide=True)
    for share, allowed in ((-0.55, 4e-3), (-0.3, 1e-3), (0.4, 8e-4)):
        own, pressure = MOONEY_RIVLIN.at(0.29, (share,)), np.array([0.0, 0.04])
        full = solve(case.with_material(**own.named), Path(pressure, pressure, pressure), count=6)
        assert full.converged
        found = wide.predict(own, pressure)
        assert found is not None
        np.testing.assert_allclose(found, full.at(points), rtol=0, atol=allowed)
    assert wide.predict(MOONEY_RIVLIN.at(0.29, (-0.65,)), np.array([0.0, 0.04])) is None


def test_beyond_what_a_path_reached_there_is_no_prediction() -> None:
    reduced = np.linspace(0.0, 0.3, 7)
    u = np.tile(reduced[:, None, None] * np.ones((1, 1, 3)), (3, 1, 1, 1))
    table = LoadPaths((np.array([0.1, 0.5, 0.9]),), ((0.0, 1.0),), reduced, u, np.array([0.1, 0.2, 0.3]))
    assert table.predict(MOONEY_RIVLIN.at(0.3, (0.3,)), np.array([0.0, 0.3 * 0.149])) is not None  # 0.15 between two paths
    assert table.predict(MOONEY_RIVLIN.at(0.3, (0.3,)), np.array([0.0, 0.3 * 0.151])) is None
    found = table.predict(MOONEY_RIVLIN.at(0.2, (0.9,)), np.array([0.02]))
    assert found is not None
    np.testing.assert_allclose(found, 0.1, rtol=1e-9)  # linear in p / C, as made


def test_a_soft_share_ends_where_its_path_did(paths: LoadPaths) -> None:
    assert (paths.reached > 0.05).all()
    top = float(paths.reached.min())
    assert paths.predict(MOONEY_RIVLIN.at(0.3, (float(paths.nodes[0][0]),)), np.array([0.3 * 1.01 * paths.reached[0]])) is None
    found = paths.predict(MOONEY_RIVLIN.at(0.3, (float(paths.nodes[0][0]),)), np.array([0.3 * 0.9 * top]))
    assert found is not None
    assert np.isfinite(found).all()


def test_of_two_materials_the_table_holds_the_total_as_well(short: Finger, monkeypatch: pytest.MonkeyPatch) -> None:
    law = replace(MOONEY_RIVLIN, shapes=(replace(MOONEY_RIVLIN.shapes[0], count=3),))
    for name, value in (("SCALES", 4), ("LEVELS", 6)):
        monkeypatch.setattr(f"twin.model.loadpaths.{name}", value)  # quick, and still within the tolerance
    case = base_case(finger=short, lattice=Lattice(per_bellow=1, ring=False, centred=False))
    low = np.flatnonzero(case.nodes[case.connectivity][..., 2].max(axis=1) < 3)
    sets = {"body": np.setdiff1d(case.element_sets["body"], low), "sole": low}
    stiff = Material(C10=1.0)
    case = replace(case, element_sets=sets, materials={**case.materials, "sole": stiff}, kept=("sole",))
    points = case.position(4401)[None]
    table = sheets(case, points, law, cache=no_cache, key="s", top=0.2, scales=(0.1, 0.5))
    for total, share in ((0.15, 0.2), (0.33, 0.6)):
        pressure = np.array([0.0, 0.1, 0.2]) * total
        full = solve(case.with_material(**MOONEY_RIVLIN.at(total, (share,)).named), Path(pressure, pressure, pressure), count=6)
        quick = table.predict(MOONEY_RIVLIN.at(total, (share,)), pressure)
        assert quick is not None
        u = full.at(points)
        np.testing.assert_allclose(quick[[0, 2]], u[[0, 2]], rtol=0, atol=2e-3 * np.abs(u).max())
        # one total for all would be wrong: the sole does not soften with the silicone
        other = table.paths[0].predict(MOONEY_RIVLIN.at(total, (share,)), pressure)
        assert other is not None
        assert np.abs(other[2] - u[2]).max() > 0.02 * np.abs(u).max()
    assert table.predict(MOONEY_RIVLIN.at(0.3, (0.3,)), np.array([0.3 * 0.21])) is None


def test_the_same_constants_give_the_same_bits_every_time() -> None:
    """Without it a killed calibration would end beside the one that was not killed."""
    rng = np.random.default_rng(5)
    reduced = np.linspace(0.0, 0.3, 7)
    shares = 0.5 - 0.5 * np.cos(np.pi * (np.arange(5) + 0.5) / 5)
    table = LoadPaths((shares,), ((0.0, 1.0),), reduced, rng.normal(size=(5, 7, 2, 3)), np.full(5, 0.3))
    found = {np.asarray(table.predict(MOONEY_RIVLIN.at(0.3, (0.37,)), np.array([0.02, 0.05]))).tobytes() for _ in range(30)}
    assert len(found) == 1


def test_a_law_of_more_shapes_than_two_has_paths_of_one_shape_alone(bellow: tuple[Case, Array]) -> None:
    law, (case, points) = LAWS["ogden2"], bellow
    with pytest.raises(ValueError, match=saying("'ogden2'", "3", "2")):
        load_paths(case, points, law, cache=no_cache, key="k", top=0.1)
    own = law.nominal
    table = load_paths(case, points, law, cache=no_cache, key="k", top=0.1, held=own.shape)
    assert len(table.u) == 1
    stiffer = law.at(2 * own.scale, own.shape)
    pressure = np.array([0.0, 0.05 * stiffer.scale])
    full = solve(case.with_material(**stiffer.terms), Path(pressure, pressure, pressure), count=6)
    found = table.predict(stiffer, pressure)
    assert found is not None
    np.testing.assert_allclose(found, full.at(points), rtol=0, atol=8e-4)  # mm, as of the whole table


@pytest.mark.slow
@pytest.mark.parametrize("name", ["neo-hooke", "yeoh", "gent", "arruda-boyce", "ogden1"])
def test_the_paths_of_every_law_are_full_finite_elements(case: Case, points: Array, name: str) -> None:
    law, rng = LAWS[name], np.random.default_rng(5)
    table = load_paths(case, points, law, cache=no_cache, key="k", top=0.2)
    assert len(table.u) == int(np.prod([shape.count for shape in law.shapes]))
    for _ in range(4):
        shape = tuple(float(rng.uniform(s.low, s.high)) for s in law.shapes)
        own = law.at(float(rng.uniform(0.1, 0.5)), shape)
        pressure = 0.12 * own.scale * np.array([0.0, 0.37, 1.0])
        full = solve(case.with_material(**own.terms), Path(pressure, pressure, pressure), count=6)
        quick = table.predict(own, pressure)
        assert full.converged
        assert quick is not None
        # mm of 3: polynomials of three to five nodes, and what least squares with whole solves mend
        np.testing.assert_allclose(quick[[0, 2]], full.at(points)[[0, 2]], rtol=0, atol=6e-3)
