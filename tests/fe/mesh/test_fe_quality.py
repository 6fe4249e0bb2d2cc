"""The shape of elements: known cubes and a known distortion, and every kind of element."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path as File

import numpy as np
import pytest

from fe.deck.reader import read_deck
from fe.mesh.elementshapes import quality

Tube = Callable[..., File]
BOX = """*Node
1, 0., 0., 0.
2, {x}, 0., 0.
3, {x}, 2., 0.
4, 0., 2., 0.
5, {shear}, 0., 2.
6, {over}, 0., 2.
7, {over}, 2., 2.
8, {shear}, 2., 2.
*Element, type=C3D8, elset=All
7, 1, 2, 3, 4, 5, 6, 7, 8
*Solid section, elset=All, material=M
,
*Material, name=M
*Hyperelastic, neo hooke
0.2, 0.01
"""


def box(folder: File, *, x: float = 2.0, shear: float = 0.0) -> dict[str, float]:
    """The measures of one hexahedron x mm long and sheared by `shear` mm over its height of 2 mm."""
    deck = folder / "box.inp"
    deck.write_text(BOX.format(x=x, shear=shear, over=x + shear))
    return {m.name: float(m.values[0]) for m in quality(read_deck(deck).case)}


def test_a_cube_is_perfect(tmp_path: File) -> None:
    found = box(tmp_path)
    assert list(found.values()) == pytest.approx([1.0, 1.0, 90.0, 90.0], abs=1e-9)


def test_a_long_and_a_sheared_box(tmp_path: File) -> None:
    assert box(tmp_path, x=24.0)["longest over shortest edge"] == pytest.approx(12.0)
    sheared = box(tmp_path, shear=2.0)  # by 45 degrees
    assert sheared["smallest angle"] == pytest.approx(45.0)
    assert sheared["largest angle"] == pytest.approx(135.0)
    assert sheared["Jacobian, smallest over largest"] == pytest.approx(1.0)  # a parallelepiped


@pytest.mark.parametrize("kind", ["C3D8H", "C3D10H", "C3D20RH"])
def test_every_kind_of_element_is_measured(tube_deck: Tube, tmp_path: File, kind: str) -> None:
    case = read_deck(tube_deck(tmp_path, kind, cells=5)).case
    measures = {m.name: m for m in quality(case)}
    jacobian = measures["Jacobian, smallest over largest"]
    assert 0.5 < jacobian.values.min() <= jacobian.values.max() <= 1.0 + 1e-12
    edges = measures["longest over shortest edge"]
    assert edges.values[edges.worst] == edges.values.max() > 10  # cells of 10.25 x 1 mm
    assert edges.poor[0] == edges.worst
    assert len(edges.poor) == int((edges.values > 10).sum()) > 0
    moved = case.nodes.copy()
    node = case.connectivity[0, 0]
    moved[node] += 0.6 * (case.nodes[case.connectivity[0]].mean(axis=0) - moved[node])
    worse = {m.name: m for m in quality(replace(case, nodes=moved))}[jacobian.name]
    assert worse.values[0] < 0.7 * jacobian.values[0]
    assert np.array_equal(worse.values[-1:], jacobian.values[-1:])  # far away nothing changes
