"""The structured mesh of the finger: valid cells, closed surfaces, the same geometry on every lattice."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from fe import Case, Finger, Lattice, Material, finger_case
from fe.element import HEX27, gauss
from fe.kernel.assembly import Geometry
from fe.mesh.finger import NAMED_NODES
from tests.fe.conftest import STUB

MATERIAL = Material(0.2, 0.1)
WHOLE = Finger()
LATTICES = [
    Lattice(),
    Lattice(ring=False),
    Lattice(refine=2),
    Lattice(ring=False, refine=2),
    Lattice(per_bellow=4, centred=False),
    Lattice(per_bellow=2, ring=False, centred=False),
]


@cache
def case_of(lattice: Lattice) -> Case:
    return finger_case(MATERIAL, lattice=lattice)


@cache
def volume(lattice: Lattice, finger: Finger = WHOLE) -> float:
    case = finger_case(MATERIAL, finger=finger, lattice=lattice)
    return float(Geometry(case.nodes, case.connectivity, case.element).weight.sum())


def enclosed(case: Case, surface: str) -> float:
    """One third of the flux of x through a surface, out of the material: its share of an enclosed volume."""
    weight, (N, dN) = HEX27.face_weights, HEX27.on_face(HEX27.face_points)
    x = case.nodes[case.face_nodes(surface)]
    s, t = (np.einsum("fai,qa->fqi", x, dN[:, :, d]) for d in range(2))
    return float(np.einsum("q,qa,fai,fqi->", weight, N, x, np.cross(s, t))) / 3


@pytest.mark.parametrize("lattice", LATTICES)
def test_every_cell_is_the_right_way_round(lattice: Lattice) -> None:
    case = case_of(lattice)
    weight = Geometry(case.nodes, case.connectivity, case.element).weight
    assert (weight > 0).all()
    relative = weight / weight.mean(axis=1, keepdims=True) / (gauss(3)[1] / 8 * 27)
    assert relative.min() > 0.05  # a cell is distorted, never nearly folded


@pytest.mark.parametrize("lattice", LATTICES)
def test_the_surface_is_closed(lattice: Lattice) -> None:
    # The symmetry plane y = 0 adds nothing to the flux of x; the chamber's normal points into the cavity.
    case = case_of(lattice)
    outside, chamber = enclosed(case, "outside"), -enclosed(case, "chamber")
    assert chamber > 0.2 * outside
    # both sides integrate the same quadratic faces exactly: rounding only
    assert outside - chamber == pytest.approx(volume(lattice), rel=1e-10)


def test_both_topologies_converge_to_one_volume() -> None:
    base = Lattice(per_bellow=4, centred=False)
    limit = volume(replace(base, refine=4), STUB)
    for ring in (False, True):
        off = [abs(volume(replace(base, refine=r, ring=ring), STUB) / limit - 1) for r in (1, 2, 3)]
        # quadratic cells: order 3 or more, seen until the limit's own error (4e-5 between the topologies)
        # shows
        assert off[0] < 5e-3
        assert off[1] < off[0] / 8
        assert off[2] < 1e-4


def test_refinement_keeps_the_nodes_of_the_coarse_mesh() -> None:
    # The geometry is a map of the lattice: twice as many cells hold every old cell corner at its place.
    coarse, fine = case_of(Lattice()), case_of(Lattice(refine=2))
    corners = coarse.nodes[np.unique(coarse.connectivity[:, [0, 2, 6, 8, 18, 20, 24, 26]])]
    keys = {tuple(k) for k in np.round(fine.nodes * 1e5).astype(int)}
    assert all(tuple(k) in keys for k in np.round(corners * 1e5).astype(int))


def test_inner_edges_have_their_radius() -> None:
    # Without pleats the edge along the chamber's floor is a cylinder about (y, z) = (w - side - r, bottom +
    # r).
    g = replace(Finger(), pleat=0.0, side_pleat=0.0)
    case = finger_case(MATERIAL, finger=g, lattice=Lattice(fillet=2))
    x, y, z = case.nodes[np.unique(case.face_nodes("chamber"))].T
    centre = g.width / 2 - g.side - g.radius, g.bottom + g.radius
    band = (y > centre[0] - 1e-9) & (z < centre[1] + 1e-9) & (x > 6) & (x < 100)
    assert band.sum() > 100
    # 4 fillet cells along the arc: the map is exact at nodes
    np.testing.assert_allclose(np.hypot(y[band] - centre[0], z[band] - centre[1]), g.radius, atol=1e-9)
    # at equal angles: 8 parts of the quarter circle
    angles = np.degrees(np.arctan2(centre[1] - z[band], y[band] - centre[0])) / (90 / 8)
    np.testing.assert_allclose(angles, np.round(angles), atol=1e-9)
    assert len(np.unique(np.round(angles))) == 9


def test_the_corners_of_the_chamber_are_spheres() -> None:
    g = replace(Finger(), pleat=0.0, side_pleat=0.0)
    case = finger_case(MATERIAL, finger=g, lattice=Lattice(fillet=2))
    p = case.nodes[np.unique(case.face_nodes("chamber"))]
    centre = np.array([g.base_cap + g.radius, g.width / 2 - g.side - g.radius, g.bottom + g.radius])
    sign = np.array([-1, 1, -1])
    corner = p[((p - centre) * sign > -1e-9).all(axis=1)]
    assert len(corner) > 10
    np.testing.assert_allclose(np.linalg.norm(corner - centre, axis=1), g.radius, atol=1e-9)


def test_walls_have_their_thickness() -> None:
    g, case = Finger(), case_of(Lattice())
    chamber = case.nodes[np.unique(case.face_nodes("chamber"))]
    assert chamber[:, 2].min() == pytest.approx(g.bottom)
    assert chamber[:, 0].min() == pytest.approx(g.base_cap)
    assert chamber[:, 0].max() == pytest.approx(g.length - g.tip_cap)
    low, high = case.nodes.min(0), case.nodes.max(0)
    np.testing.assert_allclose(low, [0, 0, 0], atol=1e-12)
    np.testing.assert_allclose(high[:2], [g.length, g.width / 2], atol=1e-12)
    assert high[2] == pytest.approx(
        g.height, abs=0.5
    )  # crests: half the wall, measured across, above its middle


@pytest.mark.parametrize("lattice", LATTICES)
def test_the_labels_of_the_study_sit_at_their_nodes(lattice: Lattice) -> None:
    case, g = case_of(lattice), Finger()
    assert len(np.unique(case.labels)) == len(case.nodes)
    np.testing.assert_allclose(case.position(NAMED_NODES["tip"]), g.tip_node, atol=1e-9)
    np.testing.assert_allclose(case.position(NAMED_NODES["middle"]), g.middle_node, atol=1e-9)
    for x in (g.tip_node, g.middle_node):  # on the flat lower edge of the side face
        assert x[1:] == (g.width / 2, 0.0)


def test_the_sets_lie_on_their_planes() -> None:
    case = case_of(Lattice())
    for name, axis, value in (("clamp", 0, 0.0), ("symmetry", 1, 0.0), ("tip_face", 0, Finger().length)):
        np.testing.assert_array_equal(
            case.node_sets[name], np.flatnonzero(np.abs(case.nodes[:, axis] - value) < 1e-9)
        )


def test_an_unknown_label_names_the_nearest() -> None:
    case = case_of(Lattice())
    sentence = "node 99999: not in the model, wanted one of its"
    with pytest.raises(ValueError, match=sentence) as caught:
        case.position(99999)
    named = [int(w) for w in re.search(r"nearest: ([\d, ]+)", str(caught.value)).group(1).split(",")]
    assert set(named) <= set(case.labels.tolist())
    assert max(case.labels) in named
