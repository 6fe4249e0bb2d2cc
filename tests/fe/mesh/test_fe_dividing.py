"""The mesh follows from a finger's dimensions; the nearest place on its surface."""

from dataclasses import replace

import numpy as np
import pytest

from fe import Finger, Lattice, Material, finger_case
from fe.element import ELEMENTS, HEX27
from fe.kernel.assembly import Geometry
from fe.mesh.convert import converted
from fe.mesh.finger import CELLS, lattice_of, marked
from fe.mesh.points import nearest_on_faces
from tests.fe.conftest import STUB

MATERIAL = Material(0.2, 0.1)


def test_the_default_finger_has_the_default_lattice() -> None:
    assert lattice_of(Finger()) == Lattice()


@pytest.mark.parametrize(
    ("change", "finer"),
    [
        ({"bellows": 4}, "per_bellow"),
        ({"top": 1.0, "pleat": 3.8}, "per_bellow"),
        ({"flatness": 1.2}, "per_bellow"),
        ({"side_pleat": 1.0}, "per_bellow"),
        ({"pleat": 1.0}, "across"),
        ({"width": 40.0}, "across"),
        ({"side": 3.5}, "wall"),
        ({"bottom": 5.0}, "wall"),
    ],
)
def test_what_makes_the_default_too_coarse_gets_more_cells(change: dict[str, float], finer: str) -> None:
    lattice = lattice_of(replace(Finger(), **change))  # type: ignore[arg-type]
    assert getattr(lattice, finer) > getattr(Lattice(), finer)
    others = [name for name in ("per_bellow", "across", "wall") if name != finer]
    assert [getattr(lattice, name) for name in others] == [getattr(Lattice(), name) for name in others]


def test_pleats_that_fall_off_to_the_sides_get_finer_fillets() -> None:
    assert lattice_of(replace(Finger(), side_pleat=1.0)).fillet == Lattice().fillet + 1


def test_the_lattice_knows_no_unit() -> None:
    g = replace(Finger(), bellows=4, side=3.0, flatness=1.2)
    lengths = ("length", "width", "height", "side", "bottom", "top", "base_cap", "tip_cap", "pleat", "side_pleat", "radius")
    twice = replace(g, **{name: 2 * getattr(g, name) for name in lengths})
    assert lattice_of(twice) == lattice_of(g)


def test_a_short_finger_gets_more_cells_everywhere() -> None:
    lattice = lattice_of(replace(Finger(), length=10 + 100 / 3, bellows=3))
    assert (lattice.across, lattice.up, lattice.caps, lattice.wall) == (2, 2, 2, 2)


def test_cells_along_the_chamber_are_bounded() -> None:
    long = replace(Finger(), length=400.0, bellows=9)
    assert lattice_of(long).per_bellow * 9 <= CELLS


def test_a_flat_profile_is_flat_at_crests_and_valleys_and_as_deep() -> None:
    phase, k = np.linspace(0, 2 * np.pi, 4001), 1.2
    round_, flat = Finger().wave(phase), replace(Finger(), flatness=k).wave(phase)
    assert (flat[0].max(), flat[0].min()) == (pytest.approx(1.0), pytest.approx(-1.0))
    # more of it near the ends, and steeper between: k / tanh(k) times
    assert (np.abs(flat[0]) > 0.9).mean() > 1.2 * (np.abs(round_[0]) > 0.9).mean()
    assert np.abs(flat[1]).max() == pytest.approx(k / np.tanh(k), rel=1e-4)
    for value, slope in (round_, flat):  # the slope is the value's: differences of second order
        np.testing.assert_allclose(np.gradient(value, phase)[1:-1], slope[1:-1], atol=1e-5)


def test_a_flat_profile_meshes() -> None:
    finger = marked(replace(STUB, flatness=1.2))
    case = finger_case(MATERIAL, finger=finger, lattice=lattice_of(finger))
    assert (Geometry(case.nodes, case.connectivity, case.element).weight > 0).all()


@pytest.mark.parametrize("kind", ["hex27", "C3D20", "C3D10"])
def test_the_nearest_place_on_the_surface(kind: str) -> None:
    case = finger_case(MATERIAL, finger=STUB, lattice=Lattice(per_bellow=2, ring=False, centred=False))
    case = case if kind == "hex27" else converted(case, kind)
    element = HEX27 if kind == "hex27" else ELEMENTS[kind]
    faces, w = case.nodes[case.face_nodes("outside")], STUB.width / 2
    for x, wanted in (
        ((STUB.length + 2, w + 1, -1.0), (STUB.length, w, 0.0)),  # beyond a corner
        ((STUB.length / 2, 3.0, -0.7), (STUB.length / 2, 3.0, 0.0)),  # below the flat bottom
        ((STUB.length / 2, 3.0, 0.4), (STUB.length / 2, 3.0, 0.0)),  # inside the bottom wall
        ((-1.0, 2.0, 4.0), (0.0, 2.0, 4.0)),
    ):
        np.testing.assert_allclose(nearest_on_faces(element, faces, np.array(x)), wanted, atol=1e-8)


def test_no_place_on_the_surface_is_nearer() -> None:
    # On the curved pleats: against 25 x 25 places on every face, which can only be farther.
    case = finger_case(MATERIAL, finger=STUB, lattice=Lattice(per_bellow=4, centred=False))
    faces = case.nodes[case.face_nodes("outside")]
    grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, 25)] * 2), axis=-1).reshape(-1, 2)
    places = np.einsum("km,fmi->fki", HEX27.on_face(grid)[0], faces).reshape(-1, 3)
    rng = np.random.default_rng(3)
    low, high = case.nodes.min(axis=0), case.nodes.max(axis=0)
    for x in rng.uniform(low - 3, high + 3, (12, 3)):
        sampled = np.linalg.norm(places - x, axis=1).min()
        found = np.linalg.norm(nearest_on_faces(HEX27, faces, x) - x)
        assert sampled - 0.2 < found <= sampled + 1e-9  # 0.2 mm: cells of 4 mm, samples 0.17 mm apart
